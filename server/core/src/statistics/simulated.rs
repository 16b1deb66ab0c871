//! Noise for the tests of this module.

use rand::{Rng, RngExt};

/// A standard normal variable (Box and Muller, "A note on the generation of random normal deviates", 1958).
pub(crate) fn normal(random: &mut impl Rng) -> f64 {
    let (a, b) = (1.0 - random.random::<f64>(), random.random::<f64>());
    (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}
