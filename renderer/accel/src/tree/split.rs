//! Cutting a triangle's box in two for spatial splits.
//!
//! Stich, Friedrich and Dietrich, "Spatial Splits in Bounding Volume Hierarchies" (2009): the part of
//! the triangle on either side of a plane has a smaller box than the cut box.

use glam::{BVec3A, Vec3A};

/// A box in vector registers, laid out like Embree's boxes: a spare word follows each corner.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(crate) struct Piece {
    pub(crate) lower: Vec3A,
    pub(crate) upper: Vec3A,
}

impl Piece {
    #[inline(always)]
    fn at(corner: Vec3A) -> Self {
        Self { lower: corner, upper: corner }
    }

    #[inline(always)]
    fn union(self, other: Self) -> Self {
        Self { lower: self.lower.min(other.lower), upper: self.upper.max(other.upper) }
    }

    #[inline(always)]
    fn within(self, other: &Self) -> Self {
        Self { lower: self.lower.max(other.lower), upper: self.upper.min(other.upper) }
    }
}

const AXES: [BVec3A; 3] =
    [BVec3A::new(true, false, false), BVec3A::new(false, true, false), BVec3A::new(false, false, true)];

/// A corner, and its coordinate along the axis of the cut in every lane.
#[derive(Clone, Copy, Debug)]
struct Along {
    corner: Vec3A,
    at: Vec3A,
}

impl Along {
    #[inline(always)]
    fn select(mask: BVec3A, yes: Self, no: Self) -> Self {
        Self { corner: Vec3A::select(mask, yes.corner, no.corner), at: Vec3A::select(mask, yes.at, no.at) }
    }

    #[inline(always)]
    fn sorted(self, other: Self) -> (Self, Self) {
        let swapped = other.at.cmplt(self.at);
        (Self::select(swapped, other, self), Self::select(swapped, self, other))
    }

    /// The slope of an edge to a corner further up, along the axis. Not finite where both are nearly level.
    #[inline(always)]
    fn slope(self, up: Self) -> Vec3A {
        let slope = (up.corner - self.corner) / (up.at - self.at);
        Vec3A::select(self.at.cmplt(up.at), slope, Vec3A::ZERO)
    }
}

/// A triangle prepared to be cut by planes across one axis. Builders ask for tens of millions of cuts with
/// unforeseeable comparisons, so every choice selects between two values without a jump.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cutter {
    /// The corners in order along the axis.
    low: Along,
    middle: Along,
    high: Along,
    /// Slopes of the edges from the low corner to the high one, to the middle one, and between these.
    long: Vec3A,
    lower: Vec3A,
    upper: Vec3A,
    /// Error bound of the crossings: a box too small by one unit would let rays through.
    slack: Vec3A,
    axis: BVec3A,
}

impl Cutter {
    /// Of nothing, to be replaced.
    pub(crate) const NONE: Self = {
        let none = Along { corner: Vec3A::ZERO, at: Vec3A::ZERO };
        let zero = Vec3A::ZERO;
        Self {
            low: none,
            middle: none,
            high: none,
            long: zero,
            lower: zero,
            upper: zero,
            slack: zero,
            axis: AXES[0],
        }
    };

    /// Prepares a triangle for planes across axis `dimension`, 0 to 2.
    #[inline(always)]
    pub(crate) fn new(corners: [&Vec3A; 3], dimension: usize) -> Self {
        let [a, b, c] =
            corners.map(|corner| Along { corner: *corner, at: Vec3A::splat(corner.as_ref()[dimension]) });
        let (a, b) = a.sorted(b);
        let (b, high) = b.sorted(c);
        let (low, middle) = a.sorted(b);
        let reach = low.corner.abs().max(middle.corner.abs()).max(high.corner.abs());
        let [long, lower, upper] = [low.slope(high), low.slope(middle), middle.slope(high)];
        // An edge so level that its slope is no number may cross anywhere.
        let endless = Vec3A::splat(f32::MAX);
        let steepest = long.abs().max(lower.abs()).max(upper.abs());
        let usable = steepest.cmple(endless);
        let zero = Vec3A::ZERO;
        Self {
            low,
            middle,
            high,
            long: Vec3A::select(usable, long, zero),
            lower: Vec3A::select(usable, lower, zero),
            upper: Vec3A::select(usable, upper, zero),
            slack: reach * Vec3A::select(usable, Vec3A::splat(8.0 * f32::EPSILON), Vec3A::splat(2.0)),
            axis: AXES[dimension],
        }
    }

    /// Boxes inside `within` below and above the plane at `position`; inverted where there is no part.
    #[inline(always)]
    pub(crate) fn cut(&self, within: &Piece, position: f32) -> (Piece, Piece) {
        let Self { low, middle, high, axis, .. } = *self;
        let plane = Vec3A::splat(position);
        // The plane cuts the long edge, and one of the two short ones.
        let middle_is_above = plane.cmplt(middle.at);
        let from = Along::select(middle_is_above, low, middle);
        let to = Vec3A::select(middle_is_above, middle.corner, high.corner);
        let slope = Vec3A::select(middle_is_above, self.lower, self.upper);
        let inside = plane.max(low.at).min(high.at);
        let one = low.corner + self.long * (inside - low.at);
        let other = from.corner + slope * (inside - from.at);
        let cut = Piece { lower: one.min(other) - self.slack, upper: one.max(other) + self.slack };
        let left = cut.union(Piece::at(low.corner)).union(Piece::at(from.corner));
        let right = cut.union(Piece::at(high.corner)).union(Piece::at(to));
        // Along the axis itself no slack is needed; a plane beside the triangle inverts one of the boxes.
        let left = Piece {
            lower: Vec3A::select(axis, low.at, left.lower),
            upper: Vec3A::select(axis, plane, left.upper),
        };
        let right = Piece {
            lower: Vec3A::select(axis, plane, right.lower),
            upper: Vec3A::select(axis, high.at, right.upper),
        };
        (left.within(within), right.within(within))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn split(corners: &[Vec3A; 3], within: &Piece, dimension: usize, position: f32) -> (Piece, Piece) {
        Cutter::new(corners.each_ref(), dimension).cut(within, position)
    }

    fn whole(corners: &[Vec3A; 3]) -> Piece {
        corners.map(Piece::at).into_iter().reduce(Piece::union).expect("three corners")
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
        /// Any point of the triangle lies in one of the boxes, up to the rounding of the point itself.
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
