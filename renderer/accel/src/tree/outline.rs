//! The upper part of a tree, for the code that places or opens it.

use std::collections::BinaryHeap;

use glam::Affine3A;

use super::top::transformed;
use crate::layout::{Bounds, NodeRef, Root, TreeNode};

/// A node or leaf near the root.
#[derive(Clone, Copy, Debug)]
struct Part {
    node: NodeRef,
    bounds: Bounds,
    /// Where its children begin in the outline, and how many they are; none if they are not in it.
    first: u32,
    count: u32,
}

/// The largest nodes of a tree, the root first.
#[derive(Debug)]
pub(super) struct Outline {
    parts: Vec<Part>,
}

// SAFETY: the references are read by `Outline::of` alone, which borrows their tree; after that they are only
// handed on.
unsafe impl Send for Outline {}
// SAFETY: as above.
unsafe impl Sync for Outline {}

/// Areas order like their bits, for they are not below zero.
pub(super) fn by_size(bounds: &Bounds) -> u64 {
    bounds.half_area().max(0.0).to_bits()
}

impl Outline {
    /// Takes in nodes, the largest first, until there are `most`.
    ///
    /// # Safety
    /// The root is that of a tree of nodes `N`, which lives.
    pub(super) unsafe fn of<N: TreeNode>(root: &Root, most: usize) -> Self {
        let part = |bounds, node| Part { node, bounds, first: 0, count: 0 };
        let mut parts = vec![part(root.bounds, root.node)];
        let mut closed = BinaryHeap::from([(by_size(&root.bounds), 0)]);
        while parts.len() < most {
            let Some((_, number)) = closed.pop() else {
                break;
            };
            let node: NodeRef = parts[number].node;
            if node.is_leaf() {
                continue;
            }
            // SAFETY: the caller vouches for the tree.
            let inner = unsafe { node.node::<N>() };
            (parts[number].first, parts[number].count) = (parts.len() as u32, inner.count() as u32);
            for child in 0..inner.count() {
                let bounds = inner.child_bounds(child);
                closed.push((by_size(&bounds), parts.len()));
                parts.push(part(bounds, inner.children()[child]));
            }
        }
        Self { parts }
    }

    /// The node behind a number; the root's is 0.
    pub(super) fn node(&self, number: usize) -> NodeRef {
        self.parts[number].node
    }

    /// Numbers of a node's children, as far as they are in the outline.
    pub(super) fn children(&self, number: usize) -> std::ops::Range<usize> {
        let Part { first, count, .. } = self.parts[number];
        first as usize..(first + count) as usize
    }

    /// A box around the triangles below a node after `by`. It encloses the boxes farthest down, each of which
    /// is turned by itself, so it is tighter than the turned box of the node.
    pub(super) fn placed(&self, number: usize, by: &Affine3A) -> Bounds {
        let children = self.children(number);
        if children.is_empty() {
            return transformed(&self.parts[number].bounds, by);
        }
        children.map(|child| self.placed(child, by)).fold(Bounds::EMPTY, Bounds::union)
    }
}
