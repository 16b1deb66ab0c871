//! The triangles of a leaf, four or eight to a block.

use crate::geometry::{NO_TRIANGLE, Triangles};

/// Up to `B` triangles. A plain block holds the first corner and two edges, a watertight one the three
/// corners: `vertices[which][axis][lane]`. Unused lanes hold NaN, which no test accepts,
/// and [`NO_TRIANGLE`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Block<const B: usize> {
    pub(crate) vertices: [[[f32; B]; 3]; 3],
    pub(crate) triangles: [u32; B],
}

const _: () = assert!(size_of::<Block<4>>() == 160 && size_of::<Block<8>>() == 320);

impl<const B: usize> Block<B> {
    /// Up to `B` triangles by number: with corners if `watertight`, otherwise with `v0`, `v0 - v1` and
    /// `v2 - v0`.
    pub(crate) fn new(numbers: impl Iterator<Item = u32>, triangles: &Triangles, watertight: bool) -> Self {
        let mut block = Self { vertices: [[[f32::NAN; B]; 3]; 3], triangles: [NO_TRIANGLE; B] };
        for (lane, number) in numbers.take(B).enumerate() {
            let [a, b, c] = triangles.corners(number as usize);
            let stored = if watertight { [a, b, c] } else { [a, a - b, c - a] };
            for (which, vertex) in stored.into_iter().enumerate() {
                for (axis, value) in vertex.to_array().into_iter().enumerate() {
                    block.vertices[which][axis][lane] = value;
                }
            }
            block.triangles[lane] = number;
        }
        block
    }

    /// Numbers of the triangles in use.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = u32> + '_ {
        self.triangles.iter().copied().filter(|&number| number != NO_TRIANGLE)
    }
}
