//! Several rays in flight on one thread: they take turns, a node or leaf each, so that their waiting for
//! memory overlaps (Kocberber, Falsafi and Grot, "Asynchronous Memory Access Chaining", 2015). Every ray
//! takes the steps that it takes alone ([`super::kernel`]), so answers are equal bit for bit.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use std::{marker::PhantomData, mem::MaybeUninit};

use super::boxes::Boxes;
use super::kernel::{self, Leaves};
use super::stack::{PlainStack, Stack};
use super::triangles::{BlockLeaves, Blocks};
use crate::geometry::{Hit, Ray};
use crate::layout::{Block, NodeRef, Root, TreeNode};

pub(crate) const FLIGHT_MAX: usize = 8;

/// The requests of a ray, step by step.
///
/// # Safety
/// All functions require the processor features of the tests within, and a tree of their nodes and blocks,
/// which lives.
pub(crate) trait Query<'a> {
    type Node: TreeNode;
    type Block;
    type Stack;
    type Answer: Copy;
    /// The answer to rays that hit nothing.
    const MISS: Self::Answer;

    /// Prepares for a ray that is valid, and empties the stack.
    unsafe fn begin(root: &'a Root, ray: &'a Ray, stack: &mut MaybeUninit<Self::Stack>) -> Self;

    /// Visits a node or leaf and gives what to visit next, [`NodeRef::END`] after the last one.
    unsafe fn visit(&mut self, current: NodeRef, stack: &mut Self::Stack) -> NodeRef;

    fn answer(&self) -> Self::Answer;
}

pub(crate) struct ClosestQuery<'a, N, X, T, const B: usize> {
    boxes: X,
    leaves: BlockLeaves<'a, T, B>,
    hit: Hit,
    nodes: PhantomData<N>,
}

impl<'a, N: TreeNode, X: Boxes<N>, T: Blocks<B>, const B: usize> Query<'a> for ClosestQuery<'a, N, X, T, B> {
    type Node = N;
    type Block = Block<B>;
    type Stack = Stack;
    type Answer = Option<Hit>;
    const MISS: Option<Hit> = None;

    #[inline(always)]
    unsafe fn begin(root: &'a Root, ray: &'a Ray, stack: &mut MaybeUninit<Stack>) -> Self {
        Stack::begin(stack);
        let leaves = BlockLeaves { blocks: T::new(ray), ray, all: &root.triangles };
        Self { boxes: X::new(root, ray), leaves, hit: Hit::none(ray.t_max), nodes: PhantomData }
    }

    #[inline(always)]
    unsafe fn visit(&mut self, current: NodeRef, stack: &mut Stack) -> NodeRef {
        if !current.is_leaf() {
            return kernel::after_node::<N, X>(current, &self.boxes, stack, self.hit.t);
        }
        self.leaves.closest(current, &mut self.hit);
        stack.pop_before(self.hit.t.to_bits() as i32)
    }

    #[inline(always)]
    fn answer(&self) -> Option<Hit> {
        self.hit.found()
    }
}

pub(crate) struct OccludedQuery<'a, N, X, T, const B: usize> {
    boxes: X,
    leaves: BlockLeaves<'a, T, B>,
    found: bool,
    nodes: PhantomData<N>,
}

impl<'a, N: TreeNode, X: Boxes<N>, T: Blocks<B>, const B: usize> Query<'a> for OccludedQuery<'a, N, X, T, B> {
    type Node = N;
    type Block = Block<B>;
    type Stack = PlainStack;
    type Answer = bool;
    const MISS: bool = false;

    #[inline(always)]
    unsafe fn begin(root: &'a Root, ray: &'a Ray, stack: &mut MaybeUninit<PlainStack>) -> Self {
        PlainStack::begin(stack);
        let leaves = BlockLeaves { blocks: T::new(ray), ray, all: &root.triangles };
        Self { boxes: X::new(root, ray), leaves, found: false, nodes: PhantomData }
    }

    #[inline(always)]
    unsafe fn visit(&mut self, current: NodeRef, stack: &mut PlainStack) -> NodeRef {
        let t_max = self.leaves.ray.t_max;
        if !current.is_leaf() {
            return kernel::after_shadowed_node::<N, X>(current, &self.boxes, stack, t_max);
        }
        self.found = self.leaves.any(current, t_max);
        if self.found { NodeRef::END } else { stack.pop() }
    }

    #[inline(always)]
    fn answer(&self) -> bool {
        self.found
    }
}

/// A ray on its way, what it visits next, and where its answer goes.
struct Flying<'b, Q, A> {
    query: Q,
    next: NodeRef,
    answer: &'b mut A,
}

/// The answer to each ray, with at most `flight` of them under way, up to [`FLIGHT_MAX`].
///
/// # Safety
/// As for [`Query`].
#[inline(always)]
pub(crate) unsafe fn each<'a, Q: Query<'a>>(
    root: &'a Root,
    flight: usize,
    rays: &'a [Ray],
    answers: &mut [Q::Answer],
) {
    assert_eq!(rays.len(), answers.len(), "one answer a ray");
    answers.fill(Q::MISS);
    let mut waiting = rays.iter().zip(answers).filter(|(ray, _)| ray.is_valid());
    let mut stacks = [const { MaybeUninit::<Q::Stack>::uninit() }; FLIGHT_MAX];
    let mut places: [Option<Flying<'_, Q, Q::Answer>>; FLIGHT_MAX] = [const { None }; FLIGHT_MAX];
    let mut under_way = true;
    while under_way {
        under_way = false;
        for (place, stack) in places.iter_mut().zip(&mut stacks).take(flight) {
            if let Some(flying) = place {
                // The stack was begun with the ray.
                flying.next = flying.query.visit(flying.next, stack.assume_init_mut());
                if !flying.next.is_end() {
                    flying.next.prefetch::<Q::Node, Q::Block>();
                    under_way = true;
                    continue;
                }
                *flying.answer = flying.query.answer();
                *place = None;
            }
            if let Some((ray, answer)) = waiting.next() {
                let query = Q::begin(root, ray, stack);
                *place = Some(Flying { query, next: root.node, answer });
                under_way = true;
            }
        }
    }
}
