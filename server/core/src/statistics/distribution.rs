//! The normal distribution and Student's, as far as estimates and tests need them.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// The density of the standard normal distribution.
pub fn normal_density(z: f64) -> f64 {
    libm::exp(-0.5 * z * z) / (2.0 * PI).sqrt()
}

/// The probability that a standard normal variable is at most `z`.
pub fn normal_cdf(z: f64) -> f64 {
    let probability = 0.5 * libm::erfc(-z * FRAC_1_SQRT_2);
    assert!(z.is_nan() || (0.0..=1.0).contains(&probability), "a probability of {probability} at {z}");
    probability
}

/// The probability that a variable of Student's distribution with `freedom` degrees of freedom, at least 1,
/// is at most `t`. It takes Wallace's transformation to a normal variable ("Bounds on normal approximations
/// to Student's and the chi-square distributions", Annals of Mathematical Statistics 30, 1959) with the
/// constant of Hill's algorithm 395 (Communications of the ACM 13, 1970). From three degrees of freedom on it
/// is off by less than 0.002.
pub fn student_cdf(t: f64, freedom: f64) -> f64 {
    assert!(freedom >= 1.0, "{freedom} degrees of freedom");
    if !t.is_finite() {
        return if t > 0.0 { 1.0 } else { 0.0 };
    }
    let shrink = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0);
    let z = shrink * (freedom * libm::log1p(t * t / freedom)).sqrt();
    normal_cdf(if t < 0.0 { -z } else { z })
}

/// The expected excess over `t` of a variable of Student's distribution with `freedom` degrees of freedom,
/// more than 1, counted as 0 below `t`. It is the integral of its upper tail, in closed form.
pub fn student_excess(t: f64, freedom: f64) -> f64 {
    assert!(freedom > 1.0, "{freedom} degrees of freedom");
    if !t.is_finite() {
        return if t > 0.0 { 0.0 } else { f64::INFINITY };
    }
    let log_density = libm::lgamma(0.5 * (freedom + 1.0))
        - libm::lgamma(0.5 * freedom)
        - 0.5 * libm::log(freedom * PI)
        - 0.5 * (freedom + 1.0) * libm::log1p(t * t / freedom);
    let within = (freedom + t * t) / (freedom - 1.0) * libm::exp(log_density);
    // Far out this is a difference of two close numbers, which must not become negative.
    (within - t * student_cdf(-t, freedom)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn students_distribution_has_its_tabulated_values() {
        // Quantiles of probability 0.975 from the usual tables.
        for (freedom, t) in [(3.0, 3.182), (5.0, 2.571), (10.0, 2.228), (30.0, 2.042), (1e6, 1.960)] {
            assert!((student_cdf(t, freedom) - 0.975).abs() < 2e-3, "{freedom}: {}", student_cdf(t, freedom));
            assert!((student_cdf(-t, freedom) - 0.025).abs() < 2e-3);
        }
        assert_eq!(student_cdf(f64::INFINITY, 3.0), 1.0);
        assert_eq!(student_cdf(f64::NEG_INFINITY, 3.0), 0.0);
    }

    #[test]
    fn the_excess_is_the_integral_of_the_upper_tail() {
        // Half the mean magnitude, by the usual formula.
        assert!((student_excess(0.0, 3.0) - 0.551_329).abs() < 1e-6);
        assert!((student_excess(0.0, 1e6) - normal_density(0.0)).abs() < 1e-6);
        for freedom in [3.0, 8.0, 40.0] {
            for t in [-3.0, -0.5, 0.7, 2.0] {
                let step = 1e-3;
                let tail: f64 = (0..200_000)
                    .map(|index| step * student_cdf(-(t + (f64::from(index) + 0.5) * step), freedom))
                    .sum();
                let excess = student_excess(t, freedom);
                assert!((excess - tail).abs() < 0.01, "{freedom}, {t}: {excess}, {tail}");
            }
        }
        assert_eq!(student_excess(f64::INFINITY, 3.0), 0.0);
    }
}
