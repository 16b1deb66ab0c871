//! The walk: down to the nearest child first, the others on a stack with the distance where the ray
//! enters them, and whatever lies behind a hit is passed by.
//!
//! A shadow ray needs no order. It goes on with the last child it meets: the builder sorts children big
//! to small, and the small ones are soon done with.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use std::mem::MaybeUninit;

use super::boxes::Boxes;
use super::lanes::Stored;
use super::triangles::Blocks;
use crate::geometry::{Hit, NO_INSTANCE, Ray};
use crate::limits::MAX_DEPTH;
use crate::tree::Root;
use crate::tree::layout::{NO_TRIANGLE, NodeRef, TreeNode, WIDTH_MAX};

/// Most entries on the stack: on each level all children but one, and the builder keeps within the
/// permitted depth.
const STACK: usize = (*MAX_DEPTH.end() as usize + 1) * (WIDTH_MAX - 1) + 1;

/// A child to come back to.
#[derive(Clone, Copy)]
struct Entry {
    node: NodeRef,
    t: f32,
}

/// Children to come back to, the next one last.
struct Stack<T: Copy> {
    entries: [MaybeUninit<T>; STACK],
    top: usize,
}

impl<T: Copy> Stack<T> {
    #[inline(always)]
    fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; STACK], top: 0 }
    }

    #[inline(always)]
    fn push(&mut self, entry: T) {
        self.entries[self.top].write(entry);
        self.top += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<T> {
        self.top = self.top.checked_sub(1)?;
        // SAFETY: every entry below the old top was written by `push`.
        Some(unsafe { self.entries[self.top].assume_init() })
    }
}

impl Stack<Entry> {
    /// Orders the entries from `first` on so that the nearest is popped first. There are few: insertion sort.
    #[inline(always)]
    fn sort_from(&mut self, first: usize) {
        // SAFETY: every entry below the top was written by `push`.
        let fresh: &mut [Entry] = unsafe { self.entries[first..self.top].assume_init_mut() };
        for index in 1..fresh.len() {
            let moving = fresh[index];
            let mut place = index;
            while place > 0 && fresh[place - 1].t < moving.t {
                fresh[place] = fresh[place - 1];
                place -= 1;
            }
            fresh[place] = moving;
        }
    }

    /// The next entry that begins before `t_max`.
    #[inline(always)]
    fn pop_before(&mut self, t_max: f32) -> Option<NodeRef> {
        loop {
            let entry = self.pop()?;
            if entry.t < t_max {
                return Some(entry.node);
            }
        }
    }
}

/// The nearest hit.
///
/// # Safety
/// The processor has the features of `X` and `T`; the tree has nodes `N` and blocks of the width and kind `T`
/// tests.
#[inline(always)]
pub(crate) unsafe fn closest<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
    root: &Root,
    ray: &Ray,
) -> Option<Hit> {
    if !ray.is_valid() {
        return None;
    }
    let boxes = X::new(root, ray);
    let triangles = T::new(ray);
    let mut stack = Stack::<Entry>::new();
    let mut hit = Hit { t: ray.t_max, u: 0.0, v: 0.0, triangle: NO_TRIANGLE, instance: NO_INSTANCE };
    let mut current = root.node;
    'walk: loop {
        while !current.is_leaf() {
            let node = current.node::<N>();
            let (mut met, times) = boxes.test(node, hit.t);
            if met == 0 {
                match stack.pop_before(hit.t) {
                    Some(next) => current = next,
                    None => break 'walk,
                }
                continue;
            }
            let first = met.trailing_zeros() as usize;
            met &= met - 1;
            if met == 0 {
                current = node.children()[first];
                continue;
            }
            let times = Stored::from(times).0;
            let second = met.trailing_zeros() as usize;
            met &= met - 1;
            if met == 0 {
                let (near, far) =
                    if times[first] <= times[second] { (first, second) } else { (second, first) };
                stack.push(Entry { node: node.children()[far], t: times[far] });
                current = node.children()[near];
                continue;
            }
            let bottom = stack.top;
            for child in [first, second] {
                stack.push(Entry { node: node.children()[child], t: times[child] });
            }
            while met != 0 {
                let child = met.trailing_zeros() as usize;
                met &= met - 1;
                stack.push(Entry { node: node.children()[child], t: times[child] });
            }
            stack.sort_from(bottom);
            if let Some(next) = stack.pop() {
                current = next.node;
            }
        }
        for block in current.blocks::<B>() {
            triangles.closest(block, &mut hit);
        }
        match stack.pop_before(hit.t) {
            Some(next) => current = next,
            None => break 'walk,
        }
    }
    (hit.triangle != NO_TRIANGLE).then_some(hit)
}

/// Whether anything is hit.
///
/// # Safety
/// As for [`closest`].
#[inline(always)]
pub(crate) unsafe fn occluded<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
    root: &Root,
    ray: &Ray,
) -> bool {
    if !ray.is_valid() {
        return false;
    }
    let boxes = X::new(root, ray);
    let triangles = T::new(ray);
    let mut stack = Stack::<NodeRef>::new();
    let mut current = root.node;
    loop {
        if current.is_leaf() {
            for block in current.blocks::<B>() {
                if triangles.any(block, ray.t_max) {
                    return true;
                }
            }
        } else {
            let node = current.node::<N>();
            let (mut met, _) = boxes.test(node, ray.t_max);
            if met != 0 {
                let last = (u32::BITS - 1 - met.leading_zeros()) as usize;
                met &= !(1 << last);
                while met != 0 {
                    stack.push(node.children()[met.trailing_zeros() as usize]);
                    met &= met - 1;
                }
                current = node.children()[last];
                continue;
            }
        }
        match stack.pop() {
            Some(next) => current = next,
            None => return false,
        }
    }
}
