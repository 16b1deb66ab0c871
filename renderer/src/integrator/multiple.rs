//! Light that several microfacets of a rough metal reflect in turn.
//!
//! The lobe of a rough layer loses it, up to 60 %. A second, wide lobe gives it back (Kulla and Conty,
//! Revisiting Physically Based Shading at Imageworks, SIGGRAPH course 2017; the share of a coloured metal
//! after Hill, A Multi-Faceted Exploration, 2018). The loss is a polynomial, so that shading many hits at
//! once stays a loop without tables.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

#[derive(Clone, Copy, Debug)]
pub(super) struct Multiple {
    /// Share of what the first lobe loses that the second gives back.
    pub(super) albedo: Vec3,
    /// One over π and the mean loss.
    pub(super) scale: f32,
    /// See [`Losses::of_direction`].
    pub(super) losses: Losses,
}

/// The loss of the first lobe of perfect microfacets, by powers of `cosine / (cosine + alpha)` from 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Losses(pub(super) [f32; 4]);

/// The losses of a roughness, and their mean over all directions.
pub(super) fn losses(roughness: f32) -> (Losses, f32) {
    let place = roughness.clamp(0.0, 1.0) * (LOSSES.len() - 1) as f32;
    let row = (place as usize).min(LOSSES.len() - 2);
    let ((low, lower), (high, higher)) = (LOSSES[row], LOSSES[row + 1]);
    let between = |low: f32, high: f32| low + (high - low) * (place - row as f32);
    (Losses([0, 1, 2, 3].map(|power| between(low[power], high[power]))), between(lower, higher))
}

impl Losses {
    /// Share of light from a direction.
    #[inline(always)]
    pub(super) fn of_direction(&self, cosine: f32, alpha: f32) -> f32 {
        let [first, second, third, fourth] = self.0;
        let x = cosine / (cosine + alpha);
        let loss = x * (first + x * (second + x * (third + x * fourth)));
        loss.clamp(0.0, 1.0)
    }
}

impl Multiple {
    pub(super) const NONE: Self = Self { albedo: Vec3::ZERO, scale: 0.0, losses: Losses([0.0; 4]) };

    /// Of a metal with this mean reflectance of a microfacet, which is this share of the surface.
    pub(super) fn new(roughness: f32, mean: Vec3, metallic: f32) -> Self {
        let (losses, mean_loss) = losses(roughness);
        let mean_loss = mean_loss.max(1e-4);
        let albedo = mean * mean * (1.0 - mean_loss) / (Vec3::ONE - mean * mean_loss);
        Self { albedo: albedo * metallic, scale: FRAC_1_PI / mean_loss, losses }
    }

    /// The second lobe times the cosine of the light, for the losses of both directions.
    #[inline(always)]
    pub(super) fn value(&self, view_loss: f32, light: f32, alpha: f32) -> Vec3 {
        self.albedo * (self.scale * view_loss * self.losses.of_direction(light, alpha) * light)
    }
}

/// The loss of a GGX layer for a roughness of 0 to 1 in sixteenths: coefficients of [`Losses`], and the mean
/// by the cosine. Least squares to visible normals; the largest error is 0.014, for the roughest at grazing.
const LOSSES: [([f32; 4], f32); 17] = [
    ([0.04235, 1.68903, -3.59980, 1.86916], 0.0000),
    ([0.04235, 1.68903, -3.59980, 1.86916], 0.0002),
    ([-0.02452, 1.95695, -3.95198, 2.02114], 0.0008),
    ([-0.02108, 1.94268, -3.92891, 2.00835], 0.0034),
    ([-0.00789, 1.87446, -3.80415, 1.93580], 0.0104),
    ([0.01561, 1.80375, -3.68778, 1.86824], 0.0269),
    ([0.10621, 1.41703, -2.95552, 1.40281], 0.0481),
    ([0.25267, 0.67829, -1.52382, 0.51034], 0.0788),
    ([0.38968, 0.14066, -0.47879, -0.18737], 0.1176),
    ([0.56265, -0.48609, 0.73459, -1.00688], 0.1650),
    ([0.77461, -1.17724, 2.02739, -1.86814], 0.2197),
    ([1.03618, -1.97436, 3.45560, -2.78273], 0.2800),
    ([1.35998, -2.96702, 5.23499, -3.91150], 0.3438),
    ([1.76225, -4.30315, 7.78036, -5.62864], 0.4088),
    ([2.25717, -6.14756, 11.62461, -8.50007], 0.4727),
    ([2.85465, -8.66044, 17.36028, -13.25501], 0.5339),
    ([3.56385, -12.02526, 25.71379, -20.86268], 0.5909),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_loss_is_that_of_the_polynomial() {
        for step in 1..=32 {
            let roughness = step as f32 / 32.0;
            let (losses, mean_loss) = losses(roughness);
            let cosines = (0..1000).map(|place| (place as f32 + 0.5) / 1000.0);
            let of_direction = |cosine| 2.0 * cosine * losses.of_direction(cosine, roughness * roughness);
            let mean = cosines.map(of_direction).sum::<f32>() / 1000.0;
            assert!((mean - mean_loss).abs() < 0.004, "step {step}: {mean} and {mean_loss}");
        }
    }
}
