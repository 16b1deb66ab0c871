//! An environment map as a light: pixels drawn by how much light they send.
//!
//! A pixel is drawn with probability proportional to its luminance times its solid angle (an alias table).
//! Then a direction is drawn uniformly within it (Pharr, Jakob and Humphreys, Physically Based Rendering, 4th
//! edition 2023, 12.5, with a table in place of two searches). Bright suns in a map are found by every shadow
//! ray that way.

use std::{f32::consts::PI, sync::Arc};

use glam::Vec3;

use super::lamp::LightSample;
use super::sampling::{AliasTable, luminance};
use crate::scene::Environment;

#[derive(Clone, Debug)]
pub(super) struct SkyTable {
    map: Arc<Environment>,
    table: Option<AliasTable>,
    /// Density over solid angle with which each pixel's directions are drawn.
    densities: Arc<[f32]>,
}

impl SkyTable {
    /// Of a map: O(pixels). One that is black is never sampled.
    pub(super) fn new(map: &Arc<Environment>) -> Self {
        let (width, height) = (map.width(), map.height());
        let solid_angle = |row: u32| {
            let cosine = |row: u32| (f64::from(row) / f64::from(height) * std::f64::consts::PI).cos();
            (cosine(row) - cosine(row + 1)) * std::f64::consts::TAU / f64::from(width)
        };
        let rows = map.pixels().chunks_exact(width as usize).zip(0..height);
        let weights: Vec<f64> = rows
            .flat_map(|(pixels, row)| {
                let angle = solid_angle(row);
                pixels.iter().map(move |&pixel| f64::from(luminance(pixel)) * angle)
            })
            .collect();
        let total: f64 = weights.iter().sum();
        let table = AliasTable::new(&weights);
        let density = |(&pixel, _): (&Vec3, &f64)| {
            if table.is_some() { (f64::from(luminance(pixel)) / total) as f32 } else { 0.0 }
        };
        let densities = map.pixels().iter().zip(&weights).map(density).collect();
        Self { map: Arc::clone(map), table, densities }
    }

    pub(super) fn sample(&self, pick: f32, [u, v]: [f32; 2]) -> LightSample {
        let pixel = self.table.as_ref().map_or(0, |table| table.sample(pick)) as u32;
        let (width, height) = (self.map.width(), self.map.height());
        let (column, row) = (pixel % width, pixel / width);
        let azimuth = (column as f32 + u) / width as f32;
        let cosine = |row: u32| (row as f32 / height as f32 * PI).cos();
        // Even over the sphere is even in height.
        let up = cosine(row) + (cosine(row + 1) - cosine(row)) * v;
        let direction = Environment::direction(azimuth, up);
        LightSample {
            direction,
            distance: f32::INFINITY,
            radiance: self.map.pixels()[pixel as usize],
            pdf: self.densities[pixel as usize],
        }
    }

    /// Radiance from a direction, and the density with which it is drawn: those of its pixel.
    pub(super) fn look_up(&self, direction: Vec3) -> (Vec3, f32) {
        let pixel = self.map.pixel(direction);
        (self.map.pixels()[pixel], self.densities[pixel])
    }

    /// Radiance from a direction as it is seen: between pixels.
    pub(super) fn seen(&self, direction: Vec3) -> Vec3 {
        self.map.radiance(direction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::random::PathRandom;

    /// A dim sky with a bright spot.
    fn map() -> Arc<Environment> {
        let pixels =
            (0..32 * 16).map(|pixel| Vec3::splat(if pixel == 5 * 32 + 11 { 400.0 } else { 0.5 })).collect();
        Arc::new(Environment::new(32, pixels).expect("it is sound"))
    }

    #[test]
    fn the_density_is_that_of_the_samples() {
        let table = SkyTable::new(&map());
        let random = PathRandom::new(3, 0, 0);
        let mut sum = 0.0;
        for place in 0..20_000 {
            let light = table.sample(random.single(2 * place), random.pair(2 * place + 1));
            let (radiance, pdf) = table.look_up(light.direction);
            assert!((light.direction.length() - 1.0).abs() < 1e-5);
            assert!(
                (pdf / light.pdf - 1.0).abs() < 1e-3 || (pdf - light.pdf).abs() > 1.0,
                "{pdf} {}",
                light.pdf
            );
            sum += f64::from(1.0 / light.pdf);
            assert!(radiance.x >= 0.5);
        }
        // The mean of one over the density is the whole sphere; few samples miss the bright spot.
        let sphere = sum / 20_000.0;
        assert!((sphere - 12.566).abs() < 1.0, "{sphere}");
    }

    #[test]
    fn a_black_map_is_never_drawn() {
        let black = Arc::new(Environment::new(4, vec![Vec3::ZERO; 8]).expect("it is sound"));
        let table = SkyTable::new(&black);
        assert_eq!(table.look_up(Vec3::Y), (Vec3::ZERO, 0.0));
    }
}
