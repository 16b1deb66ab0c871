//! The worth of measuring a point, by a process's belief about it. Values are minimised.

use std::f64::consts::PI;

use super::regression::Posterior;
use crate::statistics::distribution::{normal_cdf, normal_density};

/// Standard deviations from which on tails of the normal distribution come from a continued fraction.
/// Densities and probabilities vanish further out, and their differences lose digits before.
const FAR: f64 = 5.0;
/// Terms of the fraction: from [`FAR`] on further ones change nothing in double precision.
const FRACTION_TERMS: u32 = 24;

/// The logarithm of the expected improvement over `best`. The improvement is `best` minus the value where
/// that is positive, and zero elsewhere (Jones, Schonlau and Welch, "Efficient global optimization of
/// expensive black-box functions", Journal of Global Optimization 13, 1998, equation 15). The logarithm
/// distinguishes points where the improvement itself would vanish (Ament et al., "Unexpected improvements to
/// expected improvement", NeurIPS 2023).
pub(crate) fn log_expected_improvement(best: f64, belief: Posterior) -> f64 {
    log_improvement((best - belief.mean) / belief.deviation) + libm::log(belief.deviation)
}

/// `ln(phi(z) + z Phi(z))`: the expected improvement for a standard normal and a best of `z`.
fn log_improvement(z: f64) -> f64 {
    if z > -FAR {
        return libm::log(normal_density(z) + z * normal_cdf(z));
    }
    // phi(x) (1 - x / h(x)) with x = -z and the hazard h(x) = x + e, so that nothing is subtracted.
    let (x, excess) = (-z, hazard_excess(-z));
    -0.5 * x * x - 0.5 * libm::log(2.0 * PI) + libm::log(excess) - libm::log(x + excess)
}

/// The excess over `x` of the hazard `phi(x) / Phi(-x)` of the standard normal, from [`FAR`] on: Laplace's
/// continued fraction `1 / (x + 2 / (x + 3 / (x + ...)))` (Abramowitz and Stegun, "Handbook of Mathematical
/// Functions", 26.2.14).
fn hazard_excess(x: f64) -> f64 {
    (1..=FRACTION_TERMS).rev().fold(0.0, |rest, term| f64::from(term) / (x + rest))
}

/// Whether the expected gain by a change of the value is at least `odds` times the expected loss.
pub(crate) fn is_worth(change: Posterior, odds: f64) -> bool {
    assert!(odds > 0.0, "odds of {odds}");
    let z = -change.mean / change.deviation;
    log_improvement(z) - log_improvement(-z) >= libm::log(odds)
}

/// The mean less `optimism` deviations: optimistic above zero, careful below.
pub(crate) fn confidence_bound(belief: Posterior, optimism: f64) -> f64 {
    belief.mean - optimism * belief.deviation
}

/// The probability that a measurement with noise of variance `noise` is below a threshold.
pub(crate) fn probability_below(threshold: f64, belief: Posterior, noise: f64) -> f64 {
    assert!(noise >= 0.0, "a variance of {noise}");
    normal_cdf((threshold - belief.mean) / (belief.deviation * belief.deviation + noise).sqrt())
}

/// The expected value of a measurement with noise of variance `noise`, given that it is above a bound: the
/// mean of a truncated normal.
pub(crate) fn mean_above(bound: f64, belief: Posterior, noise: f64) -> f64 {
    assert!(noise >= 0.0, "a variance of {noise}");
    let deviation = (belief.deviation * belief.deviation + noise).sqrt();
    let z = (bound - belief.mean) / deviation;
    let hazard = if z > FAR { z + hazard_excess(z) } else { normal_density(z) / normal_cdf(-z) };
    let mean = belief.mean + deviation * hazard;
    if mean.is_finite() { mean.max(bound) } else { bound }
}
