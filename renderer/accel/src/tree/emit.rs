//! Writes a clustered tree to memory at once, each thread in slabs of its own: for builds without a plan.

use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::occlusion::{Prospect, area as area_of, order_of};
use super::{arena::Arena, clusters::ClusterLink, ploc::Ploc};
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX};
use crate::{error::BuildError, geometry::Triangles, parameters::TreeParameters, prefetch::prefetch};

/// Bytes of a slab: as large as a huge page, or for small trees a share of their largest size.
const SLAB: usize = 2 << 20;
const SLAB_MIN: usize = 16 << 10;
/// Bytes a triangle comes to, with its share of nodes.
const BYTES_PER_TRIANGLE: usize = 96;
const TASKS_PER_THREAD: u32 = 8;
/// Fewest triangles that are worth a task of their own.
const TRIANGLES_PER_TASK: u32 = 4_096;

/// A written node or leaf with its prospect for shadow rays, on its way from the thread that wrote it.
#[derive(Clone, Copy)]
struct Written(NodeRef, Prospect);

/// The state that all threads share.
struct Emitter<'a> {
    ploc: &'a Ploc,
    triangles: &'a Triangles,
    parameters: &'a TreeParameters,
    /// Subtrees of more triangles are shared between threads.
    per_task: u32,
    slab: usize,
    slabs: Mutex<Vec<Arena>>,
    /// The rest of the slabs of ended tasks, for the next ones: the kernel zeroes every fresh one.
    rooms: Mutex<Vec<Room>>,
}

struct Room {
    next: *mut u8,
    left: usize,
}

// SAFETY: only its owner writes to it, and it is handed on when nothing is written any more.
unsafe impl Send for Room {}

/// Lists that are used again and again.
#[derive(Default)]
struct Lists {
    /// Triangles of a node's leaves, one leaf after the other.
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
        parameters,
        per_task: (triangles.len() as u32 / tasks).max(TRIANGLES_PER_TASK),
        slab: (bytes / tasks as usize).next_power_of_two().clamp(SLAB_MIN, SLAB),
        slabs: Mutex::default(),
        rooms: Mutex::default(),
    };
    let (all, room, lists) = ((ploc.bounds(ploc.root), ploc.root), &mut Room::new(), &mut Lists::default());
    let Written(root, _) = if ploc.is_leaf(ploc.root) {
        ploc.gather(ploc.root, &mut lists.numbers);
        emitter.leaf::<B>(&all.0, &lists.numbers, room)?
    } else {
        emitter.subtree::<N, B>(all, 0, room, lists)?
    };
    let slabs = emitter.slabs.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok((slabs, root))
}

impl Room {
    fn new() -> Self {
        Self { next: std::ptr::null_mut(), left: 0 }
    }
}

impl Emitter<'_> {
    fn rooms(&self) -> MutexGuard<'_, Vec<Room>> {
        self.rooms.lock().unwrap_or_else(PoisonError::into_inner)
    }

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

    /// Writes an inner node after its subtrees. Recursion is as deep as the wide tree may be.
    fn subtree<N: TreeNode, const B: usize>(
        &self,
        (bounds, link): (Bounds, ClusterLink),
        depth: u32,
        room: &mut Room,
        lists: &mut Lists,
    ) -> Result<Written, BuildError> {
        // Its children are a level deeper.
        if depth >= self.parameters.max_depth {
            return Err(BuildError::DepthLimit(self.parameters.max_depth));
        }
        let place: *mut N = self.take(room, 1)?;
        self.ploc.children(link, N::WIDTH, &mut lists.children);
        let count = lists.children.len();
        let mut found = [(Bounds::EMPTY, link); WIDTH_MAX];
        found[..count].copy_from_slice(&lists.children);
        let found = &found[..count];
        let mut below = [const { Written(NodeRef::EMPTY, Prospect::NONE) }; WIDTH_MAX];
        self.leaves::<B>(found, &mut below, room, &mut lists.numbers)?;
        let inner = |place: &usize| !self.ploc.is_leaf(found[*place].1);
        if self.ploc.triangles(link) > self.per_task {
            let inner: Vec<usize> = (0..count).filter(inner).collect();
            let written: Vec<Written> = inner
                .par_iter()
                .map(|&place| {
                    let mut lists = Lists::default();
                    let mut room = self.rooms().pop().unwrap_or_else(Room::new);
                    let written = self.subtree::<N, B>(found[place], depth + 1, &mut room, &mut lists);
                    self.rooms().push(room);
                    written
                })
                .collect::<Result<_, _>>()?;
            inner.into_iter().zip(written).for_each(|(place, written)| below[place] = written);
        } else {
            for place in (0..count).filter(inner) {
                below[place] = self.subtree::<N, B>(found[place], depth + 1, room, lists)?;
            }
        }
        let prospects: [_; WIDTH_MAX] = std::array::from_fn(|place| {
            (found.get(place).map_or(0.0, |(bounds, _)| bounds.half_area() as f32), below[place].1)
        });
        let (order, prospect) = order_of(&prospects[..count], bounds.half_area() as f32, self.parameters);
        let mut children = [(Bounds::EMPTY, NodeRef::EMPTY); WIDTH_MAX];
        for (child, &from) in children.iter_mut().zip(&order[..count]) {
            *child = (found[usize::from(from)].0, below[usize::from(from)].0);
        }
        // SAFETY: the room was taken for it alone and is aligned.
        unsafe { place.write(N::new(&children[..count])) };
        Ok(Written(NodeRef::to_node(place), prospect))
    }

    /// Writes the leaves among a node's children.
    fn leaves<const B: usize>(
        &self,
        found: &[(Bounds, ClusterLink)],
        below: &mut [Written; WIDTH_MAX],
        room: &mut Room,
        numbers: &mut Vec<u32>,
    ) -> Result<(), BuildError> {
        numbers.clear();
        let mut ends = [0; WIDTH_MAX];
        for (end, &(_, link)) in ends.iter_mut().zip(found) {
            if self.ploc.is_leaf(link) {
                self.ploc.gather(link, numbers);
            }
            *end = numbers.len();
        }
        // Where a triangle's corners are is anywhere in memory, and only its indices say where.
        numbers.iter().for_each(|&number| prefetch(self.triangles.indices(), number as usize));
        let mut first = 0;
        for ((end, &(bounds, _)), written) in ends.into_iter().zip(found).zip(below) {
            if first < end {
                *written = self.leaf::<B>(&bounds, &numbers[first..end], room)?;
            }
            first = end;
        }
        Ok(())
    }

    fn leaf<const B: usize>(
        &self,
        bounds: &Bounds,
        numbers: &[u32],
        room: &mut Room,
    ) -> Result<Written, BuildError> {
        for &number in numbers {
            let corners = self.triangles.indices()[number as usize];
            corners.into_iter().for_each(|corner| prefetch(self.triangles.positions(), corner as usize));
        }
        let count = numbers.len().div_ceil(B);
        let blocks: *mut Block<B> = self.take(room, count)?;
        let mut area = 0.0;
        for (index, some) in numbers.chunks(B).enumerate() {
            let block = Block::new(some.iter().copied(), self.triangles, self.parameters.robust);
            area += area_of(&block, self.parameters.robust);
            // SAFETY: the room was taken for this number of blocks alone and is aligned.
            unsafe { blocks.add(index).write(block) };
        }
        let prospect = Prospect::leaf(count, area, bounds.half_area() as f32, self.parameters);
        Ok(Written(NodeRef::to_leaf(blocks, count), prospect))
    }
}
