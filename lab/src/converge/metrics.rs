//! The error of a picture against the reference.
//!
//! Three numbers. The relative mean squared error is computed on linear radiance and is what theory speaks
//! about: for an unbiased estimator it falls as one over the number of samples (Rousselle, Knaus, Zwicker:
//! Adaptive Sampling and Reconstruction using Greedy Error Minimization, SIGGRAPH Asia 2011, with the small
//! constant taken relative to the scene's brightness). Structural similarity (see `ssim`) and the difference
//! that people notice (see `flip`) are computed on pictures as people see them, all tone-mapped alike.

use glam::Vec3;

use super::flip::Flip;
use super::ssim::Similarity;
use treewright_renderer::film::Picture;
use treewright_renderer::image_file::{Exposure, exposure_factor};
use treewright_renderer::tone::displayed;

/// Keeps nearly black pixels from deciding everything, as a share of the squared mean luminance.
const EPSILON: f64 = 0.01;

/// Compares pictures with one reference. What depends on the reference alone is computed once.
#[derive(Clone, Debug)]
pub struct Yardstick {
    reference: Picture,
    /// One over what a pixel's squared error is divided by, for each channel.
    weights: Vec<[f64; 3]>,
    /// Factor on radiance before every picture is developed.
    exposure: f32,
    structure: Similarity,
    appearance: Flip,
}

impl Yardstick {
    /// Compares with this reference.
    pub fn new(reference: Picture) -> Self {
        let mean = reference.mean_luminance();
        // A black reference has no brightness to be relative to.
        let floor = (EPSILON * mean * mean).max(f64::MIN_POSITIVE.sqrt());
        let weight = |value: f32| 1.0 / (f64::from(value) * f64::from(value) + floor);
        let weights = reference.pixels.iter().map(|pixel| pixel.to_array().map(weight)).collect();
        let exposure = exposure_factor(&reference, Exposure::Auto);
        let shown = shown_luminance(&reference, exposure);
        let width = reference.width as usize;
        let structure = Similarity::new(width, shown);
        let appearance = Flip::new(width, &shown_colours(&reference, exposure));
        Self { reference, weights, exposure, structure, appearance }
    }

    /// The reference.
    pub fn reference(&self) -> &Picture {
        &self.reference
    }

    /// Mean over pixels and channels of the squared error over the squared reference. 0 for the same picture.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn relative_mse(&self, picture: &Picture) -> f64 {
        self.check(picture);
        self.mean_weighted(|index, channel| {
            f64::from(picture.pixels[index][channel]) - f64::from(self.reference.pixels[index][channel])
        })
    }

    /// The weight of squared errors, for each channel of each pixel.
    pub(super) fn weights(&self) -> &[[f64; 3]] {
        &self.weights
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

    /// Mean structural similarity of the luminance as shown: 1 for the same picture.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn ssim(&self, picture: &Picture) -> f64 {
        self.check(picture);
        self.structure.to(&shown_luminance(picture, self.exposure))
    }

    /// Mean FLIP of the colours as shown: 0 for the same picture, 1 at most.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn flip(&self, picture: &Picture) -> f64 {
        self.check(picture);
        self.appearance.to(&shown_colours(picture, self.exposure))
    }

    fn check(&self, picture: &Picture) {
        assert_eq!(
            (picture.width, picture.height),
            (self.reference.width, self.reference.height),
            "pictures are compared with a reference of their size"
        );
    }
}

/// A picture as it is shown.
fn shown_colours(picture: &Picture, exposure: f32) -> Vec<Vec3> {
    picture.pixels.iter().map(|pixel| displayed(*pixel * exposure)).collect()
}

/// Luminance of a picture as it is shown, 0 to 1 (ITU-R BT.709, on encoded values as video does it).
fn shown_luminance(picture: &Picture, exposure: f32) -> Vec<f64> {
    let weights = Vec3::new(0.2126, 0.7152, 0.0722);
    picture.pixels.iter().map(|pixel| f64::from(displayed(*pixel * exposure).dot(weights))).collect()
}

#[cfg(test)]
#[path = "metrics_tests.rs"]
mod tests;
