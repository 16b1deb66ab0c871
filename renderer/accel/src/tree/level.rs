//! The upper level of two: a tree over placed objects, or parts of them.
//!
//! Its leaves hold one part each, because each part costs a walk of its own. Objects whose boxes overlap are
//! opened, the largest first: the object's nodes are placed instead of the object, so that a ray enters only
//! nodes that it comes near to. That is partial re-braiding (Benthin, Woop, Wald and Afra, "Improved
//! Two-Level BVHs using Partial Re-Braiding", 2017), done before the build instead of during it.

use std::collections::BinaryHeap;
use std::sync::Arc;

use rayon::prelude::*;

use super::Tree;
use super::arena::Arena;
use super::binary::BinaryTree;
use super::collapse::collapse;
use super::outline::{Outline, by_size};
use super::plan::Plan;
use super::reinsertion::optimise;
use super::top::binary_over;
use super::write::{Items, write};
use crate::error::BuildError;
use crate::instances::Instance;
use crate::layout::{Bounds, Node, NodeRef, PlacedPart, Root, TreeNode, for_node};
use crate::limits::MAX_DEPTH;
use crate::parameters::{Collapse, TreeParameters};
use crate::traverse::placed::{Lower, Object};
use crate::traverse::{Isa, Kernels, LEVEL_WIDTH, LevelKernels};

/// Nodes of an object's tree that decide how tight its boxes in the world are.
const OUTLINE: usize = 64;

/// Least number of instances that the decision how many to open assumes.
const INSTANCES_MIN: usize = 64;

/// The upper level and what lies below it. It refers to the objects' trees.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) root: Root,
    pub(super) lower: Lower,
    pub(super) kernels: LevelKernels,
    parts: usize,
    nodes: usize,
    depth: u32,
    upper: Option<Upper>,
}

/// The upper level by numbers, and in memory.
#[derive(Debug)]
struct Upper {
    outlines: Vec<Outline>,
    seeds: Vec<Seed>,
    plan: Plan,
    /// The boxes that a ray met when it was built, see [`Plan::boxes_met`].
    boxes_met: f64,
    /// Owns the nodes and leaves.
    _memory: Arena,
}

// SAFETY: the memory that it refers to is never written once its root leads there.
unsafe impl Send for Level {}
// SAFETY: as above.
unsafe impl Sync for Level {}

/// An object to be placed.
pub(super) struct Below<'a> {
    pub(super) tree: &'a Tree,
    /// Number of its first triangle.
    pub(super) first: u32,
}

/// An object in a place, with its number as an instance.
pub(super) type Place = (u32, Instance);

/// A part under construction.
#[derive(Clone, Copy, Debug)]
struct Seed {
    /// Number of the place.
    place: usize,
    /// Number in the object's outline.
    part: usize,
    bounds: Bounds,
}

impl Items for &[PlacedPart] {
    type Item = PlacedPart;

    fn count(&self, numbers: &[u32]) -> usize {
        numbers.len()
    }

    fn item(&self, numbers: &[u32], index: usize) -> PlacedPart {
        self[numbers[index] as usize]
    }
}

impl Level {
    /// Without anything in it.
    pub(super) fn empty(isa: Isa, parameters: &TreeParameters) -> Self {
        let kernels = LevelKernels::select(isa, parameters.robust).expect("the instruction set was detected");
        let of_objects = Kernels::select(isa, parameters).expect("the parameters were checked");
        Self {
            root: Root { node: NodeRef::EMPTY, bounds: Bounds::EMPTY, triangles: Arc::default() },
            lower: Lower { objects: Vec::new(), kernels: of_objects },
            kernels,
            parts: 0,
            nodes: 0,
            depth: 0,
            upper: None,
        }
    }

    /// Builds over objects in their places; an instance's number of an object is that in `below`.
    pub(super) fn build(
        below: &[Below<'_>],
        places: &[Place],
        isa: Isa,
        parameters: &TreeParameters,
    ) -> Result<Self, BuildError> {
        let mut level = Self::empty(isa, parameters);
        let objects =
            below.iter().map(|object| Object { root: object.tree.root.clone(), first: object.first });
        level.lower.objects = objects.collect();
        let outlines = outlines(below, places, parameters);
        let seeds = seeds(&outlines, places, parameters);
        if seeds.is_empty() {
            return Ok(level);
        }
        let plan = plan(&seeds, parameters);
        let (memory, node) = written(&outlines, &seeds, &plan, places)?;
        level.root = Root { node, bounds: plan.root.bounds, triangles: Arc::default() };
        (level.parts, level.nodes, level.depth) = (seeds.len(), plan.nodes(), plan.depth);
        let boxes_met = plan.boxes_met();
        level.upper = Some(Upper { outlines, seeds, plan, boxes_met, _memory: memory });
        Ok(level)
    }

    /// Fits the level to its places, which moved, of objects that rest. Returns false where there is no tree,
    /// its cost has grown beyond `most` times that of its build, or memory ran out. The level must then be
    /// rebuilt.
    pub(super) fn fit(&mut self, places: &[Place], most: f64) -> bool {
        let Some(upper) = &mut self.upper else {
            return false;
        };
        let (outlines, seeds) = (&upper.outlines, &mut upper.seeds);
        seeds.par_iter_mut().for_each(|seed| *seed = placed(outlines, places, seed.place, seed.part));
        upper.plan.fit(|number| seeds[number as usize].bounds);
        if upper.plan.boxes_met() > most * upper.boxes_met {
            return false;
        }
        let Ok((memory, node)) = written(outlines, seeds, &upper.plan, places) else {
            return false;
        };
        self.root = Root { node, bounds: upper.plan.root.bounds, triangles: Arc::default() };
        upper._memory = memory;
        true
    }

    /// Bytes of nodes and parts.
    pub(super) fn bytes(&self) -> usize {
        self.nodes * size_of::<Node<LEVEL_WIDTH>>() + self.parts * size_of::<PlacedPart>()
    }

    /// Calls `visit` for every node below the root and every leaf with its depth, its box, and what a leaf
    /// holds.
    pub(super) fn walk(&self, visit: &mut impl FnMut(u32, Bounds, Option<&PlacedPart>)) {
        let mut stack = vec![(0, self.root.bounds, self.root.node)];
        while let Some((depth, bounds, node)) = stack.pop() {
            if node.is_leaf() {
                // SAFETY: the reference came from this level, which is borrowed.
                for part in unsafe { node.items::<PlacedPart>() } {
                    visit(depth, bounds, Some(part));
                }
                continue;
            }
            visit(depth, bounds, None);
            // SAFETY: as above.
            let inner = unsafe { node.node::<Node<LEVEL_WIDTH>>() };
            for child in 0..inner.count() {
                stack.push((depth + 1, inner.child_bounds(child), inner.children()[child]));
            }
        }
    }
}

/// Nodes and leaves in memory, and the root's place.
fn written(
    outlines: &[Outline],
    seeds: &[Seed],
    plan: &Plan,
    places: &[Place],
) -> Result<(Arena, NodeRef), BuildError> {
    let part = |seed: &Seed| {
        let (number, instance) = &places[seed.place];
        PlacedPart::new(instance, *number, outlines[instance.object as usize].node(seed.part))
    };
    let parts: Vec<PlacedPart> = seeds.iter().map(part).collect();
    write::<Node<LEVEL_WIDTH>, _>(plan, &parts.as_slice())
}

/// A part of an object in its place.
fn placed(outlines: &[Outline], places: &[Place], place: usize, part: usize) -> Seed {
    let instance = &places[place].1;
    let bounds = finite(outlines[instance.object as usize].placed(part, &instance.to_world));
    Seed { place, part, bounds }
}

/// The upper parts of all objects' trees. One that is placed once may be opened as far as all others
/// together.
fn outlines(below: &[Below<'_>], places: &[Place], parameters: &TreeParameters) -> Vec<Outline> {
    let mut times = vec![0usize; below.len()];
    for (_, instance) in places {
        times[instance.object as usize] += 1;
    }
    let opened = parts_most(places.len(), parameters);
    let outline = |(object, times): (&Below<'_>, &usize)| {
        let most = if *times == 1 { opened.max(OUTLINE) } else { OUTLINE };
        // SAFETY: the tree is of this kind of node and borrowed.
        for_node!(parameters, N => unsafe { Outline::of::<N>(&object.tree.root, most) })
    };
    below.par_iter().zip(&times).map(outline).collect()
}

/// The most parts of `places` places.
fn parts_most(places: usize, parameters: &TreeParameters) -> usize {
    places + (parameters.instance_opening as usize - 1) * places.max(INSTANCES_MIN)
}

/// One part a place, and more of those that are worth it.
fn seeds(outlines: &[Outline], places: &[Place], parameters: &TreeParameters) -> Vec<Seed> {
    let seed = |place: usize, part: usize| placed(outlines, places, place, part);
    let mut seeds: Vec<Seed> = (0..places.len()).into_par_iter().map(|place| seed(place, 0)).collect();
    let most = parts_most(places.len(), parameters);
    if seeds.len() < most {
        let sizes = seeds.iter().enumerate().map(|(number, seed)| (by_size(&seed.bounds), number));
        let mut closed: BinaryHeap<(u64, usize)> = sizes.collect();
        while seeds.len() < most {
            let Some((_, number)) = closed.pop() else {
                break;
            };
            let Seed { place, part, .. } = seeds[number];
            let mut children = outlines[places[place].1.object as usize].children(part);
            // One child takes its parent's place, the others come behind all.
            let Some(first) = children.next() else {
                continue;
            };
            seeds[number] = seed(place, first);
            closed.push((by_size(&seeds[number].bounds), number));
            for child in children {
                closed.push((0, seeds.len()));
                seeds.push(seed(place, child));
            }
        }
    }
    seeds
}

/// Boxes so far out that they overflow end where numbers do: the heuristic has to calculate with them.
fn finite(bounds: Bounds) -> Bounds {
    const MOST: f32 = f32::MAX / 4.0;
    // A factor of zero and an infinite coordinate make no number.
    let or = |plane: f32, otherwise: f32| if plane.is_nan() { otherwise } else { plane.clamp(-MOST, MOST) };
    Bounds {
        lower: bounds.lower.map(|plane| or(plane, -MOST)),
        upper: bounds.upper.map(|plane| or(plane, MOST)),
    }
}

/// The wide tree over the parts.
fn plan(seeds: &[Seed], parameters: &TreeParameters) -> Plan {
    let boxes: Vec<Bounds> = seeds.iter().map(|seed| seed.bounds).collect();
    let one_each =
        TreeParameters { min_leaf_size: 1, max_leaf_size: 1, sah_block_size: 1, ..TreeParameters::default() };
    let mut tree: BinaryTree = binary_over(&boxes);
    let passes = if parameters.collapse == Collapse::Optimal { parameters.reinsertion_passes } else { 0 };
    if passes > 0 {
        let mut better = tree.clone();
        optimise(&mut better, passes);
        let plan = collapse::<LEVEL_WIDTH>(&better, &one_each);
        // Moved subtrees may come to lie deeper than the walks have room for.
        if plan.depth <= *MAX_DEPTH.end() {
            return plan;
        }
    }
    tree.renumber();
    collapse::<LEVEL_WIDTH>(&tree, &one_each)
}
