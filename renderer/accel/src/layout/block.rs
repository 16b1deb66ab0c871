//! The triangles of a leaf, four or eight to a block.

use glam::Vec3A;

use crate::geometry::{CARD, NO_TRIANGLE, Ray, Triangles};

/// Up to `B` triangles, `vertices[which][axis][lane]`: a corner and two edges, or three corners if
/// watertight. Unused lanes hold NaN and [`NO_TRIANGLE`]; numbers of triangles with masks carry the mark
/// [`CARD`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Block<const B: usize> {
    pub(crate) vertices: [[[f32; B]; 3]; 3],
    pub(crate) triangles: [u32; B],
}

const _: () = assert!(size_of::<Block<4>>() == 160 && size_of::<Block<8>>() == 320);

impl<const B: usize> Block<B> {
    /// Up to `B` triangles by number: with corners if `watertight`, else `v0`, `v0 - v1` and `v2 - v0`.
    pub(crate) fn new(numbers: impl Iterator<Item = u32>, triangles: &Triangles, watertight: bool) -> Self {
        let mut block = Self { vertices: [[[f32::NAN; B]; 3]; 3], triangles: [NO_TRIANGLE; B] };
        for (lane, number) in numbers.take(B).enumerate() {
            block.store(lane, triangles.corners(number as usize), watertight);
            block.triangles[lane] = marked(number, triangles);
        }
        block
    }

    #[inline]
    fn store(&mut self, lane: usize, [a, b, c]: [Vec3A; 3], watertight: bool) {
        let stored = if watertight { [a, b, c] } else { [a, a - b, c - a] };
        for (which, vertex) in stored.into_iter().enumerate() {
            for (axis, value) in vertex.to_array().into_iter().enumerate() {
                self.vertices[which][axis][lane] = value;
            }
        }
    }

    /// Fetches its triangles and masks as they are now. Gives the corners around them, and how many.
    pub(crate) fn fit(&mut self, triangles: &Triangles, watertight: bool) -> (Vec3A, Vec3A, usize) {
        let (mut lower, mut upper, mut count) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY, 0);
        // Lanes in use come first.
        while count < B && self.triangles[count] != NO_TRIANGLE {
            let number = self.triangles[count] & !CARD;
            let [a, b, c] = triangles.corners(number as usize);
            self.triangles[count] = marked(number, triangles);
            self.store(count, [a, b, c], watertight);
            lower = lower.min(a.min(b).min(c));
            upper = upper.max(a.max(b).max(c));
            count += 1;
        }
        (lower, upper, count)
    }

    pub(crate) fn numbers(&self) -> impl Iterator<Item = u32> + '_ {
        self.triangles.iter().filter(|&&number| number != NO_TRIANGLE).map(|&number| number & !CARD)
    }

    pub(crate) fn renumber(&mut self, renumbered: impl Fn(u32) -> u32) {
        for number in self.triangles.iter_mut().filter(|number| **number != NO_TRIANGLE) {
            *number = renumbered(*number & !CARD) | (*number & CARD);
        }
    }
}

/// A triangle's number as it stands in a block.
#[inline]
fn marked(number: u32, triangles: &Triangles) -> u32 {
    if triangles.is_card(number as usize) { number | CARD } else { number }
}

/// Whether a triangle is solid where a ray meets it; `number` is its number as it stands in a leaf.
#[inline(always)]
pub(crate) fn is_met(triangles: &Triangles, number: u32, ray: &Ray) -> bool {
    number & CARD == 0 || is_card_met(triangles, number & !CARD, ray)
}

/// Out of the way of rays in scenes without masks.
#[cold]
#[inline(never)]
fn is_card_met(triangles: &Triangles, number: u32, ray: &Ray) -> bool {
    triangles.is_met(number as usize, ray)
}

/// Whether any of the lanes' triangles is solid where a ray meets it.
#[inline(always)]
pub(crate) fn is_any_met(triangles: &Triangles, numbers: &[u32], mut lanes: u32, ray: &Ray) -> bool {
    while lanes != 0 {
        if is_met(triangles, numbers[lanes.trailing_zeros() as usize], ray) {
            return true;
        }
        lanes &= lanes - 1;
    }
    false
}
