//! A Gaussian process over states and configurations together, fitted to a few dozen measurements.
//!
//! Source: Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, algorithm 2.1. The
//! covariance is Matérn 5/2 of one weighted distance with a length for each indicator and parameter: what is
//! measured under one state tells about a neighbouring state in the measure in which they are alike.

use super::hyper::Hyper;
use crate::matrix::{Factor, dot};
use crate::search::layout::{INACTIVE, Metric};

/// What a process is fitted to: features, row after row, and the measurements behind each row.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    pub(super) metrics: Vec<Metric>,
    /// Column after column would be faster to walk; it is turned when fitted.
    pub(super) features: Vec<f64>,
    pub(super) counts: Vec<f64>,
}

impl Rows {
    pub(super) fn new(metrics: Vec<Metric>) -> Self {
        Rows { metrics, features: Vec::new(), counts: Vec::new() }
    }

    pub(super) fn push(&mut self, state: &[f64], configuration: &[f64], count: f64) {
        self.features.extend(state);
        self.features.extend(configuration);
        self.counts.push(count);
    }

    pub(super) fn len(&self) -> usize {
        self.counts.len()
    }

    pub(super) fn dimension(&self) -> usize {
        self.metrics.len()
    }

    pub(super) fn row(&self, index: usize) -> &[f64] {
        let d = self.dimension();
        &self.features[index * d..(index + 1) * d]
    }

    /// Squared distances of two rows along each axis.
    pub(super) fn apart(&self, p: usize, q: usize, into: &mut [f64]) {
        let pairs = self.row(p).iter().zip(self.row(q));
        for ((into, metric), (&a, &b)) in into.iter_mut().zip(&self.metrics).zip(pairs) {
            *into = apart_on(*metric, a, b);
        }
    }
}

/// The squared distance along one axis. A choice is the same or not; a point beside a conditional axis is as
/// far from a point on it as half its length away from its middle.
fn apart_on(metric: Metric, a: f64, b: f64) -> f64 {
    match metric {
        _ if a == b => 0.0,
        Metric::Guide => 0.0,
        Metric::Unordered => 1.0,
        Metric::Ordered if a == INACTIVE || b == INACTIVE => (a.max(b) - 0.5).powi(2) + 0.25,
        Metric::Ordered => (a - b) * (a - b),
    }
}

/// The correlation at a squared distance, and its slope: Matérn 5/2.
pub(super) fn shape(squared: f64) -> (f64, f64) {
    let a = (5.0 * squared).sqrt();
    let decay = libm::exp(-a);
    ((1.0 + a + a * a / 3.0) * decay, -5.0 / 6.0 * (1.0 + a) * decay)
}

/// What a process says of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Belief {
    pub(super) mean: f64,
    /// Standard deviation of the mean, noise left out.
    pub(super) deviation: f64,
}

/// A fitted process.
pub(super) struct Field<'a> {
    rows: &'a Rows,
    weights: Vec<f64>,
    /// Features, axis by axis.
    columns: Vec<Vec<f64>>,
    factor: Factor,
    /// Inverse of the correlations times the values less their mean.
    pub(super) alpha: Vec<f64>,
    mean: f64,
    /// Variance of the values, without noise.
    pub(super) variance: f64,
    noise: f64,
}

/// What the prior adds to the sum of squares: one more value that is off by a tenth or so.
const VARIANCE_PRIOR: f64 = 1e-2;

impl<'a> Field<'a> {
    /// Fits the process. `None` without rows, or when numbers are not finite.
    pub(super) fn fit(rows: &'a Rows, values: &[f64], hyper: &Hyper) -> Option<Self> {
        let n = rows.len();
        if n == 0 {
            return None;
        }
        let (weights, noise) = (hyper.weights(), hyper.noise());
        let columns: Vec<Vec<f64>> =
            (0..rows.dimension()).map(|axis| (0..n).map(|row| rows.row(row)[axis]).collect()).collect();
        let mut matrix = vec![0.0; n * n];
        for p in 0..n {
            let row = &mut matrix[p * n..p * n + p];
            distances(&rows.metrics, &weights, rows.row(p), &columns, row);
            row.iter_mut().for_each(|squared| *squared = shape(*squared).0);
            matrix[p * n + p] = 1.0 + noise / rows.counts[p];
        }
        let factor = Factor::of(&matrix, n)?;
        let (mut ones, mut y) = (vec![1.0; n], values.to_vec());
        factor.forward(&mut ones);
        factor.forward(&mut y);
        let mean = dot(&ones, &y) / dot(&ones, &ones);
        let mut residual: Vec<f64> = ones.iter().zip(&y).map(|(one, y)| y - mean * one).collect();
        let variance = (dot(&residual, &residual) + VARIANCE_PRIOR) / (n as f64 + 1.0);
        factor.backward(&mut residual);
        let finite = mean.is_finite() && variance.is_finite();
        finite.then_some(Field {
            rows,
            weights,
            columns,
            factor,
            alpha: residual,
            mean,
            variance,
            noise: noise * variance,
        })
    }

    /// Variance of a single measurement around its mean.
    pub(super) fn noise(&self) -> f64 {
        self.noise
    }

    pub(super) fn inverse(&self) -> Vec<f64> {
        self.factor.inverse()
    }

    /// The state's part of the squared distances to all rows.
    pub(super) fn towards(&self, state: &[f64]) -> Vec<f64> {
        let mut squared = vec![0.0; self.rows.len()];
        let width = state.len();
        distances(
            &self.rows.metrics[..width],
            &self.weights[..width],
            state,
            &self.columns[..width],
            &mut squared,
        );
        squared
    }

    /// The correlations of a configuration's features in the state that `towards` was asked of.
    pub(super) fn nearness(&self, towards: &[f64], configuration: &[f64], into: &mut Vec<f64>) {
        into.clear();
        into.extend_from_slice(towards);
        let from = self.rows.dimension() - configuration.len();
        distances(
            &self.rows.metrics[from..],
            &self.weights[from..],
            configuration,
            &self.columns[from..],
            into,
        );
        into.iter_mut().for_each(|squared| *squared = shape(*squared).0);
    }

    pub(super) fn mean(&self, nearness: &[f64]) -> f64 {
        self.mean + dot(nearness, &self.alpha)
    }

    /// Uses `nearness` up.
    pub(super) fn deviation(&self, nearness: &mut [f64]) -> f64 {
        self.factor.forward(nearness);
        (self.variance * (1.0 - dot(nearness, nearness)).max(1e-9)).sqrt()
    }

    pub(super) fn at(&self, towards: &[f64], configuration: &[f64]) -> Belief {
        let mut nearness = Vec::with_capacity(self.rows.len());
        self.nearness(towards, configuration, &mut nearness);
        Belief { mean: self.mean(&nearness), deviation: self.deviation(&mut nearness) }
    }
}

/// Adds the weighted squared distances of one point to the first `into.len()` points of `columns`.
fn distances(metrics: &[Metric], weights: &[f64], point: &[f64], columns: &[Vec<f64>], into: &mut [f64]) {
    for (((&metric, &weight), &x), column) in metrics.iter().zip(weights).zip(point).zip(columns) {
        if metric == Metric::Ordered && x != INACTIVE {
            let beside = (x - 0.5) * (x - 0.5) + 0.25;
            for (sum, &other) in into.iter_mut().zip(column) {
                *sum += weight * if other == INACTIVE { beside } else { (x - other) * (x - other) };
            }
        } else {
            for (sum, &other) in into.iter_mut().zip(column) {
                *sum += weight * apart_on(metric, x, other);
            }
        }
    }
}
