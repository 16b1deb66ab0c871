//! A clustered tree becomes memory at once: wide nodes and their leaves as they are met, each thread in slabs of its
//! own. For builds that have no time for a plan.

use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::arena::Arena;
use super::ploc::{ClusterLink, Ploc};
use crate::error::BuildError;
use crate::geometry::Triangles;
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX};
use crate::parameters::TreeParameters;

/// Bytes of a slab: as large as a huge page, or for small trees a share of what they may come to.
const SLAB: usize = 2 << 20;
const SLAB_MIN: usize = 16 << 10;

/// Bytes a triangle comes to, with its share of nodes.
const BYTES_PER_TRIANGLE: usize = 96;

/// Tasks for each thread.
const TASKS_PER_THREAD: u32 = 8;

/// Fewest triangles that are worth a task of their own.
const TRIANGLES_PER_TASK: u32 = 4_096;

/// A reference on its way from the thread that wrote what it refers to.
#[derive(Clone, Copy)]
struct Handed(NodeRef);

// SAFETY: the node is finished and nobody writes to it again.
unsafe impl Send for Handed {}

/// What all threads share.
struct Emitter<'a> {
    ploc: &'a Ploc,
    triangles: &'a Triangles,
    watertight: bool,
    max_depth: u32,
    /// Subtrees of more triangles are shared between threads.
    per_task: u32,
    slab: usize,
    slabs: Mutex<Vec<Arena>>,
    /// What ended tasks left of theirs, for the next ones: a slab that each took for itself would stay mostly empty, and
    /// the kernel zeroes the whole of it.
    rooms: Mutex<Vec<Room>>,
}

/// Room of one task.
struct Room {
    next: *mut u8,
    left: usize,
}

// SAFETY: whoever has it alone writes to it, and it is handed on when nothing is written any more.
unsafe impl Send for Room {}

/// Lists that are used again and again.
#[derive(Default)]
struct Lists {
    numbers: Vec<u32>,
    children: Vec<(Bounds, ClusterLink)>,
}

/// Writes the tree with nodes `N` and blocks of `B` triangles. Fails where it would be deeper than permitted.
pub(super) fn emit<N: TreeNode, const B: usize>(
    ploc: &Ploc,
    triangles: &Triangles,
    parameters: &TreeParameters,
) -> Result<(Vec<Arena>, NodeRef), BuildError> {
    let tasks = rayon::current_num_threads() as u32 * TASKS_PER_THREAD;
    let bytes = triangles.len() * BYTES_PER_TRIANGLE;
    let emitter = Emitter {
        ploc,
        triangles,
        watertight: parameters.robust,
        max_depth: parameters.max_depth,
        per_task: (triangles.len() as u32 / tasks).max(TRIANGLES_PER_TASK),
        slab: (bytes / tasks as usize).next_power_of_two().clamp(SLAB_MIN, SLAB),
        slabs: Mutex::default(),
        rooms: Mutex::default(),
    };
    let root = emitter.subtree::<N, B>(ploc.root, 0, &mut Room::new(), &mut Lists::default())?;
    let slabs = emitter.slabs.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok((slabs, root))
}

impl Room {
    /// None yet.
    fn new() -> Self {
        Self { next: std::ptr::null_mut(), left: 0 }
    }
}

impl Emitter<'_> {
    fn rooms(&self) -> MutexGuard<'_, Vec<Room>> {
        self.rooms.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Room for so many values.
    fn take<T>(&self, room: &mut Room, count: usize) -> Result<*mut T, BuildError> {
        let bytes = count * size_of::<T>();
        let padding = room.next.align_offset(align_of::<T>());
        if room.next.is_null() || padding.saturating_add(bytes) > room.left {
            let slab = Arena::new(self.slab.max(bytes))?;
            *room = Room { next: slab.start(), left: self.slab.max(bytes) };
            self.slabs.lock().unwrap_or_else(PoisonError::into_inner).push(slab);
            return self.take(room, count);
        }
        let start = room.next.wrapping_add(padding);
        *room = Room { next: start.wrapping_add(bytes), left: room.left - padding - bytes };
        Ok(start.cast())
    }

    /// Writes what is below a node, and itself. Recursion is as deep as the wide tree may be.
    fn subtree<N: TreeNode, const B: usize>(
        &self,
        link: ClusterLink,
        depth: u32,
        room: &mut Room,
        lists: &mut Lists,
    ) -> Result<NodeRef, BuildError> {
        if depth > self.max_depth {
            return Err(BuildError::DepthLimit { max_depth: self.max_depth });
        }
        if self.ploc.is_leaf(link) {
            return self.leaf::<B>(link, room, &mut lists.numbers);
        }
        let place: *mut N = self.take(room, 1)?;
        self.ploc.children(link, N::WIDTH, &mut lists.children);
        let mut children = [(Bounds::EMPTY, NodeRef::EMPTY); WIDTH_MAX];
        let mut links = [link; WIDTH_MAX];
        let count = lists.children.len();
        for (index, &(bounds, child)) in lists.children.iter().enumerate() {
            (children[index].0, links[index]) = (bounds, child);
        }
        if self.ploc.triangles(link) > self.per_task {
            let below: Vec<Handed> = links[..count]
                .par_iter()
                .map(|&child| {
                    let mut lists = Lists::default();
                    let mut room = self.rooms().pop().unwrap_or_else(Room::new);
                    let below = self.subtree::<N, B>(child, depth + 1, &mut room, &mut lists).map(Handed);
                    self.rooms().push(room);
                    below
                })
                .collect::<Result<_, _>>()?;
            below.into_iter().zip(&mut children).for_each(|(below, child)| child.1 = below.0);
        } else {
            for (&below, child) in links[..count].iter().zip(&mut children) {
                child.1 = self.subtree::<N, B>(below, depth + 1, room, lists)?;
            }
        }
        // SAFETY: the room was taken for it, is aligned and nobody else's.
        unsafe { place.write(N::new(&children[..count])) };
        Ok(NodeRef::to_node(place))
    }

    fn leaf<const B: usize>(
        &self,
        link: ClusterLink,
        room: &mut Room,
        numbers: &mut Vec<u32>,
    ) -> Result<NodeRef, BuildError> {
        numbers.clear();
        self.ploc.gather(link, numbers);
        let count = numbers.len().div_ceil(B);
        let blocks: *mut Block<B> = self.take(room, count)?;
        for (index, some) in numbers.chunks(B).enumerate() {
            let block = Block::new(some.iter().copied(), self.triangles, self.watertight);
            // SAFETY: the room was taken for so many blocks, is aligned and nobody else's.
            unsafe { blocks.add(index).write(block) };
        }
        Ok(NodeRef::to_leaf(blocks, count))
    }
}
