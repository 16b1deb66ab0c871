//! The guard of light sampling: whether the means of a picture's squares are what they should be.
//!
//! Each way is compared with the plain one, square by square and in the whole, by standard errors of two
//! independent halves. Bright dots are rare, so a square's noise counts as at least the picture's mean,
//! relative to brightness. No dot is left out, for another way may find it everywhere.
//!
//! A look has a false alarm in fewer than one of a hundred trials: five standard errors leave room for skewed
//! means where Bonferroni's inequality asks for 3.7. An alarm counts only if a second look finds the same
//! square off in the same direction.

use std::fmt;

use crate::{film::Picture, integrator::sampling::luminance};

/// Most squares across and down.
const SQUARES_MAX: [u32; 2] = [8, 6];
/// Fewest pixels of a square along either side where there is more than one: means of few are too skewed.
const EDGE_MIN: u32 = 16;
/// Standard errors beyond which a mean is off.
const BOUND: f64 = 5.0;
/// Relative differences up to this pass.
const TOLERANCE: f64 = 0.01;
/// Errors are relative to brightness; darkness below this share of the picture's mean counts as that.
pub(crate) const FLOOR: f64 = 0.1;

/// A mean that is off by more than noise would make it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias {
    /// Number of the square, row by row from 1; 0 for the whole picture.
    pub square: usize,
    /// Squares in a row.
    pub across: usize,
    /// Mean luminance.
    pub brightness: f64,
    /// The mean luminance that it should have.
    pub expected: f64,
    /// The difference beyond the tolerance in standard errors; negative where it is too dark.
    pub deviation: f64,
}

impl fmt::Display for Bias {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "the brightness of the picture")?;
        if let Some(square) = self.square.checked_sub(1) {
            let (column, row) = (square % self.across + 1, square / self.across + 1);
            write!(formatter, "'s square in column {column} of {}, row {row},", self.across)?;
        }
        match self.brightness / self.expected {
            ratio if ratio.is_finite() => write!(formatter, " is {ratio:.2} times what it should be")?,
            _ => write!(formatter, " should be 0")?,
        }
        let deviation = self.deviation.abs();
        write!(formatter, ", {deviation:.0} standard errors off: this sampling is not sound here")
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Square {
    pixels: f64,
    brightness: f64,
    /// Of that mean.
    variance: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct Squares {
    across: usize,
    /// The whole picture, and then its squares row by row.
    all: Vec<Square>,
}

impl Squares {
    /// Of the mean of two pictures of one size that are drawn independently of each other.
    pub(crate) fn of(halves: [&Picture; 2]) -> Self {
        let [first, second] = halves;
        let (width, height) = (first.width as usize, first.height as usize);
        let [across, down] = [(first.width, SQUARES_MAX[0]), (first.height, SQUARES_MAX[1])]
            .map(|(edge, most)| (edge / EDGE_MIN).clamp(1, most) as usize);
        let mut all = vec![Square::default(); 1 + across * down];
        for (pixel, (&first, &second)) in first.pixels.iter().zip(&second.pixels).enumerate() {
            let (row, column) = (pixel / width * down / height, pixel % width * across / width);
            let [first, second] = [first, second].map(|value| f64::from(luminance(value)));
            for part in [0, 1 + row * across + column] {
                all[part].pixels += 1.0;
                all[part].brightness += 0.5 * (first + second);
                // See `FrameNoise::of`.
                all[part].variance += 0.25 * (first - second).powi(2);
            }
        }
        for part in &mut all {
            part.brightness /= part.pixels;
            part.variance /= part.pixels * part.pixels;
        }
        Self { across, all }
    }

    /// [`Bias::deviation`] of the whole and of each square.
    fn deviations(&self, expected: &Self) -> Vec<f64> {
        let pairs = || self.all.iter().zip(&expected.all);
        // A square without one of the dots that it should have is not dark.
        let brighter = |(own, other): (&Square, &Square)| own.brightness.max(other.brightness);
        let variance = |(own, other): (&Square, &Square)| own.variance + other.variance;
        let floor = FLOOR * brighter((&self.all[0], &expected.all[0]));
        let unit = |pair: (&Square, &Square)| (brighter(pair).powi(2) + floor * floor) / pair.0.pixels;
        let relative = pairs().skip(1).map(|pair| variance(pair) / unit(pair));
        let typical = relative.sum::<f64>() / (self.all.len() - 1) as f64;
        pairs()
            .map(|pair| {
                let difference = pair.0.brightness - pair.1.brightness;
                let beyond = (difference.abs() - TOLERANCE * brighter(pair)).max(0.0);
                // Of black pictures the typical one is not a number, and the maximum is the other.
                let variance = variance(pair).max(typical * unit(pair));
                (beyond / variance.sqrt().max(f64::MIN_POSITIVE)).copysign(difference)
            })
            .collect()
    }

    /// What is off most, if anything is.
    pub(crate) fn bias(&self, expected: &Self) -> Option<Bias> {
        let deviations = self.deviations(expected).into_iter().enumerate();
        let (square, deviation) = deviations.max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))?;
        let [brightness, expected] = [self, expected].map(|one| one.all[square].brightness);
        let bias = Bias { square, across: self.across, brightness, expected, deviation };
        (deviation.abs() > BOUND).then_some(bias)
    }

    /// Whether another look at both finds the same.
    pub(crate) fn confirms(&self, expected: &Self, bias: &Bias) -> bool {
        let found = self.deviations(expected).get(bias.square).copied();
        found.is_some_and(|found| found * bias.deviation.signum() > BOUND)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const ACROSS: u32 = 6;
    const WIDTH: u32 = 16 * ACROSS;
    const HEIGHT: u32 = 64;

    /// Light of a sample, of mean 1, by a number in [0, 1).
    type Light = fn(f32) -> f32;

    fn even(number: f32) -> f32 {
        0.75 + 0.5 * number
    }

    /// Pareto's law of exponent 3/2, whose variance is infinite.
    fn heavy(number: f32) -> f32 {
        (1.0 - number).powf(-2.0 / 3.0) / 3.0
    }

    /// One of 2,000 samples, which many squares have none of, brings a fifth of the light.
    fn dotted(number: f32) -> f32 {
        if number < 5e-4 { 400.8 } else { 0.8 }
    }

    /// Halves with this number of samples each, a part of which is darkened.
    fn drawn(
        light: Light,
        samples: u32,
        factor: impl Fn(u32, u32) -> f32,
        random: &mut ChaCha8Rng,
    ) -> Squares {
        let halves = [0, 1].map(|_| {
            let mut pixel = |x, y| {
                let sum: f32 = (0..samples).map(|_| light(random.random())).sum();
                Vec3::splat(sum / samples as f32 * factor(x, y))
            };
            let pixels = (0..HEIGHT * WIDTH).map(|index| pixel(index % WIDTH, index / WIDTH)).collect();
            Picture { width: WIDTH, height: HEIGHT, pixels }
        });
        Squares::of(halves.each_ref())
    }

    fn look(expected: Light, way: Light, random: &mut ChaCha8Rng) -> (Squares, Squares) {
        (drawn(way, 4, |_, _| 1.0, random), drawn(expected, 8, |_, _| 1.0, random))
    }

    #[test]
    fn looks_have_few_false_alarms_and_second_ones_confirm_none() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let pairs: [(Light, Light); 6] =
            [(even, even), (heavy, even), (even, heavy), (heavy, heavy), (dotted, even), (even, dotted)];
        let (trials, mut alarms) = (100, 0);
        for (expected, way) in pairs {
            for _ in 0..trials {
                let (found, known) = look(expected, way, &mut random);
                if let Some(bias) = found.bias(&known) {
                    alarms += 1;
                    let (found, known) = look(expected, way, &mut random);
                    assert!(!found.confirms(&known, &bias), "{bias}");
                }
            }
        }
        assert!(alarms <= pairs.len() * trials / 100, "{alarms} alarms");
    }

    #[test]
    fn a_square_that_is_darker_by_a_twentieth_is_found_again_and_named() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let darker = |x: u32, y: u32| if x / 16 == 2 && y / 16 == 1 { 0.95 } else { 1.0 };
        for _ in 0..10 {
            let [found, again] = [0, 1].map(|_| drawn(even, 4, darker, &mut random));
            let [known, known_again] = [0, 1].map(|_| drawn(even, 8, |_, _| 1.0, &mut random));
            let bias = found.bias(&known).expect("it is ten standard errors off");
            assert!(again.confirms(&known_again, &bias) && !known_again.confirms(&known, &bias), "{bias:?}");
            assert!(bias.to_string().contains("square in column 3 of 6, row 2, is 0.9"), "{bias}");
            // Too bright elsewhere is not the same.
            assert!(!known_again.confirms(&again, &bias));
        }
    }

    #[test]
    fn a_picture_that_is_darker_everywhere_is_found_as_a_whole() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let found = drawn(even, 4, |_, _| 0.98, &mut random);
        let bias = found.bias(&drawn(even, 8, |_, _| 1.0, &mut random)).expect("it is off");
        assert_eq!(bias.square, 0, "{bias}");
        assert!(bias.to_string().starts_with("the brightness of the picture is 0.98 times"), "{bias}");
        let black = drawn(|_| 0.0, 4, |_, _| 1.0, &mut random);
        assert_eq!(black.bias(&black), None);
        let lit = found.bias(&black).expect("it is off");
        assert!(lit.to_string().contains(" should be 0, "), "{lit}");
    }
}
