//! What a search's answer is worth while it goes on, on a machine as restless as shared ones are: after 1, 8,
//! 16, 32 and 60 frames, the true cost of the best fixed configuration of other scenes over that of what
//! would be exploited.
//!
//! `cargo run --release -p treewright-lab --example answers -- [SEEDS] [SCENES_BEFORE] [TRIALS]`. Each run
//! asks the tuner itself, one client in one modelled scene after the other, as in `leave_out`; the last one
//! counts, and nothing of it is known before. Costs carry noise of their own and a wandering speed of the
//! machine:
//!
//! | machine | noise of a frame | speed: deviation, frames it lasts |
//! |---|---|---|
//! | quiet | 3 % | 2 %, 30 |
//! | shared | 5 % | 8 %, 15 |
//! | busy | 10 % | 12 %, 8 |
//!
//! The best fixed configuration is what does best in the scenes before, by their true costs, among all that
//! was measured there: nobody could know it as well.

#[path = "../search_quality/problem.rs"]
#[allow(dead_code)]
mod problem;
#[path = "../search_quality/roofline.rs"]
mod roofline;
#[path = "../search_quality/trees.rs"]
mod trees;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::Policy;
use treewright_core::space::{Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::Outcome;
use treewright_core::tuner::{Ask, Tuner};

use problem::{Problem, normal};
pub(crate) use roofline::best_of;

/// Frames after which the answer is judged.
const FRAMES: [usize; 5] = [1, 8, 16, 32, 60];

/// How restless a machine is.
#[derive(Clone, Copy, Debug)]
struct Machine {
    name: &'static str,
    noise: f64,
    speed_deviation: f64,
    speed_frames: f64,
}

const MACHINES: [Machine; 3] = [
    Machine { name: "quiet", noise: 0.03, speed_deviation: 0.02, speed_frames: 30.0 },
    Machine { name: "shared", noise: 0.05, speed_deviation: 0.08, speed_frames: 15.0 },
    Machine { name: "busy", noise: 0.10, speed_deviation: 0.12, speed_frames: 8.0 },
];

/// The logarithm of the factor on every cost, which wanders and comes back.
struct Speed {
    machine: Machine,
    log_factor: f64,
}

impl Speed {
    fn next(&mut self, random: &mut ChaCha8Rng) -> f64 {
        let keeps = (-1.0 / self.machine.speed_frames).exp();
        let step = self.machine.speed_deviation * (1.0 - keeps * keeps).sqrt();
        self.log_factor = keeps * self.log_factor + step * normal(random);
        self.log_factor + self.machine.noise * normal(random)
    }
}

fn spec(space: Space, seed: u64, trials: u32) -> StudySpec {
    let indicator = Indicator { name: "scene".into(), min: 0.0, max: 1.0, scale: Scale::Linear };
    let terms = vec![ObjectiveTerm { metric: "render_ms".into(), weight: 1.0 }];
    StudySpec {
        display_name: "answers".into(),
        space,
        indicators: IndicatorSchema::new(vec![indicator]).expect("valid"),
        objective: Objective::new(terms).expect("valid"),
        state_tolerance: 0.01,
        policy: Policy { epsilon: 1.0, trials_per_state: trials, ..Policy::default() },
        seed,
    }
}

/// What the answers of one scene came to.
struct Run {
    /// The cost of the best fixed configuration over that of the answer, after each number of frames.
    over_fixed: [f64; FRAMES.len()],
    /// The optimum over the last answer.
    of_optimum: f64,
}

fn run(machine: Machine, seed: u64, before: u64, trials: u32) -> Run {
    let first: Problem = trees::problem(seed);
    let mut tuner = Tuner::new(Arc::new(spec(first.space.clone(), seed, trials))).expect("valid");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut known: BTreeSet<Configuration> = BTreeSet::new();
    let mut scenes: Vec<Problem> = Vec::new();
    let mut run = Run { over_fixed: [f64::NAN; FRAMES.len()], of_optimum: f64::NAN };
    for scene in 0..=before {
        let counts = scene == before;
        let problem = if counts { trees::problem(seed) } else { trees::problem(1000 + 50 * seed + scene) };
        let fixed = if counts { best_fixed(&scenes, &known) } else { None };
        let indicators = BTreeMap::from([("scene".to_owned(), scene as f64 / 50.0)]);
        let mut speed = Speed { machine, log_factor: 0.0 };
        for number in 1..=trials as usize {
            let ask = Ask { client_id: "a".into(), indicators: indicators.clone(), ..Ask::default() };
            let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
            let truth = (problem.truth)(&trial.configuration);
            let factor = speed.next(&mut random).exp();
            let (measurements, outcome) = match truth {
                Some(truth) => (BTreeMap::from([("render_ms".to_owned(), truth * factor)]), Outcome::Ok),
                None => (BTreeMap::new(), Outcome::Infeasible { reason: "cannot be built".into() }),
            };
            let _change = tuner.report(&trial, measurements, outcome, 1).expect("a valid report");
            if !counts {
                known.insert(trial.configuration);
            } else if let Some(place) = FRAMES.iter().position(|&frames| frames == number) {
                let best = tuner.best(Some(&indicators), None).expect("valid").expect("measured");
                let cost = (problem.truth)(&best.configuration).expect("it ran");
                let fixed = fixed.as_ref().and_then(|fixed| (problem.truth)(fixed));
                run.over_fixed[place] = fixed.map_or(f64::INFINITY, |fixed| fixed / cost);
                run.of_optimum = problem.optimum / cost;
            }
        }
        scenes.push(problem);
    }
    run
}

/// The configuration with the lowest mean logarithm of its cost in the scenes, of those that run in all of
/// them.
fn best_fixed(scenes: &[Problem], known: &BTreeSet<Configuration>) -> Option<Configuration> {
    let mean = |configuration: &Configuration| {
        let costs: Option<Vec<f64>> = scenes.iter().map(|scene| (scene.truth)(configuration)).collect();
        costs.map(|costs| costs.iter().map(|cost| cost.ln()).sum::<f64>())
    };
    let means = known.iter().filter_map(|configuration| Some((mean(configuration)?, configuration)));
    means.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, configuration)| configuration.clone())
}

fn main() {
    let argument = |index: usize, default: u64| {
        std::env::args().nth(index).map_or(default, |text| text.parse().expect("a number"))
    };
    let (seeds, before, trials) = (argument(1, 40), argument(2, 6), argument(3, 60) as u32);
    println!(
        "cost of the best fixed configuration of {before} other scenes over the answer's: median (tenth, least)"
    );
    for machine in MACHINES {
        let runs: Vec<Run> = (0..seeds).map(|seed| run(machine, seed, before, trials)).collect();
        print!("{:7}", machine.name);
        for (place, frames) in FRAMES.iter().enumerate() {
            let mut ratios: Vec<f64> = runs.iter().map(|run| run.over_fixed[place]).collect();
            ratios.sort_by(f64::total_cmp);
            let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share).round() as usize];
            print!(" | {frames:2}: {:.3} ({:.2}, {:.2})", at(0.5), at(0.1), at(0.0));
        }
        let of_optimum = runs.iter().map(|run| run.of_optimum).sum::<f64>() / runs.len() as f64;
        println!(" | of the optimum {of_optimum:.3}");
    }
}
