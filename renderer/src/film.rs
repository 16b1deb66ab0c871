//! What has been rendered so far: the sum of all samples of each pixel.

use glam::Vec3;
use rayon::prelude::*;

use super::integrator::sampling::luminance;

/// Edge of a tile in pixels. A tile is the unit of work of the renderer.
pub const TILE: u32 = 16;

const TILE_PIXELS: usize = (TILE * TILE) as usize;

/// Accumulated samples. Pixels lie tile by tile, so that threads write to memory of their own.
#[derive(Clone, Debug)]
pub struct Film {
    width: u32,
    height: u32,
    samples: u32,
    sums: Vec<Vec3>,
}

/// A finished picture: linear RGB radiance, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// `width * height` pixels.
    pub pixels: Vec<Vec3>,
}

impl Film {
    /// An empty film.
    pub fn new(width: u32, height: u32) -> Self {
        let tiles = width.div_ceil(TILE) as usize * height.div_ceil(TILE) as usize;
        Self { width, height, samples: 0, sums: vec![Vec3::ZERO; tiles * TILE_PIXELS] }
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Samples of each pixel so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.samples = 0;
        self.sums.fill(Vec3::ZERO);
    }

    /// The mean of the samples; black where there are none.
    pub fn picture(&self) -> Picture {
        let scale = 1.0 / self.samples.max(1) as f32;
        let across = self.tiles_across();
        let pixels = (0..self.height)
            .flat_map(|y| (0..self.width).map(move |x| (x, y)))
            .map(|(x, y)| {
                let tile = (y / TILE * across + x / TILE) as usize;
                self.sums[tile * TILE_PIXELS + (y % TILE * TILE + x % TILE) as usize] * scale
            })
            .collect();
        Picture { width: self.width, height: self.height, pixels }
    }

    pub(crate) fn tiles_across(&self) -> u32 {
        self.width.div_ceil(TILE)
    }

    pub(crate) fn tiles_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [Vec3]> {
        self.sums.par_chunks_mut(TILE_PIXELS)
    }

    pub(crate) fn count_sample(&mut self) {
        self.samples += 1;
    }
}

impl Picture {
    /// Mean luminance.
    pub fn mean_luminance(&self) -> f64 {
        let sum: f64 = self.pixels.iter().map(|&pixel| f64::from(luminance(pixel))).sum();
        sum / self.pixels.len().max(1) as f64
    }

    /// Mean absolute difference of the pixels' luminance, relative to this picture's mean luminance. Zero for
    /// two black pictures.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn mean_relative_difference(&self, other: &Self) -> f64 {
        assert_eq!(
            (self.width, self.height),
            (other.width, other.height),
            "pictures of one size are compared"
        );
        let pairs = self.pixels.iter().zip(&other.pixels);
        let sum: f64 = pairs.map(|(&a, &b)| f64::from((luminance(a) - luminance(b)).abs())).sum();
        let mean = self.mean_luminance() * self.pixels.len() as f64;
        if sum == 0.0 { 0.0 } else { sum / mean.max(f64::MIN_POSITIVE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_find_their_way_out_of_the_tiles() {
        let mut film = Film::new(37, 21);
        let across = film.tiles_across() as usize;
        film.tiles_mut().enumerate().for_each(|(tile, pixels)| {
            for (index, sum) in pixels.iter_mut().enumerate() {
                let x = tile % across * 16 + index % 16;
                let y = tile / across * 16 + index / 16;
                *sum = Vec3::new(x as f32, y as f32, 0.0);
            }
        });
        film.count_sample();
        let picture = film.picture();
        assert_eq!(picture.pixels.len(), 37 * 21);
        for (index, pixel) in picture.pixels.iter().enumerate() {
            assert_eq!((pixel.x as usize, pixel.y as usize), (index % 37, index / 37));
        }
    }

    #[test]
    fn differences_are_relative() {
        let grey = |level: f32| Picture { width: 2, height: 1, pixels: vec![Vec3::splat(level); 2] };
        assert!((grey(2.0).mean_relative_difference(&grey(2.1)) - 0.05).abs() < 1e-6);
        assert_eq!(grey(0.0).mean_relative_difference(&grey(0.0)), 0.0);
    }
}
