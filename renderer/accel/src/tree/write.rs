//! A [`Plan`] becomes memory: each node and leaf in its place, all in one block.

use rayon::prelude::*;

use super::arena::Arena;
use super::order::sequence;
use super::plan::{Link, Named, Plan};
use crate::error::BuildError;
use crate::geometry::Triangles;
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX};
use crate::parameters::NodeOrder;

/// Fewest nodes and leaves that are worth a task of their own.
const ITEMS_PER_TASK: usize = 2048;

/// Where every node and leaf lies, in bytes from the start of the block.
struct Places {
    nodes: Vec<usize>,
    leaves: Vec<usize>,
    /// Bytes of all.
    end: usize,
}

impl Places {
    fn new<N: TreeNode, const B: usize>(plan: &Plan, sequence: &[Link]) -> Self {
        let mut places = Self { nodes: vec![0; plan.nodes()], leaves: vec![0; plan.leaves()], end: 0 };
        for link in sequence {
            let (place, align, bytes) = match link.named() {
                Named::Node(node) => (&mut places.nodes[node], align_of::<N>(), size_of::<N>()),
                Named::Leaf(leaf) => {
                    let blocks = plan.triangles(leaf).len().div_ceil(B);
                    (&mut places.leaves[leaf], align_of::<Block<B>>(), blocks * size_of::<Block<B>>())
                }
            };
            *place = places.end.next_multiple_of(align);
            places.end = *place + bytes;
        }
        places
    }
}

/// The block of memory, as several threads write to it.
#[derive(Clone, Copy)]
struct Start(*mut u8);

// SAFETY: each thread writes to places of its own.
unsafe impl Send for Start {}
// SAFETY: as above.
unsafe impl Sync for Start {}

impl Start {
    fn place<T>(self, offset: usize) -> *mut T {
        self.0.wrapping_add(offset).cast()
    }
}

/// Writes the plan with nodes of kind `N` and blocks of `B` triangles, with corners if `watertight`.
pub(super) fn write<N: TreeNode, const B: usize>(
    plan: &Plan,
    order: NodeOrder,
    triangles: &Triangles,
    watertight: bool,
) -> Result<(Arena, NodeRef), BuildError> {
    let sequence = sequence(plan, order);
    let places = Places::new::<N, B>(plan, &sequence);
    let arena = Arena::new(places.end)?;
    let start = Start(arena.start());
    let reference = |link: Link| match link.named() {
        Named::Node(node) => NodeRef::to_node::<N>(start.place(places.nodes[node])),
        Named::Leaf(leaf) => {
            let blocks = plan.triangles(leaf).len().div_ceil(B);
            NodeRef::to_leaf::<B>(start.place(places.leaves[leaf]), blocks)
        }
    };
    sequence.par_iter().with_min_len(ITEMS_PER_TASK).for_each(|link| match link.named() {
        Named::Node(node) => {
            let mut children = [(Bounds::EMPTY, NodeRef::EMPTY); WIDTH_MAX];
            let planned = plan.children(node);
            for (place, child) in children.iter_mut().zip(planned) {
                *place = (child.bounds, reference(child.link));
            }
            let written = N::new(&children[..planned.len()]);
            // SAFETY: the block has room for it in this place, which is aligned and nobody else's.
            unsafe { start.place::<N>(places.nodes[node]).write(written) };
        }
        Named::Leaf(leaf) => {
            let room = start.place::<Block<B>>(places.leaves[leaf]);
            for (index, some) in plan.triangles(leaf).chunks(B).enumerate() {
                let block = Block::new(some.iter().copied(), triangles, watertight);
                // SAFETY: as above, for as many blocks as were counted.
                unsafe { room.add(index).write(block) };
            }
        }
    });
    Ok((arena, reference(plan.root.link)))
}
