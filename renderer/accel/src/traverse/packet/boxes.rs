//! The rays of a packet against the box of one child, and all of them at once against all children.
//!
//! The signs of all rays' directions are equal, so that they share near and far planes.

use super::bundle::Bundle;
use crate::layout::Root;
use crate::traverse::boxes::{DIVISOR_MIN, PaddedBoxes, Planes, near_offsets, scaled, times};
use crate::traverse::lanes::{Lanes, Lanes3, Stored};

/// Rays prepared for tests against single boxes. A ray gets the answer it gets alone, bit by bit.
///
/// # Safety
/// Both functions require the processor features of `Rays`.
pub(crate) trait PacketBoxes<N>: Copy {
    type Rays: Lanes;

    unsafe fn new(root: &Root, rays: &Bundle) -> Self;

    /// One bit for each ray that meets the child's box before its `t_max`.
    unsafe fn meet(&self, node: &N, child: usize, t_max: Self::Rays) -> u32;
}

/// One over the directions, as [`crate::traverse::boxes::safe_reciprocals`] has it.
#[inline(always)]
unsafe fn reciprocals<L: Lanes>(rays: &Bundle) -> Lanes3<L> {
    let [x, y, z] = rays.directions::<L>().0;
    Lanes3([reciprocal(x), reciprocal(y), reciprocal(z)])
}

#[inline(always)]
unsafe fn reciprocal<L: Lanes>(component: L) -> L {
    let small = L::bits(component.abs().less(L::splat(DIVISOR_MIN)));
    L::choose(small, L::splat(1.0 / DIVISOR_MIN), L::splat(1.0).div(component))
}

#[inline(always)]
unsafe fn first<L: Lanes>(of: Lanes3<L>) -> glam::Vec3 {
    let [x, y, z] = of.0;
    glam::Vec3::new(Stored::from(x).0[0], Stored::from(y).0[0], Stored::from(z).0[0])
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
    unsafe fn new(_root: &Root, rays: &Bundle) -> Self {
        let reciprocal = reciprocals::<L>(rays);
        let origin = Lanes3(scaled(rays.origins::<L>(), reciprocal));
        let near = near_offsets(N::WIDTH, first(reciprocal));
        Self { reciprocal, origin, t_min: rays.t_min::<L>().abs(), near }
    }

    #[inline(always)]
    unsafe fn meet(&self, node: &N, child: usize, t_max: L) -> u32 {
        let ([rx, ry, rz], [ox, oy, oz], [x, y, z]) = (self.reciprocal.0, self.origin.0, self.near);
        let [near_x, far_x] = times(node.child_planes::<L>(child, x), rx, ox);
        let [near_y, far_y] = times(node.child_planes::<L>(child, y), ry, oy);
        let [near_z, far_z] = times(node.child_planes::<L>(child, z), rz, oz);
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
    unsafe fn new(root: &Root, rays: &Bundle) -> Self {
        let (reciprocal, origin) = (reciprocals::<L>(rays), rays.origins::<L>());
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
            t_min: rays.t_min::<L>().abs(),
            near: near_offsets(N::WIDTH, first(reciprocal)),
        })
    }

    #[inline(always)]
    unsafe fn meet(&self, node: &N, child: usize, t_max: L) -> u32 {
        let [x, y, z] = self.0.near;
        let [near_x, far_x] = node.child_planes::<L>(child, x);
        let [near_y, far_y] = node.child_planes::<L>(child, y);
        let [near_z, far_z] = node.child_planes::<L>(child, z);
        self.0.interval([near_x, near_y, near_z], [far_x, far_y, far_z], t_max).0
    }
}

/// All rays as one, for a test against all children at once: the intervals of origins and reciprocal
/// directions on each axis. Every box that one of them meets is met, and entered no later, with margins
/// several times those of [`PaddedBoxes`]. Planes behind the rays decide nothing.
///
/// `R` has a lane for each ray, `L` one for each child of a node.
#[inline(always)]
pub(crate) unsafe fn frustum<R: Lanes, L: Lanes>(root: &Root, rays: &Bundle, width: usize) -> PaddedBoxes<L> {
    let (origins, reciprocals) = (rays.origins::<R>(), reciprocals::<R>(rays));
    let lower = (folded_each(origins, lesser), folded_each(reciprocals, lesser));
    let upper = (folded_each(origins, greater), folded_each(reciprocals, greater));
    let t_min = folded(&Stored::from(rays.t_min::<R>().abs()), lesser);
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

fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lanes of each folded into one number.
#[inline(always)]
unsafe fn folded_each<L: Lanes>(of: Lanes3<L>, join: impl Fn(f32, f32) -> f32 + Copy) -> glam::Vec3 {
    let [x, y, z] = of.0;
    let of = |lanes: &Stored| folded(lanes, join);
    glam::Vec3::new(of(&Stored::from(x)), of(&Stored::from(y)), of(&Stored::from(z)))
}

/// Folds all lanes into one number, halves onto halves, which vectors can do.
#[inline(always)]
fn folded(lanes: &Stored, join: impl Fn(f32, f32) -> f32) -> f32 {
    let mut left = lanes.0;
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            left[lane] = join(left[lane], left[lane + half]);
        }
    }
    left[0]
}
