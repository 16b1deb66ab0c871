//! What measuring a point is worth, by what a process believes of it. Values are minimised.

use std::f64::consts::PI;

use super::regression::Belief;
use crate::statistics::distribution::{normal_cdf, normal_density};

/// The logarithm of the expected improvement over `best`: of the mean of `best` minus the value where that is positive,
/// and zero elsewhere (Jones, Schonlau and Welch, "Efficient global optimization of expensive black-box functions",
/// Journal of Global Optimization 13, 1998, equation 15). In logarithms, so that it tells points apart where it would
/// otherwise vanish (Ament et al., "Unexpected improvements to expected improvement", NeurIPS 2023).
pub(crate) fn log_expected_improvement(best: f64, belief: Belief) -> f64 {
    log_improvement((best - belief.mean) / belief.deviation) + libm::log(belief.deviation)
}

/// `ln(phi(z) + z Phi(z))`: the same for a standard normal and a best of `z`.
fn log_improvement(z: f64) -> f64 {
    if z > -5.0 {
        return libm::log(normal_density(z) + z * normal_cdf(z));
    }
    // The first terms of the asymptotic expansion: phi(z) / z^2 (1 - 3 / z^2 + 15 / z^4).
    let inverse = 1.0 / (z * z);
    -0.5 * z * z - 0.5 * libm::log(2.0 * PI)
        + libm::log(inverse * (1.0 - 3.0 * inverse + 15.0 * inverse * inverse))
}

/// The mean less so many deviations: optimistic above zero, careful below.
pub(crate) fn confidence_bound(belief: Belief, optimism: f64) -> f64 {
    belief.mean - optimism * belief.deviation
}

/// The probability that a measurement with so much noise (a variance) is below a threshold.
pub(crate) fn probability_below(threshold: f64, belief: Belief, noise: f64) -> f64 {
    normal_cdf((threshold - belief.mean) / (belief.deviation * belief.deviation + noise).sqrt())
}

/// The mean of what is believed of a measurement with so much noise (a variance), given that it is above a bound: that of
/// a truncated normal.
pub(crate) fn mean_above(bound: f64, belief: Belief, noise: f64) -> f64 {
    let deviation = (belief.deviation * belief.deviation + noise).sqrt();
    let z = (bound - belief.mean) / deviation;
    // The hazard of the normal, which approaches a straight line from above.
    let hazard = if z > 5.0 { z + 1.0 / z } else { normal_density(z) / normal_cdf(-z) };
    let mean = belief.mean + deviation * hazard;
    if mean.is_finite() { mean.max(bound) } else { bound }
}
