//! What is learnt of the covariance, and how: by climbing the posterior density of lengths and noise.
//!
//! The steps are those of [`ascent`](crate::ascent). The prior on lengths grows with the root of the dimension (Hvarfner, Hellsten and Nardi, ICML 2024).

use serde::{Deserialize, Serialize};

use super::field::{Field, Rows, shape};
use crate::ascent::climb;

/// Logarithms of each axis' weight (the inverse square of its length), then of the noise's variance as a
/// share of the values'.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Hyper {
    log: Vec<f64>,
    steps: Vec<f64>,
    signs: Vec<i8>,
}

/// The prior: the middle of a length in roots of the dimension and the spread of its logarithm, and the same
/// of the noise's variance. A few dozen lessons say little about lengths, so that they are held close together: mean
/// regret over the fifteen problems of `examples/contextual` was 0.34 with a length of 0.5 and a spread of 1, 0.31 with
/// a spread of 0.5, 0.30 with these. Kernels with a kink, a quadratic trend or costs without a logarithm did no better.
const LENGTH_MEAN: f64 = 0.4;
const LENGTH_SPREAD: f64 = 0.35;
const NOISE_MEAN: f64 = 0.01;
const NOISE_SPREAD: f64 = 1.5;
const STEP_START: f64 = 0.3;
const STEP_MIN: f64 = 0.01;
const STEP_MAX: f64 = 0.8;
/// Weights and noise stay within this, so that no sequence of lessons drives them out of range.
const WEIGHT_RANGE: [f64; 2] = [1e-6, 1e4];
const NOISE_RANGE: [f64; 2] = [1e-5, 4.0];

impl Hyper {
    /// The middle of the prior.
    pub(super) fn new(dimension: usize) -> Self {
        let mut log = vec![Self::weight_mean(dimension); dimension];
        log.push(NOISE_MEAN.ln());
        Hyper { steps: vec![STEP_START; log.len()], signs: vec![0; log.len()], log }
    }

    fn weight_mean(dimension: usize) -> f64 {
        -2.0 * LENGTH_MEAN.ln() - (dimension.max(1) as f64).ln()
    }

    /// The weight of each axis.
    pub(super) fn weights(&self) -> Vec<f64> {
        self.log[..self.log.len() - 1].iter().map(|&log| libm::exp(log)).collect()
    }

    /// The noise's variance as a share of the values'.
    pub(super) fn noise(&self) -> f64 {
        libm::exp(self.log[self.log.len() - 1])
    }

    /// One step up. Leaves everything as it is when the rows cannot be fitted.
    pub(super) fn climb(&mut self, rows: &Rows, values: &[f64]) {
        let Some(field) = Field::fit(rows, values, self) else {
            return;
        };
        let gradient = self.gradient(rows, &field);
        let dimension = self.log.len() - 1;
        let prior = [
            (Self::weight_mean(dimension), 2.0 * LENGTH_SPREAD, WEIGHT_RANGE),
            (NOISE_MEAN.ln(), NOISE_SPREAD, NOISE_RANGE),
        ];
        for (index, likelihood) in gradient.into_iter().enumerate() {
            let (mean, spread, range) = prior[usize::from(index == dimension)];
            let slope = likelihood - (self.log[index] - mean) / (spread * spread);
            let (log, step) = (&mut self.log[index], &mut self.steps[index]);
            climb(log, step, &mut self.signs[index], slope, [STEP_MIN, STEP_MAX]);
            *log = log.clamp(range[0].ln(), range[1].ln());
        }
    }

    /// The gradient of the log likelihood by the logarithms of weights and noise (Rasmussen and Williams,
    /// "Gaussian Processes for Machine Learning", 2006, equation 5.9).
    fn gradient(&self, rows: &Rows, field: &Field<'_>) -> Vec<f64> {
        let (n, dimension) = (rows.len(), rows.dimension());
        let weights = self.weights();
        let inverse = field.inverse();
        let pull = |p: usize, q: usize| field.alpha[p] * field.alpha[q] / field.variance - inverse[p * n + q];
        let mut gradient = vec![0.0; dimension + 1];
        let mut apart = vec![0.0; dimension];
        for p in 0..n {
            for q in 0..p {
                rows.apart(p, q, &mut apart);
                let squared: f64 = weights.iter().zip(&apart).map(|(weight, apart)| weight * apart).sum();
                let factor = pull(p, q) * shape(squared).1;
                gradient.iter_mut().zip(&apart).for_each(|(sum, apart)| *sum += factor * apart);
            }
        }
        gradient.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum *= weight);
        let own = (0..n).map(|p| pull(p, p) / rows.counts[p]);
        gradient[dimension] = 0.5 * self.noise() * own.sum::<f64>();
        gradient
    }
}
