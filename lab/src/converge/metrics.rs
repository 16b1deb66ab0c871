//! The error of a picture against the reference: the relative mean squared error of linear radiance.
//!
//! For an unbiased estimator it falls as one over the number of samples (Rousselle, Knaus, Zwicker: Adaptive
//! Sampling and Reconstruction using Greedy Error Minimization, SIGGRAPH Asia 2011, with the small constant
//! taken relative to the scene's brightness).

use treewright_renderer::film::Picture;

/// Keeps nearly black pixels from deciding everything, as a share of the squared mean luminance.
const EPSILON: f64 = 0.01;

/// Compares pictures with one reference. What depends on the reference alone is computed once.
#[derive(Clone, Debug)]
pub(crate) struct Yardstick {
    reference: Picture,
    /// One over what a pixel's squared error is divided by, for each channel.
    weights: Vec<[f64; 3]>,
}

impl Yardstick {
    pub(crate) fn new(reference: Picture) -> Self {
        let mean = reference.mean_luminance();
        // A black reference has no brightness to be relative to.
        let floor = (EPSILON * mean * mean).max(f64::MIN_POSITIVE.sqrt());
        let weight = |value: f32| 1.0 / (f64::from(value) * f64::from(value) + floor);
        let weights = reference.pixels.iter().map(|pixel| pixel.to_array().map(weight)).collect();
        Self { reference, weights }
    }

    pub(crate) fn reference(&self) -> &Picture {
        &self.reference
    }

    /// Mean over pixels and channels of the squared error over the squared reference. 0 for equal pictures.
    pub(crate) fn relative_mse(&self, picture: &Picture) -> f64 {
        self.check(picture);
        self.mean_weighted(|index, channel| {
            f64::from(picture.pixels[index][channel]) - f64::from(self.reference.pixels[index][channel])
        })
    }

    /// Mean over pixels and channels of `difference(pixel, channel)²`, divided like the squared error.
    pub(super) fn mean_weighted(&self, difference: impl Fn(usize, usize) -> f64) -> f64 {
        let sum: f64 = self
            .weights
            .iter()
            .enumerate()
            .flat_map(|(index, weights)| {
                weights.iter().enumerate().map(move |(channel, weight)| (index, channel, weight))
            })
            .map(|(index, channel, weight)| difference(index, channel).powi(2) * weight)
            .sum();
        sum / (self.weights.len() * 3) as f64
    }

    fn check(&self, picture: &Picture) {
        assert_eq!(
            (picture.width, picture.height),
            (self.reference.width, self.reference.height),
            "pictures are compared with a reference of their size"
        );
    }
}

#[cfg(test)]
#[path = "metrics_tests.rs"]
mod tests;
