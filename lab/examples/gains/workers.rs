//! Many workers in one state, in simulated time: an evaluation lasts as long as it costs.

use std::collections::{BTreeMap, BTreeSet};

use treewright_core::policy::Policy;

use crate::states::{Study, problem};
use crate::summary;

const TRIALS: usize = 80;
const ARRIVED: f64 = 0.95;

struct Run {
    /// Trials that were handed out until a configuration within 5 % of the optimum was, and when that was
    /// reported, in evaluations of the optimum.
    arrived: Option<(usize, f64)>,
    /// Distinct configurations among as many trials as the budget.
    distinct: usize,
    /// Time until so many distinct configurations were measured as the budget has, or the time at the end.
    seconds: f64,
    share: f64,
}

fn one(kind: &str, seed: u64, workers: usize) -> Run {
    let problem = problem(kind, seed, 3);
    let policy = Policy { epsilon: 1.0, trials_per_state: TRIALS as u32, ..Policy::default() };
    let mut study = Study::new(problem.space.clone(), seed, policy);
    // When each worker is free, in integers to be ordered by.
    let mut busy = BTreeMap::new();
    let mut distinct = BTreeSet::new();
    let (mut handed, mut arrived, mut seconds) = (0, None, 0.0f64);
    let unit = |time: f64| (time * 1e9 / problem.optimum) as u64;
    let mut free: Vec<usize> = (0..workers).rev().collect();
    let mut now = 0;
    loop {
        while let Some(worker) = free.pop() {
            if handed >= TRIALS {
                break;
            }
            let trial = study.suggest(&format!("w{worker}"), 0);
            handed += 1;
            distinct.insert(trial.configuration.clone());
            let truth = (problem.truth)(&trial.configuration);
            // What cannot be run is found out in half the time.
            let lasts = unit(truth.unwrap_or(0.5 * problem.optimum)).max(1);
            if truth.is_some_and(|truth| problem.optimum / truth >= ARRIVED) && arrived.is_none() {
                arrived = Some((handed, (now + lasts) as f64 * 1e-9));
            }
            busy.insert((now + lasts, worker), (trial, truth));
        }
        let Some(((time, worker), (trial, truth))) = busy.pop_first() else { break };
        now = time;
        seconds = seconds.max(time as f64 * 1e-9);
        study.report(&trial, truth, problem.noise);
        free.push(worker);
    }
    let best = study.best(0).and_then(|best| (problem.truth)(&best));
    let share = best.map_or(0.1, |best| problem.optimum / best);
    Run { arrived, distinct: distinct.len(), seconds, share }
}

pub(crate) fn run(kind: &str, seeds: u64) {
    for workers in [1, 8, 32] {
        let runs: Vec<Run> = (0..seeds).map(|seed| one(kind, seed, workers)).collect();
        let mean = |of: &dyn Fn(&Run) -> f64| runs.iter().map(of).sum::<f64>() / runs.len() as f64;
        let arrived = mean(&|run| f64::from(u8::from(run.arrived.is_some())));
        let after = mean(&|run| run.arrived.map_or(TRIALS as f64, |arrived| arrived.0 as f64));
        let wall = mean(&|run| run.arrived.map_or(run.seconds, |arrived| arrived.1));
        let shares: Vec<f64> = runs.iter().map(|run| run.share).collect();
        println!(
            "{kind:14} {workers:2} workers | arrived {arrived:.2}, after {after:5.1} trials, {wall:6.1} evaluations' time | \
             {:5.1} distinct in {:6.1} | share {:.3}",
            mean(&|run| run.distinct as f64),
            mean(&|run| run.seconds),
            summary(&shares).0
        );
    }
}
