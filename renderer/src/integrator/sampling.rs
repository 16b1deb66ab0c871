//! Small pieces of Monte Carlo geometry: local frames, hemispheres, triangles, the alias table, MIS weights.

use std::f32::consts::FRAC_PI_2;

use glam::Vec3;

/// An orthonormal frame around local z, a normal, after Duff et al. (JCGT 2017).
#[derive(Clone, Copy, Debug)]
pub struct Basis {
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
}

impl Basis {
    /// The frame around a unit vector.
    #[inline(always)]
    pub fn new(normal: Vec3) -> Self {
        let sign = 1.0_f32.copysign(normal.z);
        let a = -1.0 / (sign + normal.z);
        let b = normal.x * normal.y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
            bitangent: Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
            normal,
        }
    }

    /// World to local.
    #[inline(always)]
    pub fn to_local(&self, world: Vec3) -> Vec3 {
        Vec3::new(world.dot(self.tangent), world.dot(self.bitangent), world.dot(self.normal))
    }

    /// Local to world.
    #[inline(always)]
    pub fn to_world(&self, local: Vec3) -> Vec3 {
        self.tangent * local.x + self.bitangent * local.y + self.normal * local.z
    }
}

/// Sine and cosine of `u` full turns, `u` in [0, 1), to about 1e-7: polynomials of Moshier's Cephes library
/// around the nearest quarter, four times as fast as functions for every angle.
#[inline(always)]
pub fn turn(u: f32) -> (f32, f32) {
    let quarters = (u * 4.0 + 0.5) as i32;
    let angle = (u * 4.0 - quarters as f32) * FRAC_PI_2;
    let square = angle * angle;
    let sine = angle + angle * square * (-1.666_665_5e-1 + square * (8.332_161e-3 - square * 1.951_529_6e-4));
    let cosine = 1.0 - 0.5 * square
        + square * square * (4.166_664_6e-2 + square * (-1.388_731_6e-3 + square * 2.443_315_7e-5));
    let (sine, cosine) = if quarters & 1 == 0 { (sine, cosine) } else { (cosine, -sine) };
    if quarters & 2 == 0 { (sine, cosine) } else { (-sine, -cosine) }
}

/// A direction around local z with density cos / π (Malley's method: a disc point, projected up).
#[inline(always)]
pub fn cosine_hemisphere([u, v]: [f32; 2]) -> Vec3 {
    let (sin, cos) = turn(v);
    let radius = u.sqrt();
    Vec3::new(radius * cos, radius * sin, (1.0 - u).sqrt())
}

/// A direction uniform in the cone of half angle `acos(cos_max)` around local z.
#[inline(always)]
pub fn uniform_cone([u, v]: [f32; 2], cos_max: f32) -> Vec3 {
    let cosine = 1.0 - u * (1.0 - cos_max);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (sin, cos) = turn(v);
    Vec3::new(sine * cos, sine * sin, cosine)
}

/// Barycentric weights of the second and third corner, uniform over the triangle's area.
#[inline(always)]
pub fn uniform_triangle([u, v]: [f32; 2]) -> [f32; 2] {
    let root = u.sqrt();
    [root * (1.0 - v), root * v]
}

/// Weight of a sample of density `pdf` beside `other`: the power heuristic (Veach 1997, 9.2.4).
#[inline(always)]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if !other.is_finite() {
        return 0.0;
    }
    // The ratio keeps squares of large densities inside single precision.
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

/// Relative luminance of linear sRGB (ITU-R BT.709).
#[inline(always)]
pub fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Draws an index in proportion to its weight in constant time (Vose 1991).
#[derive(Clone, Debug, Default)]
pub struct AliasTable {
    /// Probability of keeping the slot's own index, and the index taken otherwise.
    slots: Vec<(f32, u32)>,
}

impl AliasTable {
    /// The table over weights that are finite and not negative. `None` for a sum of zero or too many.
    pub fn new(weights: &[f64]) -> Option<Self> {
        let total: f64 = weights.iter().sum();
        if !(total.is_finite() && total > 0.0) || u32::try_from(weights.len()).is_err() {
            return None;
        }
        let scale = weights.len() as f64 / total;
        let mut share: Vec<f64> = weights.iter().map(|weight| weight * scale).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) =
            (0..share.len()).partition(|&index| share[index] < 1.0);
        let mut slots = vec![(1.0_f32, 0_u32); share.len()];
        while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
            small.pop();
            slots[poor] = (share[poor] as f32, rich as u32);
            share[rich] -= 1.0 - share[poor];
            if share[rich] < 1.0 {
                large.pop();
                small.push(rich);
            }
        }
        // The remaining weights differ from 1 only by rounding.
        for index in small.into_iter().chain(large) {
            slots[index] = (1.0, index as u32);
        }
        Some(Self { slots })
    }

    /// The index that belongs to a number in [0, 1).
    #[inline(always)]
    pub fn sample(&self, u: f32) -> usize {
        let scaled = f64::from(u) * self.slots.len() as f64;
        let slot = (scaled as usize).min(self.slots.len() - 1);
        let (keep, other) = self.slots[slot];
        if scaled - (slot as f64) < f64::from(keep) { slot } else { other as usize }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::integrator::random::PathRandom;

    proptest! {
        #[test]
        fn frames_are_orthonormal_and_invertible(x in -1.0_f32..1.0, y in -1.0_f32..1.0, z in -1.0_f32..1.0) {
            let normal = Vec3::new(x, y, z);
            prop_assume!(normal.length() > 1e-3);
            let normal = normal.normalize();
            let frame = Basis::new(normal);
            prop_assert!((frame.to_world(Vec3::Z) - normal).length() < 1e-6);
            let direction = Vec3::new(0.3, -0.5, 0.8);
            prop_assert!((frame.to_world(frame.to_local(direction)) - direction).length() < 1e-5);
        }

        #[test]
        fn heuristic_weights_of_two_techniques_add_up_to_one(a in 1e-6_f32..1e12, b in 1e-6_f32..1e12) {
            prop_assert!((power_heuristic(a, b) + power_heuristic(b, a) - 1.0).abs() < 1e-5);
        }
    }

    /// Pearson's statistic over n cells of equal probability: mean n - 1, deviation √(2 (n - 1)).
    fn chi_square(counts: &[u32]) -> f64 {
        let expected = f64::from(counts.iter().sum::<u32>()) / counts.len() as f64;
        counts.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum()
    }

    /// Counts samples over 8 by 8 cells of equal probability, which `cell` maps to the unit square.
    fn fills_its_cells_evenly<T>(sample: impl Fn([f32; 2]) -> T, cell: impl Fn(T) -> [f32; 2]) {
        let random = PathRandom::new(23, 0, 0);
        let mut counts = [0_u32; 64];
        for place in 0..40_000 {
            let [x, y] = cell(sample(random.pair(place))).map(|at| ((at * 8.0) as usize).min(7));
            counts[y * 8 + x] += 1;
        }
        // Mean 63, deviation 11: this is four deviations and a half above.
        assert!(chi_square(&counts) < 113.0, "{}", chi_square(&counts));
    }

    fn azimuth(direction: Vec3) -> f32 {
        (direction.y.atan2(direction.x) / std::f32::consts::TAU).rem_euclid(1.0)
    }

    #[test]
    fn directions_and_points_follow_their_densities() {
        // Density cos / π: the squared sine is uniform.
        fills_its_cells_evenly(cosine_hemisphere, |direction| {
            assert!((direction.length() - 1.0).abs() < 1e-5);
            [1.0 - direction.z * direction.z, azimuth(direction)]
        });
        // Uniform over a cap: the height is uniform (Archimedes).
        let cos_max = 0.4;
        fills_its_cells_evenly(
            |u| uniform_cone(u, cos_max),
            |direction| [(1.0 - direction.z) / (1.0 - cos_max), azimuth(direction)],
        );
        // Uniform over a triangle: the squared distance from a side, and the place along it.
        fills_its_cells_evenly(uniform_triangle, |[v, w]| [(v + w) * (v + w), w / (v + w).max(1e-9)]);
    }

    #[test]
    fn turns_are_sines_and_cosines() {
        for step in 0..1 << 16 {
            let u = step as f32 / (1 << 16) as f32;
            let (sine, cosine) = turn(u);
            let (right_sine, right_cosine) = (f64::from(u) * std::f64::consts::TAU).sin_cos();
            assert!((f64::from(sine) - right_sine).abs() < 2e-7, "{u}: {sine}");
            assert!((f64::from(cosine) - right_cosine).abs() < 2e-7, "{u}: {cosine}");
        }
    }

    #[test]
    fn alias_table_draws_in_proportion() {
        let weights = [0.0, 1.0, 2.0, 5.0, 0.0, 8.0];
        let table = AliasTable::new(&weights).expect("weights are positive");
        let mut counts = [0_u32; 6];
        let random = PathRandom::new(3, 0, 0);
        for place in 0..160_000 {
            counts[table.sample(random.single(place))] += 1;
        }
        for (count, weight) in counts.iter().zip(weights) {
            let expected = weight * 10_000.0;
            assert!((f64::from(*count) - expected).abs() <= 5.0 * expected.sqrt(), "{counts:?}");
        }
    }

    #[test]
    fn alias_table_of_nothing_is_refused() {
        assert!(AliasTable::new(&[]).is_none());
        assert!(AliasTable::new(&[0.0, 0.0]).is_none());
        assert!(AliasTable::new(&[f64::NAN]).is_none());
    }
}
