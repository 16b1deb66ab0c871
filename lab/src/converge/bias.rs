//! Bias: the part of a picture's error that does not fall with the number of samples.
//!
//! An error curve that flattens could show it, but where few bright pixels decide the error such a curve is
//! bent by chance. The runs' mean picture shows it directly: its squared error is the squared bias plus its
//! own variance plus the reference's. The first variance follows from the differences of the runs, the second
//! from those of the reference's halves. Both are subtracted pixel by pixel, so that a bright dot cancels
//! against itself. The rest is zero in expectation for an unbiased estimator (the usual unbiased estimate of
//! a squared mean, see for example Casella and Berger, Statistical Inference, 2002, section 7.3). Pixels are
//! independent of each other, which gives the interval. While bright dots are so few that no pixel saw two of
//! them, it lies rather too low than too high.

use super::bootstrap::Interval;
use super::metrics::Yardstick;
use super::reference::Reference;
use treewright_renderer::film::Picture;

/// Half the width of a 95 % interval of a normal distribution, in standard deviations.
const NORMAL_95: f64 = 1.959_964;

/// Mean and spread of independent pictures, pixel by pixel (Welford 1962).
#[derive(Clone, Debug, Default)]
pub struct Moments {
    count: u32,
    mean: Vec<[f64; 3]>,
    /// Sums of squared deviations from the mean.
    squares: Vec<[f64; 3]>,
}

impl Moments {
    /// Takes another picture in.
    ///
    /// # Panics
    /// If it is of another size than the first.
    pub fn add(&mut self, picture: &Picture) {
        if self.count == 0 {
            self.mean = vec![[0.0; 3]; picture.pixels.len()];
            self.squares = self.mean.clone();
        }
        assert_eq!(self.mean.len(), picture.pixels.len(), "pictures of one size are averaged");
        self.count += 1;
        for ((mean, squares), pixel) in self.mean.iter_mut().zip(&mut self.squares).zip(&picture.pixels) {
            for channel in 0..3 {
                let value = f64::from(pixel[channel]);
                let before = value - mean[channel];
                mean[channel] += before / f64::from(self.count);
                squares[channel] += before * (value - mean[channel]);
            }
        }
    }

    /// Squared bias relative to the reference, in the units of the relative mean squared error. `None` for
    /// fewer than two pictures. May be negative by chance.
    pub fn squared_bias(&self, reference: &Reference, yardstick: &Yardstick) -> Option<Interval> {
        if self.count < 2 {
            return None;
        }
        let count = f64::from(self.count);
        let [first, second] = &reference.halves;
        let truth = yardstick.reference();
        let (mut sum, mut sum_of_squares) = (0.0, 0.0);
        for (pixel, weights) in yardstick.weights().iter().enumerate() {
            let excess: f64 = (0..3)
                .map(|channel| {
                    let error = self.mean[pixel][channel] - f64::from(truth.pixels[pixel][channel]);
                    let variance = self.squares[pixel][channel] / (count - 1.0) / count;
                    let between = first.pixels[pixel][channel] - second.pixels[pixel][channel];
                    let floor = (0.5 * f64::from(between)).powi(2);
                    weights[channel] * (error * error - variance - floor)
                })
                .sum();
            sum += excess / 3.0;
            sum_of_squares += (excess / 3.0).powi(2);
        }
        let pixels = yardstick.weights().len() as f64;
        let estimate = sum / pixels;
        let spread = (sum_of_squares / pixels - estimate * estimate).max(0.0);
        let half = NORMAL_95 * (spread / pixels).sqrt();
        Some(Interval { estimate, range: Some([estimate - half, estimate + half]) })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::converge::testing::key;

    const SIZE: [u32; 2] = [64, 48];

    /// A picture of brightness 1 + `offset` whose pixels are mostly dark and rarely very bright.
    fn noisy(random: &mut ChaCha8Rng, offset: f32) -> Picture {
        let pixels = (0..SIZE[0] * SIZE[1])
            .map(|_| {
                let bright = if random.random::<f32>() < 0.01 { 50.0 } else { 0.0 };
                Vec3::splat(0.4 + 0.2 * random.random::<f32>() + bright + offset)
            })
            .collect();
        Picture { width: SIZE[0], height: SIZE[1], pixels }
    }

    fn mean_of(random: &mut ChaCha8Rng, count: usize) -> Picture {
        let mut sum = noisy(random, 0.0);
        for _ in 1..count {
            for (sum, pixel) in sum.pixels.iter_mut().zip(noisy(random, 0.0).pixels) {
                *sum += pixel;
            }
        }
        sum.pixels.iter_mut().for_each(|pixel| *pixel /= count as f32);
        sum
    }

    fn estimates(offset: f32) -> Vec<(Interval, f64)> {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        (0..24)
            .map(|_| {
                let halves = [mean_of(&mut random, 60), mean_of(&mut random, 60)];
                let reference = Reference { key: key(SIZE), samples_each: 60, halves };
                let yardstick = Yardstick::new(reference.picture());
                let mut moments = Moments::default();
                assert_eq!(moments.squared_bias(&reference, &yardstick), None);
                for _ in 0..5 {
                    moments.add(&noisy(&mut random, offset));
                }
                let found = moments.squared_bias(&reference, &yardstick).expect("five are enough");
                (found, reference.floor(&yardstick))
            })
            .collect()
    }

    #[test]
    fn rare_bright_dots_are_no_bias() {
        let found = estimates(0.0);
        assert!(
            found.iter().all(|(one, floor)| one.range.is_some_and(|[low, _]| low <= *floor)),
            "{found:?}"
        );
        let values: Vec<f64> = found.iter().map(|(one, _)| one.estimate).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 23.0;
        assert!(mean.abs() < 3.0 * (variance / 24.0).sqrt(), "zero is expected, {mean} was found");
    }

    #[test]
    fn what_is_too_bright_everywhere_is() {
        for (found, floor) in estimates(3.0) {
            // Weights vary with the noise of the reference; about 9 over its square is expected.
            assert!(found.range.is_some_and(|[low, _]| low > floor), "{found:?}");
        }
    }
}
