//! Visits every node and leaf of a tree once, for statistics and checks.

use super::layout::{Block, Bounds, NodeRef};
use super::{Root, Tree};

/// What is met on the walk. `bounds` is what the parent says of it; the root has depth 0.
pub(crate) enum Met<'a> {
    Node { bounds: Bounds, depth: u32, width: usize, children: &'a [Bounds] },
    Leaf { bounds: Bounds, depth: u32, blocks: &'a [Block] },
}

impl Tree {
    /// Calls `visit` for every node and non-empty leaf, parents first.
    pub(crate) fn walk(&self, mut visit: impl FnMut(Met<'_>)) {
        let Root { node, bounds } = self.root;
        match self.parameters.branching_factor {
            2 => step::<2>(node, bounds, 0, &mut visit),
            4 => step::<4>(node, bounds, 0, &mut visit),
            _ => step::<8>(node, bounds, 0, &mut visit),
        }
    }
}

/// Recursion is as deep as the tree, at most 64 levels.
fn step<const W: usize>(node: NodeRef, bounds: Bounds, depth: u32, visit: &mut impl FnMut(Met<'_>)) {
    if node.is_leaf() {
        // SAFETY: the reference came from this tree, which is borrowed for the walk.
        let blocks = unsafe { node.blocks() };
        if !blocks.is_empty() {
            visit(Met::Leaf { bounds, depth, blocks });
        }
        return;
    }
    // SAFETY: as above; `W` is the tree's width.
    let inner = unsafe { node.node::<W>() };
    // Inverted bounds mark an unused place.
    let used: Vec<usize> =
        (0..W).filter(|&child| inner.bounds[0][0][child] <= inner.bounds[0][1][child]).collect();
    let children: Vec<Bounds> = used.iter().map(|&child| inner.child_bounds(child)).collect();
    visit(Met::Node { bounds, depth, width: W, children: &children });
    for (&child, &bounds) in used.iter().zip(&children) {
        step::<W>(inner.children[child], bounds, depth + 1, visit);
    }
}
