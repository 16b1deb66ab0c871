//! The order in which a shadow ray visits the children of a node: by the probability that it is blocked below
//! a child, over the cost of its test (Ogaki and Derouet-Jourdan, "An N-ary BVH Child Node Sorting Technique
//! for Occlusion Tests", 2016).
//!
//! A line that meets a box crosses the surfaces in it `their area / half the area of the box` times on
//! average (Cauchy and Crofton); of a ray that begins inside, half of the line is left. Costs are those of
//! the surface area heuristic.
//!
//! Rays go on with the last child they meet ([`crate::traverse`]), so the one to visit first comes last.

use rayon::prelude::*;

use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX};
use crate::parameters::TreeParameters;

/// Levels whose children are shared between threads.
const TASK_LEVELS: u32 = 3;

/// The prospect of a shadow ray that meets a box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prospect {
    /// Probability that it is blocked inside.
    blocked: f32,
    /// Expected cost of finding out.
    cost: f32,
}

impl Prospect {
    pub(super) const NONE: Self = Self { blocked: 0.0, cost: 0.0 };

    /// Of a leaf with blocks of triangles of such an area in a box of such half an area.
    pub(super) fn leaf(blocks: usize, area: f32, half_area: f32, parameters: &TreeParameters) -> Self {
        // Close to `1 - exp(-crossings / 2)`, and equal on every machine. A box without area is full.
        let blocked = if half_area > 0.0 { area / (area + 2.0 * half_area) } else { 1.0 };
        Self { blocked, cost: parameters.intersection_cost * blocks as f32 }
    }

    /// Of a node of half this area, whose children come in the order of visits, with half their areas.
    fn node(
        children: impl Iterator<Item = (f32, Self)>,
        half_area: f32,
        parameters: &TreeParameters,
    ) -> Self {
        let (mut open, mut cost) = (1.0, parameters.traversal_cost);
        for (child_area, child) in children {
            let met = if child_area < half_area { child_area / half_area } else { 1.0 };
            cost += open * met * child.cost;
            open *= 1.0 - met * child.blocked;
        }
        Self { blocked: 1.0 - open, cost }
    }

    /// The greater, the sooner it should be visited.
    fn promise(self) -> f32 {
        self.blocked / self.cost.max(f32::MIN_POSITIVE)
    }
}

/// The order of a node's children, given by half their areas and prospects, and what awaits a ray there.
pub(super) fn order_of(
    children: &[(f32, Prospect)],
    half_area: f32,
    parameters: &TreeParameters,
) -> ([u8; WIDTH_MAX], Prospect) {
    let order = order_by(children.len(), |place| children[place].1.promise());
    let visits = order[..children.len()].iter().rev().map(|&place| children[usize::from(place)]);
    (order, Prospect::node(visits, half_area, parameters))
}

/// Brings the children of every node into their order.
///
/// # Safety
/// `root` is of a tree of nodes `N` and blocks of `B` triangles of these parameters, which lives, and there
/// is no other reference to it meanwhile.
pub(super) unsafe fn sort_children<N: TreeNode, const B: usize>(
    root: NodeRef,
    bounds: Bounds,
    parameters: &TreeParameters,
) {
    let subtree = Subtree { root, half_area: bounds.half_area() as f32, task_levels: TASK_LEVELS };
    // SAFETY: the caller vouches for it.
    unsafe { subtree.sort::<N, B>(parameters) };
}

/// A part of a tree that one task works on.
#[derive(Clone, Copy)]
struct Subtree {
    root: NodeRef,
    half_area: f32,
    /// The number of levels from here on that are shared between threads.
    task_levels: u32,
}

impl Subtree {
    fn children<N: TreeNode>(&self, node: &N) -> ([Self; WIDTH_MAX], usize) {
        let mut all = [*self; WIDTH_MAX];
        let count = node.count();
        for (place, child) in all[..count].iter_mut().enumerate() {
            *child = Self {
                root: node.children()[place],
                half_area: node.child_bounds(place).half_area() as f32,
                task_levels: self.task_levels.saturating_sub(1),
            };
        }
        (all, count)
    }

    /// # Safety
    /// As for [`sort_children`]. Recursion is as deep as the tree, at most 64 levels.
    unsafe fn sort<N: TreeNode, const B: usize>(self, parameters: &TreeParameters) -> Prospect {
        if self.root.is_leaf() {
            // SAFETY: the caller vouches for it.
            let blocks = unsafe { self.root.blocks::<B>() };
            let area = blocks.iter().map(|block| area(block, parameters.robust)).sum();
            return Prospect::leaf(blocks.len(), area, self.half_area, parameters);
        }
        // SAFETY: as above.
        let node = unsafe { self.root.node_mut::<N>() };
        let (children, count) = self.children(node);
        let children = &children[..count];
        // SAFETY: as above; each child's subtree is its own.
        let look = |child: &Self| (child.half_area, unsafe { child.sort::<N, B>(parameters) });
        let mut below = [(0.0, Prospect::NONE); WIDTH_MAX];
        if self.task_levels > 0 {
            let found: Vec<(f32, Prospect)> = children.par_iter().map(look).collect();
            below[..count].copy_from_slice(&found);
        } else {
            below.iter_mut().zip(children).for_each(|(below, child)| *below = look(child));
        }
        let (order, prospect) = order_of(&below[..count], self.half_area, parameters);
        node.permute(&order);
        prospect
    }
}

/// The places of `count` children, those with the greatest key last; equals stay as they were.
fn order_by(count: usize, key: impl Fn(usize) -> f32) -> [u8; WIDTH_MAX] {
    let mut order = std::array::from_fn(|place| place as u8);
    order[..count].sort_by(|&a, &b| key(a.into()).total_cmp(&key(b.into())));
    order
}

pub(super) fn area<const B: usize>(block: &Block<B>, watertight: bool) -> f32 {
    let [a, b, c] = &block.vertices;
    // The compiler makes vectors of the lanes.
    let areas: [f32; B] = std::array::from_fn(|lane| {
        let of = |vertex: &[[f32; B]; 3]| glam::Vec3::from([0, 1, 2].map(|axis| vertex[axis][lane]));
        let (first, second) = if watertight { (of(b) - of(a), of(c) - of(a)) } else { (of(b), of(c)) };
        0.5 * first.cross(second).length()
    });
    // Unused lanes hold NaN.
    areas.into_iter().filter(|area| area.is_finite()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Triangles;

    /// A box costs 1, and so does a block of triangles.
    fn parameters() -> TreeParameters {
        TreeParameters { traversal_cost: 1.0, intersection_cost: 1.0, ..TreeParameters::default() }
    }

    #[test]
    fn full_and_cheap_children_come_first() {
        let leaf = |blocks, area| Prospect::leaf(blocks, area, 1.0, &parameters());
        // Hardly anything in it, a full one that is cheap, a full one that is dear, half full and cheap.
        let children = [leaf(1, 0.01), leaf(1, 1.0), leaf(4, 1.0), leaf(1, 0.5)];
        let order = order_by(4, |place| children[place].promise());
        assert_eq!(order[..4], [0, 2, 3, 1], "the last is visited first");
    }

    #[test]
    fn of_two_orders_the_chosen_one_costs_less() {
        let full = (1.0_f32, Prospect { blocked: 0.9, cost: 2.0 });
        let empty = (1.0, Prospect { blocked: 0.1, cost: 3.0 });
        let [better, worse] =
            [[full, empty], [empty, full]].map(|order| Prospect::node(order.into_iter(), 1.0, &parameters()));
        assert!(better.cost < worse.cost);
        assert!((better.blocked - worse.blocked).abs() < 1e-6, "what blocks does not depend on the order");
        assert!((better.cost - (1.0 + 2.0 + 0.1 * 3.0)).abs() < 1e-5);
        assert!((better.blocked - (1.0 - 0.1 * 0.9)).abs() < 1e-6);
    }

    #[test]
    fn boxes_without_area_block_and_costs_are_finite() {
        let leaf = Prospect::leaf(1, 0.0, 0.0, &parameters());
        let node = Prospect::node([(0.0, leaf)].into_iter(), 0.0, &parameters());
        assert_eq!((node.blocked, node.cost), (1.0, 2.0));
    }

    #[test]
    fn the_area_of_a_block_is_that_of_its_triangles() {
        let corners = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]].map(glam::Vec3A::from);
        let triangles = Triangles::new(corners.to_vec(), vec![[0, 1, 2]; 3]).expect("it is sound");
        for watertight in [false, true] {
            let block = Block::<8>::new(0..3, &triangles, watertight);
            assert_eq!(area(&block, watertight), 18.0);
        }
    }
}
