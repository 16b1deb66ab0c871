//! The fast triangle test: Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection"
//! (1997), on many pairs of ray and triangle at once and without a division until something is hit.
//!
//! The lanes are either the triangles of a block with one ray, or the rays of a packet with one triangle.
//! Both take equal operations in equal order, so that a ray's answer does not depend on its company.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::kernel::Leaves;
use super::lanes::{Lanes, Lanes3, Stored};
use crate::geometry::{CARD, Hit, NO_INSTANCE, Ray, Triangles};
use crate::layout::{Block, NodeRef, is_any_met, is_met};

/// A ray prepared for tests against blocks of triangles.
///
/// # Safety
/// All functions require the processor features of the lanes within, and blocks of the kind they test.
pub(crate) trait Blocks<const B: usize>: Copy {
    unsafe fn new(ray: &Ray) -> Self;

    /// Replaces `hit` by a nearer one in the block. `ray` is what this was made of, `all` the triangles.
    unsafe fn closest(&self, block: &Block<B>, ray: &Ray, all: &Triangles, hit: &mut Hit);

    /// Whether the ray hits a triangle of the block before it ends.
    unsafe fn any(&self, block: &Block<B>, ray: &Ray, all: &Triangles) -> bool;
}

#[derive(Clone, Copy)]
pub(crate) struct BlockLeaves<'a, T, const B: usize> {
    pub(super) blocks: T,
    /// The ray that `blocks` is made from.
    pub(super) ray: &'a Ray,
    /// The triangles of the tree, whose masks are asked.
    pub(super) all: &'a Triangles,
}

impl<T: Blocks<B>, const B: usize> Leaves for BlockLeaves<'_, T, B> {
    #[inline(always)]
    unsafe fn closest(&self, leaf: NodeRef, hit: &mut Hit) {
        for block in leaf.blocks::<B>() {
            self.blocks.closest(block, self.ray, self.all, hit);
        }
    }

    #[inline(always)]
    unsafe fn any(&self, leaf: NodeRef, _t_max: f32) -> bool {
        for block in leaf.blocks::<B>() {
            if self.blocks.any(block, self.ray, self.all) {
                return true;
            }
        }
        false
    }
}

/// The result of a test: one bit a lane. Distance and weights are multiplied by `scale`.
#[derive(Clone, Copy)]
pub(crate) struct Found<L> {
    pub(crate) hits: u32,
    pub(crate) t: L,
    pub(crate) u: L,
    pub(crate) v: L,
    pub(crate) scale: L,
}

/// Replaces `hit` by the nearest of the lanes' hits that is nearer. `times` are their true distances,
/// `triangles` their numbers among `all`.
///
/// # Safety
/// As for [`Lanes`].
#[inline(always)]
pub(super) unsafe fn take_nearest<L: Lanes>(
    found: &Found<L>,
    times: L,
    (triangles, all): (&[u32], &Triangles),
    ray: &Ray,
    hit: &mut Hit,
) {
    let times = Stored::from(times).0;
    let mut best = None;
    let mut left = found.hits;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        if times[lane] < hit.t && is_met(all, triangles[lane], ray) {
            hit.t = times[lane];
            best = Some(lane);
        }
    }
    if let Some(lane) = best {
        let (u, v) = (Stored::from(found.u.div(found.scale)).0, Stored::from(found.v.div(found.scale)).0);
        let triangle = triangles[lane] & !CARD;
        *hit = Hit { t: hit.t, u: u[lane], v: v[lane], triangle, instance: NO_INSTANCE };
    }
}

/// A triangle, or several, as the test wants them.
#[derive(Clone, Copy)]
pub(super) struct Faces<L> {
    pub(super) corner: Lanes3<L>,
    pub(super) edge_1: Lanes3<L>,
    pub(super) edge_2: Lanes3<L>,
    pub(super) normal: Lanes3<L>,
}

/// The rays, or one.
#[derive(Clone, Copy)]
pub(super) struct Lines<L> {
    pub(super) origin: Lanes3<L>,
    pub(super) direction: Lanes3<L>,
    pub(super) t_min: L,
}

/// The normals of a block's triangles, not normalised.
///
/// # Safety
/// As for [`Lanes`]; `L` has as many lanes as the block.
#[inline(always)]
pub(super) unsafe fn normals<L: Lanes, const B: usize>(block: &Block<B>) -> Lanes3<L> {
    Lanes3::<L>::load(&block.vertices[2]).cross(Lanes3::<L>::load(&block.vertices[1]))
}

/// The test itself.
///
/// # Safety
/// As for [`Lanes`].
#[inline(always)]
pub(super) unsafe fn meet<L: Lanes>(lines: &Lines<L>, faces: &Faces<L>, t_max: L) -> Found<L> {
    let to_corner = faces.corner.sub(lines.origin);
    let across = to_corner.cross(lines.direction);
    let determinant = faces.normal.dot(lines.direction);
    let scale = determinant.abs();
    let u = across.dot(faces.edge_2).flip_sign(determinant);
    let v = across.dot(faces.edge_1).flip_sign(determinant);
    let t = faces.normal.dot(to_corner).flip_sign(determinant);
    let zero = L::splat(0.0);
    // A determinant of zero fails one of the two tests of t.
    let inside = L::and(L::and(zero.less_equal(u), zero.less_equal(v)), u.add(v).less_equal(scale));
    let between = L::and(scale.mul(lines.t_min).less(t), t.less(scale.mul(t_max)));
    Found { hits: L::bits(L::and(inside, between)), t, u, v, scale }
}

/// One ray against triangles that are stored as a corner and two edges.
#[derive(Clone, Copy)]
pub(crate) struct FastBlocks<L>(Lines<L>);

impl<L: Lanes> FastBlocks<L> {
    #[inline(always)]
    unsafe fn test<const B: usize>(&self, block: &Block<B>, t_max: f32) -> Found<L> {
        let faces = Faces {
            corner: Lanes3::load(&block.vertices[0]),
            edge_1: Lanes3::load(&block.vertices[1]),
            edge_2: Lanes3::load(&block.vertices[2]),
            normal: normals(block),
        };
        meet(&self.0, &faces, L::splat(t_max))
    }
}

impl<L: Lanes, const B: usize> Blocks<B> for FastBlocks<L> {
    #[inline(always)]
    unsafe fn new(ray: &Ray) -> Self {
        Self(Lines {
            origin: Lanes3::splat(ray.origin),
            direction: Lanes3::splat(ray.direction),
            t_min: L::splat(ray.t_min),
        })
    }

    #[inline(always)]
    unsafe fn closest(&self, block: &Block<B>, ray: &Ray, all: &Triangles, hit: &mut Hit) {
        let found = self.test(block, hit.t);
        if found.hits != 0 {
            take_nearest(&found, found.t.div(found.scale), (&block.triangles, all), ray, hit);
        }
    }

    #[inline(always)]
    unsafe fn any(&self, block: &Block<B>, ray: &Ray, all: &Triangles) -> bool {
        is_any_met(all, &block.triangles, self.test(block, ray.t_max).hits, ray)
    }
}
