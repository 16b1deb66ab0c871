//! Hyperparameters of the covariance: lengths, noise and the share of a trend, by climbing their posterior
//! density.
//!
//! A few dozen measurements say little about lengths, so that the prior matters. Its middle grows with the
//! root of the dimension, so that a few points do not look unrelated in many dimensions (Hvarfner, Hellsten
//! and Nardi, "Vanilla Bayesian optimization performs great in high dimensions", ICML 2024). The steps of
//! `ascent` only need signs of the gradient, and go on from their last state when points are added.

use serde::{Deserialize, Serialize};

use super::ascent::ascend;
use super::kernel::FeatureKind;

/// Hyperparameters as logarithms, with the state of their ascent. Stored with searches and predictors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Hyperparameters {
    /// Logarithms of each feature's weight, of the noise's variance and, where there is a trend, of the
    /// trend's variance, as shares of the values' variance. A weight is the inverse square of a length; for a
    /// linear feature it is the variance of its coefficient.
    log: Vec<f64>,
    steps: Vec<f64>,
    signs: Vec<i8>,
}

/// The prior before anything is measured. Spreads are standard deviations of logarithms.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// The middle of a length, in roots of the number of features.
    pub(crate) length_mean: f64,
    pub(crate) length_spread: f64,
    pub(crate) weight_range: [f64; 2],
    /// The middle of the noise's variance, as a share of the values'.
    pub(crate) noise_mean: f64,
    pub(crate) noise_spread: f64,
    pub(crate) noise_range: [f64; 2],
    /// The prior's part in the sum of squares of the values: it equals one more value, so that few or equal
    /// values do not make the variance zero.
    pub(crate) squares: f64,
    pub(crate) step_max: f64,
}

const STEP_START: f64 = 0.3;
const STEP_MIN: f64 = 0.01;
/// The share of the trend: middle, spread and range.
const TREND_MEAN: f64 = 1.0;
const TREND_SPREAD: f64 = 2.0;
const TREND_RANGE: [f64; 2] = [1e-4, 1e4];
/// The variance of the coefficient of a linear feature: middle and spread.
const LINEAR_MEAN: f64 = 1.0;
const LINEAR_SPREAD: f64 = 2.0;

impl Prior {
    /// One that hardly holds anything back: for few measurements in many dimensions.
    pub(crate) const WEAK: Prior = Prior {
        length_mean: 0.5,
        length_spread: 1.0,
        weight_range: [1e-6, 1e6],
        noise_mean: 0.02,
        noise_spread: 1.5,
        noise_range: [1e-6, 4.0],
        squares: 1e-3,
        step_max: 1.0,
    };

    /// Middle, spread and range of the logarithm of a hyperparameter.
    fn of(&self, index: usize, kinds: &[FeatureKind]) -> (f64, f64, [f64; 2]) {
        match index.checked_sub(kinds.len()) {
            None if kinds[index] == FeatureKind::Linear => {
                (libm::log(LINEAR_MEAN), LINEAR_SPREAD, self.weight_range)
            }
            // A weight is the inverse square of a length.
            None => {
                let mean = -2.0 * libm::log(self.length_mean) - libm::log(kinds.len() as f64);
                (mean, 2.0 * self.length_spread, self.weight_range)
            }
            Some(0) => (libm::log(self.noise_mean), self.noise_spread, self.noise_range),
            Some(_) => (libm::log(TREND_MEAN), TREND_SPREAD, TREND_RANGE),
        }
    }
}

impl Hyperparameters {
    /// The middle of the prior, for a process without a trend.
    pub(crate) fn new(kinds: &[FeatureKind], prior: &Prior) -> Self {
        Self::of(kinds, prior, kinds.len() + 1)
    }

    fn of(kinds: &[FeatureKind], prior: &Prior, count: usize) -> Self {
        let log = (0..count).map(|index| prior.of(index, kinds).0).collect();
        Hyperparameters { log, steps: vec![STEP_START; count], signs: vec![0; count] }
    }

    /// Whether they are of a process of `dimension` features without a trend.
    pub(crate) fn fits(&self, dimension: usize) -> bool {
        [self.log.len(), self.steps.len(), self.signs.len()] == [dimension + 1; 3]
    }

    /// The start of ascent for a process with a quadratic trend.
    pub(crate) fn with_trend(kinds: &[FeatureKind], prior: &Prior) -> Self {
        Self::of(kinds, prior, kinds.len() + 2)
    }

    /// The weights of the features in squared distances.
    pub(crate) fn weights(&self, dimension: usize) -> Vec<f64> {
        self.log[..dimension].iter().map(|&log| libm::exp(log)).collect()
    }

    /// The noise's variance as a share of the values'.
    pub(super) fn noise(&self, dimension: usize) -> f64 {
        libm::exp(self.log[dimension])
    }

    /// The trend's variance as a share of the values'; zero where there is no trend.
    pub(super) fn trend(&self, dimension: usize) -> f64 {
        self.log.get(dimension + 1).map_or(0.0, |&log| libm::exp(log))
    }

    /// One step up the log posterior density, whose likelihood has this gradient.
    pub(super) fn ascend(&mut self, kinds: &[FeatureKind], gradient: &[f64], prior: &Prior) {
        for (index, &likelihood) in gradient.iter().enumerate().take(self.log.len()) {
            let (mean, spread, range) = prior.of(index, kinds);
            assert!(spread > 0.0 && range[0] < range[1], "a prior of {spread} within {range:?}");
            let (log, step) = (&mut self.log[index], &mut self.steps[index]);
            let slope = likelihood - (*log - mean) / (spread * spread);
            ascend(log, step, &mut self.signs[index], slope, [STEP_MIN, prior.step_max]);
            *log = log.clamp(libm::log(range[0]), libm::log(range[1]));
        }
    }

    #[cfg(test)]
    pub(super) fn log_mut(&mut self) -> &mut [f64] {
        &mut self.log
    }
}
