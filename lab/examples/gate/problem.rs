//! Landscapes with known costs, for searches.

use rand::{Rng, RngExt};
use treewright_core::{configuration::Configuration, space::Space};

/// A cost without noise; `None` where a configuration cannot be run.
pub(crate) type Truth = Box<dyn Fn(&Configuration) -> Option<f64> + Send + Sync>;

pub(crate) struct Problem {
    pub(crate) space: Space,
    pub(crate) truth: Truth,
    /// Standard deviation of the noise's logarithm.
    pub(crate) noise: f64,
    pub(crate) optimum: f64,
}

impl Problem {
    /// Looks for the optimum.
    pub(crate) fn new(
        space: Space,
        noise: f64,
        random: &mut impl Rng,
        truth: impl Fn(&Configuration) -> Option<f64> + Send + Sync + 'static,
    ) -> Self {
        let optimum = best_of(&space, &truth, random);
        Problem { space, truth: Box::new(truth), noise, optimum }
    }
}

/// Number of climbs, and the length of each: random points, then changes of the best of them.
const CLIMBS: usize = 6;
const ANYWHERE: usize = 1500;
const CHANGES: usize = 2500;

/// The lowest cost of several long climbs from random points by changes of one to three parameters.
fn best_of(space: &Space, cost: impl Fn(&Configuration) -> Option<f64>, random: &mut impl Rng) -> f64 {
    let dimension = space.dimension();
    let value = |x: &[f64]| cost(&space.decode(x)).unwrap_or(f64::INFINITY);
    let mut found = f64::INFINITY;
    for _ in 0..CLIMBS {
        let anywhere = |random: &mut dyn Rng| (0..dimension).map(|_| random.random()).collect::<Vec<f64>>();
        let mut best = (f64::INFINITY, anywhere(random));
        for _ in 0..ANYWHERE {
            let x = anywhere(random);
            let cost = value(&x);
            if cost < best.0 {
                best = (cost, x);
            }
        }
        for _ in 0..CHANGES {
            let mut x = best.1.clone();
            for _ in 0..random.random_range(1..4) {
                x[random.random_range(0..dimension)] = random.random();
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
