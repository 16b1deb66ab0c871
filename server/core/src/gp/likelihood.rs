//! The likelihood of measurements under a covariance, and its gradient (Rasmussen and Williams, chapter
//! 5.4.1).
//!
//! Mean and variance of the values are not hyperparameters: for any correlations the likeliest have a closed
//! form, and the likelihood is taken at them.

use super::hyper::{Hyperparameters, Prior};
use super::sample::Sample;
use crate::matrix::{Factor, dot};

/// Values under given correlations.
pub(super) struct Profile {
    /// The likeliest mean.
    pub(super) mean: f64,
    /// The likeliest variance, the prior's share counted.
    pub(super) variance: f64,
    /// The logarithm of the density at both, but for a constant.
    pub(super) log_density: f64,
    /// The values less their mean, divided by the Cholesky factor.
    pub(super) whitened: Vec<f64>,
}

impl Profile {
    /// The profile of `values`, one for each row of the factorised correlations.
    pub(super) fn of(factor: &Factor, values: &[f64], prior: &Prior) -> Self {
        let count = values.len() as f64 + 1.0;
        let (mut ones, mut whitened) = (vec![1.0; values.len()], values.to_vec());
        factor.forward(&mut ones);
        factor.forward(&mut whitened);
        let mean = dot(&ones, &whitened) / dot(&ones, &ones);
        whitened.iter_mut().zip(&ones).for_each(|(y, one)| *y -= mean * one);
        let variance = (dot(&whitened, &whitened) + prior.squares) / count;
        assert!(variance.is_nan() || variance > 0.0, "the prior keeps a variance of {variance} from zero");
        let log_density = -0.5 * count * libm::log(variance) - factor.half_log_determinant();
        Profile { mean, variance, log_density, whitened }
    }
}

/// The gradient of [`Profile::log_density`] by the logarithms of the hyperparameters. `slopes` are the
/// derivatives that came with the correlations, `inverse` is their inverse, `alpha` the inverse times the
/// values less their mean.
pub(super) fn gradient(
    sample: &Sample,
    hyper: &Hyperparameters,
    slopes: &[f64],
    inverse: &[f64],
    alpha: &[f64],
    variance: f64,
) -> Vec<f64> {
    let (n, dimension) = (sample.len(), sample.dimension());
    assert!(slopes.len() == n * n && inverse.len() == n * n && alpha.len() == n, "{n} points");
    let pull = |p: usize, q: usize| alpha[p] * alpha[q] / variance - inverse[p * n + q];
    let mut gradient = vec![0.0; dimension + 2];
    let (weights, trend) = (hyper.weights(dimension), hyper.trend(dimension));
    let mut scratch = Vec::with_capacity(dimension);
    for p in 0..n {
        for q in 0..p {
            let factor = pull(p, q) * slopes[p * n + q];
            let distances = sample.distances(p, q, &mut scratch);
            gradient.iter_mut().zip(distances).for_each(|(sum, distance)| *sum += factor * distance);
        }
        // Each pair stands for two entries of the matrix, the diagonal for one.
        let entries = |q: usize| if p == q { 0.5 } else { 1.0 } * pull(p, q);
        if let Some(linear) = sample.linear {
            for column in &sample.terms {
                for q in 0..=p {
                    gradient[linear] += entries(q) * column[p] * column[q];
                }
            }
        }
        if trend > 0.0 {
            let own = sample.centred(p);
            let weighted: Vec<f64> = weights.iter().zip(own).map(|(w, x)| w * x).collect();
            for q in 0..=p {
                let other = sample.centred(q);
                let root = 1.0 + dot(&weighted, other);
                let factor = entries(q) * trend * root;
                for (sum, (a, b)) in gradient.iter_mut().zip(own.iter().zip(other)) {
                    *sum += 2.0 * factor * a * b;
                }
                gradient[dimension + 1] += factor * root;
            }
        }
    }
    gradient.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum *= weight);
    let noises = (0..n).map(|p| pull(p, p) / sample.counts[p]);
    gradient[dimension] = 0.5 * hyper.noise(dimension) * noises.sum::<f64>();
    gradient
}
