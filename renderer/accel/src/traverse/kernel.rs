//! The walk: down to the nearest child first, the others on a stack with the distance where the ray enters
//! them. Children behind a hit are passed by. A shadow ray goes on with the last child it meets.
//!
//! The only branch on the number of children met is on none, one or several; several are sorted without
//! branches ([`super::lanes::Order`]). With the branch on none the processor begins the next node early:
//! selecting instead was a tenth slower on primary rays and a quarter on shadow rays.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::stack::{PlainStack, Stack};
use super::{boxes::Boxes, lanes::Order};
use crate::geometry::{Hit, Ray};
use crate::layout::{NodeRef, Root, TreeNode};

/// The work of a ray in a leaf: it tests triangles, or goes on in the objects that are placed there.
///
/// # Safety
/// Both functions require a leaf of the kind they test, which lives, and the processor features they are made
/// for.
pub(crate) trait Leaves {
    /// Replaces `hit` by a nearer one in the leaf, if there is one.
    unsafe fn closest(&self, leaf: NodeRef, hit: &mut Hit);

    /// Whether the ray hits a triangle of the leaf before `t_max`.
    unsafe fn any(&self, leaf: NodeRef, t_max: f32) -> bool;
}

/// Replaces `hit` by a nearer one below `start`, if there is one. Rays that are not valid miss.
///
/// # Safety
/// The processor has the features of `X` and `L`; the tree has nodes `N` and leaves of the kind `L` tests.
#[inline(always)]
pub(crate) unsafe fn closest<N: TreeNode, X: Boxes<N>, L: Leaves>(
    root: &Root,
    start: NodeRef,
    ray: &Ray,
    leaves: &L,
    hit: &mut Hit,
) {
    if !ray.is_valid() {
        return;
    }
    let boxes = X::new(root, ray);
    let mut stack = Stack::new();
    // A copy, which can stay in registers.
    let mut nearest = *hit;
    let mut current = start;
    loop {
        while !current.is_leaf() {
            current = after_node::<N, X>(current, &boxes, &mut stack, nearest.t);
        }
        if current.is_end() {
            break;
        }
        leaves.closest(current, &mut nearest);
        current = stack.pop_before(nearest.t.to_bits() as i32);
    }
    *hit = nearest;
}

/// Tests the children of a node before `t_max`. Gives where the ray goes on: to the nearest child that it
/// meets, the others being on the stack then, or where it meets none, to what the stack holds.
///
/// # Safety
/// The processor has the features of `X`, `current` is a node `N` that lives, and the stack is of its walk.
#[inline(always)]
pub(super) unsafe fn after_node<N: TreeNode, X: Boxes<N>>(
    current: NodeRef,
    boxes: &X,
    stack: &mut Stack,
    t_max: f32,
) -> NodeRef {
    let node = current.node::<N>();
    let (met, times) = boxes.test(node, t_max);
    let children = node.children().as_ptr();
    if met == 0 {
        return stack.pop_before(t_max.to_bits() as i32);
    }
    if met & (met - 1) == 0 {
        return *children.add(met.trailing_zeros() as usize);
    }
    let nodes = stack.free();
    times.write_sorted(met, children, nodes, stack.free_keys());
    let others = met.count_ones() as usize - 1;
    stack.grow(others);
    // The nearest one stays behind the top.
    *nodes.add(others)
}

/// Whether the ray hits a triangle below `start`.
///
/// # Safety
/// As for [`closest`].
#[inline(always)]
pub(crate) unsafe fn occluded<N: TreeNode, X: Boxes<N>, L: Leaves>(
    root: &Root,
    start: NodeRef,
    ray: &Ray,
    leaves: &L,
) -> bool {
    if !ray.is_valid() {
        return false;
    }
    let boxes = X::new(root, ray);
    let mut stack = PlainStack::new();
    let mut current = start;
    loop {
        while !current.is_leaf() {
            current = after_shadowed_node::<N, X>(current, &boxes, &mut stack, ray.t_max);
        }
        if current.is_end() {
            return false;
        }
        if leaves.any(current, ray.t_max) {
            return true;
        }
        current = stack.pop();
    }
}

/// As [`after_node`], to the last child that the ray meets.
///
/// # Safety
/// As for [`after_node`].
#[inline(always)]
pub(super) unsafe fn after_shadowed_node<N: TreeNode, X: Boxes<N>>(
    current: NodeRef,
    boxes: &X,
    stack: &mut PlainStack,
    t_max: f32,
) -> NodeRef {
    let node = current.node::<N>();
    let (met, _) = boxes.test(node, t_max);
    let children = node.children().as_ptr();
    if met == 0 {
        return stack.pop();
    }
    X::Times::write_met(met, children, stack.free());
    stack.grow(met.count_ones() as usize - 1);
    *children.add((u32::BITS - 1 - met.leading_zeros()) as usize)
}
