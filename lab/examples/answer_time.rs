//! How long answers take as trials pile up in one state of the renderer's space.
//!
//! `cargo run --release -p treewright-lab --example answer_time [TRIALS]` prints, after 20, 40, 80, … trials,
//! the time of the best configuration with its standing (`GetBest`), and that of suggestions and of reports
//! since the line before: the median and the longest. All of it is computed at once; the daemon computes the
//! costly parts beside its other answers.

#[path = "search_quality/problem.rs"]
#[allow(dead_code)]
mod problem;
#[path = "search_quality/trees.rs"]
mod trees;

use std::sync::Arc;
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::policy::Policy;
use treewright_core::tuner::Tuner;
use treewright_lab::simulated::{ask, normal, report, study};

/// The first mark; each further one is twice as far.
const FIRST: usize = 20;
/// Questions for the best at each mark.
const QUESTIONS: usize = 5;

fn ms(begin: Instant) -> f64 {
    1e3 * begin.elapsed().as_secs_f64()
}

/// Median and longest, in words.
fn spread(times_ms: &mut Vec<f64>) -> String {
    times_ms.sort_by(f64::total_cmp);
    let words = match times_ms.last() {
        Some(longest) => format!("{:9.2}{longest:9.2}", times_ms[times_ms.len() / 2]),
        None => String::new(),
    };
    times_ms.clear();
    words
}

fn main() {
    let most: usize = std::env::args().nth(1).map_or(320, |text| text.parse().expect("a number of trials"));
    let problem = trees::problem(1);
    let policy = Policy { epsilon: 1.0, trials_per_state: most as u32, ..Policy::default() };
    let spec = study(problem.space.clone(), std::iter::empty(), policy, 1);
    let mut tuner = Tuner::new(Arc::new(spec)).expect("a study");
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut suggested, mut reported) = (Vec::new(), Vec::new());
    println!("{:>7}{:>18}{:>18}{:>18}", "trials", "best, ms", "suggestion, ms", "report, ms");
    for trials in 1..=most {
        let begin = Instant::now();
        let (trial, _change) = tuner.suggest(&ask([]), 0).expect("a trial");
        suggested.push(ms(begin));
        let cost = (problem.truth)(&trial.configuration);
        let cost = cost.map(|cost| cost * (problem.noise * normal(&mut random)).exp());
        let begin = Instant::now();
        report(&mut tuner, &trial, cost);
        reported.push(ms(begin));
        if trials.is_multiple_of(FIRST) && (trials / FIRST).is_power_of_two() {
            let mut times: Vec<f64> = Vec::new();
            for _ in 0..QUESTIONS {
                let begin = Instant::now();
                let best = tuner.best(None, None).expect("a valid question");
                assert!(best.is_some(), "something was measured");
                times.push(ms(begin));
            }
            let [best, suggestion, report] = [&mut times, &mut suggested, &mut reported].map(spread);
            println!("{trials:>7}{best}{suggestion}{report}");
        }
    }
}
