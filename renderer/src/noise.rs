//! The noise of a picture without a reference, from two halves of its samples that are independent.

use serde::{Deserialize, Serialize};

use crate::bias::{Bias, FLOOR, Squares};
use crate::{film::Picture, integrator::sampling::luminance};

/// The share of pixels of the largest error that is left out: a few dots would otherwise decide.
const TRIMMED: f64 = 1e-3;
/// Edge of the squares over which brightness is averaged for the weights, in pixels.
const BLOCK: u32 = 8;

/// Samples of each half where noise is measured.
pub const HALF_SAMPLES: u32 = 4;
/// Samples of the picture whose brightness errors are relative to, in two halves.
pub(crate) const WEIGHT_SAMPLES: u32 = 16;
/// The relative variance that counts as arrived: errors of a tenth.
pub const TARGET_VARIANCE: f64 = 0.01;

/// The measured noise of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameNoise {
    /// Mean relative variance of the luminance of a picture of twice [`HALF_SAMPLES`] samples a pixel.
    pub relative_variance: f64,
    /// Of that mean, by how squares of pixels differ.
    pub standard_error: f64,
    /// Samples a pixel until the variance is [`TARGET_VARIANCE`], if each brings as much as these did.
    pub samples_to_error: f64,
    /// What differs most from the picture that errors are relative to, by more than noise would make it.
    #[serde(skip)]
    pub bias: Option<Bias>,
}

/// The weight of error in each pixel: one over the square of the brightness around it.
#[derive(Clone, Debug)]
pub struct Weights {
    of_pixel: Vec<f64>,
    /// The picture that they are of.
    expected: Squares,
}

impl Weights {
    /// By the brightness of the mean of two pictures that are drawn independently of each other.
    pub fn of(halves: [&Picture; 2]) -> Self {
        let [first, second] = halves;
        let (width, height) = (first.width as usize, first.height as usize);
        let mean = 0.5 * (first.mean_luminance() + second.mean_luminance());
        let edge = BLOCK as usize;
        let across = width.div_ceil(edge);
        let [one, other] = halves.map(|half| half.block_luminances(BLOCK));
        let brightness: Vec<f64> = one.iter().zip(&other).map(|(a, b)| 0.5 * (a + b)).collect();
        let floor = (FLOOR * mean).max(f64::MIN_POSITIVE.sqrt());
        let weight = |pixel: usize| {
            let around = brightness[pixel / width / edge * across + pixel % width / edge];
            1.0 / (around * around + floor * floor)
        };
        Self { of_pixel: (0..width * height).map(weight).collect(), expected: Squares::of(halves) }
    }
}

impl FrameNoise {
    /// Of the mean of two pictures that are drawn independently of each other.
    ///
    /// # Panics
    /// If the sizes differ.
    pub(crate) fn of(halves: [&Picture; 2], weights: &Weights) -> Self {
        let [first, second] = halves;
        assert!(first.pixels.len() == second.pixels.len() && first.pixels.len() == weights.of_pixel.len());
        // Each half is off by the square of their distance over two in the mean, both together by half that.
        let errors: Vec<f64> = first
            .pixels
            .iter()
            .zip(&second.pixels)
            .zip(&weights.of_pixel)
            .map(|((&first, &second), weight)| {
                let distance = f64::from(luminance(first) - luminance(second));
                distance * distance * weight * 0.25
            })
            .collect();
        let left_out = (errors.len() as f64 * TRIMMED) as usize;
        let mut sorted = errors.clone();
        let limit = match left_out {
            0 => f64::INFINITY,
            _ => *sorted.select_nth_unstable_by(errors.len() - left_out, f64::total_cmp).1,
        };
        let kept = |error: f64| if error < limit { error } else { 0.0 };
        let count = errors.len() as f64;
        let relative_variance = errors.iter().map(|&error| kept(error)).sum::<f64>() / count;
        let width = first.width as usize;
        let rows = errors.chunks(width * BLOCK as usize);
        let groups: Vec<f64> = rows
            .flat_map(|rows| {
                (0..width.div_ceil(BLOCK as usize)).map(move |column| {
                    let range = column * BLOCK as usize..((column + 1) * BLOCK as usize).min(width);
                    let row = |row: &[f64]| row[range.clone()].iter().map(|&error| kept(error)).sum::<f64>();
                    rows.chunks(width).map(row).sum()
                })
            })
            .collect();
        let mean = groups.iter().sum::<f64>() / groups.len() as f64;
        let spread = groups.iter().map(|group| (group - mean).powi(2)).sum::<f64>();
        let samples = f64::from(2 * HALF_SAMPLES);
        Self {
            relative_variance,
            standard_error: spread.sqrt() / count,
            samples_to_error: samples * relative_variance / TARGET_VARIANCE,
            bias: Squares::of(halves).bias(&weights.expected),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn noisy(level: f32, deviation: f32, random: &mut ChaCha8Rng) -> Picture {
        // Even noise from -1 to 1 has a variance of a third.
        let reach = deviation * 3.0_f32.sqrt();
        let pixels = (0..64 * 48).map(|_| Vec3::splat(level + reach * (2.0 * random.random::<f32>() - 1.0)));
        Picture { width: 64, height: 48, pixels: pixels.collect() }
    }

    fn weights(level: f32, random: &mut ChaCha8Rng) -> Weights {
        Weights::of([&noisy(level, 0.0, random), &noisy(level, 0.0, random)])
    }

    #[test]
    fn the_error_of_a_known_noise_is_found() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for (level, deviation) in [(2.0, 0.4), (0.01, 0.001), (500.0, 200.0)] {
            let weights = weights(level, &mut random);
            let halves = [0, 1].map(|_| noisy(level, deviation, &mut random));
            let noise = FrameNoise::of([&halves[0], &halves[1]], &weights);
            // The mean of two halves has half the variance; a hundredth of the weight is the floor's.
            let expected = 0.5 * f64::from(deviation / level).powi(2) / (1.0 + FLOOR * FLOOR);
            let off = (noise.relative_variance / expected - 1.0).abs();
            assert!(off < 0.08, "{level}: {} and {expected}", noise.relative_variance);
            assert!(noise.standard_error > 0.005 * expected && noise.standard_error < 0.05 * expected);
            assert_eq!(noise.bias, None);
            assert!((noise.samples_to_error - 800.0 * noise.relative_variance).abs() < 1e-9);
        }
    }

    #[test]
    fn a_few_bright_dots_do_not_decide_and_black_pictures_have_no_error() {
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let weights = weights(1.0, &mut random);
        let mut halves = [0, 1].map(|_| noisy(1.0, 0.1, &mut random));
        let before = FrameNoise::of([&halves[0], &halves[1]], &weights).relative_variance;
        halves[0].pixels[77] = Vec3::splat(1e6);
        let after = FrameNoise::of([&halves[0], &halves[1]], &weights).relative_variance;
        assert!((after / before - 1.0).abs() < 0.05);
        let black = noisy(0.0, 0.0, &mut random);
        let noise = FrameNoise::of([&black, &black], &Weights::of([&black, &black]));
        assert_eq!((noise.relative_variance, noise.bias), (0.0, None));
    }
}
