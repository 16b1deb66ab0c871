//! Writes a [`Plan`] to memory: each node and leaf in its place, all in one block.

use rayon::prelude::*;

use super::plan::{Link, Named, Plan};
use super::{arena::Arena, order::sequence};
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX};
use crate::{error::BuildError, geometry::Triangles};

/// Fewest nodes and leaves that are worth a task of their own.
const ITEMS_PER_TASK: usize = 2048;

/// Where every node and leaf lies, in bytes from the start of the block.
struct Places {
    nodes: Vec<usize>,
    leaves: Vec<usize>,
    /// Bytes of all.
    end: usize,
}

/// The contents of leaves, made from the numbers that the plan has in them.
pub(super) trait Items: Sync {
    /// Aligned for a [`NodeRef`].
    type Item: Send;

    /// The number of items of a leaf of these numbers.
    fn count(&self, numbers: &[u32]) -> usize;

    fn item(&self, numbers: &[u32], index: usize) -> Self::Item;
}

/// Blocks of `B` triangles, with corners if `watertight`.
pub(super) struct TriangleBlocks<'a, const B: usize> {
    pub(super) triangles: &'a Triangles,
    pub(super) watertight: bool,
}

impl<const B: usize> Items for TriangleBlocks<'_, B> {
    type Item = Block<B>;

    fn count(&self, numbers: &[u32]) -> usize {
        numbers.len().div_ceil(B)
    }

    fn item(&self, numbers: &[u32], index: usize) -> Block<B> {
        Block::new(numbers[index * B..].iter().copied(), self.triangles, self.watertight)
    }
}

impl Places {
    fn new<N: TreeNode, I: Items>(plan: &Plan, sequence: &[Link], items: &I) -> Self {
        let mut places = Self { nodes: vec![0; plan.nodes()], leaves: vec![0; plan.leaves()], end: 0 };
        for link in sequence {
            let (place, align, bytes) = match link.named() {
                Named::Node(node) => (&mut places.nodes[node], align_of::<N>(), size_of::<N>()),
                Named::Leaf(leaf) => {
                    let count = items.count(plan.triangles(leaf));
                    (&mut places.leaves[leaf], align_of::<I::Item>(), count * size_of::<I::Item>())
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

/// Writes the plan with nodes of kind `N` and these items in its leaves.
pub(super) fn write<N: TreeNode, I: Items>(plan: &Plan, items: &I) -> Result<(Arena, NodeRef), BuildError> {
    let sequence = sequence(plan);
    let places = Places::new::<N, I>(plan, &sequence, items);
    let arena = Arena::new(places.end)?;
    let start = Start(arena.start());
    let reference = |link: Link| match link.named() {
        Named::Node(node) => NodeRef::to_node::<N>(start.place(places.nodes[node])),
        Named::Leaf(leaf) => {
            let count = items.count(plan.triangles(leaf));
            NodeRef::to_leaf::<I::Item>(start.place(places.leaves[leaf]), count)
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
            // SAFETY: the block has room for it alone in this place, which is aligned.
            unsafe { start.place::<N>(places.nodes[node]).write(written) };
        }
        Named::Leaf(leaf) => {
            let room = start.place::<I::Item>(places.leaves[leaf]);
            let numbers = plan.triangles(leaf);
            for index in 0..items.count(numbers) {
                // SAFETY: as above, for as many items as were counted.
                unsafe { room.add(index).write(items.item(numbers, index)) };
            }
        }
    });
    Ok((arena, reference(plan.root.link)))
}
