//! Counts what queries do: nodes visited, blocks of triangles tested, bytes they lie in. For analyses; slow.
//!
//! The walk is that of the queries ([`super::kernel`]) on portable vectors. Such counts explain times (Aila,
//! Karras and Laine, "On Quality Metrics of Bounding Volume Hierarchies", 2013) and repeat to the last digit.

use std::{cell::Cell, ops::AddAssign};

use serde::Serialize;

use super::boxes::{Boxes, FastBoxes, PaddedBoxes, Planes};
use super::lanes::{Order, Portable};
use super::triangles::{BlockLeaves, Blocks, FastBlocks};
use super::{kernel, watertight::WatertightBlocks};
use crate::geometry::{Hit, Ray, Triangles};
use crate::layout::{Block, Root, TreeNode, for_node};
use crate::parameters::TreeParameters;

/// Counts of some queries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Visits {
    /// Nodes whose children's boxes were tested.
    pub nodes: u64,
    /// Blocks whose triangles were tested.
    pub blocks: u64,
    /// Bytes of these nodes and blocks, each time they were visited.
    pub bytes: u64,
}

impl AddAssign for Visits {
    fn add_assign(&mut self, other: Self) {
        self.nodes += other.nodes;
        self.blocks += other.blocks;
        self.bytes += other.bytes;
    }
}

thread_local! {
    /// The visits of this thread's queries since they were last taken.
    static DONE: Cell<Visits> = const { Cell::new(Visits { nodes: 0, blocks: 0, bytes: 0 }) };
}

fn count(nodes: u64, blocks: u64, bytes: usize) {
    let mut done = DONE.get();
    done += Visits { nodes, blocks, bytes: bytes as u64 };
    DONE.set(done);
}

#[derive(Clone, Copy)]
struct CountedBoxes<X>(X);

impl<N, X: Boxes<N>> Boxes<N> for CountedBoxes<X> {
    type Times = X::Times;

    unsafe fn new(root: &Root, ray: &Ray) -> Self {
        // SAFETY: what the caller promises is what this asks for.
        Self(unsafe { X::new(root, ray) })
    }

    unsafe fn test(&self, node: &N, t_max: f32) -> (u32, Self::Times) {
        count(1, 0, size_of::<N>());
        // SAFETY: as above.
        unsafe { self.0.test(node, t_max) }
    }
}

#[derive(Clone, Copy)]
struct CountedBlocks<T>(T);

impl<const B: usize, T: Blocks<B>> Blocks<B> for CountedBlocks<T> {
    unsafe fn new(ray: &Ray) -> Self {
        // SAFETY: what the caller promises is what this asks for.
        Self(unsafe { T::new(ray) })
    }

    unsafe fn closest(&self, block: &Block<B>, ray: &Ray, all: &Triangles, hit: &mut Hit) {
        count(0, 1, size_of::<Block<B>>());
        // SAFETY: as above.
        unsafe { self.0.closest(block, ray, all, hit) }
    }

    unsafe fn any(&self, block: &Block<B>, ray: &Ray, all: &Triangles) -> bool {
        count(0, 1, size_of::<Block<B>>());
        // SAFETY: as above.
        unsafe { self.0.any(block, ray, all) }
    }
}

/// The visits of these rays, one by one, to any hit or the nearest in a tree of these parameters.
///
/// # Safety
/// The tree below `root` was built with these parameters and lives.
pub(crate) unsafe fn visits(root: &Root, parameters: &TreeParameters, rays: &[Ray], any: bool) -> Visits {
    // SAFETY: nodes and blocks are those of the parameters; portable vectors need no features.
    unsafe { for_node!(parameters, N => of_nodes::<N, Portable<{ N::WIDTH }>>(root, parameters, rays, any)) }
}

unsafe fn of_nodes<N: Planes, L: Order>(
    root: &Root,
    parameters: &TreeParameters,
    rays: &[Ray],
    any: bool,
) -> Visits {
    // SAFETY: what the caller promises is what these ask for.
    unsafe {
        match (parameters.block_width, parameters.robust) {
            (4, false) => counted::<N, FastBoxes<L>, FastBlocks<Portable<4>>, 4>(root, rays, any),
            (4, true) => counted::<N, PaddedBoxes<L>, WatertightBlocks<Portable<4>>, 4>(root, rays, any),
            (_, false) => counted::<N, FastBoxes<L>, FastBlocks<Portable<8>>, 8>(root, rays, any),
            (_, true) => counted::<N, PaddedBoxes<L>, WatertightBlocks<Portable<8>>, 8>(root, rays, any),
        }
    }
}

/// # Safety
/// As for [`visits`], with nodes `N` and blocks of `B`.
unsafe fn counted<N: Planes, X: Boxes<N>, T: Blocks<B>, const B: usize>(
    root: &Root,
    rays: &[Ray],
    any: bool,
) -> Visits {
    DONE.set(Visits::default());
    for ray in rays {
        // SAFETY: what the caller promises is what these ask for.
        unsafe {
            let blocks = CountedBlocks(T::new(ray));
            let leaves = BlockLeaves::<'_, _, B> { blocks, ray, all: &root.triangles };
            if any {
                kernel::occluded::<N, CountedBoxes<X>, _>(root, root.node, ray, &leaves);
            } else {
                let mut hit = Hit::none(ray.t_max);
                kernel::closest::<N, CountedBoxes<X>, _>(root, root.node, ray, &leaves, &mut hit);
            }
        }
    }
    DONE.take()
}
