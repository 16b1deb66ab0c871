//! Gaussian process regression over features of mixed kind.
//!
//! Source: Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, chapters 2, 4 and 5.
//! The covariance is Matérn 5/2 of one weighted distance with a length for each axis. Axes without order
//! count as 0 or 1 apart, as if one-hot coded; an axis that is active in one of two points only is as far
//! apart as a point beside the axis is from a point on it, which keeps the distance Euclidean (after Hutter
//! and Osborne, "A kernel for hierarchical parameter spaces", 2013). Lengths, noise and scale are those of
//! highest posterior density; the prior on lengths grows with the root of the dimension (Hvarfner, Hellsten
//! and Nardi, "Vanilla Bayesian optimization performs great in high dimensions", ICML 2024), so that a few
//! points do not look unrelated in many dimensions. They are climbed to by iRprop (Igel and Hüsken 2000),
//! which needs signs of gradients only and goes on where it stood when points are added.
//!
//! A process may have a quadratic trend: the covariance of a random quadratic function around the middle of
//! the features, a polynomial kernel (chapter 4.2.2), is added, its share learnt like all else. Near a
//! minimum that says how axes act together, which a sum of distances cannot; far from one it misleads.
//!
//! What a guide says of a point (see [`Metric::Guide`]) is no place, and adds nothing to a distance: values may depend
//! on it linearly, with a coefficient around zero whose variance is learnt in place of a length (chapter 2.7).

use serde::{Deserialize, Serialize};

use crate::ascent::climb;
use crate::matrix::{Factor, dot, quadratic};
use crate::search::layout::{INACTIVE, Metric};

/// What is learnt of the covariance. The scale of the values is not among it: it has a closed form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Hyper {
    /// Logarithms: of each axis' weight (the inverse square of its length), then of the noise's variance
    /// and, where there is a trend, the trend's, as shares of the values'.
    log: Vec<f64>,
    /// Step sizes of the ascent.
    steps: Vec<f64>,
    /// Signs of the last gradient.
    signs: Vec<i8>,
}

/// The prior: the middle of a length, in roots of the dimension, and the spread of its logarithm; the same of
/// the noise's variance.
const LENGTH_MEAN: f64 = 0.5;
const LENGTH_SPREAD: f64 = 1.0;
const NOISE_MEAN: f64 = 0.02;
const NOISE_SPREAD: f64 = 1.5;
const STEP_START: f64 = 0.3;
const STEP_MIN: f64 = 0.01;
const STEP_MAX: f64 = 1.0;
/// The noise's share of the variance stays within this.
const NOISE_RANGE: [f64; 2] = [1e-6, 4.0];
/// The same of the trend.
const TREND_MEAN: f64 = 1.0;
const TREND_SPREAD: f64 = 2.0;
const TREND_RANGE: [f64; 2] = [1e-4, 1e4];
/// The same of the coefficient of a guide.
const GUIDE_MEAN: f64 = 1.0;
const GUIDE_SPREAD: f64 = 2.0;

impl Hyper {
    /// The middle of the prior, of a process without a trend.
    pub(super) fn new(metrics: &[Metric]) -> Self {
        let dimension = metrics.len();
        let weight = |metric: &Metric| match metric {
            Metric::Guide => GUIDE_MEAN.ln(),
            _ => Self::weight_mean(dimension),
        };
        let mut log: Vec<f64> = metrics.iter().map(weight).collect();
        log.push(NOISE_MEAN.ln());
        Hyper { steps: vec![STEP_START; log.len()], signs: vec![0; log.len()], log }
    }

    /// The same with a quadratic trend.
    pub(super) fn with_trend(metrics: &[Metric]) -> Self {
        let mut hyper = Hyper::new(metrics);
        hyper.log.push(TREND_MEAN.ln());
        hyper.steps.push(STEP_START);
        hyper.signs.push(0);
        hyper
    }

    fn weight_mean(dimension: usize) -> f64 {
        -2.0 * LENGTH_MEAN.ln() - (dimension.max(1) as f64).ln()
    }

    fn noise(&self, dimension: usize) -> f64 {
        self.log[dimension].exp()
    }

    /// Zero where there is no trend.
    fn trend(&self, dimension: usize) -> f64 {
        self.log.get(dimension + 1).map_or(0.0, |log| log.exp())
    }

    /// One step of the ascent along the gradient of the log posterior density.
    fn climb(&mut self, metrics: &[Metric], gradient: &[f64]) {
        let dimension = metrics.len();
        let weight_mean = Self::weight_mean(dimension);
        for (index, &likelihood) in gradient.iter().enumerate().take(self.log.len()) {
            let (mean, spread) = match index.checked_sub(dimension) {
                None if metrics[index] == Metric::Guide => (GUIDE_MEAN.ln(), GUIDE_SPREAD),
                None => (weight_mean, 2.0 * LENGTH_SPREAD),
                Some(0) => (NOISE_MEAN.ln(), NOISE_SPREAD),
                Some(_) => (TREND_MEAN.ln(), TREND_SPREAD),
            };
            let slope = likelihood - (self.log[index] - mean) / (spread * spread);
            let (log, step) = (&mut self.log[index], &mut self.steps[index]);
            climb(log, step, &mut self.signs[index], slope, [STEP_MIN, STEP_MAX]);
        }
        for (log, range) in self.log[dimension..].iter_mut().zip([NOISE_RANGE, TREND_RANGE]) {
            *log = log.clamp(range[0].ln(), range[1].ln());
        }
    }
}

/// The points a process is fitted to.
pub(super) struct Sample {
    pub(super) metrics: Vec<Metric>,
    /// Features, axis by axis: all points of the first axis, then of the second.
    columns: Vec<Vec<f64>>,
    /// How many measurements stand behind each point.
    counts: Vec<f64>,
    /// Squared distances along each axis of each pair of points `p > q`, pair by pair.
    apart: Vec<f64>,
    /// What the trend sees of each point, point by point.
    centred: Vec<f64>,
    /// The axis of the guide, if there is one: the last.
    guide: Option<usize>,
}

impl Sample {
    /// `points` are features, one value for each metric; `counts` at least 1.
    pub(super) fn new(metrics: Vec<Metric>, points: &[&[f64]], counts: Vec<f64>) -> Self {
        let columns: Vec<Vec<f64>> =
            (0..metrics.len()).map(|axis| points.iter().map(|point| point[axis]).collect()).collect();
        let mut apart = Vec::with_capacity(points.len() * points.len() / 2 * metrics.len());
        for (p, a) in points.iter().enumerate() {
            for b in &points[..p] {
                apart.extend(
                    metrics.iter().zip(a.iter().zip(*b)).map(|(&metric, (&a, &b))| apart_on(metric, a, b)),
                );
            }
        }
        let centred = points.iter().flat_map(|point| centred(&metrics, point)).collect();
        let guide = metrics.iter().position(|metric| *metric == Metric::Guide);
        Sample { metrics, columns, counts, apart, centred, guide }
    }

    fn len(&self) -> usize {
        self.counts.len()
    }

    fn centred(&self, point: usize) -> &[f64] {
        let dimension = self.metrics.len();
        &self.centred[point * dimension..(point + 1) * dimension]
    }

    /// The correlations of all points and, below the diagonal, their slopes by the squared distance; noise
    /// on the diagonal.
    fn correlations(&self, hyper: &Hyper) -> (Vec<f64>, Vec<f64>) {
        let (n, dimension) = (self.len(), self.metrics.len());
        let weights: Vec<f64> = hyper.log[..dimension].iter().map(|log| log.exp()).collect();
        let (mut matrix, mut slopes) = (vec![0.0; n * n], vec![0.0; n * n]);
        let mut pairs = self.apart.chunks_exact(dimension.max(1));
        let trend = hyper.trend(dimension);
        for p in 0..n {
            for q in 0..p {
                let squared = pairs.next().map_or(0.0, |apart| dot(&weights, apart));
                (matrix[p * n + q], slopes[p * n + q]) = matern(squared);
            }
            matrix[p * n + p] = 1.0 + hyper.noise(dimension) / self.counts[p];
            if let Some(guide) = self.guide {
                let column = &self.columns[guide];
                let own = weights[guide] * column[p];
                matrix[p * n..=p * n + p].iter_mut().zip(column).for_each(|(sum, other)| *sum += own * other);
            }
            if trend > 0.0 {
                let weighted: Vec<f64> = weights.iter().zip(self.centred(p)).map(|(w, x)| w * x).collect();
                for q in 0..=p {
                    matrix[p * n + q] += trend * (1.0 + dot(&weighted, self.centred(q))).powi(2);
                }
            }
        }
        (matrix, slopes)
    }
}

/// Matérn 5/2 of a squared distance, and its slope.
fn matern(squared: f64) -> (f64, f64) {
    let a = (5.0 * squared).sqrt();
    let decay = libm::exp(-a);
    ((1.0 + a + a * a / 3.0) * decay, -5.0 / 6.0 * (1.0 + a) * decay)
}

/// What the trend sees of features: ordered axes around their middles; nothing of the others.
fn centred(metrics: &[Metric], point: &[f64]) -> Vec<f64> {
    let of = |(&metric, &x): (&Metric, &f64)| {
        if metric == Metric::Ordered && x != INACTIVE { x - 0.5 } else { 0.0 }
    };
    metrics.iter().zip(point).map(of).collect()
}

fn apart_on(metric: Metric, a: f64, b: f64) -> f64 {
    match metric {
        _ if a == b || metric == Metric::Guide => 0.0,
        Metric::Unordered | Metric::Guide => 1.0,
        // A point beside the axis, half its length away from its middle.
        Metric::Ordered if a == INACTIVE || b == INACTIVE => (a.max(b) - 0.5).powi(2) + 0.25,
        Metric::Ordered => (a - b) * (a - b),
    }
}

/// A fitted process.
pub(super) struct Process {
    sample: Sample,
    weights: Vec<f64>,
    /// Inverse of the correlations with noise.
    inverse: Vec<f64>,
    /// Inverse times the values less their mean.
    alpha: Vec<f64>,
    mean: f64,
    /// Variance of the values, without noise.
    variance: f64,
    noise: f64,
    trend: f64,
    evidence: f64,
}

/// The covariances of one point with all of the sample, and with itself, as shares of the variance.
pub(super) struct Nearness {
    others: Vec<f64>,
    own: f64,
}

/// What a process says of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Belief {
    pub(super) mean: f64,
    /// Standard deviation, noise left out.
    pub(super) deviation: f64,
}

/// The part of a likelihood that depends on the values: mean, variance and the log density.
struct Profile {
    mean: f64,
    variance: f64,
    log_density: f64,
}

fn profile(factor: &Factor, values: &[f64]) -> Profile {
    let n = values.len() as f64;
    let (mut ones, mut y) = (vec![1.0; values.len()], values.to_vec());
    factor.forward(&mut ones);
    factor.forward(&mut y);
    let mean = dot(&ones, &y) / dot(&ones, &ones);
    let squares: f64 = ones.iter().zip(&y).map(|(one, y)| (y - mean * one).powi(2)).sum();
    // The prior of one more value of variance one keeps few points from pinning it to zero.
    let variance = (squares + VARIANCE_PRIOR) / (n + 1.0);
    Profile { mean, variance, log_density: -0.5 * (n + 1.0) * variance.ln() - factor.half_log_determinant() }
}

/// What the prior adds to the sum of squares: values are of order one, or all alike.
const VARIANCE_PRIOR: f64 = 1e-3;

impl Process {
    /// Fits the covariance in `rounds` steps of ascent from `hyper`, which is left where they end, or with
    /// `learn` one step further, for the next fit. `views`
    /// are the values seen through several transformations, each with the logarithm of its Jacobian: the
    /// likeliest is taken, by its index. `None` when numbers are not finite.
    pub(super) fn fit(
        sample: Sample,
        views: &[(Vec<f64>, f64)],
        hyper: &mut Hyper,
        rounds: usize,
        learn: bool,
    ) -> Option<(Process, usize)> {
        let mut chosen = None;
        let dimension = sample.metrics.len();
        for round in 0..=rounds {
            let (matrix, slopes) = sample.correlations(hyper);
            let factor = Factor::of(&matrix, sample.len())?;
            let profiles: Vec<Profile> = views.iter().map(|(values, _)| profile(&factor, values)).collect();
            let density = |view: &usize| profiles[*view].log_density + views[*view].1;
            let view =
                *chosen.get_or_insert((0..views.len()).max_by(|a, b| density(a).total_cmp(&density(b)))?);
            let Profile { mean, variance, log_density } = profiles[view];
            let residuals: Vec<f64> = views[view].0.iter().map(|value| value - mean).collect();
            let inverse = factor.inverse();
            let n = sample.len();
            let alpha: Vec<f64> = (0..n).map(|p| dot(&inverse[p * n..(p + 1) * n], &residuals)).collect();
            let climb = if round < rounds || learn {
                gradient(&sample, hyper, &slopes, &inverse, &alpha, variance)
            } else {
                Vec::new()
            };
            if round == rounds {
                let weights = hyper.log[..dimension].iter().map(|log| log.exp()).collect();
                let noise = hyper.noise(dimension) * variance;
                let trend = hyper.trend(dimension);
                if learn {
                    hyper.climb(&sample.metrics, &climb);
                }
                let evidence = log_density + views[view].1;
                let process =
                    Process { sample, weights, inverse, alpha, mean, variance, noise, trend, evidence };
                return Some((process, view));
            }
            hyper.climb(&sample.metrics, &climb);
        }
        None
    }

    /// Inverse squares of the lengths of the axes.
    pub(super) fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Logarithm of the likelihood of the values it was fitted to.
    pub(super) fn evidence(&self) -> f64 {
        self.evidence
    }

    /// Variance of a single measurement around its mean.
    pub(super) fn noise(&self) -> f64 {
        self.noise
    }

    /// The squared weighted distances to all points of the sample.
    fn distances(&self, point: &[f64]) -> Vec<f64> {
        let mut squared = vec![0.0; self.sample.len()];
        for (axis, column) in self.sample.columns.iter().enumerate() {
            let (x, weight, metric) = (point[axis], self.weights[axis], self.sample.metrics[axis]);
            if metric == Metric::Ordered && x != INACTIVE {
                for (sum, &other) in squared.iter_mut().zip(column) {
                    let beside = (x - 0.5) * (x - 0.5) + 0.25;
                    *sum += weight * if other == INACTIVE { beside } else { (x - other) * (x - other) };
                }
            } else if metric != Metric::Guide {
                for (sum, &other) in squared.iter_mut().zip(column) {
                    *sum += weight * apart_on(metric, x, other);
                }
            }
        }
        squared
    }

    /// The correlations of features with all points of the sample.
    pub(super) fn nearness(&self, point: &[f64]) -> Nearness {
        let mut others = self.distances(point);
        others.iter_mut().for_each(|squared| *squared = matern(*squared).0);
        let mut own = 1.0;
        if let Some(guide) = self.sample.guide {
            let weighted = self.weights[guide] * point[guide];
            own += weighted * point[guide];
            let column = &self.sample.columns[guide];
            others.iter_mut().zip(column).for_each(|(sum, other)| *sum += weighted * other);
        }
        if self.trend > 0.0 {
            let centred = centred(&self.sample.metrics, point);
            let weighted: Vec<f64> = self.weights.iter().zip(&centred).map(|(w, x)| w * x).collect();
            let with = |other: &[f64]| self.trend * (1.0 + dot(&weighted, other)).powi(2);
            own += with(&centred);
            for (index, covariance) in others.iter_mut().enumerate() {
                *covariance += with(self.sample.centred(index));
            }
        }
        Nearness { others, own }
    }

    pub(super) fn mean(&self, nearness: &Nearness) -> f64 {
        self.mean + dot(&nearness.others, &self.alpha)
    }

    pub(super) fn deviation(&self, nearness: &Nearness) -> f64 {
        let known = quadratic(&self.inverse, &nearness.others);
        (self.variance * (nearness.own - known).max(1e-12)).sqrt()
    }

    /// The deviation where nothing near is known.
    pub(super) fn deviation_max(&self, nearness: &Nearness) -> f64 {
        (self.variance * nearness.own).sqrt()
    }

    /// What the process says of features.
    pub(super) fn at(&self, point: &[f64]) -> Belief {
        let nearness = self.nearness(point);
        Belief { mean: self.mean(&nearness), deviation: self.deviation(&nearness) }
    }
}

/// The gradient of the log likelihood by the logarithms of weights and noise.
fn gradient(
    sample: &Sample,
    hyper: &Hyper,
    slopes: &[f64],
    inverse: &[f64],
    alpha: &[f64],
    variance: f64,
) -> Vec<f64> {
    let (n, dimension) = (sample.len(), sample.metrics.len());
    let pull = |p: usize, q: usize| alpha[p] * alpha[q] / variance - inverse[p * n + q];
    let mut gradient = vec![0.0; dimension + 2];
    let weights: Vec<f64> = hyper.log[..dimension].iter().map(|log| log.exp()).collect();
    let trend = hyper.trend(dimension);
    let mut pairs = sample.apart.chunks_exact(dimension.max(1));
    for p in 0..n {
        for q in 0..p {
            let Some(apart) = pairs.next() else { break };
            let factor = pull(p, q) * slopes[p * n + q];
            gradient.iter_mut().zip(apart).for_each(|(sum, apart)| *sum += factor * apart);
        }
        if let Some(guide) = sample.guide {
            let column = &sample.columns[guide];
            for q in 0..=p {
                let factor = if p == q { 0.5 } else { 1.0 } * pull(p, q);
                gradient[guide] += factor * column[p] * column[q];
            }
        }
        if trend > 0.0 {
            let own = sample.centred(p);
            let weighted: Vec<f64> = weights.iter().zip(own).map(|(w, x)| w * x).collect();
            for q in 0..=p {
                let other = sample.centred(q);
                let root = 1.0 + dot(&weighted, other);
                // The diagonal counts once, every other pair twice.
                let factor = if p == q { 0.5 } else { 1.0 } * pull(p, q) * trend * root;
                for (sum, (a, b)) in gradient.iter_mut().zip(own.iter().zip(other)) {
                    *sum += 2.0 * factor * a * b;
                }
                gradient[dimension + 1] += factor * root;
            }
        }
    }
    gradient.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum *= weight);
    gradient[dimension] =
        0.5 * hyper.noise(dimension) * (0..n).map(|p| pull(p, p) / sample.counts[p]).sum::<f64>();
    gradient
}
