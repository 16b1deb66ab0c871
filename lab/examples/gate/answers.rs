//! How long the best answer of a state takes, by the clock: the work of `GetBest` after a report.

use std::sync::Arc;
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::policy::Policy;
use treewright_core::tuner::Tuner;
use treewright_lab::simulated::{ask, normal, report, study};

use crate::trees;

/// Trials of the search, and those after which the best is asked for.
const TRIALS: u32 = 320;
const MARKS: [u32; 3] = [80, 160, TRIALS];
/// Questions at a mark. The shortest counts, since other programs may run meanwhile.
const QUESTIONS: usize = 7;
/// The longest that an answer may take, in milliseconds, in any build.
pub(crate) const LONGEST_MS: f64 = 60.0;

/// Numbers of trials, each with the milliseconds of the best answer then, in a search of the renderer's
/// space.
pub(crate) fn times_ms() -> Vec<(u32, f64)> {
    let problem = trees::problem(1);
    let policy = Policy { epsilon: 1.0, trials_per_state: TRIALS, ..Policy::default() };
    let spec = study(problem.space.clone(), std::iter::empty(), policy, 1);
    let mut tuner = Tuner::new(Arc::new(spec)).expect("a valid study");
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut times = Vec::new();
    for trials in 1..=TRIALS {
        let trial = tuner.suggest(&ask([]), 0).expect("a valid question").0;
        let cost = (problem.truth)(&trial.configuration);
        report(&mut tuner, &trial, cost.map(|cost| cost * (problem.noise * normal(&mut random)).exp()));
        if MARKS.contains(&trials) {
            let question = |_| {
                let begin = Instant::now();
                assert!(
                    tuner.best(None, None).expect("a valid question").is_some(),
                    "something was measured"
                );
                1e3 * begin.elapsed().as_secs_f64()
            };
            times.push((trials, (0..QUESTIONS).map(question).fold(f64::INFINITY, f64::min)));
        }
    }
    times
}
