//! The rays of a packet against one triangle.

use std::marker::PhantomData;

use super::PacketLeaves;
use super::bundle::{Bundle, Hits, each_lane};
use crate::geometry::{CARD, Hit, NO_INSTANCE, NO_TRIANGLE, Ray, Triangles};
use crate::layout::{Block, NodeRef, Root, is_met};
use crate::traverse::lanes::{Lanes, Lanes3, Stored};
use crate::traverse::triangles::{Faces, Found, Lines, meet};
use crate::traverse::watertight::{Sheared, axes};
use crate::traverse::{ClosestBelow, OccludedBelow};

/// Rays prepared for tests against single triangles. A ray gets the answer it gets alone, bit by bit.
///
/// # Safety
/// All functions require the processor features of the lanes within, and blocks of the kind they test.
pub(crate) trait PacketBlocks<L, const B: usize>: Copy {
    /// Rays can be tested together if their bits are equal in both.
    unsafe fn classes(rays: &Bundle) -> [u32; 2];

    unsafe fn new(rays: &Bundle) -> Self;

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
    unsafe fn classes(_rays: &Bundle) -> [u32; 2] {
        [0; 2]
    }

    #[inline(always)]
    unsafe fn new(rays: &Bundle) -> Self {
        Self(Lines { origin: rays.origins(), direction: rays.directions(), t_min: rays.t_min() })
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
    /// The main axis as [`axes`] has it: the first, or if not the second.
    #[inline(always)]
    unsafe fn classes(rays: &Bundle) -> [u32; 2] {
        let [x, y, z] = rays.directions::<L>().0;
        let (x, y, z) = (x.abs(), y.abs(), z.abs());
        let first = L::bits(L::and(y.less(x), z.less(x)));
        [first, L::bits(z.less(y)) & !first]
    }

    #[inline(always)]
    unsafe fn new(rays: &Bundle) -> Self {
        let axes = axes(&rays.ray(0, 0.0));
        let (origins, directions) = (rays.origins::<L>().0, rays.directions::<L>().0);
        let [x, y, z] = axes.map(|axis| directions[axis]);
        let shear = [x.div(z), y.div(z), L::splat(1.0).div(z)];
        let origin = axes.map(|axis| origins[axis]);
        Self { axes, rays: Sheared { origin, shear, t_min: rays.t_min() } }
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

/// A tree with leaves of blocks, and its single-ray queries, of which a packet of one kind needs one.
#[derive(Clone, Copy)]
pub(crate) struct BlockTree<'a> {
    pub(crate) root: &'a Root,
    pub(crate) closest: Option<ClosestBelow>,
    pub(crate) occluded: Option<OccludedBelow>,
}

pub(crate) struct PacketBlockLeaves<'a, L, T, const B: usize> {
    triangles: T,
    /// The triangles of the tree, for their masks.
    all: &'a Triangles,
    lanes: PhantomData<L>,
}

/// The rays of `lanes`, one bit a ray, that meet a triangle where it is solid.
#[inline(always)]
fn met(all: &Triangles, number: u32, lanes: u32, rays: &Bundle) -> u32 {
    if number & CARD == 0 {
        return lanes;
    }
    let mut left = 0;
    each_lane(lanes, |lane| {
        left |= u32::from(is_met(all, number, &rays.ray(lane, f32::INFINITY))) << lane;
    });
    left
}

impl<L: Lanes, T: PacketBlocks<L, B>, const B: usize> PacketBlockLeaves<'_, L, T, B> {
    /// All rays against all triangles of a block.
    #[inline(always)]
    unsafe fn test(&self, block: &Block<B>, rays: &Bundle, active: u32, hits: &mut Hits) {
        for lane in 0..B {
            if block.triangles[lane] == NO_TRIANGLE {
                break;
            }
            let t_max = hits.ends::<L>();
            let found = self.triangles.meet(block, lane, t_max);
            if found.hits & active == 0 {
                continue;
            }
            let times = T::times(&found);
            let nearer = L::bits(times.less(t_max)) & found.hits & active;
            let nearer = met(self.all, block.triangles[lane], nearer, rays);
            let (u, v) = (found.u.div(found.scale), found.v.div(found.scale));
            for (value, old) in [(times, &mut hits.t), (u, &mut hits.u), (v, &mut hits.v)] {
                L::choose(nearer, value, L::load(old.0.as_ptr())).store(old.0.as_mut_ptr());
            }
            each_lane(nearer, |ray| {
                hits.triangles[ray] = block.triangles[lane] & !CARD;
                hits.instances[ray] = NO_INSTANCE;
            });
        }
    }
}

impl<'a, L: Lanes, T: PacketBlocks<L, B>, const B: usize> PacketLeaves for PacketBlockLeaves<'a, L, T, B> {
    type Rays = L;
    type Tree = BlockTree<'a>;

    #[inline(always)]
    unsafe fn new(tree: BlockTree<'a>, rays: &Bundle) -> Self {
        Self { triangles: T::new(rays), all: &tree.root.triangles, lanes: PhantomData }
    }

    #[inline(always)]
    unsafe fn closest(&self, rays: &Bundle, leaf: NodeRef, active: u32, hits: &mut Hits) {
        for block in leaf.blocks::<B>() {
            self.test(block, rays, active, hits);
        }
    }

    #[inline(always)]
    unsafe fn any(&self, rays: &Bundle, leaf: NodeRef, active: u32, ends: &Stored) -> u32 {
        let t_max = L::load(ends.0.as_ptr());
        let mut found = 0;
        for block in leaf.blocks::<B>() {
            for lane in 0..B {
                if block.triangles[lane] == NO_TRIANGLE {
                    break;
                }
                let hits = self.triangles.meet(block, lane, t_max).hits & active & !found;
                found |= met(self.all, block.triangles[lane], hits, rays);
            }
        }
        found
    }

    #[inline(always)]
    unsafe fn closest_alone(tree: BlockTree<'a>, node: NodeRef, ray: &Ray, hit: &mut Hit) {
        if let Some(below) = tree.closest {
            below(tree.root, node, ray, hit);
        }
    }

    #[inline(always)]
    unsafe fn any_alone(tree: BlockTree<'a>, node: NodeRef, ray: &Ray) -> bool {
        match tree.occluded {
            Some(below) => below(tree.root, node, ray),
            None => false,
        }
    }
}
