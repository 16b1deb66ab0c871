//! Which children of a node does a ray meet, and where?
//!
//! The slab test of Kay and Kajiya (1986) on all children at once. The signs of the direction choose the
//! near and far plane of each axis beforehand, as an offset into the node, so that no comparison is left.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::lanes::{Lanes, Lanes3, Order};
use crate::geometry::Ray;
use crate::layout::{Node, Root, TreeNode};

/// A ray prepared for tests against the boxes of nodes.
///
/// # Safety
/// Both functions require the processor features of `Times`.
pub(crate) trait Boxes<N>: Copy {
    /// The distances of the children.
    type Times: Order;

    unsafe fn new(root: &Root, ray: &Ray) -> Self;

    /// One bit for each child whose box meets the ray before `t_max`, and entry distances of at least zero.
    unsafe fn test(&self, node: &N, t_max: f32) -> (u32, Self::Times);
}

/// Access to the children's planes by their place in the node: `near` is where the near planes of an axis
/// begin, and the far planes begin at `near ^ WIDTH`.
///
/// # Safety
/// All functions require the processor features of `L`.
pub(crate) trait Planes: TreeNode {
    /// Near and far planes; `L` has as many lanes as the node children.
    unsafe fn planes<L: Lanes>(&self, near: usize) -> [L; 2];

    /// The planes of one child in every lane, of which there may be any number.
    unsafe fn child_planes<L: Lanes>(&self, child: usize, near: usize) -> [L; 2];
}

impl<const W: usize> Planes for Node<W> {
    #[inline(always)]
    unsafe fn planes<L: Lanes>(&self, near: usize) -> [L; 2] {
        debug_assert!(L::COUNT == W);
        let planes = (&raw const self.bounds).cast::<f32>();
        [L::load(planes.add(near)), L::load(planes.add(near ^ W))]
    }

    #[inline(always)]
    unsafe fn child_planes<L: Lanes>(&self, child: usize, near: usize) -> [L; 2] {
        let planes = (&raw const self.bounds).cast::<f32>();
        [L::splat(*planes.add(near + child)), L::splat(*planes.add((near ^ W) + child))]
    }
}

/// When a ray, or several, meet these planes: `plane * reciprocal - origin`.
///
/// # Safety
/// As for [`Lanes`].
#[inline(always)]
pub(super) unsafe fn times<L: Lanes>(planes: [L; 2], reciprocal: L, origin: L) -> [L; 2] {
    planes.map(|plane| plane.mul_sub(reciprocal, origin))
}

/// Divisor in place of nearly zero components, for finite products of coordinates in range.
pub(super) const DIVISOR_MIN: f32 = 1e-18;

#[inline(always)]
fn safe_reciprocal(component: f32) -> f32 {
    if component.abs() < DIVISOR_MIN { 1.0 / DIVISOR_MIN } else { 1.0 / component }
}

#[inline(always)]
pub(super) fn safe_reciprocals(direction: glam::Vec3) -> glam::Vec3 {
    glam::Vec3::new(safe_reciprocal(direction.x), safe_reciprocal(direction.y), safe_reciprocal(direction.z))
}

/// Offset of each axis' near planes inside a node, in planes; the far ones begin at the other offset.
#[inline(always)]
pub(super) fn near_offsets(width: usize, reciprocal: glam::Vec3) -> [usize; 3] {
    // `bounds[axis][side][child]`: an axis spans two widths, its upper planes start at the second.
    let of = |axis: usize| 2 * width * axis + if reciprocal[axis] < 0.0 { width } else { 0 };
    [of(0), of(1), of(2)]
}

/// One fused operation a plane: `plane / d - origin / d`. Its rounding can lose rays that graze a box.
#[derive(Clone, Copy)]
pub(crate) struct FastBoxes<L> {
    reciprocal: Lanes3<L>,
    origin: Lanes3<L>,
    t_min: L,
    near: [usize; 3],
}

impl<L: Order, N: Planes> Boxes<N> for FastBoxes<L> {
    type Times = L;

    #[inline(always)]
    unsafe fn new(_root: &Root, ray: &Ray) -> Self {
        let reciprocal = safe_reciprocals(ray.direction);
        Self {
            reciprocal: Lanes3::splat(reciprocal),
            origin: Lanes3::splat(ray.origin * reciprocal),
            // Without the sign of a negative zero, which would spoil the order of keys.
            t_min: L::splat(ray.t_min.abs()),
            near: near_offsets(N::WIDTH, reciprocal),
        }
    }

    #[inline(always)]
    unsafe fn test(&self, node: &N, t_max: f32) -> (u32, L) {
        let ([rx, ry, rz], [ox, oy, oz], [x, y, z]) = (self.reciprocal.0, self.origin.0, self.near);
        let [near_x, far_x] = times(node.planes::<L>(x), rx, ox);
        let [near_y, far_y] = times(node.planes::<L>(y), ry, oy);
        let [near_z, far_z] = times(node.planes::<L>(z), rz, oz);
        let near = near_x.max(near_y).max(near_z.max(self.t_min));
        let far = far_x.min(far_y).min(far_z.min(L::splat(t_max)));
        (L::bits(near.less_equal(far)), near)
    }
}

/// Conservative test for watertight trees, after Woop, Benthin and Wald (2013), section 4: origins apart by
/// more than the shear can err, reciprocals rounded down and up.
#[derive(Clone, Copy)]
pub(crate) struct PaddedBoxes<L> {
    pub(super) near_reciprocal: Lanes3<L>,
    pub(super) far_reciprocal: Lanes3<L>,
    pub(super) near_origin: Lanes3<L>,
    pub(super) far_origin: Lanes3<L>,
    pub(super) t_min: L,
    pub(super) near: [usize; 3],
}

impl<L: Order, N: Planes> Boxes<N> for PaddedBoxes<L> {
    type Times = L;

    #[inline(always)]
    unsafe fn new(root: &Root, ray: &Ray) -> Self {
        let (lower, upper) = (glam::Vec3::from(root.bounds.lower), glam::Vec3::from(root.bounds.upper));
        // Eight units of the last place of the reach cover all roundings.
        let reach = (lower - ray.origin).abs().max((upper - ray.origin).abs()).max_element();
        let pad = glam::Vec3::splat(reach * (4.0 * f32::EPSILON));
        let reciprocal = safe_reciprocals(ray.direction);
        // Towards the ray's start on near planes, away from it on far ones.
        let towards = pad * glam::Vec3::ONE.copysign(reciprocal);
        Self {
            near_reciprocal: Lanes3::splat(reciprocal * (1.0 - 2.0 * f32::EPSILON)),
            far_reciprocal: Lanes3::splat(reciprocal * (1.0 + 2.0 * f32::EPSILON)),
            near_origin: Lanes3::splat(ray.origin + towards),
            far_origin: Lanes3::splat(ray.origin - towards),
            // Without the sign of a negative zero, which would spoil the order of keys.
            t_min: L::splat(ray.t_min.abs()),
            near: near_offsets(N::WIDTH, reciprocal),
        }
    }

    #[inline(always)]
    unsafe fn test(&self, node: &N, t_max: f32) -> (u32, L) {
        let [x, y, z] = self.near;
        let [near_x, far_x] = node.planes::<L>(x);
        let [near_y, far_y] = node.planes::<L>(y);
        let [near_z, far_z] = node.planes::<L>(z);
        self.interval([near_x, near_y, near_z], [far_x, far_y, far_z], L::splat(t_max))
    }
}

impl<L: Lanes> PaddedBoxes<L> {
    /// Which lanes' planes leave something of the ray, and where it begins.
    #[inline(always)]
    pub(super) unsafe fn interval(&self, near: [L; 3], far: [L; 3], t_max: L) -> (u32, L) {
        let [near_x, near_y, near_z] = scaled(Lanes3(near).sub(self.near_origin), self.near_reciprocal);
        let [far_x, far_y, far_z] = scaled(Lanes3(far).sub(self.far_origin), self.far_reciprocal);
        let near = near_x.max(near_y).max(near_z.max(self.t_min));
        let far = far_x.min(far_y).min(far_z.min(t_max));
        (L::bits(near.less_equal(far)), near)
    }
}

#[inline(always)]
pub(super) unsafe fn scaled<L: Lanes>(planes: Lanes3<L>, by: Lanes3<L>) -> [L; 3] {
    let ([x, y, z], [sx, sy, sz]) = (planes.0, by.0);
    [x.mul(sx), y.mul(sy), z.mul(sz)]
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::lanes::Portable;
    use super::*;
    use crate::layout::{Bounds, NodeRef, Root};

    /// The unit cube as the only child.
    fn cube() -> (Root, Node<2>) {
        let bounds = Bounds { lower: [0.0; 3], upper: [1.0; 3] };
        let mut node = Node::<2>::EMPTY;
        for axis in 0..3 {
            node.bounds[axis][0][0] = 0.0;
            node.bounds[axis][1][0] = 1.0;
        }
        (Root { node: NodeRef::EMPTY, bounds, triangles: std::sync::Arc::default() }, node)
    }

    fn met<B: Boxes<Node<2>>>(origin: Vec3, direction: Vec3, t_max: f32) -> u32 {
        let (root, node) = cube();
        let ray = Ray { origin, direction, t_min: 0.0, t_max };
        // SAFETY: portable vectors need no features.
        unsafe { B::new(&root, &ray).test(&node, t_max).0 }
    }

    #[test]
    fn padding_covers_the_rounding_of_far_origins() {
        // From 100 away, coordinates relative to the origin have errors of about 1e-5.
        let beside = Vec3::new(1.0 + 2e-6, 0.5, -100.0);
        assert_eq!(met::<FastBoxes<Portable<2>>>(beside, Vec3::Z, f32::INFINITY), 0);
        assert_eq!(met::<PaddedBoxes<Portable<2>>>(beside, Vec3::Z, f32::INFINITY), 1);
        let far_beside = Vec3::new(1.001, 0.5, -100.0);
        assert_eq!(met::<PaddedBoxes<Portable<2>>>(far_beside, Vec3::Z, f32::INFINITY), 0);
    }

    #[test]
    fn unused_places_and_boxes_out_of_reach_are_not_met() {
        for sign in [1.0, -1.0] {
            let origin = Vec3::splat(0.5) - sign * Vec3::new(3.0, 2.0, 1.0);
            let direction = sign * Vec3::new(3.0, 2.0, 1.0);
            assert_eq!(met::<FastBoxes<Portable<2>>>(origin, direction, 1.0), 1);
            assert_eq!(met::<PaddedBoxes<Portable<2>>>(origin, direction, 1.0), 1);
            assert_eq!(met::<FastBoxes<Portable<2>>>(origin, direction, 0.1), 0);
            assert_eq!(met::<PaddedBoxes<Portable<2>>>(origin, -direction, 1.0), 0);
        }
    }
}
