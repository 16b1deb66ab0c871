//! The picture so far: the sum of all samples of each pixel.

use glam::Vec3;

use super::integrator::morton::{decode_2, encode_2};
use super::integrator::sampling::luminance;

/// Edge of a block in pixels: the largest tile.
const BLOCK: u32 = 32;
const BLOCK_PIXELS: usize = (BLOCK * BLOCK) as usize;

/// Accumulated samples, in blocks of 32 × 32 along Morton's curve: every square tile is one run of memory for
/// one thread, and 4 × 4 pixels make the most coherent packets.
#[derive(Clone, Debug)]
pub struct Film {
    width: u32,
    height: u32,
    samples: u32,
    sums: Vec<Vec3>,
}

/// A square of pixels, the unit of work of the renderer.
#[derive(Debug)]
pub(crate) struct Tile<'a> {
    pub(crate) left: u32,
    pub(crate) top: u32,
    /// Its pixels along Morton's curve, those outside the picture too.
    pub(crate) sums: &'a mut [Vec3],
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
    /// An empty film of so many pixels across and down.
    pub fn new([width, height]: [u32; 2]) -> Self {
        let blocks = width.div_ceil(BLOCK) as usize * height.div_ceil(BLOCK) as usize;
        Self { width, height, samples: 0, sums: vec![Vec3::ZERO; blocks * BLOCK_PIXELS] }
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
        let across = self.width.div_ceil(BLOCK);
        let pixels = (0..self.height)
            .flat_map(|y| (0..self.width).map(move |x| (x, y)))
            .map(|(x, y)| {
                let block = (y / BLOCK * across + x / BLOCK) as usize;
                self.sums[block * BLOCK_PIXELS + encode_2(x % BLOCK, y % BLOCK) as usize] * scale
            })
            .collect();
        Picture { width: self.width, height: self.height, pixels }
    }

    /// The tiles row by row, as they are begun. An edge but 8, 16 and 32 is taken for the nearest below.
    pub(crate) fn tiles(&mut self, edge: u32) -> Vec<Tile<'_>> {
        let edge = 1 << edge.clamp(8, BLOCK).ilog2();
        let (width, height, across) = (self.width, self.height, self.width.div_ceil(BLOCK));
        let per_block = BLOCK_PIXELS / (edge * edge) as usize;
        let mut tiles: Vec<Tile<'_>> = self
            .sums
            .chunks_exact_mut((edge * edge) as usize)
            .enumerate()
            .map(|(index, sums)| {
                let block = (index / per_block) as u32;
                let (x, y) = decode_2((index % per_block) as u32);
                let left = block % across * BLOCK + x * edge;
                Tile { left, top: block / across * BLOCK + y * edge, sums }
            })
            .filter(|tile| tile.left < width && tile.top < height)
            .collect();
        tiles.sort_unstable_by_key(|tile| (tile.top, tile.left));
        tiles
    }

    pub(crate) fn count_sample(&mut self) {
        self.samples += 1;
    }
}

impl Picture {
    /// The pixel in this column and row.
    pub fn pixel(&self, x: u32, y: u32) -> Vec3 {
        self.pixels[(y * self.width + x) as usize]
    }

    /// Mean luminance.
    pub fn mean_luminance(&self) -> f64 {
        let sum: f64 = self.pixels.iter().map(|&pixel| f64::from(luminance(pixel))).sum();
        sum / self.pixels.len().max(1) as f64
    }

    /// Mean luminances of the squares of pixels with this edge, row by row.
    pub(crate) fn block_luminances(&self, edge: u32) -> Vec<f64> {
        let across = self.width.div_ceil(edge);
        let mut sums = vec![(0.0, 0_u32); (across * self.height.div_ceil(edge)) as usize];
        for (index, &pixel) in self.pixels.iter().enumerate() {
            let (x, y) = (index as u32 % self.width, index as u32 / self.width);
            let (sum, count) = &mut sums[(y / edge * across + x / edge) as usize];
            *sum += f64::from(luminance(pixel));
            *count += 1;
        }
        sums.into_iter().map(|(sum, count)| sum / f64::from(count)).collect()
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
        for (width, height) in [(37, 21), (64, 64), (130, 65), (1, 1)] {
            for edge in [8, 16, 32] {
                let mut film = Film::new([width, height]);
                for tile in film.tiles(edge) {
                    assert_eq!(tile.sums.len(), (edge * edge) as usize);
                    for (pixel, sum) in tile.sums.iter_mut().enumerate() {
                        let (x, y) = decode_2(pixel as u32);
                        *sum += Vec3::new((tile.left + x) as f32, (tile.top + y) as f32, 1.0);
                    }
                }
                film.count_sample();
                let picture = film.picture();
                assert_eq!(picture.pixels.len(), (width * height) as usize);
                for (index, pixel) in picture.pixels.iter().enumerate() {
                    let (x, y) = (index as u32 % width, index as u32 / width);
                    assert_eq!(*pixel, Vec3::new(x as f32, y as f32, 1.0));
                }
            }
        }
    }

    #[test]
    fn tiles_come_row_by_row() {
        let mut film = Film::new([32, 24]);
        let places: Vec<(u32, u32)> =
            film.tiles(8).iter().map(|tile| (tile.left / 8, tile.top / 8)).collect();
        assert_eq!(places[..5], [(0, 0), (1, 0), (2, 0), (3, 0), (0, 1)]);
        assert_eq!(places.len(), 12);
    }

    #[test]
    fn differences_are_relative() {
        let grey = |level: f32| Picture { width: 2, height: 1, pixels: vec![Vec3::splat(level); 2] };
        assert!((grey(2.0).mean_relative_difference(&grey(2.1)) - 0.05).abs() < 1e-6);
        assert_eq!(grey(0.0).mean_relative_difference(&grey(0.0)), 0.0);
    }
}
