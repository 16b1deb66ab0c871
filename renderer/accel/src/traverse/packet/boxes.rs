//! The rays of a packet against the box of one child, and all of them at once against all children.
//!
//! The rays have directions of the same signs, so that they share near and far planes.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::{PACKET, numbers};
use crate::geometry::Ray;
use crate::layout::Root;
use crate::traverse::boxes::{DIVISOR_MIN, PaddedBoxes, Planes, near_offsets, safe_reciprocals, scaled};
use crate::traverse::lanes::{Lanes, Lanes3};

/// Rays prepared for tests against single boxes. A ray gets the answer it gets alone, bit by bit.
///
/// # Safety
/// Both functions require the processor features of `Rays`.
pub(crate) trait PacketBoxes<N>: Copy {
    /// One lane a ray.
    type Rays: Lanes;

    unsafe fn new(root: &Root, rays: &[Ray; PACKET]) -> Self;

    /// One bit for each ray that meets the child's box before its `t_max`.
    unsafe fn meet(&self, node: &N, child: usize, t_max: Self::Rays) -> u32;
}

#[inline(always)]
unsafe fn origins<L: Lanes>(rays: &[Ray; PACKET]) -> Lanes3<L> {
    Lanes3([
        numbers(rays, |ray| ray.origin.x),
        numbers(rays, |ray| ray.origin.y),
        numbers(rays, |ray| ray.origin.z),
    ])
}

#[inline(always)]
unsafe fn reciprocals<L: Lanes>(rays: &[Ray; PACKET]) -> Lanes3<L> {
    let [x, y, z]: [L; 3] = [
        numbers(rays, |ray| ray.direction.x),
        numbers(rays, |ray| ray.direction.y),
        numbers(rays, |ray| ray.direction.z),
    ];
    let (least, one) = (L::splat(DIVISOR_MIN), L::splat(1.0));
    let of = |component: L| {
        let small = L::bits(component.abs().less(least));
        L::choose(small, L::splat(1.0 / DIVISOR_MIN), one.div(component))
    };
    Lanes3([of(x), of(y), of(z)])
}

/// As [`crate::traverse::boxes::FastBoxes`].
#[derive(Clone, Copy)]
pub(crate) struct FastPacket<L> {
    reciprocal: Lanes3<L>,
    origin: Lanes3<L>,
    t_min: L,
    near: [usize; 3],
}

impl<L: Lanes, N: Planes> PacketBoxes<N> for FastPacket<L> {
    type Rays = L;

    #[inline(always)]
    unsafe fn new(_root: &Root, rays: &[Ray; PACKET]) -> Self {
        let reciprocal = reciprocals::<L>(rays);
        let origin = Lanes3(scaled(origins::<L>(rays), reciprocal));
        let near = near_offsets(N::WIDTH, safe_reciprocals(rays[0].direction));
        Self { reciprocal, origin, t_min: numbers(rays, |ray| ray.t_min.abs()), near }
    }

    #[inline(always)]
    unsafe fn meet(&self, node: &N, child: usize, t_max: L) -> u32 {
        let ([rx, ry, rz], [ox, oy, oz], [x, y, z]) = (self.reciprocal.0, self.origin.0, self.near);
        let [near_x, far_x] = node.child_times(child, 0, x, rx, ox);
        let [near_y, far_y] = node.child_times(child, 1, y, ry, oy);
        let [near_z, far_z] = node.child_times(child, 2, z, rz, oz);
        let near = near_x.max(near_y).max(near_z.max(self.t_min));
        let far = far_x.min(far_y).min(far_z.min(t_max));
        L::bits(near.less_equal(far))
    }
}

/// As [`PaddedBoxes`].
#[derive(Clone, Copy)]
pub(crate) struct PaddedPacket<L>(PaddedBoxes<L>);

impl<L: Lanes, N: Planes> PacketBoxes<N> for PaddedPacket<L> {
    type Rays = L;

    #[inline(always)]
    unsafe fn new(root: &Root, rays: &[Ray; PACKET]) -> Self {
        let (reciprocal, origin) = (reciprocals::<L>(rays), origins::<L>(rays));
        let reach_on = |axis: usize| {
            let below = L::splat(root.bounds.lower[axis]).sub(origin.0[axis]).abs();
            let above = L::splat(root.bounds.upper[axis]).sub(origin.0[axis]).abs();
            below.max(above)
        };
        let reach = reach_on(0).max(reach_on(1)).max(reach_on(2));
        let pad = reach.mul(L::splat(4.0 * f32::EPSILON));
        let [rx, ry, rz] = reciprocal.0;
        let towards = Lanes3([pad.flip_sign(rx), pad.flip_sign(ry), pad.flip_sign(rz)]);
        let times = |factor: f32| {
            let factor = L::splat(factor);
            Lanes3([rx.mul(factor), ry.mul(factor), rz.mul(factor)])
        };
        Self(PaddedBoxes {
            near_reciprocal: times(1.0 - 2.0 * f32::EPSILON),
            far_reciprocal: times(1.0 + 2.0 * f32::EPSILON),
            near_origin: origin.add(towards),
            far_origin: origin.sub(towards),
            t_min: numbers(rays, |ray| ray.t_min.abs()),
            near: near_offsets(N::WIDTH, safe_reciprocals(rays[0].direction)),
        })
    }

    #[inline(always)]
    unsafe fn meet(&self, node: &N, child: usize, t_max: L) -> u32 {
        let [x, y, z] = self.0.near;
        let [near_x, far_x] = node.child_planes::<L>(child, 0, x);
        let [near_y, far_y] = node.child_planes::<L>(child, 1, y);
        let [near_z, far_z] = node.child_planes::<L>(child, 2, z);
        self.0.interval([near_x, near_y, near_z], [far_x, far_y, far_z], t_max).0
    }
}

/// All rays as one, for a test against all children at once: the interval of their origins and that of their
/// reciprocal directions, on each axis. What any of them meets is met, and entered no later: each plane's
/// earliest (latest) time is that of the extreme origin and slope as long as it lies ahead of the rays, and
/// planes behind them decide nothing.
///
/// The margins are several times those of [`PaddedBoxes`] and cover the rounding of the rays' own tests.
#[inline(always)]
pub(crate) unsafe fn frustum<L: Lanes>(root: &Root, rays: &[Ray; PACKET], width: usize) -> PaddedBoxes<L> {
    let mut lower = (glam::Vec3::INFINITY, glam::Vec3::INFINITY);
    let mut upper = (glam::Vec3::NEG_INFINITY, glam::Vec3::NEG_INFINITY);
    let mut t_min = f32::INFINITY;
    for ray in rays {
        let reciprocal = safe_reciprocals(ray.direction);
        lower = (lower.0.min(ray.origin), lower.1.min(reciprocal));
        upper = (upper.0.max(ray.origin), upper.1.max(reciprocal));
        t_min = t_min.min(ray.t_min.abs());
    }
    let (low, high) = (glam::Vec3::from(root.bounds.lower), glam::Vec3::from(root.bounds.upper));
    let farthest = [low, high, lower.0, upper.0].map(|corner| corner.abs().max_element());
    let reach = farthest.into_iter().fold(0.0, f32::max);
    let pad = glam::Vec3::splat(reach * (32.0 * f32::EPSILON));
    let forward = lower.1.cmpge(glam::Vec3::ZERO);
    let near_reciprocal = glam::Vec3::select(forward, lower.1, upper.1);
    let far_reciprocal = glam::Vec3::select(forward, upper.1, lower.1);
    let near_origin = glam::Vec3::select(forward, upper.0 + pad, lower.0 - pad);
    let far_origin = glam::Vec3::select(forward, lower.0 - pad, upper.0 + pad);
    PaddedBoxes {
        near_reciprocal: Lanes3::splat(near_reciprocal * (1.0 - 8.0 * f32::EPSILON)),
        far_reciprocal: Lanes3::splat(far_reciprocal * (1.0 + 8.0 * f32::EPSILON)),
        near_origin: Lanes3::splat(near_origin),
        far_origin: Lanes3::splat(far_origin),
        t_min: L::splat(t_min),
        near: near_offsets(width, near_reciprocal),
    }
}
