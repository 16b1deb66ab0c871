//! The rays of a packet against one triangle.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::{PACKET, numbers};
use crate::geometry::Ray;
use crate::layout::Block;
use crate::traverse::lanes::{Lanes, Lanes3};
use crate::traverse::triangles::{Faces, Found, Lines, meet};
use crate::traverse::watertight::{Sheared, axes};

/// Rays prepared for tests against single triangles. A ray gets the answer it gets alone, bit by bit.
///
/// # Safety
/// All functions require the processor features of the lanes within, and blocks of the kind they test.
pub(crate) trait PacketBlocks<L, const B: usize>: Copy {
    /// Rays can be tested together if this is the same for all: less than 4.
    fn class(ray: &Ray) -> u8;

    unsafe fn new(rays: &[Ray; PACKET]) -> Self;

    /// Which rays meet the triangle in `lane` before their `t_max`.
    unsafe fn meet(&self, block: &Block<B>, lane: usize, t_max: L) -> Found<L>;

    /// The true distances.
    unsafe fn times(found: &Found<L>) -> L;
}

#[inline(always)]
unsafe fn corner<L: Lanes, const B: usize>(block: &Block<B>, which: usize, lane: usize) -> [L; 3] {
    let [x, y, z] = &block.vertices[which];
    [L::splat(x[lane]), L::splat(y[lane]), L::splat(z[lane])]
}

/// As [`crate::traverse::triangles::FastBlocks`].
#[derive(Clone, Copy)]
pub(crate) struct FastRays<L>(Lines<L>);

impl<L: Lanes, const B: usize> PacketBlocks<L, B> for FastRays<L> {
    #[inline(always)]
    fn class(_ray: &Ray) -> u8 {
        0
    }

    #[inline(always)]
    unsafe fn new(rays: &[Ray; PACKET]) -> Self {
        let origin = [0, 1, 2].map(|axis| numbers(rays, |ray| ray.origin[axis]));
        let direction = [0, 1, 2].map(|axis| numbers(rays, |ray| ray.direction[axis]));
        let t_min = numbers(rays, |ray| ray.t_min);
        Self(Lines { origin: Lanes3(origin), direction: Lanes3(direction), t_min })
    }

    #[inline(always)]
    unsafe fn meet(&self, block: &Block<B>, lane: usize, t_max: L) -> Found<L> {
        let (edge_1, edge_2) = (Lanes3(corner(block, 1, lane)), Lanes3(corner(block, 2, lane)));
        let faces =
            Faces { corner: Lanes3(corner(block, 0, lane)), edge_1, edge_2, normal: edge_2.cross(edge_1) };
        meet(&self.0, &faces, t_max)
    }

    #[inline(always)]
    unsafe fn times(found: &Found<L>) -> L {
        found.t.div(found.scale)
    }
}

/// As [`crate::traverse::watertight::WatertightBlocks`].
#[derive(Clone, Copy)]
pub(crate) struct WatertightRays<L> {
    axes: [usize; 3],
    rays: Sheared<L>,
}

impl<L: Lanes, const B: usize> PacketBlocks<L, B> for WatertightRays<L> {
    #[inline(always)]
    fn class(ray: &Ray) -> u8 {
        axes(ray)[2] as u8
    }

    #[inline(always)]
    unsafe fn new(rays: &[Ray; PACKET]) -> Self {
        let axes = axes(&rays[0]);
        let [x, y, z]: [L; 3] = axes.map(|axis| numbers(rays, |ray| ray.direction[axis]));
        let origin = axes.map(|axis| numbers(rays, |ray| ray.origin[axis]));
        let shear = [x.div(z), y.div(z), L::splat(1.0).div(z)];
        Self { axes, rays: Sheared { origin, shear, t_min: numbers(rays, |ray| ray.t_min) } }
    }

    #[inline(always)]
    unsafe fn meet(&self, block: &Block<B>, lane: usize, t_max: L) -> Found<L> {
        let of = |which: usize| {
            let corner = corner::<L, B>(block, which, lane);
            self.axes.map(|axis| corner[axis])
        };
        self.rays.meet([of(0), of(1), of(2)], t_max)
    }

    #[inline(always)]
    unsafe fn times(found: &Found<L>) -> L {
        found.t
    }
}
