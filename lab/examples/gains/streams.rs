//! Knowledge of other states: what it is worth in one that was not met, and how fast it fades where it
//! misleads.

use treewright_core::configuration::Configuration;
use treewright_core::policy::Policy;
use treewright_core::space::Space;

use crate::problem::Problem;
use crate::states::{Study, problem};
use crate::summary;

const BEFORE: u64 = 7;
/// The state that counts beside others that want the opposite.
const COUNTS: u64 = 9;
const TRIALS: usize = 60;
const MARKS: [usize; 5] = [1, 8, 16, 32, 60];

fn policy() -> Policy {
    Policy { epsilon: 1.0, trials_per_state: TRIALS as u32, ..Policy::default() }
}

/// The configuration that costs least on average over some states, of those that can be run in all of them
/// and in the one that counts.
fn best_fixed<'a>(
    tried: &'a [Configuration],
    others: &[Problem],
    counts: &Problem,
) -> Option<&'a Configuration> {
    let mean = |configuration: &&Configuration| -> Option<f64> {
        (counts.truth)(configuration)?;
        others.iter().map(|other| (other.truth)(configuration).map(f64::ln)).sum()
    };
    let costs = tried.iter().filter_map(|configuration| Some((mean(&configuration)?, configuration)));
    costs.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, configuration)| configuration)
}

/// The true cost of what would be exploited after each of the marks; after the first, of what was answered.
fn explore(study: &mut Study, number: u64, problem: &Problem) -> Vec<f64> {
    let mut costs = Vec::new();
    for count in 1..=TRIALS {
        let trial = study.frame("a", number, &problem.truth, problem.noise);
        if MARKS.contains(&count) {
            let best = if count == 1 { Some(trial.configuration) } else { study.best(number) };
            // What cannot be run counts as ten times the optimum.
            let cost = best.and_then(|best| (problem.truth)(&best));
            costs.push(cost.unwrap_or(10.0 * problem.optimum));
        }
    }
    costs
}

/// A state that was not met, after seven that were.
pub(crate) fn unmet(kind: &str, seeds: u64) {
    let (mut over, mut share) = (vec![Vec::new(); MARKS.len()], vec![Vec::new(); MARKS.len()]);
    let (mut fixed_share, mut exploited) = (Vec::new(), Vec::new());
    for seed in 0..seeds {
        let problems: Vec<Problem> = (0..=BEFORE).map(|number| problem(kind, seed, number)).collect();
        let (counts, others) = problems.split_last().expect("eight");
        let mut study = Study::new(problems[0].space.clone(), seed, policy());
        let mut tried = vec![problems[0].space.default_configuration()];
        for (number, other) in others.iter().enumerate() {
            for _ in 0..TRIALS {
                let trial = study.frame("a", number as u64, &other.truth, other.noise);
                tried.push(trial.configuration);
            }
        }
        let predicted = study.tuner.predict(&Study::indicators(BEFORE), None).expect("valid").configuration;
        let predicted = (counts.truth)(&predicted).unwrap_or(10.0 * counts.optimum);
        let costs = explore(&mut study, BEFORE, counts);
        let Some(fixed) = best_fixed(&tried, others, counts).and_then(|fixed| (counts.truth)(fixed)) else {
            continue;
        };
        fixed_share.push(counts.optimum / fixed);
        exploited.push(fixed / predicted);
        for (mark, cost) in costs.into_iter().enumerate() {
            over[mark].push(fixed / cost);
            share[mark].push(counts.optimum / cost);
        }
    }
    print!("{kind:14} fixed {:.3} | exploited {:.3} |", summary(&fixed_share).0, summary(&exploited).0);
    for (mark, trials) in MARKS.iter().enumerate() {
        let (mean, worst) = summary(&over[mark]);
        print!("  {trials:2}: {mean:.3} [{worst:.3}] {:.3}", summary(&share[mark]).0);
    }
    println!();
}

/// The configuration with the other end of every other parameter.
fn turned(space: &Space, configuration: &Configuration) -> Configuration {
    let mut x = space.encode(configuration);
    x.iter_mut().step_by(2).for_each(|x| *x = 1.0 - *x);
    space.decode(&x)
}

/// A state that wants the opposite of all that are known.
pub(crate) fn opposite(kind: &str, seeds: u64) {
    for before in [0, 1, 5] {
        let mut share = vec![Vec::new(); MARKS.len()];
        for seed in 0..seeds {
            let counts = problem(kind, seed, COUNTS);
            let mut study = Study::new(counts.space.clone(), seed, policy());
            for number in 0..before {
                let other = problem(kind, seed, number);
                let truth = |c: &Configuration| (other.truth)(&turned(&counts.space, c));
                (0..TRIALS).for_each(|_| drop(study.frame("a", number, truth, other.noise)));
            }
            let costs = explore(&mut study, COUNTS, &counts);
            costs.into_iter().enumerate().for_each(|(mark, cost)| share[mark].push(counts.optimum / cost));
        }
        print!("{kind:14} after {before} |");
        for (mark, trials) in MARKS.iter().enumerate() {
            let (mean, worst) = summary(&share[mark]);
            print!("  {trials:2}: {mean:.3} [{worst:.3}]");
        }
        println!();
    }
}
