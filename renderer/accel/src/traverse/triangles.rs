//! The fast triangle test: Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection"
//! (1997), on all triangles of a block at once and without a division until something is hit.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::lanes::{Lanes, Lanes3, Stored};
use crate::geometry::{Hit, Ray};
use crate::tree::layout::Block;

/// A ray prepared for tests against blocks of triangles.
///
/// # Safety
/// All functions require the processor features of the lanes within, and blocks of the kind they test.
pub(crate) trait Blocks<const B: usize>: Copy {
    unsafe fn new(ray: &Ray) -> Self;

    /// Replaces `hit` by a nearer one in the block, if there is one.
    unsafe fn closest(&self, block: &Block<B>, hit: &mut Hit);

    /// Whether a triangle of the block is hit before `t_max`.
    unsafe fn any(&self, block: &Block<B>, t_max: f32) -> bool;
}

/// Triangles as a corner and two edges.
#[derive(Clone, Copy)]
pub(crate) struct FastBlocks<L> {
    origin: Lanes3<L>,
    direction: Lanes3<L>,
    t_min: L,
}

/// Everything scaled by the determinant's magnitude `scale`, so that tests need no division.
struct Scaled<L> {
    hits: u32,
    u: L,
    v: L,
    t: L,
    scale: L,
}

impl<L: Lanes> FastBlocks<L> {
    #[inline(always)]
    unsafe fn test<const B: usize>(&self, block: &Block<B>, t_max: f32) -> Scaled<L> {
        let corner = Lanes3::<L>::load(&block.vertices[0]);
        let edge_1 = Lanes3::<L>::load(&block.vertices[1]);
        let edge_2 = Lanes3::<L>::load(&block.vertices[2]);
        let to_corner = corner.sub(self.origin);
        let across = to_corner.cross(self.direction);
        let normal = edge_2.cross(edge_1);
        let determinant = normal.dot(self.direction);
        let scale = determinant.abs();
        let u = across.dot(edge_2).flip_sign(determinant);
        let v = across.dot(edge_1).flip_sign(determinant);
        let t = normal.dot(to_corner).flip_sign(determinant);
        let zero = L::splat(0.0);
        // A determinant of zero fails one of the two tests of t.
        let inside = L::and(L::and(zero.less_equal(u), zero.less_equal(v)), u.add(v).less_equal(scale));
        let between = L::and(scale.mul(self.t_min).less(t), t.less(scale.mul(L::splat(t_max))));
        Scaled { hits: L::bits(L::and(inside, between)), u, v, t, scale }
    }
}

impl<L: Lanes, const B: usize> Blocks<B> for FastBlocks<L> {
    #[inline(always)]
    unsafe fn new(ray: &Ray) -> Self {
        Self {
            origin: Lanes3::splat(ray.origin),
            direction: Lanes3::splat(ray.direction),
            t_min: L::splat(ray.t_min),
        }
    }

    #[inline(always)]
    unsafe fn closest(&self, block: &Block<B>, hit: &mut Hit) {
        let Scaled { hits, u, v, t, scale } = self.test(block, hit.t);
        if hits == 0 {
            return;
        }
        let times = Stored::from(t.div(scale)).0;
        let mut best = None;
        let mut left = hits;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            if times[lane] < hit.t {
                hit.t = times[lane];
                best = Some(lane);
            }
        }
        if let Some(lane) = best {
            hit.u = Stored::from(u.div(scale)).0[lane];
            hit.v = Stored::from(v.div(scale)).0[lane];
            hit.triangle = block.triangles[lane];
        }
    }

    #[inline(always)]
    unsafe fn any(&self, block: &Block<B>, t_max: f32) -> bool {
        self.test(block, t_max).hits != 0
    }
}
