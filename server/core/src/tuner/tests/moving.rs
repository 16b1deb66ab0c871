//! Indicators that move within a state, and costs with them.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::randomness::standard_normal as normal;

/// A cost that wants wide nodes and small leaves, a tenth of which can be gained.
fn truth(configuration: &Configuration) -> f64 {
    let number = |name: &str| configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
    let travel = (number("travel_cost") - 4.0).abs();
    100.0 - number("width") + 0.4 * number("max_leaf_size") + 0.3 * number("min_leaf_size") + travel
}

/// Plays a search with its confirmation while the indicators move, and costs by up to 13 % with them. Returns
/// the true gain of the answer and whether all was one state.
fn gain(seed: u64, moves: bool) -> (f64, bool) {
    let mut tuner = seeded(seed, Policy { epsilon: 1.0, trials_per_state: 60, ..Policy::default() });
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for frame in 0..160 {
        let mut step = || if moves && frame > 0 { 2.0 * random.random::<f64>() - 1.0 } else { 0.0 };
        let [x, y] = [step(), step()];
        let trial = suggest(&mut tuner, "a", 0.5 + 0.048 * x, 0.5 + 0.048 * y);
        let moved = 0.13 * (0.8 * x - 0.6 * y);
        let cost = truth(&trial.configuration) * f64::exp(moved + 0.02 * normal(&mut random));
        let _ = tuner.report(&trial, measured(cost), Outcome::Ok, 1).expect("a valid report");
    }
    let best = tuner.best(None, None).expect("valid").expect("measured");
    let default = truth(tuner.spec().space.default_ref());
    (1.0 - truth(&best.configuration) / default, tuner.knowledge.states.len() == 1)
}

#[test]
fn a_moving_camera_gains_nearly_what_a_still_one_does() {
    let all = |moves: bool| {
        let runs: Vec<_> = (0..16).map(|seed| gain(seed, moves)).collect();
        assert!(runs.iter().all(|run| run.1), "one state");
        runs.iter().map(|run| run.0).sum::<f64>() / runs.len() as f64
    };
    let (still, moving) = (all(false), all(true));
    assert!(still > 0.04, "{still}");
    assert!(moving > 0.85 * still, "{moving} of {still}");
}
