//! Visits every node and leaf of a tree once, for statistics and checks.

use super::Tree;
use crate::layout::{Block, Bounds, NodeRef, Root, TreeNode, for_block, for_node};

/// A node or leaf with its box in the parent; `reach` is what of it lies inside all boxes on the way.
pub(crate) enum Met<'a> {
    Node { bounds: Bounds, depth: u32, bytes: usize, children: &'a [Bounds] },
    Leaf { bounds: Bounds, reach: Bounds, depth: u32, bytes: usize, numbers: &'a [u32] },
}

#[derive(Clone, Copy)]
struct Place {
    node: NodeRef,
    bounds: Bounds,
    reach: Bounds,
    depth: u32,
}

impl Tree {
    /// Calls `visit` for every node and non-empty leaf, parents first.
    pub(crate) fn walk(&self, visit: &mut impl FnMut(Met<'_>)) {
        let Root { node, bounds, .. } = self.root;
        let place = Place { node, bounds, reach: bounds, depth: 0 };
        for_node!(self.parameters, N => for_block!(self.parameters, B => step::<N, B>(place, visit)));
    }
}

/// Recursion is as deep as the tree, at most 64 levels.
fn step<N: TreeNode, const B: usize>(place: Place, visit: &mut impl FnMut(Met<'_>)) {
    let Place { node, bounds, reach, depth } = place;
    if node.is_leaf() {
        // SAFETY: the reference is of this tree, borrowed for the walk; `B` is its blocks' width.
        let blocks = unsafe { node.blocks::<B>() };
        if !blocks.is_empty() {
            let numbers: Vec<u32> = blocks.iter().flat_map(Block::numbers).collect();
            visit(Met::Leaf { bounds, reach, depth, bytes: size_of_val(blocks), numbers: &numbers });
        }
        return;
    }
    // SAFETY: as above; `N` is the tree's kind of node.
    let inner = unsafe { node.node::<N>() };
    let children: Vec<Bounds> = (0..inner.count()).map(|child| inner.child_bounds(child)).collect();
    visit(Met::Node { bounds, depth, bytes: size_of::<N>(), children: &children });
    for (&node, &bounds) in inner.children().iter().zip(&children) {
        step::<N, B>(Place { node, bounds, reach: reach.overlap(bounds), depth: depth + 1 }, visit);
    }
}
