//! Contextual tuning: every round brings another input, and the best configuration moves with it.
//!
//! Each problem has four parameters and two indicators in 0..1. The cost rises with each parameter's way from
//! an optimum that moves smoothly with the indicators: as a bowl or a cone, with kinks, across the axes, in
//! waves, over magnitudes; measurements carry 5 % of relative noise. Every round draws a fresh context, asks
//! the whole tuner, and reports the noisy cost. Regret is the noiseless cost above the least possible in that
//! context, divided so that the best fixed configuration (found on 4,000 contexts) has a mean regret of 0.60:
//! a method that knows no context cannot do better than that.
//!
//! `cargo run --release -p treewright-lab --example contextual -- [SEEDS] [PREDICTOR...]` prints a JSON
//! object a problem and predictor: all of them unless some are named.

mod problem;

use problem::Problem;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use treewright_core::policy::{Policy, PredictorMethod};
use treewright_lab::simulated::{ask, mean, normal, report};

/// Rounds of one run, and the first that counts.
const ROUNDS: usize = 80;
const FROM: usize = 40;
/// Standard deviation of the relative noise.
const NOISE: f64 = 0.05;

/// Regret of each round.
fn run(problem: &Problem, policy: &Policy, seed: u64) -> Vec<f64> {
    let mut tuner = problem.tuner(policy.clone(), seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let round = |round: i64| {
        let context: [f64; 2] = [random.random(), random.random()];
        let ask = ask([("u", context[0]), ("v", context[1])]);
        let (trial, _) = tuner.suggest(&ask, round).expect("a valid question");
        let cost = problem.cost(&context, &problem.point(&trial.configuration));
        report(&mut tuner, &trial, Some(cost * (1.0 + NOISE * normal(&mut random)).max(0.01)));
        problem.regret(cost, &context)
    };
    (0..ROUNDS as i64).map(round).collect()
}

fn main() {
    let seeds: u64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(15);
    let methods = [
        (PredictorMethod::Auto, 0.2),
        (PredictorMethod::Auto, 1.0),
        (PredictorMethod::Contextual, 0.2),
        (PredictorMethod::Contextual, 1.0),
        (PredictorMethod::NearestNeighbour, 0.2),
        (PredictorMethod::RbfGreedyGq, 0.2),
    ];
    let named: Vec<String> = std::env::args().skip(2).collect();
    let wanted = |method: PredictorMethod| named.is_empty() || named.iter().any(|name| name == method.name());
    for problem in problem::all() {
        for (predictor, epsilon) in methods.into_iter().filter(|(method, _)| wanted(*method)) {
            let policy = Policy { predictor, epsilon, ..Policy::default() };
            let regrets: Vec<Vec<f64>> = (0..seeds).map(|seed| run(&problem, &policy, seed)).collect();
            let part = |from: usize, to: usize| {
                regrets.iter().map(|regrets| mean(&regrets[from..to])).sum::<f64>() / seeds as f64
            };
            println!(
                "{}",
                json!({
                    "problem": problem.name,
                    "predictor": predictor.name(),
                    "epsilon": epsilon,
                    "seeds": seeds,
                    "regret_1_to_40": part(0, FROM),
                    "regret_41_to_80": part(FROM, ROUNDS),
                })
            );
        }
    }
}
