//! Cutting a triangle's box in two for spatial splits.
//!
//! Stich, Friedrich and Dietrich, "Spatial Splits in Bounding Volume Hierarchies" (2009): the part of
//! the triangle on either side of a plane has a smaller box than the cut box.

use glam::Vec3A;

use super::layout::Bounds;

/// Boxes of the parts of a triangle on the lower and the upper side of the plane `dimension = position`,
/// both inside `within`, the box of the piece being cut. A side without any part gets an inverted box,
/// which tells the builder to leave the piece whole.
pub(crate) fn split(
    corners: &[Vec3A; 3],
    within: &Bounds,
    dimension: usize,
    position: f32,
) -> (Bounds, Bounds) {
    let (mut left, mut right) = (Bounds::EMPTY, Bounds::EMPTY);
    for index in 0..3 {
        let (from, to) = (corners[index], corners[(index + 1) % 3]);
        let (start, end) = (from[dimension], to[dimension]);
        if start <= position {
            left = left.union(point(from));
        }
        if start >= position {
            right = right.union(point(from));
        }
        if (start < position && position < end) || (end < position && position < start) {
            let crossing = crossing(from, to, dimension, position);
            left = left.union(crossing);
            right = right.union(crossing);
        }
    }
    (intersection(&left, within), intersection(&right, within))
}

/// Where an edge crosses the plane: exact on the split axis, and elsewhere widened by the rounding of
/// the interpolation, since a box too small by one unit would let rays through.
fn crossing(from: Vec3A, to: Vec3A, dimension: usize, position: f32) -> Bounds {
    let along = (position - from[dimension]) / (to[dimension] - from[dimension]);
    let at = from + (to - from) * along;
    let slack = (from.abs().max(to.abs())) * (4.0 * f32::EPSILON);
    let mut lower = (at - slack).max(from.min(to));
    let mut upper = (at + slack).min(from.max(to));
    lower[dimension] = position;
    upper[dimension] = position;
    Bounds {
        lower: lower.to_array(),
        upper: upper.to_array(),
    }
}

fn point(at: Vec3A) -> Bounds {
    Bounds {
        lower: at.to_array(),
        upper: at.to_array(),
    }
}

fn intersection(a: &Bounds, b: &Bounds) -> Bounds {
    let axes = [0, 1, 2];
    Bounds {
        lower: axes.map(|axis| a.lower[axis].max(b.lower[axis])),
        upper: axes.map(|axis| a.upper[axis].min(b.upper[axis])),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn corner() -> impl Strategy<Value = Vec3A> {
        prop::array::uniform3(-100.0f32..100.0).prop_map(Vec3A::from_array)
    }

    #[test]
    fn a_plane_beside_the_triangle_leaves_one_side_empty() {
        let corners = [Vec3A::ZERO, Vec3A::X, Vec3A::Y];
        let (left, right) = split(&corners, &Bounds::of_corners(&corners), 0, 2.0);
        assert_eq!(left, Bounds::of_corners(&corners));
        assert!(right.lower[0] > right.upper[0]);
    }

    #[test]
    fn halves_of_a_right_triangle_are_tight() {
        let corners = [Vec3A::ZERO, Vec3A::X, Vec3A::Y];
        let (left, right) = split(&corners, &Bounds::of_corners(&corners), 0, 0.5);
        assert_eq!(left.upper[..2], [0.5, 1.0]);
        assert_eq!(right.lower[..2], [0.5, 0.0]);
        assert!(
            (right.upper[1] - 0.5).abs() < 1e-5,
            "the right half is only half as high: {right:?}"
        );
    }

    proptest! {
        /// Any point of the triangle, taken from fine barycentric weights, lies in one of the boxes up to
        /// the rounding of the point itself.
        #[test]
        fn no_part_is_lost(a in corner(), b in corner(), c in corner(), dimension in 0usize..3, share in 0.0f32..1.0, i in 0u32..32, j in 0u32..32) {
            let corners = [a, b, c];
            let whole = Bounds::of_corners(&corners);
            let position = whole.lower[dimension] + (whole.upper[dimension] - whole.lower[dimension]) * share;
            let (left, right) = split(&corners, &whole, dimension, position);
            let (u, v) = (i as f32 / 31.0, j as f32 / 31.0);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let inside = a + (b - a) * u + (c - a) * v;
            let near = |bounds: &Bounds| (0..3).all(|axis| bounds.lower[axis] - 1e-3 <= inside[axis] && inside[axis] <= bounds.upper[axis] + 1e-3);
            prop_assert!(near(&left) || near(&right));
            prop_assert!(whole.contains(&left) || left.lower[dimension] > left.upper[dimension]);
            prop_assert!(left.upper[dimension] <= position && right.lower[dimension] >= position);
        }
    }
}
