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

use std::collections::BTreeMap;
use std::time::Instant;

use problem::Problem;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use treewright_core::policy::{Policy, PredictorMethod};
use treewright_lab::simulated::{ask, normal, report};

/// Rounds of one run, and the first that counts.
const ROUNDS: usize = 80;
const FROM: usize = 40;
/// Standard deviation of the relative noise.
const NOISE: f64 = 0.05;

/// Regret of each round, the time that asking and telling took, in microseconds, and the predictors' errors.
fn run(problem: &Problem, policy: &Policy, seed: u64) -> (Vec<f64>, Vec<f64>, Vec<(PredictorMethod, f64)>) {
    let mut tuner = problem.tuner(policy.clone(), seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut regrets, mut times) = (Vec::new(), Vec::new());
    for round in 0..ROUNDS as i64 {
        let context: [f64; 2] = [random.random(), random.random()];
        let ask = ask([("u", context[0]), ("v", context[1])]);
        let begin = Instant::now();
        let (trial, _) = tuner.suggest(&ask, round).expect("a valid question");
        let mut spent = begin.elapsed();
        let cost = problem.cost(&context, &problem.point(&trial.configuration));
        regrets.push(problem.regret(cost, &context));
        let noisy = cost * (1.0 + NOISE * normal(&mut random)).max(0.01);
        let begin = Instant::now();
        report(&mut tuner, &trial, Some(noisy));
        spent += begin.elapsed();
        times.push(spent.as_secs_f64() * 1e6);
    }
    let errors =
        tuner.predictor_errors().into_iter().map(|(method, interval)| (method, interval.mean)).collect();
    (regrets, times, errors)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn main() {
    let seeds: u64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(15);
    let methods = [
        (PredictorMethod::Auto, 0.2),
        (PredictorMethod::Auto, 1.0),
        (PredictorMethod::Contextual, 0.2),
        (PredictorMethod::Contextual, 1.0),
        (PredictorMethod::NearestNeighbour, 0.2),
        (PredictorMethod::WeightedNeighbours, 0.2),
        (PredictorMethod::LeastSquares, 0.2),
        (PredictorMethod::RbfGreedyGq, 0.2),
    ];
    let named: Vec<String> = std::env::args().skip(2).collect();
    let wanted = |method: PredictorMethod| named.is_empty() || named.iter().any(|name| name == method.name());
    for problem in problem::all() {
        for (predictor, epsilon) in methods.into_iter().filter(|(method, _)| wanted(*method)) {
            let policy = Policy { predictor, epsilon, ..Policy::default() };
            let (mut regrets, mut times, mut errors) = (vec![0.0; ROUNDS], Vec::new(), BTreeMap::new());
            for seed in 0..seeds {
                let (regret, time, error) = run(&problem, &policy, seed);
                regrets.iter_mut().zip(regret).for_each(|(sum, regret)| *sum += regret / seeds as f64);
                times.extend(time);
                for (method, error) in error {
                    *errors.entry(method.name()).or_insert(0.0) += error / seeds as f64;
                }
            }
            times.sort_by(f64::total_cmp);
            let part = |from: usize, to: usize| mean(&regrets[from..to]);
            println!(
                "{}",
                json!({
                    "problem": problem.name,
                    "predictor": predictor.name(),
                    "epsilon": epsilon,
                    "seeds": seeds,
                    "regret_1_to_40": part(0, FROM),
                    "regret_41_to_80": part(FROM, ROUNDS),
                    "regret_41_to_60": part(FROM, 60),
                    "regret_61_to_80": part(60, ROUNDS),
                    "best_fixed": 0.6,
                    "random": problem.random_regret(),
                    "prequential_error": errors,
                    "answer_us": { "mean": mean(&times), "p50": times[times.len() / 2],
                        "p99": times[times.len() * 99 / 100] },
                })
            );
        }
    }
}
