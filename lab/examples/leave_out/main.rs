//! Trials saved by leaving out: trials until 90, 95 and 98 % of the roofline of the modelled renderer space,
//! with and without conditional knowledge.
//!
//! `cargo run --release -p treewright-lab --example leave_out -- [SEEDS] [SCENES_BEFORE] [TRIALS] [NOISE] [ARM...]`.
//! Each run asks the tuner itself, one client in one scene after the other. NOISE is the standard deviation
//! of the logarithm of measurements, 0.07 by default; it decides how soon effects of a few percent can be
//! seen. "flat" is the space as a list of parameters that are always active; "conditional" knows which
//! parameter is active under which condition. In "scenes" other scenes were explored before; in "unlike"
//! every other parameter means the opposite there, in "one unlike" only in the nearest. Runs that do not
//! arrive count as the budget. The last columns are the share at the end over that of "conditional" on that
//! seed: median and least. Names of arms choose among them.

#[path = "../search_quality/problem.rs"]
mod problem;
#[path = "../search_quality/trees.rs"]
mod trees;

use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::policy::Policy;
use treewright_core::space::{Parameter, Space};
use treewright_core::tuner::Tuner;
use treewright_lab::simulated::{ask, normal, report, study};

/// Shares of the roofline that count as arrived, by the true cost of the best configuration tried.
const ARRIVED: [f64; 3] = [0.90, 0.95, 0.98];

fn flat(space: &Space) -> Space {
    let parameters = space.parameters().iter().cloned();
    let always = parameters.map(|parameter| Parameter { active_if: None, ..parameter });
    Space::new(always.collect(), space.constraints().to_vec()).expect("a valid space")
}

/// An arm of the comparison.
struct Arm {
    name: &'static str,
    is_flat: bool,
    before: u64,
    /// The number of scenes before, the nearest ones, that are unlike the one that counts.
    unlike: u64,
}

struct Run {
    /// Trials until each share; `None` where it was not reached.
    arrived: [Option<usize>; ARRIVED.len()],
    share: f64,
}

/// The configuration with the other end of every other parameter.
fn opposite(space: &Space, configuration: &Configuration) -> Configuration {
    let mut x = space.encode(configuration);
    x.iter_mut().step_by(2).for_each(|x| *x = 1.0 - *x);
    space.decode(&x)
}

/// Explores `before` scenes and then one that counts.
fn run(arm: &Arm, seed: u64, trials: u32, noise: Option<f64>) -> Run {
    let &Arm { is_flat, before, unlike, .. } = arm;
    let first = trees::problem(seed);
    let space = if is_flat { flat(&first.space) } else { first.space };
    let policy = Policy { epsilon: 1.0, trials_per_state: trials, ..Policy::default() };
    let spec = study(space, std::iter::once("scene".to_owned()), policy, seed);
    let mut tuner = Tuner::new(Arc::new(spec)).expect("a valid study");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut result = Run { arrived: Default::default(), share: 0.0 };
    for scene in 0..=before {
        let counts = scene == before;
        let problem = if counts { trees::problem(seed) } else { trees::problem(1000 + 50 * seed + scene) };
        let turned = !counts && scene + unlike >= before;
        let mut best = f64::INFINITY;
        for number in 1..=trials as usize {
            let ask = ask([("scene", scene as f64 / 50.0)]);
            let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
            let truth = match turned {
                true => (problem.truth)(&opposite(&problem.space, &trial.configuration)),
                false => (problem.truth)(&trial.configuration),
            };
            best = truth.map_or(best, |truth| best.min(truth));
            let noise = noise.unwrap_or(problem.noise);
            let cost = truth.map(|truth| truth * (noise * normal(&mut random)).exp());
            report(&mut tuner, &trial, cost);
            if counts {
                for (arrived, share) in result.arrived.iter_mut().zip(ARRIVED) {
                    if problem.optimum / best >= share {
                        arrived.get_or_insert(number);
                    }
                }
            }
        }
        if counts {
            result.share = problem.optimum / best;
        }
    }
    result
}

fn main() {
    let argument = |index: usize, default: u64| {
        std::env::args().nth(index).map_or(default, |text| text.parse().expect("a number"))
    };
    let (seeds, before, trials) = (argument(1, 15), argument(2, 5), argument(3, 200) as u32);
    let noise: Option<f64> = std::env::args().nth(4).map(|text| text.parse().expect("a number"));
    print!("{:24}", "mean trials (arrived) to");
    ARRIVED.iter().for_each(|share| print!("{:>8.0} %      ", 100.0 * share));
    println!("{:>10}{:>10}{:>10}", "at end", "over alone", "least");
    let named: Vec<String> = std::env::args().skip(5).collect();
    let arm = |name, is_flat, before| Arm { name, is_flat, before, unlike: 0 };
    let arms = [
        arm("flat", true, 0),
        arm("conditional", false, 0),
        arm("flat + scenes", true, before),
        arm("conditional + scenes", false, before),
        Arm { unlike: 1, ..arm("conditional + one unlike", false, before) },
        Arm { unlike: before, ..arm("conditional + unlike", false, before) },
    ];
    let mut alone: Vec<f64> = Vec::new();
    for arm in arms {
        let Arm { name, .. } = arm;
        if !named.is_empty() && !named.iter().any(|part| name == part) {
            continue;
        }
        let runs: Vec<Run> = (0..seeds).map(|seed| run(&arm, seed, trials, noise)).collect();
        let mean = |of: &dyn Fn(&Run) -> f64| runs.iter().map(of).sum::<f64>() / runs.len() as f64;
        print!("{name:24}");
        for place in 0..ARRIVED.len() {
            let after = mean(&|run| run.arrived[place].unwrap_or(trials as usize) as f64);
            let arrived = mean(&|run| f64::from(u8::from(run.arrived[place].is_some())));
            print!("{after:8.1} ({arrived:4.2}) ");
        }
        print!("{:10.3}", mean(&|run| run.share));
        if name == "conditional" {
            alone = runs.iter().map(|run| run.share).collect();
        }
        let mut over: Vec<f64> = runs.iter().zip(&alone).map(|(run, alone)| run.share / alone).collect();
        over.sort_by(f64::total_cmp);
        match over.get(over.len() / 2) {
            Some(median) => println!("{median:10.3}{:10.3}", over[0]),
            None => println!(),
        }
    }
}
