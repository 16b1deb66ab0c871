//! The fitted process: its mean and its deviation at a point.
//!
//! Source: Rasmussen and Williams, algorithm 2.1.

use super::hyper::{Hyperparameters, Prior};
use super::kernel::{add_squared_distances, centred, linear_terms, squared_distance};
use super::likelihood::{Profile, gradient};
use super::sample::Sample;
use crate::matrix::{Factor, dot, matern};

/// The least variance of a mean, as a share of the values': smaller ones are rounding errors.
const VARIANCE_MIN: f64 = 1e-9;

/// A fitted process. Values and deviations are in the unit of its data.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    sample: Sample,
    /// The weight of each feature: the inverse square of its length.
    pub(crate) weights: Vec<f64>,
    factor: Factor,
    /// Inverse of the correlations times the values less their mean.
    alpha: Vec<f64>,
    mean: f64,
    /// Variance of the values, without noise.
    variance: f64,
    /// Variance of one measurement around its mean.
    pub(crate) noise: f64,
    /// The trend's variance as a share of the values'.
    trend: f64,
    /// Logarithm of the likelihood of its values, their Jacobian counted, but for a constant.
    pub(crate) log_likelihood: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Posterior {
    /// The expected mean of measurements there.
    pub(crate) mean: f64,
    /// Standard deviation of that mean, noise left out.
    pub(crate) deviation: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Schedule {
    /// Steps of ascent before the process is made.
    pub(crate) steps: usize,
    /// One more step afterwards, for the next fit.
    pub(crate) ahead: bool,
}

/// The covariances of one point with all points of the sample and with itself, as shares of the variance. A
/// buffer: [`Process::covariances`] fills it, and [`Process::deviation`] overwrites it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Covariances {
    others: Vec<f64>,
    own: f64,
}

/// The first features of points that share them, and their part of the distances to the sample.
#[derive(Clone, Debug)]
pub(crate) struct SharedFeatures {
    features: Vec<f64>,
    distances: Vec<f64>,
}

impl Process {
    /// Fits one vector of values without learning. `None` without points, or when numbers are not finite.
    pub(crate) fn fit(
        sample: Sample,
        values: Vec<f64>,
        hyper: &Hyperparameters,
        prior: &Prior,
    ) -> Option<Process> {
        let mut unchanged = hyper.clone();
        let views = [(values, 0.0)];
        Self::learn(sample, &views, &mut unchanged, prior, Schedule::default()).map(|(process, _)| process)
    }

    /// Climbs to likelier hyperparameters and fits the process. `views` are the values seen through several
    /// transformations, each with the logarithm of its Jacobian: the likeliest at the start is taken, and its
    /// index returned. `None`, and `hyper` not moved any further, without points or when numbers are not
    /// finite.
    pub(crate) fn learn(
        sample: Sample,
        views: &[(Vec<f64>, f64)],
        hyper: &mut Hyperparameters,
        prior: &Prior,
        schedule: Schedule,
    ) -> Option<(Process, usize)> {
        assert!(views.iter().all(|(values, _)| values.len() == sample.len()), "{} points", sample.len());
        if sample.len() == 0 {
            return None;
        }
        let mut chosen: Option<usize> = None;
        let mut step = 0;
        loop {
            let (matrix, slopes) = sample.correlations(hyper);
            let factor = Factor::of(&matrix, sample.len())?;
            let profile = |view: usize| Profile::of(&factor, &views[view].0, prior);
            let (view, Profile { mean, variance, log_density, whitened: mut alpha }) = match chosen {
                Some(view) => (view, profile(view)),
                None => (0..views.len()).map(|view| (view, profile(view))).max_by(|a, b| {
                    let density = |(view, profile): &(usize, Profile)| profile.log_density + views[*view].1;
                    density(a).total_cmp(&density(b))
                })?,
            };
            chosen = Some(view);
            if !(mean.is_finite() && variance.is_finite()) {
                return None;
            }
            assert!(view < views.len() && variance > 0.0, "a variance of {variance} by view {view}");
            factor.backward(&mut alpha);
            let is_last = step == schedule.steps;
            let before = is_last.then(|| hyper.clone());
            if !is_last || schedule.ahead {
                let inverse = factor.inverse();
                let slope = gradient(&sample, hyper, &slopes, &inverse, &alpha, variance);
                hyper.ascend(&sample.kinds, &slope, prior);
            }
            let Some(before) = before else {
                step += 1;
                continue;
            };
            let dimension = sample.dimension();
            let (weights, trend) = (before.weights(dimension), before.trend(dimension));
            let noise = before.noise(dimension) * variance;
            let log_likelihood = log_density + views[view].1;
            let process =
                Process { sample, weights, factor, alpha, mean, variance, noise, trend, log_likelihood };
            return Some((process, view));
        }
    }

    /// The distances along the first features, which many points share.
    pub(crate) fn context(&self, features: &[f64]) -> SharedFeatures {
        let (width, mut distances) = (features.len(), vec![0.0; self.sample.len()]);
        let (kinds, weights, columns) =
            (&self.sample.kinds[..width], &self.weights[..width], &self.sample.columns[..width]);
        add_squared_distances(kinds, weights, features, columns, &mut distances);
        SharedFeatures { features: features.to_vec(), distances }
    }

    /// The covariances of the point with the features of the context and these.
    pub(crate) fn covariances(&self, context: &SharedFeatures, features: &[f64], into: &mut Covariances) {
        let (sample, from) = (&self.sample, context.features.len());
        let width = sample.dimension();
        assert_eq!(from + features.len(), width + sample.parts(), "a point of other features");
        assert_eq!(context.distances.len(), sample.len(), "the context of another process");
        into.own = 1.0;
        into.others.clear();
        into.others.extend_from_slice(&context.distances);
        let (kinds, weights, columns) =
            (&sample.kinds[from..], &self.weights[from..], &sample.columns[from..]);
        add_squared_distances(kinds, weights, &features[..width - from], columns, &mut into.others);
        into.others.iter_mut().for_each(|squared| *squared = matern(*squared).0);
        let point = || context.features.iter().chain(features);
        if let Some(linear) = sample.linear {
            let terms = linear_terms(&sample.kinds, point());
            // Parts of inactive parameters are zero.
            for (own, column) in terms.into_iter().zip(&sample.terms).filter(|(own, _)| *own != 0.0) {
                let weighted = self.weights[linear] * own;
                into.own += weighted * own;
                into.others.iter_mut().zip(column).for_each(|(sum, other)| *sum += weighted * other);
            }
        }
        if self.trend > 0.0 {
            let centred: Vec<f64> = centred(&sample.kinds, point()).collect();
            let weighted: Vec<f64> = self.weights.iter().zip(&centred).map(|(w, x)| w * x).collect();
            let with = |other: &[f64]| {
                let root = 1.0 + dot(&weighted, other);
                self.trend * (root * root)
            };
            into.own += with(&centred);
            for (index, covariance) in into.others.iter_mut().enumerate() {
                *covariance += with(sample.centred(index));
            }
        }
    }

    pub(crate) fn mean(&self, covariances: &Covariances) -> f64 {
        self.mean + dot(&covariances.others, &self.alpha)
    }

    /// The standard deviation of the mean at their point, noise left out. It overwrites them.
    pub(crate) fn deviation(&self, covariances: &mut Covariances) -> f64 {
        self.factor.forward(&mut covariances.others);
        let known = dot(&covariances.others, &covariances.others);
        let deviation = (self.variance * (covariances.own - known).max(VARIANCE_MIN)).sqrt();
        assert!(deviation > 0.0, "a deviation of {deviation}");
        deviation
    }

    /// The prior deviation there, before any measurement.
    pub(crate) fn deviation_max(&self, covariances: &Covariances) -> f64 {
        (self.variance * covariances.own).sqrt()
    }

    pub(crate) fn at(&self, context: &SharedFeatures, features: &[f64]) -> Posterior {
        let mut covariances = Covariances::default();
        self.covariances(context, features, &mut covariances);
        Posterior { mean: self.mean(&covariances), deviation: self.deviation(&mut covariances) }
    }

    /// The posterior of the value at `one` less that at `other`, two points in a context. For distances
    /// alone: the process must have neither a trend nor a linear feature.
    pub(crate) fn difference(&self, context: &SharedFeatures, one: &[f64], other: &[f64]) -> Posterior {
        assert!(self.trend == 0.0 && self.sample.linear.is_none(), "a process of distances alone");
        let (mut at_one, mut at_other) = (Covariances::default(), Covariances::default());
        self.covariances(context, one, &mut at_one);
        self.covariances(context, other, &mut at_other);
        let mean = self.mean(&at_one) - self.mean(&at_other);
        let from = context.features.len();
        let pairs = self.sample.kinds[from..].iter().zip(&self.weights[from..]).zip(one.iter().zip(other));
        let between: f64 =
            pairs.map(|((&kind, weight), (&a, &b))| weight * squared_distance(kind, a, b)).sum();
        at_one.own += at_other.own - 2.0 * matern(between).0;
        at_one.others.iter_mut().zip(&at_other.others).for_each(|(one, other)| *one -= other);
        Posterior { mean, deviation: self.deviation(&mut at_one) }
    }

    /// The deviation by which the mean at `one` is expected to move by a measurement at `other` that counts
    /// `count` times. The two points differ in categorical features only.
    pub(crate) fn moved_by(&self, one: &[f64], other: &[f64], count: f64) -> f64 {
        assert!(count > 0.0, "a measurement that counts {count} times");
        let (mut at_one, mut at_other) = (Covariances::default(), Covariances::default());
        self.covariances(&self.context(&[]), one, &mut at_one);
        self.covariances(&self.context(&[]), other, &mut at_other);
        let pairs = self.sample.kinds.iter().zip(&self.weights).zip(one.iter().zip(other));
        let between: f64 =
            pairs.map(|((&kind, weight), (&a, &b))| weight * squared_distance(kind, a, b)).sum();
        // Terms that do not depend on the distance are equal at both.
        let between = at_one.own - 1.0 + matern(between).0;
        self.factor.forward(&mut at_one.others);
        self.factor.forward(&mut at_other.others);
        let shared = between - dot(&at_one.others, &at_other.others);
        let own = (at_other.own - dot(&at_other.others, &at_other.others)).max(VARIANCE_MIN);
        let moved = self.variance.sqrt() * shared.abs() / (own + self.noise / self.variance / count).sqrt();
        assert!(moved >= 0.0, "a deviation of {moved}");
        moved
    }

    /// The likeliest difference of some of the values from the others, points being equal: the generalised
    /// least squares of a second mean. 0 where it cannot be estimated.
    pub(crate) fn shift_of(&self, is_one: impl Fn(usize) -> bool) -> f64 {
        let mut ones = vec![1.0; self.sample.len()];
        let mut some: Vec<f64> = (0..ones.len()).map(|index| f64::from(u8::from(is_one(index)))).collect();
        let sum = dot(&some, &self.alpha);
        self.factor.forward(&mut ones);
        self.factor.forward(&mut some);
        let shared = dot(&some, &ones);
        let own = dot(&some, &some) - shared * shared / dot(&ones, &ones);
        if own > VARIANCE_MIN { sum / own } else { 0.0 }
    }

    pub(crate) fn predict(&self, features: &[f64]) -> Posterior {
        self.at(&self.context(&[]), features)
    }
}
