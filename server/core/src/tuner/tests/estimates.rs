//! Measurements that are estimates with known standard errors, some good and some poor.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::randomness::standard_normal as normal;

/// The relative standard errors of good and of poor measurements.
const GOOD: f64 = 0.01;
const POOR: f64 = 0.8;
/// The least of [`cost`] where `x` is 0.5.
const LEAST: f64 = 12.75;

/// The answer's cost above the optimum, as a share, after a search in which half of the measurements are
/// poor. The client reports their standard errors, or keeps them for itself.
fn excess(seed: u64, is_told: bool) -> f64 {
    let mut tuner = Tuner::new(Arc::new(StudySpec { seed, ..spec(explore_always()) })).expect("valid");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..30 {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        let error = if random.random::<bool>() { GOOD } else { POOR };
        let render_ms = cost(&trial) * libm::exp(error * normal(&mut random));
        let errors = if is_told { measured(error * render_ms) } else { BTreeMap::new() };
        assert!(tuner.report_estimates(&trial, measured(render_ms), errors, Outcome::Ok, 1).is_ok());
    }
    let best = tuner.best(None, None).expect("valid").expect("measured");
    let answer = Trial { configuration: best.configuration, ..suggest(&mut tuner, "b", 0.5, 0.5) };
    cost(&answer) / LEAST - 1.0
}

#[test]
fn who_tells_standard_errors_gets_better_answers() {
    let mean = |is_told| (0..12).map(|seed| excess(seed, is_told)).sum::<f64>() / 12.0;
    let (told, untold) = (mean(true), mean(false));
    println!("above the optimum: {told:.3} with standard errors, {untold:.3} without");
    assert!(told < 0.8 * untold, "{told} with standard errors, {untold} without");
}

#[test]
fn standard_errors_of_zero_and_of_what_is_no_cost_change_nothing() {
    let mut plain = tuner(explore_always());
    let mut told = plain.clone();
    for frame in 0..12 {
        let trial = suggest(&mut plain, "a", 0.5, 0.5);
        assert_eq!(trial, suggest(&mut told, "a", 0.5, 0.5), "frame {frame}");
        let mut metrics = measured(cost(&trial));
        metrics.insert("build_ms".to_owned(), 3.0);
        let errors = [("render_ms", 0.0), ("build_ms", 2.0)].map(|(name, error)| (name.to_owned(), error));
        let errors = BTreeMap::from(errors);
        assert!(plain.report(&trial, metrics.clone(), Outcome::Ok, 1).is_ok());
        let reported = told.report_estimates(&trial, metrics, errors.clone(), Outcome::Ok, 1);
        assert_eq!(reported.expect("valid").0.standard_errors, errors);
    }
    assert_eq!(plain.best(None, None), told.best(None, None));
    let checkpoint =
        |tuner: &Tuner| tuner.knowledge.learnt(tuner.spec()).checkpoint().expect("a small study");
    assert_eq!(checkpoint(&plain), checkpoint(&told));
}
