//! Does the error fall as theory says: as one over the time, down to zero?
//!
//! The mean squared error of an unbiased estimator is its variance over the number of samples. On logarithmic
//! axes that is a line of slope −1, against rendering time as well since all samples cost alike. The slope is
//! fitted to the runs' mean curve, with the reference's own variance taken off. The squared bias (see `bias`)
//! shows whether the curve would end on a plateau: clearly above the reference's own error it is an error
//! that no time removes.

use serde::Serialize;

use super::bootstrap::{Interval, interval};
use super::reference::TRUSTED_FROM;

/// Fewer points than this carry no line.
const POINTS_MIN: usize = 4;

/// A squared bias below the reference's own error times this is as good as none.
const HARMLESS_TO: f64 = 2.0;

/// The convergence of an estimator, from its curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Convergence {
    /// Exponent of the error's fall over rendering time; −1 in theory. Absent when too few points lie above
    /// the reference's own error.
    pub slope: Option<Interval>,
    /// Number of points that the slope rests on.
    pub slope_points: usize,
    /// The relative squared bias: the height above the reference's own error at which the curve would end.
    /// Absent for a single run.
    pub squared_bias: Option<Interval>,
    /// The verdict from both.
    pub verdict: Verdict,
}

/// Whether a curve tends to zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The error falls until the reference's own error hides it.
    Unbiased,
    /// The error ends on a plateau above the reference's own error.
    Biased,
    /// The runs are too few, too short or too noisy for a verdict.
    Unclear,
}

/// A point of a run: rendering time in any unit and relative squared error.
pub type TimeAndError = (f64, f64);

/// Judges a contender by its runs. The points with the same number belong together: they have the same number
/// of samples. `floor` is the reference's own error.
pub fn judge(runs: &[Vec<TimeAndError>], floor: f64, squared_bias: Option<Interval>) -> Convergence {
    let slope = interval(runs.len(), |drawn| slope(&pooled(runs, drawn), floor));
    let all: Vec<usize> = (0..runs.len()).collect();
    let verdict = match squared_bias.and_then(|bias| bias.range) {
        Some([low, _]) if low > floor => Verdict::Biased,
        Some([_, high]) if high <= HARMLESS_TO * floor => Verdict::Unbiased,
        _ => Verdict::Unclear,
    };
    let slope_points = trusted(&pooled(runs, &all), floor).len();
    Convergence { slope, slope_points, squared_bias, verdict }
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
fn slope(curve: &[TimeAndError], floor: f64) -> Option<f64> {
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

    fn about(estimate: f64, half: f64) -> Option<Interval> {
        Some(Interval { estimate, range: Some([estimate - half, estimate + half]) })
    }

    #[test]
    fn an_unbiased_estimator_is_told_as_such() {
        let floor = 1e-4;
        let found = judge(&runs(-1.0, 0.2, floor, 0.05, 8), floor, about(1e-6, 1e-5));
        let slope = found.slope.expect("there are points enough");
        let [low, high] = slope.range.expect("there are runs enough");
        assert!((slope.estimate + 1.0).abs() < 0.02 && low <= -0.98 && high >= -1.02, "{slope:?}");
        assert!(high - low < 0.1);
        assert_eq!(found.verdict, Verdict::Unbiased);
        assert!(found.slope_points >= 18, "{}", found.slope_points);
    }

    #[test]
    fn a_plateau_flattens_the_slope_and_is_called_bias() {
        let found = judge(&runs(-1.0, 0.2, 1e-2, 0.05, 8), 1e-4, about(9.9e-3, 1e-4));
        assert_eq!(found.verdict, Verdict::Biased);
        assert!(found.slope.is_some_and(|slope| slope.estimate > -0.9), "the slope flattens");
    }

    #[test]
    fn too_little_is_unclear() {
        let few = runs(-1.0, 0.2, 1e-4, 0.05, 1);
        assert_eq!(judge(&few, 1e-4, None).verdict, Verdict::Unclear);
        assert_eq!(judge(&few, 1e-4, about(0.0, 1e-3)).verdict, Verdict::Unclear);
        let nothing = judge(&[], 1e-4, None);
        assert_eq!((nothing.slope, nothing.slope_points, nothing.verdict), (None, 0, Verdict::Unclear));
        // All below twice the floor.
        assert_eq!(judge(&runs(-1.0, 1e-6, 1e-4, 0.05, 3), 1e-4, None).slope, None);
    }

    proptest! {
        #[test]
        fn every_exponent_is_recovered(exponent in -2.0_f64..-0.3, variance in 1e-3_f64..1e3) {
            let found = judge(&runs(exponent, variance, 0.0, 0.0, 2), 0.0, None);
            let slope = found.slope.expect("there are points enough");
            prop_assert!((slope.estimate - exponent).abs() < 1e-9);
            prop_assert!(slope.range.is_some_and(|[low, high]| (high - low).abs() < 1e-9));
        }
    }
}
