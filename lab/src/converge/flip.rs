//! FLIP: how different two pictures look to somebody who flips between them (Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström, Fairchild: "FLIP: A Difference Evaluator for Alternating Images", HPG
//! 2020). 0 for the same picture, 1 at most.
//!
//! Pictures as shown are blurred as the eye blurs them at a common distance, their colours compared in a
//! space of even differences, and edges and points that one of them lacks make a difference count more. All
//! of the paper's filters are products of a filter across and one down, or sums of such, and are applied that
//! way.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};

/// Pixels a degree of sight: a screen 0.7 m wide, 3840 pixels across, 0.7 m away.
const PIXELS_PER_DEGREE: f64 = 67.020_643_276_582_25;

/// Exponent on colour differences, the share of the largest difference at which the scale bends, and the
/// value of that share.
const COLOUR_EXPONENT: f64 = 0.7;
const CUT_SHARE: f64 = 0.4;
const CUT_VALUE: f64 = 0.95;

/// Width of the feature detector in degrees, and exponent on feature differences.
const FEATURE_WIDTH: f64 = 0.082;
const FEATURE_EXPONENT: f64 = 0.5;

/// Contrast sensitivity of the three channels: pairs of height and width of Gaussians.
const SENSITIVITY: [[(f64, f64); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// White as XYZ.
const WHITE: DVec3 = DVec3::new(0.950_428_545, 1.0, 1.088_900_371);

/// Linear sRGB to XYZ.
const TO_XYZ: DMat3 = DMat3::from_cols(
    DVec3::new(10_135_552.0 / 24_577_794.0, 2_613_072.0 / 12_288_897.0, 1_425_312.0 / 73_733_382.0),
    DVec3::new(8_788_810.0 / 24_577_794.0, 8_788_810.0 / 12_288_897.0, 8_788_810.0 / 73_733_382.0),
    DVec3::new(4_435_075.0 / 24_577_794.0, 887_015.0 / 12_288_897.0, 70_074_185.0 / 73_733_382.0),
);

/// Compares with one reference, of which everything is computed once.
#[derive(Clone, Debug)]
pub(super) struct Flip {
    width: usize,
    /// Blurred, in the space of even differences.
    colours: Vec<DVec3>,
    /// Strength of edges and of points.
    features: Vec<[f64; 2]>,
    /// The largest colour difference that there is.
    most: f64,
}

impl Flip {
    /// Of the reference as shown, each channel from 0 to 1 with the transfer function of sRGB.
    pub(super) fn new(width: usize, shown: &[Vec3]) -> Self {
        let most = difference(even(DVec3::Y), even(DVec3::Z));
        let (colours, features) = seen(width, shown);
        Self { width, colours, features, most }
    }

    /// Mean over all pixels.
    pub(super) fn to(&self, shown: &[Vec3]) -> f64 {
        let (colours, features) = seen(self.width, shown);
        let cut = CUT_SHARE * self.most;
        let pixel = |index: usize| {
            let colour = difference(self.colours[index], colours[index]);
            let colour = if colour < cut {
                CUT_VALUE / cut * colour
            } else {
                CUT_VALUE + (colour - cut) / (self.most - cut) * (1.0 - CUT_VALUE)
            };
            let [edge, point] =
                [0, 1].map(|which| (self.features[index][which] - features[index][which]).abs());
            let feature = (edge.max(point) / 2.0_f64.sqrt()).powf(FEATURE_EXPONENT).clamp(0.0, 1.0);
            colour.powf(1.0 - feature)
        };
        (0..colours.len()).map(pixel).sum::<f64>() / colours.len().max(1) as f64
    }
}

/// Distance of two colours (HyAB), compressed.
fn difference(a: DVec3, b: DVec3) -> f64 {
    let between = a - b;
    (between.x.abs() + between.y.hypot(between.z)).powf(COLOUR_EXPONENT)
}

/// CIE L*a*b* of a linear colour, its chroma lessened in the dark (Hunt's effect).
fn even(linear: DVec3) -> DVec3 {
    const DELTA: f64 = 6.0 / 29.0;
    let curve = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = (TO_XYZ * linear / WHITE).to_array().map(curve);
    let lightness = 116.0 * y - 16.0;
    DVec3::new(lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z))
}

/// A picture as the eye sees it: blurred colours, and features.
fn seen(width: usize, shown: &[Vec3]) -> (Vec<DVec3>, Vec<[f64; 2]>) {
    let opponent: Vec<DVec3> = shown.iter().map(|colour| opponent(*colour)).collect();
    let channel = |which: usize| opponent.iter().map(|one| one[which]).collect::<Vec<f64>>();
    let blurred = [0, 1, 2].map(|which| blurred(width, &channel(which), SENSITIVITY[which]));
    let to_linear = TO_XYZ.inverse();
    let colour = |index: usize| {
        let y = (blurred[0][index] + 16.0) / 116.0;
        let xyz = DVec3::new(blurred[1][index] / 500.0 + y, y, y - blurred[2][index] / 200.0) * WHITE;
        even((to_linear * xyz).clamp(DVec3::ZERO, DVec3::ONE))
    };
    let brightness: Vec<f64> = opponent.iter().map(|one| (one.x + 16.0) / 116.0).collect();
    ((0..shown.len()).map(colour).collect(), features(width, &brightness))
}

/// The linear opponent space YCxCz of a colour as shown.
fn opponent(shown: Vec3) -> DVec3 {
    let linear = |encoded: f64| {
        if encoded > 0.04045 { ((encoded + 0.055) / 1.055).powf(2.4) } else { encoded / 12.92 }
    };
    let linear = DVec3::from_array(shown.as_dvec3().to_array().map(linear));
    let xyz = TO_XYZ * linear / WHITE;
    DVec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
}

/// A channel under the eye's contrast sensitivity: a sum of two Gaussians that together keep the mean.
fn blurred(width: usize, channel: &[f64], gaussians: [(f64, f64); 2]) -> Vec<f64> {
    let widest = 0.04_f64;
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i64;
    let parts = gaussians.iter().filter(|(height, _)| *height > 0.0).map(|(height, spread)| {
        let at = |x: i64| {
            let degrees = x as f64 / PIXELS_PER_DEGREE;
            (-PI * PI * degrees * degrees / spread).exp()
        };
        let kernel: Vec<f64> = (-radius..=radius).map(at).collect();
        let sum: f64 = kernel.iter().sum();
        let weight = height * (PI / spread).sqrt() * sum * sum;
        let kernel: Vec<f64> = kernel.iter().map(|value| value / sum).collect();
        (weight, convolved(width, channel, &kernel, &kernel))
    });
    let parts: Vec<(f64, Vec<f64>)> = parts.collect();
    let whole: f64 = parts.iter().map(|(weight, _)| weight).sum();
    let value = |index: usize| parts.iter().map(|(weight, part)| weight * part[index]).sum::<f64>() / whole;
    (0..channel.len()).map(value).collect()
}

/// Strength of edges and of points: lengths of the first and second derivatives of a Gaussian's width.
fn features(width: usize, brightness: &[f64]) -> Vec<[f64; 2]> {
    let spread = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * spread).ceil() as i64;
    let gaussian = |x: i64| (-((x * x) as f64) / (2.0 * spread * spread)).exp();
    let kernel = |of: &dyn Fn(i64) -> f64| balanced((-radius..=radius).map(of).collect());
    let smooth = kernel(&gaussian);
    let edge = kernel(&|x| -(x as f64) * gaussian(x));
    let point = kernel(&|x| ((x * x) as f64 / (spread * spread) - 1.0) * gaussian(x));
    let strength = |kernel: &[f64]| {
        let across = convolved(width, brightness, kernel, &smooth);
        let down = convolved(width, brightness, &smooth, kernel);
        across.into_iter().zip(down).map(|(a, b)| a.hypot(b)).collect::<Vec<f64>>()
    };
    strength(&edge).into_iter().zip(strength(&point)).map(|(edge, point)| [edge, point]).collect()
}

/// Scaled so that the positive values add up to 1, and the negative ones to -1.
fn balanced(mut kernel: Vec<f64>) -> Vec<f64> {
    let positive: f64 = kernel.iter().filter(|value| **value > 0.0).sum();
    let negative: f64 = -kernel.iter().filter(|value| **value < 0.0).sum::<f64>();
    for value in &mut kernel {
        *value /= if *value < 0.0 { negative } else { positive };
    }
    kernel
}

/// A filter across and one down, the border's values going on beyond it.
fn convolved(width: usize, values: &[f64], across: &[f64], down: &[f64]) -> Vec<f64> {
    let height = values.len() / width.max(1);
    let filtered = |values: &[f64],
                    kernel: &[f64],
                    edge: usize,
                    index_of: &dyn Fn(usize, usize) -> usize,
                    place: usize,
                    line: usize| {
        let radius = (kernel.len() / 2) as i64;
        kernel
            .iter()
            .enumerate()
            .map(|(offset, weight)| {
                let at = (place as i64 + offset as i64 - radius).clamp(0, edge as i64 - 1) as usize;
                weight * values[index_of(at, line)]
            })
            .sum::<f64>()
    };
    let rows: Vec<f64> = (0..values.len())
        .map(|index| filtered(values, across, width, &|x, y| y * width + x, index % width, index / width))
        .collect();
    (0..values.len())
        .map(|index| filtered(&rows, down, height, &|y, x| y * width + x, index / width, index % width))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 32;

    /// A pattern, and a copy that is a little brighter, shifted and has a bright point.
    fn pair() -> (Vec<Vec3>, Vec<Vec3>) {
        let value = |index: usize| {
            let (x, y) = (index % SIZE, index / SIZE);
            let part = |a: usize, b: usize| ((x * a + y * b) % 16) as f32 / 16.0;
            Vec3::new(part(1, 2), part(3, 1), part(2, 5))
        };
        let reference: Vec<Vec3> = (0..SIZE * SIZE).map(value).collect();
        let mut test: Vec<Vec3> =
            (0..SIZE * SIZE).map(|index| value((index + 1) % (SIZE * SIZE)) * 0.9 + 0.05).collect();
        test[SIZE * 16 + 16] = Vec3::ONE;
        (reference, test)
    }

    #[test]
    fn it_agrees_with_its_authors_program() {
        let (reference, test) = pair();
        let flip = Flip::new(SIZE, &reference);
        assert!(flip.to(&reference).abs() < 1e-12, "the same picture");
        assert!((flip.to(&test) - AUTHORS).abs() < 2e-4, "{}", flip.to(&test));
    }

    /// Mean of flip-evaluator 1.7 for that pair.
    const AUTHORS: f64 = 0.406_291;

    #[test]
    fn black_and_white_are_as_different_as_can_be() {
        let (black, white) = (vec![Vec3::ZERO; 64], vec![Vec3::ONE; 64]);
        let between = Flip::new(8, &black).to(&white);
        assert!((0.9..=1.0).contains(&between), "{between}");
    }
}
