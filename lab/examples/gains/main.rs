//! What tuning gains over doing nothing clever: over the best fixed configuration of the states that are
//! known, where nothing can be gained, where a state wants the opposite, and with many workers.
//!
//! `cargo run --release -p treewright-lab --example gains -- TEST SEEDS [SUITE...]`. Every test drives the
//! tuner itself.
//!
//! - `streams`: seven states are explored by 60 trials each, then an eighth that the study has not met. What
//!   would be exploited there after 1, 8, 16, 32 and 60 trials, over the best fixed configuration of the
//!   other seven (more is better), and its share of the roofline; geometric means and the tenth part that did
//!   worst.
//! - `opposite`: the same after one state and after five in which every other parameter means the opposite,
//!   beside a state that is alone.
//! - `flat`: six states of 300 frames in which every configuration costs the same, but for 7 % of noise:
//!   frames explored.
//! - `short`: six states of 300 frames with 15 % to be gained: cost of all frames over that of the default,
//!   and explored.
//! - `second`: a second client joins a state that another has explored for 40 frames: tries in which it
//!   explores nothing, and the cost that it ends with over the optimum.
//! - `workers`: 1, 8 and 32 workers in one state, in simulated time: trials to 95 % of the optimum, wall time
//!   in evaluations of the optimum, distinct configurations among the budget, and the share at the end.
//!
//! Suites of landscapes, states being scenes or devices: `trees` and `kernels`, which constants were chosen
//! on; `fresh` (`trees` of other seeds) and `unseen` (other functions), which no constant was chosen on.

#[path = "../search_quality/grids.rs"]
#[allow(dead_code)]
mod grids;
#[path = "../search_quality/kernels.rs"]
#[allow(dead_code)]
mod kernels;
#[path = "../search_quality/problem.rs"]
#[allow(dead_code)]
mod problem;
#[path = "../search_quality/roofline.rs"]
mod roofline;
#[path = "../search_quality/trees.rs"]
mod trees;

mod sessions;
mod states;
mod streams;
mod workers;

pub(crate) use roofline::best_of;

/// The landscapes of a suite: kinds of them, which are averaged over.
fn kinds(suite: &str) -> Vec<&'static str> {
    match suite {
        "trees" => vec!["trees"],
        "fresh" => vec!["fresh"],
        "kernels" => kernels::KERNELS.to_vec(),
        "unseen" => kernels::UNSEEN.to_vec(),
        other => panic!("{other} is no suite"),
    }
}

/// The geometric mean, and that of the worst tenth.
fn summary(values: &[f64]) -> (f64, f64) {
    let mean = |values: &[f64]| (values.iter().map(|v| v.ln()).sum::<f64>() / values.len() as f64).exp();
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (mean(&sorted), mean(&sorted[..sorted.len().div_ceil(10)]))
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [test, seeds, suites @ ..] = arguments.as_slice() else {
        panic!("give a test, a number of seeds, and suites");
    };
    let seeds: u64 = seeds.parse().expect("a number of seeds");
    match test.as_str() {
        "flat" => sessions::flat(seeds),
        "short" => sessions::short(seeds),
        "second" => sessions::second(seeds),
        test => {
            for suite in suites {
                for kind in kinds(suite) {
                    match test {
                        "streams" => streams::unmet(kind, seeds),
                        "opposite" => streams::opposite(kind, seeds),
                        "workers" => workers::run(kind, seeds),
                        other => panic!("{other} is no test"),
                    }
                }
            }
        }
    }
}
