//! Cubes on a grid, and their surface, faces of one kind merged into rectangles (after Lysenko 2012).

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use crate::part::Part;

pub(super) const AIR: u8 = 0;

/// A block of cubes, each of a kind from 1 to 255 or [`AIR`].
pub(super) struct Grid {
    size: IVec3,
    kinds: Vec<u8>,
}

impl Grid {
    pub(super) fn new(size: IVec3) -> Self {
        Self { size, kinds: vec![AIR; (size.x * size.y * size.z) as usize] }
    }

    pub(super) fn size(&self) -> IVec3 {
        self.size
    }

    /// The columns along y, in order of x, then z.
    pub(super) fn columns_mut(&mut self) -> rayon::slice::ChunksMut<'_, u8> {
        self.kinds.par_chunks_mut(self.size.y as usize)
    }

    fn index(&self, at: IVec3) -> Option<usize> {
        let inside = at.cmpge(IVec3::ZERO).all() && at.cmplt(self.size).all();
        inside.then(|| ((at.x * self.size.z + at.z) * self.size.y + at.y) as usize)
    }

    /// The kind of a cube; air outside.
    pub(super) fn get(&self, at: IVec3) -> u8 {
        self.index(at).map_or(AIR, |index| self.kinds[index])
    }

    /// Places a cube; outside nothing happens.
    pub(super) fn set(&mut self, at: IVec3, kind: u8) {
        if let Some(index) = self.index(at) {
            self.kinds[index] = kind;
        }
    }

    /// Places a cube where there is air.
    pub(super) fn fill(&mut self, at: IVec3, kind: u8) {
        if self.get(at) == AIR {
            self.set(at, kind);
        }
    }

    /// Fills a box, both corners included.
    pub(super) fn set_box(&mut self, low: IVec3, high: IVec3, kind: u8) {
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    self.set(IVec3::new(x, y, z), kind);
                }
            }
        }
    }

    /// The visible faces of the cubes from `low` up to `high`, a part a kind, without the world's ends.
    pub(super) fn surface(&self, low: IVec3, high: IVec3) -> Vec<(u8, Part)> {
        let mut parts: Vec<Option<Part>> = vec![None; 256];
        for axis in 0..3 {
            for towards in [-1, 1] {
                let mut step = IVec3::ZERO;
                step[axis] = towards;
                for slice in low[axis]..high[axis] {
                    self.slice(low, high, axis, slice, step, &mut parts);
                }
            }
        }
        parts.into_iter().enumerate().filter_map(|(kind, part)| Some((kind as u8, part?))).collect()
    }

    /// Merges the faces of one slice that look along `step`.
    fn slice(
        &self,
        low: IVec3,
        high: IVec3,
        axis: usize,
        slice: i32,
        step: IVec3,
        parts: &mut [Option<Part>],
    ) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (width, height) = ((high[u] - low[u]) as usize, (high[v] - low[v]) as usize);
        let place = |column: usize, row: usize| {
            let mut at = IVec3::ZERO;
            at[axis] = slice;
            at[u] = low[u] + column as i32;
            at[v] = low[v] + row as i32;
            at
        };
        let mut mask: Vec<u8> = (0..width * height)
            .map(|cell| {
                let at = place(cell % width, cell / width);
                let beyond = at + step;
                let covered = self.get(beyond) != AIR || (self.index(beyond).is_none() && step.y != 1);
                if covered { AIR } else { self.get(at) }
            })
            .collect();
        for row in 0..height {
            for column in 0..width {
                let kind = mask[row * width + column];
                if kind == AIR {
                    continue;
                }
                let wide = (column..width).take_while(|column| mask[row * width + column] == kind).count();
                let same =
                    |row: usize| (column..column + wide).all(|column| mask[row * width + column] == kind);
                let tall = (row..height).take_while(|row| same(*row)).count();
                for row in row..row + tall {
                    mask[row * width + column..row * width + column + wide].fill(AIR);
                }
                let mut origin = place(column, row);
                origin[axis] += i32::from(step[axis] > 0);
                let (mut along_u, mut along_v) = (Vec3::ZERO, Vec3::ZERO);
                along_u[u] = wide as f32;
                along_v[v] = tall as f32;
                let part = parts[kind as usize].get_or_insert_default();
                push_face(part, origin.as_vec3(), along_u, along_v, step[axis] > 0);
            }
        }
    }
}

fn push_face(part: &mut Part, origin: Vec3, u: Vec3, v: Vec3, along_axis: bool) {
    let first = part.positions.len() as u32;
    part.positions.extend([origin, origin + u, origin + u + v, origin + v]);
    let corners = if along_axis { [0, 1, 2, 3] } else { [0, 3, 2, 1] };
    part.push_fan(&corners.map(|corner| first + corner));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_and_count(grid: &Grid) -> (f32, usize) {
        let parts = grid.surface(IVec3::ZERO, grid.size());
        let mut area = 0.0;
        let mut count = 0;
        for (_, part) in &parts {
            for triangle in &part.indices {
                let [a, b, c] = triangle.map(|vertex| part.positions[vertex as usize]);
                area += (b - a).cross(c - a).length() * 0.5;
                count += 1;
            }
        }
        (area, count)
    }

    #[test]
    fn a_bar_of_cubes_has_six_faces() {
        let mut grid = Grid::new(IVec3::splat(8));
        grid.set_box(IVec3::new(2, 2, 2), IVec3::new(4, 2, 2), 5);
        assert_eq!(area_and_count(&grid), (14.0, 12));
        let parts = grid.surface(IVec3::ZERO, grid.size());
        let middle = Vec3::new(3.5, 2.5, 2.5);
        for triangle in &parts[0].1.indices {
            let [a, b, c] = triangle.map(|vertex| parts[0].1.positions[vertex as usize]);
            assert!((b - a).cross(c - a).dot((a + b + c) / 3.0 - middle) > 0.0);
        }
    }

    #[test]
    fn kinds_stay_apart_and_the_world_has_no_underside() {
        let mut grid = Grid::new(IVec3::new(4, 3, 4));
        grid.set_box(IVec3::ZERO, IVec3::new(3, 0, 3), 1);
        grid.set(IVec3::new(1, 0, 1), 2);
        let (area, count) = area_and_count(&grid);
        assert_eq!(area, 16.0);
        // The hole splits the rest into four rectangles.
        assert_eq!(count, 2 + 4 * 2);
    }
}
