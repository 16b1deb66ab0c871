//! Sixteen rays together through the tree: for rays that mostly go the same way.
//!
//! A node costs one test of the rays' common frustum against all children at once, then one test of all
//! rays against each child that the frustum meets; a triangle is tested by all rays at once. So the rays
//! share loads, branches and the order of the walk, as in Wald, Slusallek, Benthin and Wagner, "Interactive
//! Rendering with Coherent Ray Tracing" (2001), with the frustum of Reshetov, Soupikov and Hurley,
//! "Multi-Level Ray Tracing Algorithm" (2005). Where rays have parted and few are left in a subtree, each
//! goes on alone, as in Benthin, Wald, Woop, Ernst and Mark, "Combining Single and Packet-Ray Tracing for
//! Arbitrary Ray Distributions on the Intel MIC Architecture" (2012).
//!
//! Every ray gets the answer it gets alone: tests of boxes and triangles take the same operations in the same
//! order, and the frustum's margins cover their rounding.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

pub(super) mod boxes;
pub(super) mod triangles;

use std::mem::MaybeUninit;

use self::boxes::{PacketBoxes, frustum};
use self::triangles::PacketBlocks;
use super::boxes::{Boxes, DIVISOR_MIN, PaddedBoxes, Planes};
use super::lanes::{Lanes, Order, Stored};
use super::{ClosestBelow, OccludedBelow};
use crate::geometry::{Hit, NO_INSTANCE, NO_TRIANGLE, Ray};
use crate::layout::{Block, NodeRef, Root, WIDTH_MAX};
use crate::limits::MAX_DEPTH;

/// Most rays together.
pub(crate) const PACKET: usize = 16;

/// Fewer rays of one kind are not worth a packet.
const GROUP_MIN: u32 = 4;

/// So many rays or fewer in a subtree go on alone.
const FEW: u32 = 1;

/// Most entries on the stack: on each level all children but one, and a whole node's worth on top.
const ENTRIES: usize = (*MAX_DEPTH.end() as usize + 1) * (WIDTH_MAX - 1) + 1;

/// One number of each ray.
///
/// # Safety
/// As for [`Lanes`]; `L` has sixteen lanes.
#[inline(always)]
unsafe fn numbers<L: Lanes>(rays: &[Ray; PACKET], number: impl Fn(&Ray) -> f32) -> L {
    debug_assert!(L::COUNT == PACKET);
    let stored = Stored(std::array::from_fn(|lane| number(&rays[lane])));
    L::load(stored.0.as_ptr())
}

/// What the packet comes back to: a child, when the first ray enters it, and the rays that meet it.
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

    /// Puts an entry below those of the same node, from `first` on, that are nearer.
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

/// Calls `walk` for each group of rays that can be traced together, with the other lanes filled up by copies
/// of one of them, and `alone` for the rest.
#[inline(always)]
fn groups(
    rays: &[Ray],
    class: impl Fn(&Ray) -> u8,
    mut alone: impl FnMut(usize),
    mut walk: impl FnMut(u32, &[Ray; PACKET]),
) {
    let mut classes = [0u8; PACKET];
    let mut waiting = 0u32;
    for (lane, ray) in rays.iter().enumerate().take(PACKET) {
        let backward = ray.direction.to_array().map(|component| u8::from(component <= -DIVISOR_MIN));
        classes[lane] = backward[0] | backward[1] << 1 | backward[2] << 2 | class(ray) << 3;
        waiting |= u32::from(ray.is_valid()) << lane;
    }
    while waiting != 0 {
        let first = waiting.trailing_zeros() as usize;
        let like_first = |lane: usize| u32::from(classes[lane] == classes[first]) << lane;
        let group = (0..PACKET).map(like_first).fold(0, |all, bit| all | bit) & waiting;
        waiting &= !group;
        if group.count_ones() < GROUP_MIN {
            (0..rays.len()).filter(|lane| group & 1 << lane != 0).for_each(&mut alone);
        } else {
            walk(group, &std::array::from_fn(|lane| rays[if group & 1 << lane == 0 { first } else { lane }]));
        }
    }
}

/// The hits so far, one a ray.
struct Hits {
    t: Stored,
    u: Stored,
    v: Stored,
    triangles: [u32; PACKET],
}

impl Hits {
    /// Idle lanes end before they begin.
    #[inline(always)]
    fn new(group: u32, rays: &[Ray; PACKET]) -> Self {
        let end = |lane: usize| if group & 1 << lane == 0 { -1.0 } else { rays[lane].t_max };
        Self {
            t: Stored(std::array::from_fn(end)),
            u: Stored([0.0; PACKET]),
            v: Stored([0.0; PACKET]),
            triangles: [NO_TRIANGLE; PACKET],
        }
    }

    /// The latest end of all rays. The bits of numbers not below zero order like the numbers.
    #[inline(always)]
    fn farthest(&self) -> f32 {
        let bits = self.t.0.map(|t| t.to_bits() as i32);
        f32::from_bits(bits.into_iter().fold(0, i32::max) as u32)
    }

    #[inline(always)]
    fn of(&self, lane: usize) -> Hit {
        let (t, u, v, triangle) = (self.t.0[lane], self.u.0[lane], self.v.0[lane], self.triangles[lane]);
        Hit { t, u, v, triangle, instance: NO_INSTANCE }
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, hit: &Hit) {
        (self.t.0[lane], self.u.0[lane], self.v.0[lane]) = (hit.t, hit.u, hit.v);
        self.triangles[lane] = hit.triangle;
    }
}

/// The nearest hit of each of up to sixteen rays.
///
/// # Safety
/// The processor has the features of `F`, `X` and `T`; the tree has nodes `N` and blocks of the width and kind
/// `T` tests; `below` is the single-ray query of that tree.
#[inline(always)]
pub(crate) unsafe fn closest<N, const B: usize, F, X, T>(
    root: &Root,
    below: ClosestBelow,
    rays: &[Ray],
    hits: &mut [Option<Hit>],
) where
    N: Planes,
    F: Order,
    X: PacketBoxes<N>,
    T: PacketBlocks<X::Rays, B>,
{
    hits.fill(None);
    let answers = std::cell::Cell::from_mut(hits).as_slice_of_cells();
    let alone = |lane: usize| {
        let mut hit = Hit::none(rays[lane].t_max);
        // SAFETY: the caller vouches for the tree and the processor.
        unsafe { below(root, root.node, &rays[lane], &mut hit) };
        answers[lane].set(hit.found());
    };
    groups(rays, T::class, alone, |group, packed| {
        // SAFETY: as above.
        let found = unsafe { walk_closest::<N, B, F, X, T>(root, below, group, packed) };
        for (lane, answer) in answers.iter().enumerate() {
            if group & 1 << lane != 0 {
                answer.set(found.of(lane).found());
            }
        }
    });
}

#[inline(always)]
unsafe fn walk_closest<N, const B: usize, F, X, T>(
    root: &Root,
    below: ClosestBelow,
    group: u32,
    rays: &[Ray; PACKET],
) -> Hits
where
    N: Planes,
    F: Order,
    X: PacketBoxes<N>,
    T: PacketBlocks<X::Rays, B>,
{
    let frustum: PaddedBoxes<F> = frustum(root, rays, N::WIDTH);
    let (boxes, triangles) = (X::new(root, rays), T::new(rays));
    let mut hits = Hits::new(group, rays);
    let mut farthest = hits.farthest();
    let mut stack = Stack::new();
    let mut next = Some(Entry { node: root.node, key: 0, rays: group });
    while let Some(Entry { node: current, key, rays: active }) = next {
        // Some rays may have ended since the entry was made.
        let t_max = X::Rays::load(hits.t.0.as_ptr());
        let entry = X::Rays::splat(f32::from_bits(key as u32));
        let active = active & X::Rays::bits(entry.less_equal(t_max));
        if active.count_ones() <= FEW {
            let mut left = active;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let mut hit = hits.of(lane);
                below(root, current, &rays[lane], &mut hit);
                hits.set(lane, &hit);
            }
            farthest = hits.farthest();
        } else if current.is_leaf() {
            for block in current.blocks::<B>() {
                test_closest::<X::Rays, B, T>(&triangles, block, active, &mut hits);
            }
            farthest = hits.farthest();
        } else {
            let node = current.node::<N>();
            let (mut met, times) = Boxes::<N>::test(&frustum, node, farthest);
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
                Some(entry) if entry.key > farthest.to_bits() as i32 => {}
                other => break other,
            }
        };
    }
    hits
}

/// All rays against all triangles of a block.
#[inline(always)]
unsafe fn test_closest<L: Lanes, const B: usize, T: PacketBlocks<L, B>>(
    triangles: &T,
    block: &Block<B>,
    active: u32,
    hits: &mut Hits,
) {
    for lane in 0..B {
        if block.triangles[lane] == NO_TRIANGLE {
            break;
        }
        let t_max = L::load(hits.t.0.as_ptr());
        let found = triangles.meet(block, lane, t_max);
        if found.hits & active == 0 {
            continue;
        }
        let times = T::times(&found);
        let nearer = L::bits(times.less(t_max)) & found.hits & active;
        let (u, v) = (found.u.div(found.scale), found.v.div(found.scale));
        for (value, old) in [(times, &mut hits.t), (u, &mut hits.u), (v, &mut hits.v)] {
            L::choose(nearer, value, L::load(old.0.as_ptr())).store(old.0.as_mut_ptr());
        }
        let mut left = nearer;
        while left != 0 {
            hits.triangles[left.trailing_zeros() as usize] = block.triangles[lane];
            left &= left - 1;
        }
    }
}

/// Whether anything is hit, for each of up to sixteen rays.
///
/// # Safety
/// As for [`closest`].
#[inline(always)]
pub(crate) unsafe fn occluded<N, const B: usize, F, X, T>(
    root: &Root,
    below: OccludedBelow,
    rays: &[Ray],
    occluded: &mut [bool],
) where
    N: Planes,
    F: Order,
    X: PacketBoxes<N>,
    T: PacketBlocks<X::Rays, B>,
{
    occluded.fill(false);
    let answers = std::cell::Cell::from_mut(occluded).as_slice_of_cells();
    // SAFETY: the caller vouches for the tree and the processor.
    let alone = |lane: usize| answers[lane].set(unsafe { below(root, root.node, &rays[lane]) });
    groups(rays, T::class, alone, |group, packed| {
        // SAFETY: as above.
        let found = unsafe { walk_occluded::<N, B, F, X, T>(root, below, group, packed) };
        for (lane, answer) in answers.iter().enumerate() {
            if found & 1 << lane != 0 {
                answer.set(true);
            }
        }
    });
}

/// One bit a ray that hits something.
#[inline(always)]
unsafe fn walk_occluded<N, const B: usize, F, X, T>(
    root: &Root,
    below: OccludedBelow,
    group: u32,
    rays: &[Ray; PACKET],
) -> u32
where
    N: Planes,
    F: Order,
    X: PacketBoxes<N>,
    T: PacketBlocks<X::Rays, B>,
{
    let frustum: PaddedBoxes<F> = frustum(root, rays, N::WIDTH);
    let (boxes, triangles) = (X::new(root, rays), T::new(rays));
    let ends = Hits::new(group, rays);
    let (farthest, t_max) = (ends.farthest(), X::Rays::load(ends.t.0.as_ptr()));
    // Those that have hit nothing yet.
    let mut open = group;
    let mut stack = Stack::new();
    let mut next = Some(Entry { node: root.node, key: 0, rays: group });
    while let Some(Entry { node: current, rays: active, .. }) = next {
        let active = active & open;
        if active.count_ones() <= FEW {
            let mut left = active;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                open &= !(u32::from(below(root, current, &rays[lane])) << lane);
            }
        } else if current.is_leaf() {
            for block in current.blocks::<B>() {
                for lane in 0..B {
                    if block.triangles[lane] == NO_TRIANGLE {
                        break;
                    }
                    open &= !(triangles.meet(block, lane, t_max).hits & active);
                }
            }
        } else {
            let node = current.node::<N>();
            let (mut met, _) = Boxes::<N>::test(&frustum, node, farthest);
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
