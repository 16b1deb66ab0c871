//! Trees over triangles that move: refitted, rebuilt, or rebuilt where that pays.
//!
//! At its first update a tree is cut into some hundred subtrees of like size, which are refitted in parallel,
//! then the nodes above.
//!
//! A partial update compares costs with those of the last build. A subtree whose cost has grown beyond the
//! threshold is rebuilt and grafted on. Where the cost above has grown as much, new nodes are made there, and
//! if that does not help, everything is rebuilt (Lauterbach et al., "RT-DEFORM", 2006; for parts Yoon, Curtis
//! and Manocha, "Ray Tracing Dynamic Scenes using Selective Restructuring", 2007).

use std::sync::Arc;

use rayon::prelude::*;

use super::plan::{Named, Plan};
use super::refit::{Fitted, blocks_of, measure, refit};
use super::{Tree, arena::Arena, build::plan_over};
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX, for_block, for_node};
use crate::parameters::{TreeParameters, Update};
use crate::{embree::Device, error::BuildError, geometry::Triangles, limits::MAX_DEPTH};

/// A subtree has at most this share of the triangles.
const SHARE: usize = 256;
/// Subtrees so small are not cut further.
const CUT_MIN: usize = 512;
/// Passes in which new nodes above the subtrees are improved by moving branches.
const PASSES_ABOVE: u32 = 2;

/// The state of a tree between updates.
#[derive(Debug)]
pub(super) struct Motion {
    subtrees: Vec<Subtree>,
    /// Nodes above the subtrees, parents before their children.
    above: Vec<Above>,
    /// Cost of the nodes above at the last build of everything.
    cost_above: f64,
    /// Owns the nodes above, once the subtrees got new ones.
    memory: Option<Arena>,
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

    /// Whether there is nothing to follow: its triangles rest, and a rebuild would change nothing.
    pub(super) fn rests(&self, triangles: &Triangles, update: Update) -> bool {
        (update != Update::Rebuild || self.motion.is_none()) && self.root.triangles.rest_as(triangles)
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
        let subtrees = motion.subtrees.par_iter();
        let mut fitted: Vec<Fitted> = subtrees
            // SAFETY: the tree is ours alone, of these kinds, and no two subtrees share a node.
            .map(|subtree| unsafe { refit::<N, B>(subtree.node, triangles, watertight) })
            .collect();
        let Update::Partial { rebuild_threshold } = update else {
            // SAFETY: as above; the parallel part is over.
            let (bounds, _) = unsafe { motion.fit_above::<N>(&fitted) };
            self.root.bounds = bounds;
            self.motion = Some(motion);
            return Ok(());
        };
        let threshold = f64::from(rebuild_threshold);
        let (parameters, isa) = (self.parameters, self.isa);
        let decayed = |subtree: &Subtree, fitted: &Fitted| fitted.cost() > threshold * subtree.cost;
        let pairs = motion.subtrees.par_iter_mut().zip(&mut fitted);
        pairs.filter(|(subtree, fitted)| decayed(subtree, fitted)).for_each(|(subtree, fitted)| {
            match subtree.build::<N, B>(device, triangles, &parameters, isa) {
                Ok(rebuilt) => *fitted = rebuilt,
                // It was denied a depth that the whole tree has, and would be again: it stays as it is.
                Err(_) => subtree.cost = fitted.cost(),
            }
        });
        // SAFETY: as above; the parallel part is over.
        let (mut bounds, mut cost) = unsafe { motion.fit_above::<N>(&fitted) };
        if motion.above.is_empty() {
            self.root.node = motion.subtrees[0].node;
        }
        if cost > threshold * motion.cost_above
            && let Some(node) = motion.regroup::<N>(device, &fitted, parameters.max_depth)
        {
            self.root.node = node;
            // SAFETY: as above; the nodes are new.
            (bounds, cost) = unsafe { motion.fit_above::<N>(&fitted) };
        }
        self.root.bounds = bounds;
        let has_decayed = cost > threshold * motion.cost_above;
        self.motion = Some(motion);
        if has_decayed { self.rebuild(device, triangles) } else { Ok(()) }
    }
}

impl Motion {
    /// Cuts a tree as it was built.
    fn of<N: TreeNode, const B: usize>(tree: &Tree) -> Self {
        let largest = (tree.root.triangles.len() / SHARE).max(CUT_MIN);
        let mut motion = Self { subtrees: Vec::new(), above: Vec::new(), cost_above: 0.0, memory: None };
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

    /// Makes new nodes above the subtrees by their boxes now, and gives the root. `None`, with nothing
    /// changed, where nothing is above, leaves would lie too deep, or memory lacks.
    fn regroup<N: TreeNode>(
        &mut self,
        device: &Device,
        fitted: &[Fitted],
        max_depth: u32,
    ) -> Option<NodeRef> {
        if self.above.is_empty() {
            return None;
        }
        let boxes: Vec<Bounds> = fitted.iter().map(|fitted| fitted.bounds).collect();
        let plan = plan_over(device, &boxes, N::WIDTH as u32, PASSES_ABOVE).ok()?;
        let depths = depths(&plan, self.subtrees.len());
        let is_deep = |(depth, fitted): (&u32, &Fitted)| depth + fitted.height > max_depth;
        if depths.iter().zip(fitted).any(is_deep) {
            return None;
        }
        let arena = Arena::new(plan.nodes() * size_of::<N>()).ok()?;
        let place = |node: usize| arena.start().cast::<N>().wrapping_add(node);
        let below = |named: Named| match named {
            Named::Node(node) => Below::Above(node),
            Named::Leaf(leaf) => Below::Subtree(plan.triangles(leaf)[0] as usize),
        };
        let mut above = Vec::with_capacity(plan.nodes());
        for number in 0..plan.nodes() {
            let planned = plan.children(number);
            let children: Vec<Below> = planned.iter().map(|child| below(child.link.named())).collect();
            let reference = |child: &Below| match *child {
                Below::Above(node) => NodeRef::to_node::<N>(place(node)),
                Below::Subtree(subtree) => self.subtrees[subtree].node,
            };
            let referred: Vec<(Bounds, NodeRef)> = planned
                .iter()
                .zip(&children)
                .map(|(child, below)| (child.bounds, reference(below)))
                .collect();
            // SAFETY: the block has room for as many nodes as are planned, and each has its own place.
            unsafe { place(number).write(N::new(&referred)) };
            above.push(Above { node: NodeRef::to_node::<N>(place(number)), children });
        }
        let root = above[0].node;
        for (subtree, depth) in self.subtrees.iter_mut().zip(depths) {
            subtree.depth = depth;
        }
        (self.above, self.memory) = (above, Some(arena));
        Some(root)
    }

    /// Fits the nodes above to their subtrees, which may have moved in memory. Gives the box around
    /// everything and the cost of these nodes and the subtrees' boxes.
    ///
    /// # Safety
    /// The nodes are of kind `N`, live, and there is no other reference to them.
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

/// The depth of each of `count` subtrees in a plan whose leaves are subtrees.
fn depths(plan: &Plan, count: usize) -> Vec<u32> {
    let (mut of_nodes, mut of_subtrees) = (vec![0; plan.nodes()], vec![0; count]);
    for node in 0..plan.nodes() {
        for child in plan.children(node) {
            match child.link.named() {
                Named::Node(below) => of_nodes[below] = of_nodes[node] + 1,
                Named::Leaf(leaf) => of_subtrees[plan.triangles(leaf)[0] as usize] = of_nodes[node] + 1,
            }
        }
    }
    of_subtrees
}

impl Subtree {
    fn build<N: TreeNode, const B: usize>(
        &mut self,
        device: &Device,
        triangles: &Arc<Triangles>,
        parameters: &TreeParameters,
        isa: crate::traverse::Isa,
    ) -> Result<Fitted, BuildError> {
        let max_depth = parameters.max_depth.saturating_sub(self.depth);
        if max_depth < *MAX_DEPTH.start() {
            return Err(BuildError::DepthLimit(parameters.max_depth));
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

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3, Vec3A};

    use super::*;
    use crate::parameters::{Builder, Collapse};

    /// Balls of four hundred triangles, each turned about the middle of all by an angle of its own.
    fn balls(moment: f32) -> Arc<Triangles> {
        let mut positions = Vec::new();
        for ball in 0..24 {
            let way = if ball % 2 == 0 { moment } else { -0.7 * moment };
            let around = Quat::from_rotation_y(0.9 * ball as f32 + way);
            let center = Vec3::new(2.0 + 0.5 * (ball / 6) as f32, 1.1 * (ball % 5) as f32, 0.0);
            for triangle in 0..400 {
                let along = triangle as f32 * 0.0157;
                let point = |turn: f32| {
                    let on_ball =
                        Quat::from_rotation_y(17.0 * along + turn) * Vec3::new(along.sin(), along.cos(), 0.0);
                    Vec3A::from(around * (center + 0.25 * on_ball))
                };
                positions.extend([point(0.0), point(0.04), point(0.04) + Vec3A::Y * 0.01]);
            }
        }
        let indices = (0..positions.len() as u32 / 3).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        Arc::new(Triangles::new(positions, indices).expect("they are near"))
    }

    #[test]
    fn parts_that_only_change_places_get_new_nodes_above_them() {
        let device = Device::open(0).expect("Embree starts");
        for (branching_factor, collapse) in
            [(2, Collapse::Builder), (8, Collapse::Builder), (16, Collapse::Optimal)]
        {
            let parameters = TreeParameters {
                branching_factor,
                collapse,
                builder: Builder::Ploc,
                max_depth: 64,
                ..TreeParameters::default()
            };
            let cost = |tree: &Tree| tree.statistics().sah_cost;
            let mut tree = Tree::build(&device, &balls(0.0), &parameters).expect("it builds");
            let mut regrouped = 0;
            for step in 1..=8 {
                let now = balls(step as f32 * 0.4);
                tree.update(&device, &now, Update::partial(1.5)).expect("it follows");
                tree.validate().expect("it is sound");
                // A rebuilt tree has no memory.
                regrouped += u32::from(tree.motion.as_ref().is_some_and(|motion| motion.memory.is_some()));
                let fresh = Tree::build(&device, &now, &parameters).expect("it builds");
                // The costs of subtrees may have grown by the threshold, and so may those of the nodes above.
                assert!(cost(&tree) < 2.25 * cost(&fresh), "{} against {}", cost(&tree), cost(&fresh));
            }
            assert!(regrouped > 2, "{branching_factor}: {regrouped} of 8 times");
        }
    }

    #[test]
    fn new_nodes_go_no_deeper_than_is_allowed() {
        let device = Device::open(0).expect("Embree starts");
        let parameters =
            TreeParameters { builder: Builder::Ploc, max_depth: 64, ..TreeParameters::default() };
        let mut tree = Tree::build(&device, &balls(0.0), &parameters).expect("it builds");
        tree.update(&device, &balls(0.1), Update::Refit).expect("it follows");
        let depth = tree.statistics().depth;
        let mut motion = tree.motion.take().expect("it was refitted");
        let fitted: Vec<Fitted> = motion
            .subtrees
            .iter()
            // SAFETY: nodes of the tree, which is of this kind; only boxes and heights are read.
            .map(|subtree| unsafe { measure::<crate::layout::Node<2>, 4>(subtree.node, Bounds::EMPTY) })
            .map(|fitted| Fitted { bounds: Bounds { lower: [0.0; 3], upper: [1.0; 3] }, ..fitted })
            .collect();
        let above = motion.above.len();
        assert!(
            motion.regroup::<crate::layout::Node<2>>(&device, &fitted, 5).is_none()
                && motion.above.len() == above
        );
        assert!(motion.regroup::<crate::layout::Node<2>>(&device, &fitted, depth + 20).is_some());
    }
}
