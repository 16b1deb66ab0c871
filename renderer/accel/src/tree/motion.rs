//! Trees over triangles that move: refitted, rebuilt, or rebuilt where that pays.
//!
//! When a tree is updated for the first time it is cut into some hundred subtrees of like size, and what lies
//! above them is listed. The subtrees are refitted in parallel, then the nodes above. A tree that is never
//! updated has none of this.
//!
//! A partial update also compares costs with those of the last build. Where a subtree's cost, seen from a ray
//! that hits its box, has grown beyond the threshold, the subtree alone is rebuilt and grafted on; where that
//! holds for the nodes above, whole subtrees have drifted apart, and everything is rebuilt. Rebuilding by how
//! far the heuristic's cost has grown is Lauterbach et al.'s ("RT-DEFORM: Interactive Ray Tracing of Dynamic
//! Scenes using BVHs", 2006), doing so for parts Yoon, Curtis and Manocha's ("Ray Tracing Dynamic Scenes
//! using Selective Restructuring", 2007).

use std::sync::Arc;

use rayon::prelude::*;

use super::Tree;
use super::refit::{Fitted, blocks_of, measure, refit};
use crate::embree::Device;
use crate::error::BuildError;
use crate::geometry::Triangles;
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX, for_block, for_node};
use crate::limits::MAX_DEPTH;
use crate::parameters::{TreeParameters, Update};

/// A subtree has at most this share of the triangles.
const SHARE: usize = 256;

/// Subtrees so small are not cut further.
const CUT_MIN: usize = 512;

/// What is remembered of a tree between updates.
#[derive(Debug)]
pub(super) struct Motion {
    subtrees: Vec<Subtree>,
    /// Nodes above the subtrees, parents before their children.
    above: Vec<Above>,
    /// Cost of the nodes above at the last build of everything.
    cost_above: f64,
}

/// A subtree that is refitted by one thread.
#[derive(Debug)]
struct Subtree {
    node: NodeRef,
    depth: u32,
    /// Cost at its last build.
    cost: f64,
    /// Owns the nodes, once it was rebuilt.
    graft: Option<Tree>,
}

/// A node above the subtrees.
#[derive(Debug)]
struct Above {
    node: NodeRef,
    /// The kind of each of its children.
    children: Vec<Below>,
}

#[derive(Clone, Copy, Debug)]
enum Below {
    Above(usize),
    Subtree(usize),
}

// SAFETY: the references lead into the tree that owns this and its grafts; they are followed by
// `Tree::update` alone, which has that tree to itself.
unsafe impl Send for Motion {}
// SAFETY: as above.
unsafe impl Sync for Motion {}

// SAFETY: no two subtrees share a node, so each can go to a thread of its own.
unsafe impl Send for Subtree {}
// SAFETY: a shared subtree is not followed.
unsafe impl Sync for Subtree {}

/// A subtree as a thread gets hold of it.
#[derive(Clone, Copy)]
struct Handed(NodeRef);

// SAFETY: each subtree is handed to one thread, and no two share a node.
unsafe impl Send for Handed {}
// SAFETY: as above.
unsafe impl Sync for Handed {}

impl Tree {
    /// Brings the tree up to date with moved triangles. On an error it is up to date as well, refitted.
    pub(crate) fn update(
        &mut self,
        device: &Device,
        triangles: &Arc<Triangles>,
        update: Update,
    ) -> Result<(), BuildError> {
        BuildError::same_count(self.root.triangles.len(), triangles.len())?;
        update.check()?;
        if update == Update::Rebuild || triangles.is_empty() {
            return self.rebuild(device, triangles);
        }
        let parameters = self.parameters;
        for_node!(parameters, N => for_block!(parameters, B => self.fit::<N, B>(device, triangles, update)))
    }

    fn rebuild(&mut self, device: &Device, triangles: &Arc<Triangles>) -> Result<(), BuildError> {
        let isa = self.isa;
        let fresh = Self::build(device, triangles, &self.parameters)?;
        *self = fresh.with_isa(isa).expect("this processor had it before");
        Ok(())
    }

    fn fit<N: TreeNode, const B: usize>(
        &mut self,
        device: &Device,
        triangles: &Arc<Triangles>,
        update: Update,
    ) -> Result<(), BuildError> {
        let watertight = self.parameters.robust;
        let mut motion = match self.motion.take() {
            Some(motion) => motion,
            None => Box::new(Motion::of::<N, B>(self)),
        };
        self.root.triangles = Arc::clone(triangles);
        let handed: Vec<Handed> = motion.subtrees.iter().map(|subtree| Handed(subtree.node)).collect();
        let mut fitted: Vec<Fitted> = handed
            .into_par_iter()
            // SAFETY: the tree is ours alone, of these kinds, and no two subtrees share a node.
            .map(|Handed(node)| unsafe { refit::<N, B>(node, triangles, watertight) })
            .collect();
        if let Update::Partial { rebuild_threshold } = update {
            let threshold = f64::from(rebuild_threshold);
            let decayed = |subtree: &Subtree, fitted: &Fitted| fitted.cost() > threshold * subtree.cost;
            let (parameters, isa) = (self.parameters, self.isa);
            let pairs = motion.subtrees.par_iter_mut().zip(&mut fitted);
            pairs.filter(|(subtree, fitted)| decayed(subtree, fitted)).for_each(|(subtree, fitted)| {
                match subtree.build::<N, B>(device, triangles, &parameters, isa) {
                    Ok(anew) => *fitted = anew,
                    // It was denied a depth that the whole tree has, and would be again: it stays as it is.
                    Err(_) => subtree.cost = fitted.cost(),
                }
            });
        }
        // SAFETY: as above; the parallel part is over.
        let (bounds, cost) = unsafe { motion.fit_above::<N>(&fitted) };
        self.root.bounds = bounds;
        if motion.above.is_empty() {
            self.root.node = motion.subtrees[0].node;
        }
        let cost_above = motion.cost_above;
        self.motion = Some(motion);
        match update {
            Update::Partial { rebuild_threshold } if cost > f64::from(rebuild_threshold) * cost_above => {
                self.rebuild(device, triangles)
            }
            _ => Ok(()),
        }
    }
}

impl Motion {
    /// Cuts a tree as it was built.
    fn of<N: TreeNode, const B: usize>(tree: &Tree) -> Self {
        let largest = (tree.root.triangles.len() / SHARE).max(CUT_MIN);
        let mut motion = Self { subtrees: Vec::new(), above: Vec::new(), cost_above: 0.0 };
        // SAFETY: the node is the root of a tree of these kinds, which is borrowed.
        unsafe { motion.cut::<N, B>(tree.root.node, tree.root.bounds, 0, largest) };
        let root_area = tree.root.bounds.half_area();
        motion.cost_above = if root_area > 0.0 { motion.cost_above / root_area } else { 1.0 };
        motion
    }

    /// # Safety
    /// `node` is of a tree of these kinds, which lives.
    unsafe fn cut<N: TreeNode, const B: usize>(
        &mut self,
        node: NodeRef,
        bounds: Bounds,
        depth: u32,
        largest: usize,
    ) -> Below {
        self.cost_above += bounds.half_area();
        // SAFETY: the caller vouches for it. Measuring again on each level costs a few walks, once.
        let measured = unsafe { measure::<N, B>(node, bounds) };
        if node.is_leaf() || measured.triangles <= largest {
            self.subtrees.push(Subtree { node, depth, cost: measured.cost(), graft: None });
            return Below::Subtree(self.subtrees.len() - 1);
        }
        let number = self.above.len();
        self.above.push(Above { node, children: Vec::new() });
        // SAFETY: the caller vouches for it.
        let inner = unsafe { node.node::<N>() };
        let children = (0..inner.count())
            // SAFETY: children of such a tree.
            .map(|child| unsafe {
                self.cut::<N, B>(inner.children()[child], inner.child_bounds(child), depth + 1, largest)
            })
            .collect();
        self.above[number].children = children;
        Below::Above(number)
    }

    /// Fits the nodes above to their subtrees, which may have moved in memory. Gives the box around
    /// everything and the cost of these nodes and the subtrees' boxes.
    ///
    /// # Safety
    /// The nodes are of kind `N`, live, and nobody else looks at them.
    unsafe fn fit_above<N: TreeNode>(&self, fitted: &[Fitted]) -> (Bounds, f64) {
        let mut boxes = vec![Bounds::EMPTY; self.above.len()];
        for (number, above) in self.above.iter().enumerate().rev() {
            // SAFETY: the caller vouches for it.
            let inner = unsafe { above.node.node_mut::<N>() };
            let mut bounds = [Bounds::EMPTY; WIDTH_MAX];
            for (child, below) in above.children.iter().enumerate() {
                bounds[child] = match *below {
                    Below::Above(number) => boxes[number],
                    Below::Subtree(number) => {
                        inner.children_mut()[child] = self.subtrees[number].node;
                        fitted[number].bounds
                    }
                };
            }
            let bounds = &bounds[..above.children.len()];
            inner.set_bounds(bounds);
            boxes[number] = bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        }
        let whole = boxes.first().copied().unwrap_or(fitted[0].bounds);
        let area: f64 =
            boxes.iter().chain(fitted.iter().map(|fitted| &fitted.bounds)).map(Bounds::half_area).sum();
        let own = whole.half_area();
        (whole, if own > 0.0 { area / own } else { 1.0 })
    }
}

impl Subtree {
    /// Rebuilds the subtree over its triangles.
    fn build<N: TreeNode, const B: usize>(
        &mut self,
        device: &Device,
        triangles: &Arc<Triangles>,
        parameters: &TreeParameters,
        isa: crate::traverse::Isa,
    ) -> Result<Fitted, BuildError> {
        let max_depth = parameters.max_depth.saturating_sub(self.depth);
        if max_depth < *MAX_DEPTH.start() {
            return Err(BuildError::DepthLimit { max_depth: parameters.max_depth });
        }
        let mut numbers = Vec::new();
        // SAFETY: the tree of this subtree is being updated, by one thread now.
        unsafe { blocks_of::<N, B>(self.node, &mut |block: &mut Block<B>| numbers.extend(block.numbers())) };
        // Spatial splits leave a triangle in several leaves.
        numbers.sort_unstable();
        numbers.dedup();
        let part = Arc::new(triangles.subset(&numbers));
        let parameters = TreeParameters { max_depth, ..*parameters };
        let mut graft = Tree::build(device, &part, &parameters)?.with_isa(isa).expect("the tree has it");
        let (node, bounds) = (graft.root.node, graft.root.bounds);
        let renumber = &mut |block: &mut Block<B>| block.renumber(|number| numbers[number as usize]);
        // SAFETY: the graft is new and ours.
        unsafe { blocks_of::<N, B>(node, renumber) };
        graft.root.triangles = Arc::clone(triangles);
        // SAFETY: as above.
        let fitted = unsafe { measure::<N, B>(node, bounds) };
        (self.node, self.cost, self.graft) = (node, fitted.cost(), Some(graft));
        Ok(fitted)
    }
}
