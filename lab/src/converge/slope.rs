//! Does the error fall as theory says: as one over the time?
//!
//! The mean squared error of an unbiased estimator is its variance over the number of samples. On logarithmic
//! axes that is a line of slope −1, against rendering time as well since all samples cost alike. The slope is
//! fitted to the runs' mean curve, with the reference's own variance taken off. Bias flattens it: the curve
//! ends on a plateau.

use super::bootstrap::{Interval, interval};
use super::reference::TRUSTED_FROM;

/// Fewer points than this carry no line.
const POINTS_MIN: usize = 4;

/// A point of a run: rendering time in any unit and relative squared error.
pub type TimeAndError = (f64, f64);

/// The exponent of the error's fall over rendering time; −1 in theory. The points with the same number belong
/// together: they have the same number of samples. `floor` is the reference's own error. `None` when too few
/// points lie above it.
pub fn slope(runs: &[Vec<TimeAndError>], floor: f64) -> Option<Interval> {
    interval(runs.len(), |drawn| fitted(&pooled(runs, drawn), floor))
}

/// Mean time and mean error of the chosen runs at each checkpoint that all of them have.
fn pooled(runs: &[Vec<TimeAndError>], chosen: &[usize]) -> Vec<TimeAndError> {
    let length = runs.iter().map(Vec::len).min().unwrap_or(0);
    let count = chosen.len().max(1) as f64;
    (0..length)
        .map(|point| {
            let sum = chosen.iter().fold((0.0, 0.0), |(time, error), &run| {
                let (more_time, more_error) = runs[run][point];
                (time + more_time, error + more_error)
            });
            (sum.0 / count, sum.1 / count)
        })
        .collect()
}

fn trusted(curve: &[TimeAndError], floor: f64) -> Vec<TimeAndError> {
    curve
        .iter()
        .filter(|(time, error)| *time > 0.0 && *error > TRUSTED_FROM * floor && *error > 0.0)
        .map(|(time, error)| (time.ln(), (error - floor).ln()))
        .collect()
}

/// Least squares on logarithmic axes.
fn fitted(curve: &[TimeAndError], floor: f64) -> Option<f64> {
    let points = trusted(curve, floor);
    if points.len() < POINTS_MIN {
        return None;
    }
    let count = points.len() as f64;
    let mean_x = points.iter().map(|(x, _)| x).sum::<f64>() / count;
    let mean_y = points.iter().map(|(_, y)| y).sum::<f64>() / count;
    let spread: f64 = points.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    let shared: f64 = points.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    Some(shared / spread).filter(|slope| slope.is_finite())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Runs of `variance * t^exponent + level` at powers of √2, each point off by up to `noise`.
    fn runs(exponent: f64, variance: f64, level: f64, noise: f64, count: usize) -> Vec<Vec<TimeAndError>> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        (0..count)
            .map(|_| {
                (0..20)
                    .map(|step| {
                        let time = 0.1 * 2.0_f64.powf(f64::from(step) * 0.5);
                        let error = variance * time.powf(exponent) + level;
                        (time, error * (1.0 + noise * (2.0 * random.random::<f64>() - 1.0)))
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn an_unbiased_estimator_falls_as_one_over_the_time() {
        let floor = 1e-4;
        let found = slope(&runs(-1.0, 0.2, floor, 0.05, 8), floor).expect("there are points enough");
        let [low, high] = found.range.expect("there are runs enough");
        assert!((found.estimate + 1.0).abs() < 0.02 && low <= -0.98 && high >= -1.02, "{found:?}");
        assert!(high - low < 0.1);
    }

    #[test]
    fn a_plateau_flattens_the_slope() {
        let found = slope(&runs(-1.0, 0.2, 1e-2, 0.05, 8), 1e-4);
        assert!(found.is_some_and(|slope| slope.estimate > -0.9), "{found:?}");
    }

    #[test]
    fn too_little_has_no_slope() {
        assert_eq!(slope(&[], 1e-4), None);
        assert_eq!(slope(&runs(-1.0, 1e-6, 1e-4, 0.05, 3), 1e-4), None, "all below twice the floor");
    }

    proptest! {
        #[test]
        fn every_exponent_is_recovered(exponent in -2.0_f64..-0.3, variance in 1e-3_f64..1e3) {
            let slope = slope(&runs(exponent, variance, 0.0, 0.0, 2), 0.0).expect("there are points enough");
            prop_assert!((slope.estimate - exponent).abs() < 1e-9);
            prop_assert!(slope.range.is_some_and(|[low, high]| (high - low).abs() < 1e-9));
        }
    }
}
