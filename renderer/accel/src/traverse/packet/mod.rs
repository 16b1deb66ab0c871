//! Sixteen rays together through the tree: for rays that mostly go one way.
//!
//! A node costs one test of the rays' common frustum against all children, then one of all rays against each
//! child that it meets (Wald, Slusallek, Benthin and Wagner, "Interactive Rendering with Coherent Ray
//! Tracing", 2001; Reshetov, Soupikov and Hurley, "Multi-Level Ray Tracing Algorithm", 2005). Where few rays
//! are left in a subtree, each goes on alone (Benthin, Wald, Woop, Ernst and Mark, "Combining Single and
//! Packet-Ray Tracing", 2012).
//!
//! The walk does not depend on the contents of leaves ([`PacketLeaves`]). Every ray gets the answer it gets
//! alone: tests take equal operations in equal order, and the frustum's margins cover their rounding.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

pub(super) mod boxes;
pub(super) mod bundle;
pub(super) mod triangles;

use std::mem::MaybeUninit;

use self::boxes::{PacketBoxes, frustum};
use self::bundle::{Bundle, Hits, each_lane, farthest, lanes_of};
use super::boxes::{Boxes, DIVISOR_MIN, PaddedBoxes, Planes};
use super::lanes::{Lanes, Order, Stored};
use crate::geometry::{Hit, Ray};
use crate::layout::{NodeRef, Root, WIDTH_MAX};
use crate::limits::MAX_DEPTH;

/// Most rays together.
pub(crate) const PACKET: usize = 16;
/// Fewer rays of one kind are not worth a packet.
const GROUP_MIN: u32 = 4;
/// Most rays in a subtree that go on alone.
const FEW: u32 = 1;
/// Most entries on the stack: on each level all children but one, and a whole node's worth on top.
const ENTRIES: usize = (*MAX_DEPTH.end() as usize + 1) * (WIDTH_MAX - 1) + 1;

/// The tests of a packet's rays in a leaf, and the queries of a ray that goes on alone.
///
/// # Safety
/// All functions require nodes and leaves of the tree they are given, which lives, and the processor features
/// they are made for.
pub(crate) trait PacketLeaves {
    type Rays: Lanes;
    type Tree: Copy;

    unsafe fn new(tree: Self::Tree, rays: &Bundle) -> Self;

    /// Replaces the hits of `active` rays by nearer ones in the leaf.
    unsafe fn closest(&self, rays: &Bundle, leaf: NodeRef, active: u32, hits: &mut Hits);

    /// Which of the `active` rays hit anything in the leaf before their ends.
    unsafe fn any(&self, rays: &Bundle, leaf: NodeRef, active: u32, ends: &Stored) -> u32;

    /// Replaces the hit of one ray by a nearer one below the node.
    unsafe fn closest_alone(tree: Self::Tree, node: NodeRef, ray: &Ray, hit: &mut Hit);

    /// Whether one ray hits a triangle below the node.
    unsafe fn any_alone(tree: Self::Tree, node: NodeRef, ray: &Ray) -> bool;
}

/// An entry of the stack: a child, where the first ray enters it, and the rays that meet it.
#[derive(Clone, Copy)]
struct Entry {
    node: NodeRef,
    key: i32,
    rays: u32,
}

struct Stack {
    entries: [MaybeUninit<Entry>; ENTRIES + WIDTH_MAX],
    top: usize,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; ENTRIES + WIDTH_MAX], top: 0 }
    }

    /// Makes sure that a node's children fit.
    #[inline(always)]
    fn check(&self) {
        assert!(self.top <= ENTRIES, "the tree is deeper than permitted");
    }

    /// Puts an entry below those of its node, from `first` on, that are nearer.
    ///
    /// # Safety
    /// [`Stack::check`] passed since the last node.
    #[inline(always)]
    unsafe fn insert(&mut self, first: usize, entry: Entry) {
        let entries = self.entries.as_mut_ptr();
        let mut place = self.top;
        while place > first && (*entries.add(place - 1)).assume_init().key < entry.key {
            *entries.add(place) = *entries.add(place - 1);
            place -= 1;
        }
        (*entries.add(place)).write(entry);
        self.top += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Entry> {
        self.top = self.top.checked_sub(1)?;
        // SAFETY: every entry below the old top was written.
        Some(unsafe { self.entries.get_unchecked(self.top).assume_init() })
    }
}

/// Rays whose bits differ in any of these cannot be traced together: signs of directions, and classes.
struct Kinds([u32; 5]);

impl Kinds {
    /// # Safety
    /// As for [`Lanes`]; `L` has sixteen lanes.
    #[inline(always)]
    unsafe fn new<L: Lanes>(bundle: &Bundle, classes: [u32; 2]) -> Self {
        let least = L::splat(-DIVISOR_MIN);
        let [x, y, z] = bundle.directions::<L>().0;
        let (x, y, z) = (x.less_equal(least), y.less_equal(least), z.less_equal(least));
        Self([L::bits(x), L::bits(y), L::bits(z), classes[0], classes[1]])
    }

    #[inline(always)]
    fn like(&self, first: usize, waiting: u32) -> u32 {
        let mut group = waiting;
        for mask in self.0 {
            group &= if mask & 1 << first == 0 { !mask } else { mask };
        }
        group
    }
}

/// Replaces the hits of the `active` rays by nearer ones below `start`. Rays that are not valid keep theirs.
/// Rays go together with those of their kind; too few of a kind go alone.
///
/// # Safety
/// The processor has the features of `F`, `X` and `P`; the tree has nodes `N` and leaves `P` tests.
#[inline(always)]
pub(crate) unsafe fn closest<N: Planes, F: Order, X: PacketBoxes<N>, P: PacketLeaves<Rays = X::Rays>>(
    root: &Root,
    start: NodeRef,
    bundle: &Bundle,
    active: u32,
    classes: [u32; 2],
    tree: P::Tree,
    hits: &mut Hits,
) {
    let mut waiting = active & bundle.valid::<X::Rays>(hits.ends());
    let kinds = Kinds::new::<X::Rays>(bundle, classes);
    while waiting != 0 {
        let first = waiting.trailing_zeros() as usize;
        let group = kinds.like(first, waiting);
        waiting &= !group;
        if group.count_ones() < GROUP_MIN {
            closest_alone::<P>(start, bundle, group, tree, hits);
        } else {
            // The other lanes get copies of one of the rays.
            let filled = bundle.filled::<X::Rays>(group, first);
            walk_closest::<N, F, X, P>(root, start, &filled, group, tree, hits);
        }
    }
}

#[inline(always)]
unsafe fn closest_alone<P: PacketLeaves>(
    node: NodeRef,
    bundle: &Bundle,
    rays: u32,
    tree: P::Tree,
    hits: &mut Hits,
) {
    each_lane(rays, |lane| {
        let mut hit = hits.of(lane);
        // SAFETY: the caller vouches for the tree and the processor.
        unsafe { P::closest_alone(tree, node, &bundle.ray(lane, hit.t), &mut hit) };
        hits.set(lane, &hit);
    });
}

#[inline(always)]
unsafe fn walk_closest<N: Planes, F: Order, X: PacketBoxes<N>, P: PacketLeaves<Rays = X::Rays>>(
    root: &Root,
    start: NodeRef,
    bundle: &Bundle,
    group: u32,
    tree: P::Tree,
    hits: &mut Hits,
) {
    let frustum: PaddedBoxes<F> = frustum::<X::Rays, F>(root, bundle, N::WIDTH);
    let (boxes, leaves) = (X::new(root, bundle), P::new(tree, bundle));
    let mut end = farthest::<X::Rays>(group, hits.ends());
    let mut stack = Stack::new();
    let mut next = Some(Entry { node: start, key: 0, rays: group });
    while let Some(Entry { node: current, key, rays: active }) = next {
        // Some rays may have ended since the entry was made.
        let t_max = hits.ends::<X::Rays>();
        let entry = X::Rays::splat(f32::from_bits(key as u32));
        let active = active & X::Rays::bits(entry.less_equal(t_max));
        if active.count_ones() <= FEW {
            closest_alone::<P>(current, bundle, active, tree, hits);
            end = farthest::<X::Rays>(group, hits.ends());
        } else if current.is_leaf() {
            leaves.closest(bundle, current, active, hits);
            end = farthest::<X::Rays>(group, hits.ends());
        } else {
            let node = current.node::<N>();
            let (mut met, times) = Boxes::<N>::test(&frustum, node, end);
            let times = Stored::from(times).0;
            stack.check();
            let first = stack.top;
            while met != 0 {
                let child = met.trailing_zeros() as usize;
                met &= met - 1;
                let rays = boxes.meet(node, child, t_max) & active;
                if rays != 0 {
                    let key = times[child].to_bits() as i32;
                    stack.insert(first, Entry { node: node.children()[child], key, rays });
                }
            }
        }
        next = loop {
            match stack.pop() {
                Some(entry) if entry.key > end.to_bits() as i32 => {}
                other => break other,
            }
        };
    }
}

/// Traces up to sixteen rays as a packet.
#[inline(always)]
pub(crate) fn closest_each(
    rays: &[Ray],
    hits: &mut [Option<Hit>],
    trace: impl FnOnce(&Bundle, u32, &mut Hits),
) {
    let mut found = Hits::new(rays);
    trace(&Bundle::new(rays), lanes_of(rays.len()), &mut found);
    for (lane, hit) in hits.iter_mut().enumerate() {
        *hit = found.of(lane).found();
    }
}

/// Traces up to sixteen shadow rays as a packet.
#[inline(always)]
pub(crate) fn occluded_each(
    rays: &[Ray],
    occluded: &mut [bool],
    trace: impl FnOnce(&Bundle, u32, &Stored) -> u32,
) {
    let found = trace(&Bundle::new(rays), lanes_of(rays.len()), &Hits::new(rays).t);
    for (lane, occluded) in occluded.iter_mut().enumerate() {
        *occluded = found & 1 << lane != 0;
    }
}

/// Which of the `active` rays hit anything below `start` before their ends. Rays that are not valid do not.
///
/// # Safety
/// As for [`closest`].
#[inline(always)]
pub(crate) unsafe fn occluded<N: Planes, F: Order, X: PacketBoxes<N>, P: PacketLeaves<Rays = X::Rays>>(
    root: &Root,
    start: NodeRef,
    bundle: &Bundle,
    active: u32,
    classes: [u32; 2],
    tree: P::Tree,
    ends: &Stored,
) -> u32 {
    let mut waiting = active & bundle.valid::<X::Rays>(X::Rays::load(ends.0.as_ptr()));
    let kinds = Kinds::new::<X::Rays>(bundle, classes);
    let mut found = 0;
    while waiting != 0 {
        let first = waiting.trailing_zeros() as usize;
        let group = kinds.like(first, waiting);
        waiting &= !group;
        if group.count_ones() < GROUP_MIN {
            found |= any_alone::<P>(start, bundle, group, tree, ends);
        } else {
            let filled = bundle.filled::<X::Rays>(group, first);
            found |= walk_occluded::<N, F, X, P>(root, start, &filled, group, tree, ends);
        }
    }
    found
}

/// Which of these rays hit anything, each by itself.
#[inline(always)]
unsafe fn any_alone<P: PacketLeaves>(
    node: NodeRef,
    bundle: &Bundle,
    rays: u32,
    tree: P::Tree,
    ends: &Stored,
) -> u32 {
    let mut found = 0;
    each_lane(rays, |lane| {
        // SAFETY: the caller vouches for the tree and the processor.
        let any = unsafe { P::any_alone(tree, node, &bundle.ray(lane, ends.0[lane])) };
        found |= u32::from(any) << lane;
    });
    found
}

/// One bit a ray that hits something.
#[inline(always)]
unsafe fn walk_occluded<N: Planes, F: Order, X: PacketBoxes<N>, P: PacketLeaves<Rays = X::Rays>>(
    root: &Root,
    start: NodeRef,
    bundle: &Bundle,
    group: u32,
    tree: P::Tree,
    ends: &Stored,
) -> u32 {
    let frustum: PaddedBoxes<F> = frustum::<X::Rays, F>(root, bundle, N::WIDTH);
    let (boxes, leaves) = (X::new(root, bundle), P::new(tree, bundle));
    let t_max = X::Rays::load(ends.0.as_ptr());
    let end = farthest::<X::Rays>(group, t_max);
    // The rays that have hit nothing yet.
    let mut open = group;
    let mut stack = Stack::new();
    let mut next = Some(Entry { node: start, key: 0, rays: group });
    while let Some(Entry { node: current, rays: active, .. }) = next {
        let active = active & open;
        if active.count_ones() <= FEW {
            open &= !any_alone::<P>(current, bundle, active, tree, ends);
        } else if current.is_leaf() {
            open &= !leaves.any(bundle, current, active, ends);
        } else {
            let node = current.node::<N>();
            let (mut met, _) = Boxes::<N>::test(&frustum, node, end);
            stack.check();
            while met != 0 {
                let child = met.trailing_zeros() as usize;
                met &= met - 1;
                let rays = boxes.meet(node, child, t_max) & active;
                if rays != 0 {
                    // The last child comes first, as for single rays.
                    let place = stack.top;
                    stack.insert(place, Entry { node: node.children()[child], key: 0, rays });
                }
            }
        }
        if open == 0 {
            break;
        }
        next = stack.pop();
    }
    group & !open
}
