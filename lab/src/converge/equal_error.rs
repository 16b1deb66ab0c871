//! How much earlier one contender reaches an error than another.
//!
//! Within a run all errors are of equal samples, so the ratio of two contenders' times depends only on the
//! machine and the structures. Times are interpolated between the points of a run on logarithmic axes, where
//! the curves are lines. The errors are those of a baseline after a few, some and many samples. Early on the
//! builds decide, later the frames; tuning pays off in between.

use serde::Serialize;

use super::bootstrap::{Interval, mean_of};
use super::curve::{Curve, Run};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

/// After how many samples of the baseline its error is asked for, besides the error that all reach at last.
const SAMPLES: [u32; 3] = [1, 8, 64];
/// Whom all others are compared with.
pub(crate) const BASELINES: [Who; 2] = [NATIVE_DEFAULT, Who::PaperDefault];

#[derive(Clone, Debug, Serialize)]
pub(crate) struct EqualError {
    /// The baseline's samples with this error; absent for the least error that all reach in every run.
    pub(crate) samples: Option<u32>,
    /// The error's mean over the runs.
    pub(crate) relative_mse: f64,
    pub(crate) rows: Vec<Row>,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    #[serde(rename = "name")]
    pub(crate) who: Who,
    /// Build and rendering until the error is reached; geometric mean over runs.
    pub(crate) time_ms: Interval,
    /// The time, including the search for the configuration before.
    pub(crate) time_with_setup_ms: Interval,
    pub(crate) speedups: Vec<Speedup>,
}

/// A baseline's time over the contender's, with the configuration known from the start.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Speedup {
    pub(crate) over: Who,
    pub(crate) ratio: Interval,
    /// With the time to find it counted.
    pub(crate) ratio_with_setup: Interval,
}

/// Compares the curves. The first of the baselines says which errors are asked for.
pub(crate) fn equal_error(curves: &[Curve], baselines: &[Who]) -> Vec<EqualError> {
    let built: Vec<&Curve> = curves.iter().filter(|curve| !curve.runs.is_empty()).collect();
    let find = |who: &Who| built.iter().copied().find(|curve| curve.who == *who);
    let bases: Vec<&Curve> = baselines.iter().filter_map(find).collect();
    let Some(first) = bases.first() else { return Vec::new() };
    let after = |samples: u32| -> Option<Vec<f64>> {
        let at = |run: &Run| Some(run.points.iter().find(|point| point.samples == samples)?.relative_mse);
        first.runs.iter().map(at).collect()
    };
    let runs = built.iter().map(|curve| curve.runs.len()).min().unwrap_or(0);
    let reached: Vec<f64> = (0..runs)
        .map(|run| built.iter().map(|curve| curve.runs[run].end.relative_mse).fold(0.0, f64::max))
        .collect();
    SAMPLES
        .iter()
        .map(|&samples| (Some(samples), after(samples)))
        .chain([(None, Some(reached))])
        .filter_map(|(samples, errors)| {
            let errors = errors?;
            let rows = built.iter().filter_map(|curve| row(curve, &bases, &errors)).collect();
            let relative_mse = errors.iter().sum::<f64>() / errors.len() as f64;
            Some(EqualError { samples, relative_mse, rows })
        })
        .collect()
}

fn row(curve: &Curve, bases: &[&Curve], errors: &[f64]) -> Option<Row> {
    let own = times(curve, errors)?;
    let mean = |setup_ms: f64| {
        let logs: Vec<f64> = own.iter().map(|time_ms| (time_ms + setup_ms).ln()).collect();
        geometric_mean(&logs)
    };
    let speedups = bases.iter().filter_map(|base| {
        let theirs = times(base, errors)?;
        let ratio = |setup_ms: f64| {
            let logs: Vec<f64> =
                theirs.iter().zip(&own).map(|(theirs, own)| (theirs / (own + setup_ms)).ln()).collect();
            geometric_mean(&logs)
        };
        Some(Speedup { over: base.who.clone(), ratio: ratio(0.0)?, ratio_with_setup: ratio(curve.setup_ms)? })
    });
    Some(Row {
        who: curve.who.clone(),
        time_ms: mean(0.0)?,
        time_with_setup_ms: mean(curve.setup_ms)?,
        speedups: speedups.collect(),
    })
}

/// When each run reaches its error; `None` if one of them does not.
fn times(curve: &Curve, errors: &[f64]) -> Option<Vec<f64>> {
    curve.runs.iter().zip(errors).map(|(run, &error)| time_to(run, error)).collect()
}

/// The mean of logarithms as the number they stand for, with its interval.
fn geometric_mean(logs: &[f64]) -> Option<Interval> {
    let mean = mean_of(logs)?;
    Some(Interval { estimate: mean.estimate.exp(), range: mean.range.map(|range| range.map(f64::exp)) })
}

/// Build and rendering until a run's error is down to this for good, interpolated logarithmically.
pub(crate) fn time_to(run: &Run, error: f64) -> Option<f64> {
    let points: Vec<_> = run.all_points().collect();
    let after = points.iter().rposition(|point| point.relative_mse > error).map_or(0, |last| last + 1);
    let reached = points.get(after)?;
    let render_ms = match after.checked_sub(1).map(|before| points[before]) {
        None => reached.render_ms,
        Some(before) => {
            let fall = (before.relative_mse / reached.relative_mse).ln();
            // Zero errors are reached at the point itself.
            let share = if fall.is_finite() { (before.relative_mse / error).ln() / fall } else { 1.0 };
            before.render_ms * (reached.render_ms / before.render_ms).powf(share)
        }
    };
    Some(run.build_ms + render_ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::testing::{self, curve};

    /// A run of an error of `variance / samples` with frames of this length.
    fn run(build_ms: f64, frame_ms: f64, variance: f64) -> Run {
        testing::run(build_ms, frame_ms, 70, |samples| variance / samples)
    }

    #[test]
    fn times_lie_between_the_points() {
        let run = run(5.0, 10.0, 1.0);
        for (error, expected) in
            [(1.0 / 2.0, 25.0), (1.0 / 2.5, 30.0), (1.0 / 50.0, 505.0), (1.0 / 70.0, 705.0)]
        {
            let found = time_to(&run, error).expect("it is reached");
            assert!((found - expected).abs() < 1e-6, "{error}: {found}");
        }
        assert_eq!(time_to(&run, 3.0), Some(15.0), "no frame is shorter than a frame");
        assert_eq!(time_to(&run, 1.0 / 71.0), None);
    }

    #[test]
    fn a_relapse_does_not_count_as_reached() {
        let mut run = run(0.0, 10.0, 1.0);
        run.points[5].relative_mse = 0.9;
        // The error was below 0.5 at three samples, but not for good before eleven.
        assert!(time_to(&run, 0.5).is_some_and(|time_ms| (80.0..110.0).contains(&time_ms)));
    }

    #[test]
    fn ratios_are_those_of_times_to_the_same_error() {
        let runs =
            |build_ms, frame_ms| Vec::from([1.0, 1.3, 0.9].map(|variance| run(build_ms, frame_ms, variance)));
        let curves = [
            curve(Who::PaperDefault, 0.0, runs(10.0, 20.0)),
            curve(NATIVE_DEFAULT, 0.0, runs(10.0, 10.0)),
            curve(Who::Tuned, 400.0, runs(30.0, 5.0)),
            curve(Who::Named("broken".into()), 0.0, Vec::new()),
        ];
        let found = equal_error(&curves, &[NATIVE_DEFAULT, Who::PaperDefault, Who::Found]);
        assert_eq!(
            found.iter().map(|one| one.samples).collect::<Vec<_>>(),
            [Some(1), Some(8), Some(64), None]
        );
        for (target, samples) in found.iter().zip([1.0, 8.0, 64.0, 70.0]) {
            assert_eq!(target.rows.len(), 3);
            let tuned = &target.rows[2];
            assert!((tuned.time_ms.estimate - (30.0 + 5.0 * samples)).abs() < 1e-6);
            let expected = BASELINES.into_iter().zip([10.0 + 10.0 * samples, 10.0 + 20.0 * samples]);
            for (speedup, (over, baseline_ms)) in tuned.speedups.iter().zip(expected) {
                assert_eq!(speedup.over, over);
                let ratio = baseline_ms / (30.0 + 5.0 * samples);
                assert!((speedup.ratio.estimate / ratio - 1.0).abs() < 1e-9, "{speedup:?}");
                assert!(speedup.ratio.range.is_some_and(|[low, high]| (high - low).abs() < 1e-6));
                let with_setup = baseline_ms / (430.0 + 5.0 * samples);
                assert!((speedup.ratio_with_setup.estimate / with_setup - 1.0).abs() < 1e-9);
            }
        }
        assert!(equal_error(&curves, &[Who::Found]).is_empty());
    }
}
