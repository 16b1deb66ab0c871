//! The upper part of a tree, for tight boxes around where it is placed.

use std::collections::BinaryHeap;

use glam::Affine3A;

use super::top::transformed;
use crate::layout::{Bounds, NodeRef, Root, TreeNode};

/// Nodes of an object's tree that decide how tight its boxes in the world are.
const PARTS: usize = 64;

/// The boxes of the largest nodes of a tree of which none is below another; together they hold all triangles.
#[derive(Debug)]
pub(super) struct Outline {
    boxes: Vec<Bounds>,
}

/// Areas order like their bits, for they are not below zero.
fn by_size(bounds: &Bounds) -> u64 {
    bounds.half_area().max(0.0).to_bits()
}

impl Outline {
    /// Opens nodes, the largest first, until there are [`PARTS`].
    ///
    /// # Safety
    /// The root is that of a tree of nodes `N`, which lives.
    pub(super) unsafe fn of<N: TreeNode>(root: &Root) -> Self {
        let mut parts: Vec<(Bounds, NodeRef)> = vec![(root.bounds, root.node)];
        let mut closed = BinaryHeap::from([(by_size(&root.bounds), 0)]);
        while parts.len() < PARTS {
            let Some((_, number)) = closed.pop() else {
                break;
            };
            let (_, node) = parts[number];
            if node.is_leaf() {
                continue;
            }
            // SAFETY: the caller vouches for the tree.
            let inner = unsafe { node.node::<N>() };
            for child in 0..inner.count() {
                let part = (inner.child_bounds(child), inner.children()[child]);
                // One child takes its parent's place, the others come behind all.
                let place = if child == 0 { number } else { parts.len() };
                closed.push((by_size(&part.0), place));
                match parts.get_mut(place) {
                    Some(parent) => *parent = part,
                    None => parts.push(part),
                }
            }
        }
        Self { boxes: parts.into_iter().map(|(bounds, _)| bounds).collect() }
    }

    /// A box around the triangles after `by`. Each box is turned by itself, so it is tighter than the turned
    /// box of the whole.
    pub(super) fn placed(&self, by: &Affine3A) -> Bounds {
        self.boxes.iter().map(|one| transformed(one, by)).fold(Bounds::EMPTY, Bounds::union)
    }
}
