//! New boxes and blocks for an old tree: each leaf keeps its triangles, which have moved.
//!
//! Refitting from the leaves up is van den Bergen's ("Efficient Collision Detection of Complex Deformable
//! Models using AABB Trees", 1997). On the way back the cost by the surface area heuristic falls out, so that
//! decay can be seen.

use glam::Vec3A;

use crate::geometry::Triangles;
use crate::layout::{Block, Bounds, NodeRef, TreeNode, WIDTH_MAX};

#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub(super) bounds: Bounds,
    /// Half areas of its nodes, and of its leaves once for each triangle.
    pub(super) area: f64,
    pub(super) triangles: usize,
    /// Levels below its root.
    pub(super) height: u32,
}

impl Fitted {
    const NOTHING: Self = Self { bounds: Bounds::EMPTY, area: 0.0, triangles: 0, height: 0 };

    /// Expected cost of a ray that hits its box, after MacDonald and Booth (1990).
    pub(super) fn cost(&self) -> f64 {
        let own = self.bounds.half_area();
        if own > 0.0 { self.area / own } else { 1.0 }
    }
}

/// Fits a subtree to the present positions of its triangles.
///
/// # Safety
/// `node` is of a tree of nodes `N` and blocks of `B` triangles, which lives, and there is no other reference
/// to the subtree meanwhile.
pub(super) unsafe fn refit<N: TreeNode, const B: usize>(
    node: NodeRef,
    triangles: &Triangles,
    watertight: bool,
) -> Fitted {
    if node.is_leaf() {
        let (mut lower, mut upper, mut count) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY, 0);
        // SAFETY: the caller vouches for it.
        for block in unsafe { node.blocks_mut::<B>() } {
            let (from, to, fitted) = block.fit(triangles, watertight);
            (lower, upper, count) = (lower.min(from), upper.max(to), count + fitted);
        }
        let bounds = Bounds { lower: lower.to_array(), upper: upper.to_array() };
        return Fitted { bounds, area: bounds.half_area() * count as f64, triangles: count, height: 0 };
    }
    // SAFETY: the caller vouches for it.
    let inner = unsafe { node.node_mut::<N>() };
    let count = inner.count();
    let mut bounds = [Bounds::EMPTY; WIDTH_MAX];
    let mut fitted = Fitted::NOTHING;
    for (child, of_child) in inner.children()[..count].iter().zip(&mut bounds) {
        // SAFETY: a child of such a tree, with no other reference to it.
        let below = unsafe { refit::<N, B>(*child, triangles, watertight) };
        *of_child = below.bounds;
        fitted.bounds = fitted.bounds.union(below.bounds);
        fitted.area += below.area;
        fitted.triangles += below.triangles;
        fitted.height = fitted.height.max(below.height + 1);
    }
    inner.set_bounds(&bounds[..count]);
    fitted.area += fitted.bounds.half_area();
    fitted
}

/// The result of [`refit`] for a subtree as it stands, from the boxes in its nodes; `bounds` is its own.
///
/// # Safety
/// As for [`refit`], but others may look at it.
pub(super) unsafe fn measure<N: TreeNode, const B: usize>(node: NodeRef, bounds: Bounds) -> Fitted {
    if node.is_leaf() {
        // SAFETY: the caller vouches for it.
        let triangles = unsafe { node.blocks::<B>() }.iter().map(|block| block.numbers().count()).sum();
        return Fitted { bounds, area: bounds.half_area() * triangles as f64, triangles, height: 0 };
    }
    // SAFETY: the caller vouches for it.
    let inner = unsafe { node.node::<N>() };
    let mut fitted = Fitted { bounds, area: bounds.half_area(), triangles: 0, height: 0 };
    for child in 0..inner.count() {
        // SAFETY: a child of such a tree.
        let below = unsafe { measure::<N, B>(inner.children()[child], inner.child_bounds(child)) };
        fitted.area += below.area;
        fitted.triangles += below.triangles;
        fitted.height = fitted.height.max(below.height + 1);
    }
    fitted
}

/// Calls `visit` for every block of a subtree.
///
/// # Safety
/// As for [`refit`].
pub(super) unsafe fn blocks_of<N: TreeNode, const B: usize>(
    node: NodeRef,
    visit: &mut impl FnMut(&mut Block<B>),
) {
    // SAFETY: the caller vouches for it.
    unsafe {
        if node.is_leaf() {
            node.blocks_mut::<B>().iter_mut().for_each(visit);
        } else {
            let inner = node.node::<N>();
            for child in &inner.children()[..inner.count()] {
                blocks_of::<N, B>(*child, visit);
            }
        }
    }
}
