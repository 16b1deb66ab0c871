//! The least cost of a modelled landscape.

use rand::{Rng, RngExt};
use treewright_core::configuration::Configuration;
use treewright_core::space::Space;

/// Climbs, and how long each is: random points, then changes of one to three parameters of the best.
const CLIMBS: usize = 6;
const ANYWHERE: usize = 1500;
const DRAWS: usize = 4000;

/// The lowest cost that several long climbs find.
pub(crate) fn best_of(
    space: &Space,
    cost: impl Fn(&Configuration) -> Option<f64>,
    random: &mut impl Rng,
) -> f64 {
    let dimension = space.dimension();
    let value = |x: &[f64]| cost(&space.decode(x)).unwrap_or(f64::INFINITY);
    let mut found = f64::INFINITY;
    for _ in 0..CLIMBS {
        let mut best = (f64::INFINITY, vec![0.5; dimension]);
        for draw in 0..DRAWS {
            let mut x: Vec<f64> = best.1.clone();
            if draw < ANYWHERE {
                x.fill_with(|| random.random());
            } else {
                for _ in 0..random.random_range(1..4) {
                    x[random.random_range(0..dimension)] = random.random();
                }
            }
            let cost = value(&x);
            if cost <= best.0 {
                best = (cost, x);
            }
        }
        found = found.min(best.0);
    }
    found
}
