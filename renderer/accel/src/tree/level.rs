//! The upper level of two: a tree over placed objects, one a leaf, because each costs a walk of its own.

use std::sync::Arc;

use rayon::prelude::*;

use super::build::{plan_over, plan_over_halves};
use super::write::{Items, write};
use super::{Tree, arena::Arena, outline::Outline, plan::Plan};
use crate::layout::{Bounds, Node, NodeRef, PlacedPart, Root, TreeNode, for_node};
use crate::parameters::{Collapse, TreeParameters};
use crate::traverse::placed::{Lower, Object};
use crate::traverse::{Isa, Kernels, LEVEL_WIDTH, LevelKernels};
use crate::{embree::Device, error::BuildError, instances::Instance, limits::MAX_DEPTH};

/// The upper level and what lies below it. It refers to the objects' trees.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) root: Root,
    pub(super) lower: Lower,
    pub(super) kernels: LevelKernels,
    upper: Option<Upper>,
}

/// The upper level by numbers, and in memory.
#[derive(Debug)]
struct Upper {
    outlines: Vec<Outline>,
    plan: Plan,
    /// The boxes that a ray met when it was built, see [`Plan::boxes_met`].
    boxes_met: f64,
    /// Owns the nodes and leaves.
    _memory: Arena,
}

/// An object to be placed.
pub(super) struct Below<'a> {
    pub(super) tree: &'a Tree,
    /// Number of its first triangle.
    pub(super) first: u32,
}

/// An object in a place, with its number as an instance.
pub(super) type Place = (u32, Instance);

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
    pub(super) fn empty(parameters: &TreeParameters) -> Self {
        let isa = Isa::detect();
        let kernels = LevelKernels::select(isa, parameters.robust).expect("the instruction set was detected");
        let of_objects = Kernels::select(isa, parameters).expect("the parameters were checked");
        Self {
            root: Root { node: NodeRef::EMPTY, bounds: Bounds::EMPTY, triangles: Arc::default() },
            lower: Lower { objects: Vec::new(), kernels: of_objects },
            kernels,
            upper: None,
        }
    }

    /// Builds over objects in their places; an instance's number of an object is that in `below`.
    pub(super) fn build(
        device: &Device,
        below: &[Below<'_>],
        places: &[Place],
        parameters: &TreeParameters,
    ) -> Result<Self, BuildError> {
        let mut level = Self::empty(parameters);
        let objects =
            below.iter().map(|object| Object { root: object.tree.root.clone(), first: object.first });
        level.lower.objects = objects.collect();
        if places.is_empty() {
            return Ok(level);
        }
        let outlines = outlines(below, parameters);
        let plan = plan(device, &boxes(&outlines, places), parameters)?;
        let (memory, node) = written(&level.lower, &plan, places)?;
        level.root = Root { node, bounds: plan.root.bounds, triangles: Arc::default() };
        let boxes_met = plan.boxes_met();
        level.upper = Some(Upper { outlines, plan, boxes_met, _memory: memory });
        Ok(level)
    }

    /// Fits the level to the moved places of objects that rest. False, for a rebuild, where there is no tree,
    /// its cost is beyond `most` times that of its build, or memory ran out.
    pub(super) fn fit(&mut self, places: &[Place], most: f64) -> bool {
        let Some(upper) = &mut self.upper else { return false };
        let boxes = boxes(&upper.outlines, places);
        upper.plan.fit(|number| boxes[number as usize]);
        if upper.plan.boxes_met() > most * upper.boxes_met {
            return false;
        }
        let Ok((memory, node)) = written(&self.lower, &upper.plan, places) else { return false };
        self.root = Root { node, bounds: upper.plan.root.bounds, triangles: Arc::default() };
        upper._memory = memory;
        true
    }

    pub(super) fn bytes(&self) -> usize {
        self.upper.as_ref().map_or(0, |Upper { plan, .. }| {
            plan.nodes() * size_of::<Node<LEVEL_WIDTH>>() + plan.leaves() * size_of::<PlacedPart>()
        })
    }

    /// Calls `visit` for every node below the root and every leaf: its depth, its box, what a leaf holds.
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
fn written(lower: &Lower, plan: &Plan, places: &[Place]) -> Result<(Arena, NodeRef), BuildError> {
    let part = |(number, instance): &Place| {
        PlacedPart::new(instance, *number, lower.objects[instance.object as usize].root.node)
    };
    let parts: Vec<PlacedPart> = places.iter().map(part).collect();
    write::<Node<LEVEL_WIDTH>, _>(plan, &parts.as_slice())
}

fn boxes(outlines: &[Outline], places: &[Place]) -> Vec<Bounds> {
    let around =
        |(_, instance): &Place| finite(outlines[instance.object as usize].placed(&instance.to_world));
    places.par_iter().map(around).collect()
}

/// The upper parts of all objects' trees.
fn outlines(below: &[Below<'_>], parameters: &TreeParameters) -> Vec<Outline> {
    let outline = |object: &Below<'_>| {
        // SAFETY: the tree is of this kind of node and borrowed.
        for_node!(parameters, N => unsafe { Outline::of::<N>(&object.tree.root) })
    };
    below.par_iter().map(outline).collect()
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

fn plan(device: &Device, boxes: &[Bounds], parameters: &TreeParameters) -> Result<Plan, BuildError> {
    let width = LEVEL_WIDTH as u32;
    let plan_with = |passes| match plan_over(device, boxes, width, passes) {
        // What lies ever farther out is taken off bit by bit, over more levels than Embree permits.
        Err(BuildError::DepthLimit(_)) => Ok(plan_over_halves(boxes, width, passes)),
        plan => plan,
    };
    let passes = if parameters.collapse == Collapse::Optimal { parameters.reinsertion_passes } else { 0 };
    let plan = plan_with(passes)?;
    // Moved subtrees may come to lie deeper than the walks have room for.
    if plan.depth <= *MAX_DEPTH.end() { Ok(plan) } else { plan_with(0) }
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;

    use super::*;

    #[test]
    fn what_lies_ever_farther_out_gets_a_level_that_walks_have_room_for() {
        let cube =
            |at: Vec3A, half: f32| Bounds { lower: (at - half).to_array(), upper: (at + half).to_array() };
        let near = (0..1000).map(|number| {
            let at = Vec3A::new((number % 10) as f32, (number / 10 % 10) as f32, (number / 100) as f32);
            cube((at - 4.5) * 2e-16, 5e-17)
        });
        // Six at each distance: the outermost ones come off first, some two a level.
        let far = (0..150).map(|number: i32| {
            let (out, sign) = (1e-14 * 16_f32.powi(number / 6), if number % 2 == 0 { 1.0 } else { -1.0 });
            cube(Vec3A::AXES[number as usize % 3] * (sign * out), 1e-3 * out)
        });
        let boxes: Vec<Bounds> = near.chain(far).collect();
        let device = Device::open(0).expect("Embree starts");
        let too_deep = plan_over(&device, &boxes, LEVEL_WIDTH as u32, 0).expect_err("it is too deep");
        assert_eq!(too_deep, BuildError::DepthLimit(*MAX_DEPTH.end()));
        for reinsertion_passes in [0, 2] {
            let collapse = Collapse::Optimal;
            let parameters = TreeParameters { collapse, reinsertion_passes, ..TreeParameters::default() };
            let plan = plan(&device, &boxes, &parameters).expect("it builds");
            assert!(plan.depth <= *MAX_DEPTH.end());
            let numbers = (0..plan.leaves()).flat_map(|leaf| plan.triangles(leaf));
            let mut numbers: Vec<u32> = numbers.copied().collect();
            numbers.sort_unstable();
            assert!(numbers.into_iter().eq(0..1150), "each box is in one leaf");
        }
    }
}
