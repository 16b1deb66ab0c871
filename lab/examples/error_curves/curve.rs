//! Curves: errors of several runs at the same numbers of trials, made one.

use serde::Serialize;

/// Errors count as no less: a logarithm is taken of them.
const ERROR_LEAST: f64 = 1e-4;

/// Whose error it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    Search,
    Predictor,
}

impl Kind {
    /// For file names.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Kind::Search => "search",
            Kind::Predictor => "predictor",
        }
    }

    /// For people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Kind::Search => "simple regret",
            Kind::Predictor => "prequential error",
        }
    }
}

/// What an error is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    Trials,
    Wall,
    Compute,
}

impl Axis {
    /// For file names.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Axis::Trials => "trials",
            Axis::Wall => "wall",
            Axis::Compute => "compute",
        }
    }

    /// For people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Axis::Trials => "trials",
            Axis::Wall => "seconds of wall time",
            Axis::Compute => "microseconds of own compute",
        }
    }

    /// Where a point lies.
    pub(crate) fn of(self, point: &Point) -> f64 {
        match self {
            Axis::Trials => point.trials as f64,
            Axis::Wall => point.wall_s,
            Axis::Compute => point.compute_us,
        }
    }
}

/// A run at one number of trials: what was spent in all, and the error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub(crate) trials: usize,
    pub(crate) wall_s: f64,
    pub(crate) compute_us: f64,
    pub(crate) error: f64,
}

/// All runs at one number of trials: means of what was spent, the geometric mean of the errors and its
/// interval.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Point {
    pub(crate) trials: usize,
    pub(crate) wall_s: f64,
    pub(crate) compute_us: f64,
    pub(crate) error: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// The error of one method on one problem.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Curve {
    pub(crate) kind: Kind,
    pub(crate) problem: String,
    pub(crate) method: String,
    pub(crate) runs: usize,
    pub(crate) points: Vec<Point>,
}

impl Curve {
    /// Of runs that were looked at after the same numbers of trials.
    pub(crate) fn of(kind: Kind, problem: &str, method: &str, runs: &[Vec<Sample>]) -> Self {
        let point = |place: usize| {
            let samples: Vec<Sample> = runs.iter().map(|run| run[place]).collect();
            let mean = |of: fn(&Sample) -> f64| samples.iter().map(of).sum::<f64>() / samples.len() as f64;
            let log = |sample: &Sample| sample.error.max(ERROR_LEAST).ln();
            let middle = mean(|sample| sample.error.max(ERROR_LEAST).ln());
            let squares: f64 = samples.iter().map(|sample| (log(sample) - middle).powi(2)).sum();
            let freedom = samples.len() as f64 - 1.0;
            let reach = student(freedom) * (squares / freedom / samples.len() as f64).sqrt();
            Point {
                trials: samples[0].trials,
                wall_s: mean(|sample| sample.wall_s),
                compute_us: mean(|sample| sample.compute_us),
                error: middle.exp(),
                low: (middle - reach).exp(),
                high: (middle + reach).exp(),
            }
        };
        let places = runs.iter().map(Vec::len).min().unwrap_or(0);
        let points = (0..places).map(point).collect();
        Curve { kind, problem: problem.into(), method: method.into(), runs: runs.len(), points }
    }
}

/// The 97.5 % quantile of Student's distribution, by the expansion of Cornish and Fisher (Abramowitz and
/// Stegun 26.7.5).
fn student(freedom: f64) -> f64 {
    let z = 1.959_964_f64;
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    let third = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
    z + first / freedom + second / freedom.powi(2) + third / freedom.powi(3)
}

/// Numbers of trials at which curves have points: about evenly on a logarithmic axis.
pub(crate) fn marks(first: usize, last: usize) -> Vec<usize> {
    let mut marks = vec![first];
    while let Some(&mark) = marks.last().filter(|&&mark| mark < last) {
        marks.push((mark + 1).max(mark * 4 / 3).min(last));
    }
    marks
}
