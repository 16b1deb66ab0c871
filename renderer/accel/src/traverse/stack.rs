//! Children to come back to, nearest on top.
//!
//! Distances are kept as *keys*. The bits of a non-negative number order like the number itself, and the
//! lowest bits give way to the child's place in its node, so that one word holds the child and its distance.
//! A key is never above the distance it stands for, so that culling by keys errs to the safe side.

use std::mem::MaybeUninit;

use crate::layout::{NodeRef, WIDTH_MAX};
use crate::limits::MAX_DEPTH;

/// Most entries: on each level all children but one. Builders keep within the permitted depth.
const ENTRIES: usize = (*MAX_DEPTH.end() as usize + 1) * (WIDTH_MAX - 1) + 1;
/// Vectors are written whole, with a node's worth of room behind the last entry.
const ROOM: usize = ENTRIES + WIDTH_MAX;

/// References, and with `KEYS` places their keys, side by side, so that vectors can be written.
pub(crate) struct StackOf<const KEYS: usize> {
    nodes: [MaybeUninit<NodeRef>; ROOM],
    keys: [MaybeUninit<i32>; KEYS],
    top: usize,
}

/// The stack of a closest-hit query: references and keys.
pub(crate) type Stack = StackOf<ROOM>;

/// The stack of a shadow ray: references alone.
pub(crate) type PlainStack = StackOf<0>;

/// The key below every entry: nearer than any distance.
const BOTTOM: i32 = i32::MIN;

impl<const KEYS: usize> StackOf<KEYS> {
    /// The end of the walk alone.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        let mut stack = Self {
            nodes: [const { MaybeUninit::uninit() }; ROOM],
            keys: [const { MaybeUninit::uninit() }; KEYS],
            top: 1,
        };
        stack.nodes[0].write(NodeRef::END);
        if let Some(key) = stack.keys.first_mut() {
            key.write(BOTTOM);
        }
        stack
    }

    /// The end of the walk alone, written in its place: the room of a stack is too large to be moved.
    #[inline(always)]
    pub(crate) fn begin(place: &mut MaybeUninit<Self>) {
        let stack = place.as_mut_ptr();
        // SAFETY: the places lie within the stack; of its arrays, everything else may stay unwritten.
        unsafe {
            (&raw mut (*stack).nodes).cast::<NodeRef>().write(NodeRef::END);
            if KEYS > 0 {
                (&raw mut (*stack).keys).cast::<i32>().write(BOTTOM);
            }
            (&raw mut (*stack).top).write(1);
        }
    }

    /// Where the next entry's reference goes, with room for a node's children.
    ///
    /// # Panics
    /// If the tree is deeper than permitted.
    #[inline(always)]
    pub(crate) fn free(&mut self) -> *mut NodeRef {
        assert!(self.top <= ENTRIES, "the tree is deeper than permitted");
        // SAFETY: the place lies within the array.
        unsafe { self.nodes.as_mut_ptr().add(self.top).cast() }
    }

    /// Counts `count` entries in that were written where [`StackOf::free`] and [`Stack::free_keys`] said.
    ///
    /// # Safety
    /// They were, and they were at most a node's children.
    #[inline(always)]
    pub(crate) unsafe fn grow(&mut self, count: usize) {
        self.top += count;
    }
}

impl Stack {
    /// Where the keys of the entries at [`StackOf::free`] go.
    #[inline(always)]
    pub(crate) fn free_keys(&mut self) -> *mut i32 {
        self.keys.as_mut_ptr().wrapping_add(self.top).cast()
    }

    /// Takes off the next entry that begins before `limit`.
    ///
    /// # Safety
    /// Nothing is taken off after [`NodeRef::END`].
    #[inline(always)]
    pub(crate) unsafe fn pop_before(&mut self, limit: i32) -> NodeRef {
        loop {
            self.top -= 1;
            // SAFETY: every entry below the top was written, and the lowest one ends the loop.
            unsafe {
                if self.keys.get_unchecked(self.top).assume_init() < limit {
                    return self.nodes.get_unchecked(self.top).assume_init();
                }
            }
        }
    }
}

impl PlainStack {
    /// Takes off the top entry.
    ///
    /// # Safety
    /// Nothing is taken off after [`NodeRef::END`].
    #[inline(always)]
    pub(crate) unsafe fn pop(&mut self) -> NodeRef {
        self.top -= 1;
        // SAFETY: every entry below the top was written, and there is at least the end of the walk.
        unsafe { self.nodes.get_unchecked(self.top).assume_init() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_behind_the_limit_are_passed_by_and_the_end_never_is() {
        let mut stack = Stack::new();
        for (keys, count) in [([9, 4], 2), ([7, 0], 1)] {
            let (nodes, place) = (stack.free(), stack.free_keys());
            // SAFETY: there is room for a node's children.
            unsafe {
                for (offset, key) in keys.into_iter().enumerate() {
                    *nodes.add(offset) =
                        NodeRef::from_raw(std::ptr::without_provenance_mut(key as usize * 64));
                    *place.add(offset) = key;
                }
                stack.grow(count);
            }
        }
        // SAFETY: three entries are taken off before the end.
        unsafe {
            assert_eq!(stack.pop_before(7).into_raw().addr(), 4 * 64);
            assert!(stack.pop_before(9).is_end());
            assert!(PlainStack::new().pop().is_end());
        }
    }

    #[test]
    #[should_panic(expected = "deeper than permitted")]
    fn a_tree_too_deep_is_noticed() {
        let mut stack = PlainStack::new();
        loop {
            let place = stack.free();
            // SAFETY: there is room for a node's children.
            unsafe {
                (0..WIDTH_MAX).for_each(|offset| *place.add(offset) = NodeRef::EMPTY);
                stack.grow(WIDTH_MAX);
            }
        }
    }
}
