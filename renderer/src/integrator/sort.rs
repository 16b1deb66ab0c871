//! Orders rays so that neighbours go alike ways.

use glam::Vec3;
use treewright_accel::Ray;

use super::morton::encode_3;
use super::random::PathRandom;
use super::vertex::{Path, Shadow};
use crate::render_options::Sort;

/// Bits of a key that hold a ray's number in its tile. Keys proper take the rest: three of the octant,
/// fifteen of the place.
const NUMBER_BITS: u32 = 13;

/// Memory for sorting.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    keys: Vec<u32>,
    paths: Vec<Path>,
    rays: Vec<Ray>,
}

impl Sorter {
    /// Makes room for `count` rays, at most 2¹³.
    pub(super) fn reserve(&mut self, count: usize) {
        assert!(count <= 1 << NUMBER_BITS, "a tile's rays can be numbered in a key");
        self.keys.resize(count, 0);
        self.paths.resize(count, Path::new(0, PathRandom::default(), Vec3::ZERO));
        self.rays.resize(count, Shadow::BLANK.ray);
    }

    /// Orders the first `count` paths with their rays. Rays of one key keep their order.
    pub(super) fn sort(&mut self, sort: Sort, paths: &mut Vec<Path>, rays: &mut Vec<Ray>, count: usize) {
        let place = match sort {
            Sort::None => return,
            Sort::Octant => None,
            Sort::OctantMorton => Some(Grid::around(&rays[..count])),
        };
        let keys = &mut self.keys[..count];
        for (number, (key, ray)) in keys.iter_mut().zip(&rays[..count]).enumerate() {
            let octant = ray.direction.is_negative_bitmask();
            let cell = place.as_ref().map_or(0, |grid| grid.cell(ray.origin));
            *key = (octant << 15 | cell) << NUMBER_BITS | number as u32;
        }
        keys.sort_unstable();
        for (to, key) in keys.iter().enumerate() {
            let from = (key & ((1 << NUMBER_BITS) - 1)) as usize;
            self.paths[to] = paths[from];
            self.rays[to] = rays[from];
        }
        std::mem::swap(&mut self.paths, paths);
        std::mem::swap(&mut self.rays, rays);
    }
}

/// A grid of 32 cells an axis around the origins of some rays.
struct Grid {
    corner: Vec3,
    cells_per_length: Vec3,
}

impl Grid {
    fn around(rays: &[Ray]) -> Self {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for ray in rays {
            low = low.min(ray.origin);
            high = high.max(ray.origin);
        }
        Self { corner: low, cells_per_length: Vec3::splat(31.0) / (high - low).max(Vec3::splat(1e-30)) }
    }

    /// The cell of a point, along Morton's curve.
    fn cell(&self, point: Vec3) -> u32 {
        // Conversion takes NaN for zero and keeps all other numbers in range.
        let [x, y, z] =
            ((point - self.corner) * self.cells_per_length).to_array().map(|cell| (cell as u32).min(31));
        encode_3(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_are_grouped_and_stay_with_their_paths() {
        let count = 500;
        let random = PathRandom::new(1, 0, 0);
        let numbers = |place| {
            Vec3::new(random.single(3 * place), random.single(3 * place + 1), random.single(3 * place + 2))
        };
        for sort in [Sort::None, Sort::Octant, Sort::OctantMorton] {
            let mut rays: Vec<Ray> = (0..count)
                .map(|index| Ray {
                    origin: numbers(2 * index) * 8.0,
                    direction: numbers(2 * index + 1) - 0.5,
                    t_min: 0.0,
                    t_max: index as f32,
                })
                .collect();
            let mut paths: Vec<Path> = (0..count).map(|index| Path::new(index, random, Vec3::ZERO)).collect();
            let mut sorter = Sorter::default();
            sorter.reserve(count as usize);
            // Only the first 400 take part.
            sorter.sort(sort, &mut paths, &mut rays, 400);
            let mut seen: Vec<u32> = paths[..400].iter().map(|path| path.pixel).collect();
            assert!((0..400).all(|index| rays[index].t_max == paths[index].pixel as f32));
            let changes = (1..400)
                .filter(|&index| {
                    rays[index].direction.is_negative_bitmask()
                        != rays[index - 1].direction.is_negative_bitmask()
                })
                .count();
            assert_eq!(changes == 7, sort != Sort::None, "{sort:?}: {changes}");
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..400), "{sort:?}");
        }
    }
}
