//! Cutting a triangle's box in two for spatial splits.
//!
//! Stich, Friedrich and Dietrich, "Spatial Splits in Bounding Volume Hierarchies" (2009): the part of
//! the triangle on either side of a plane has a smaller box than the cut box.

use glam::{BVec3A, Vec3A};

/// A box in vector registers: this runs for every triangle and every plane a builder considers. Laid out
/// like Embree's boxes, whose corners are followed by one word that is no coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(crate) struct Piece {
    pub(crate) lower: Vec3A,
    pub(crate) upper: Vec3A,
}

impl Piece {
    const NOTHING: Self = Self { lower: Vec3A::INFINITY, upper: Vec3A::NEG_INFINITY };

    #[inline]
    fn at(corner: Vec3A) -> Self {
        Self { lower: corner, upper: corner }
    }

    #[inline]
    fn union(self, other: Self) -> Self {
        Self { lower: self.lower.min(other.lower), upper: self.upper.max(other.upper) }
    }

    #[inline]
    fn within(self, other: &Self) -> Self {
        Self { lower: self.lower.max(other.lower), upper: self.upper.min(other.upper) }
    }
}

const AXES: [BVec3A; 3] =
    [BVec3A::new(true, false, false), BVec3A::new(false, true, false), BVec3A::new(false, false, true)];

/// The corner that is alone and the other two, by which corners lie below the plane (one bit each).
const ALONE: [[usize; 3]; 8] =
    [[0, 1, 2], [0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 0, 1], [1, 2, 0], [0, 1, 2], [0, 1, 2]];

/// Boxes of the parts of a triangle on the lower and the upper side of the plane `dimension = position`,
/// both inside `within`, the box of the piece being cut. A side without any part gets an inverted box,
/// which tells the builder to leave the piece whole.
pub(crate) fn split(corners: &[Vec3A; 3], within: &Piece, dimension: usize, position: f32) -> (Piece, Piece) {
    let below = |corner: usize| usize::from(corners[corner][dimension] < position);
    // One corner lies alone on its side. Which one is as good as random, so it is looked up: a table costs
    // less than a mispredicted branch.
    let sides = below(0) | below(1) << 1 | below(2) << 2;
    if sides == 0 || sides == 0b111 {
        return beside(corners, within, dimension, position);
    }
    let [lone, second, third] = ALONE[sides];
    let lone_is_above = 1 - below(lone);
    let cut = crossing(corners, (lone, second), dimension, position).union(crossing(
        corners,
        (lone, third),
        dimension,
        position,
    ));
    let of_lone = cut.union(Piece::at(corners[lone]));
    let of_pair = cut.union(Piece::at(corners[second])).union(Piece::at(corners[third]));
    let halves = [of_lone, of_pair];
    let (mut left, mut right) = (halves[lone_is_above], halves[1 - lone_is_above]);
    // The slack of the crossings is not needed on the axis of the cut.
    let plane = Vec3A::splat(position);
    left.upper = Vec3A::select(AXES[dimension], plane, left.upper);
    right.lower = Vec3A::select(AXES[dimension], plane, right.lower);
    (left.within(within), right.within(within))
}

/// Where an edge meets the plane, widened by the rounding of the interpolation, since a box too small by
/// one unit would let rays through. The edge must not be parallel to the plane.
#[inline]
fn crossing(corners: &[Vec3A; 3], (from, to): (usize, usize), dimension: usize, position: f32) -> Piece {
    let (from, to) = (corners[from], corners[to]);
    let share = (position - from[dimension]) / (to[dimension] - from[dimension]);
    let at = from + (to - from) * share;
    let slack = from.abs().max(to.abs()) * (4.0 * f32::EPSILON);
    Piece { lower: at - slack, upper: at + slack }
}

/// The plane only touches the triangle, or misses it.
#[cold]
fn beside(corners: &[Vec3A; 3], within: &Piece, dimension: usize, position: f32) -> (Piece, Piece) {
    let side = |belongs: fn(&f32, &f32) -> bool| {
        let mine = corners.iter().filter(|corner| belongs(&corner[dimension], &position));
        mine.fold(Piece::NOTHING, |piece, &corner| piece.union(Piece::at(corner))).within(within)
    };
    (side(f32::le), side(f32::ge))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn whole(corners: &[Vec3A; 3]) -> Piece {
        corners.iter().fold(Piece::NOTHING, |piece, &corner| piece.union(Piece::at(corner)))
    }

    fn corner() -> impl Strategy<Value = Vec3A> {
        prop::array::uniform3(-100.0f32..100.0).prop_map(Vec3A::from_array)
    }

    #[test]
    fn a_plane_beside_the_triangle_leaves_one_side_empty() {
        let corners = [Vec3A::ZERO, Vec3A::X, Vec3A::Y];
        let (left, right) = split(&corners, &whole(&corners), 0, 2.0);
        assert_eq!(left, whole(&corners));
        assert!(right.lower[0] > right.upper[0]);
    }

    #[test]
    fn halves_of_a_right_triangle_are_tight() {
        let corners = [Vec3A::ZERO, Vec3A::X, Vec3A::Y];
        let (left, right) = split(&corners, &whole(&corners), 0, 0.5);
        assert_eq!(left.upper, Vec3A::new(0.5, 1.0, 0.0));
        assert_eq!(right.lower, Vec3A::new(0.5, 0.0, 0.0));
        assert!((right.upper[1] - 0.5).abs() < 1e-5, "the right half is only half as high: {right:?}");
    }

    proptest! {
        /// Any point of the triangle, taken from fine barycentric weights, lies in one of the boxes up to
        /// the rounding of the point itself.
        #[test]
        fn no_part_is_lost(a in corner(), b in corner(), c in corner(), dimension in 0usize..3, share in 0.0f32..1.0, i in 0u32..32, j in 0u32..32) {
            let corners = [a, b, c];
            let whole = whole(&corners);
            let position = whole.lower[dimension] + (whole.upper[dimension] - whole.lower[dimension]) * share;
            let (left, right) = split(&corners, &whole, dimension, position);
            let (u, v) = (i as f32 / 31.0, j as f32 / 31.0);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let inside = a + (b - a) * u + (c - a) * v;
            let near = |piece: &Piece| (0..3).all(|axis| piece.lower[axis] - 1e-3 <= inside[axis] && inside[axis] <= piece.upper[axis] + 1e-3);
            prop_assert!(near(&left) || near(&right));
            prop_assert_eq!(left.within(&whole), left);
            prop_assert!(left.upper[dimension] <= position && right.lower[dimension] >= position);
        }
    }
}
