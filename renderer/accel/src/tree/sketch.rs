//! The result of Embree's builder when the tree is to be arranged afterwards: children, boxes, and triangle
//! numbers, in Embree's memory. It lives only until [`super::plan`] or [`super::binary`] has read it.
//!
//! The functions that Embree calls are like those of [`super::callbacks`]. A node also counts the nodes below
//! it, so that a reader of the sketch can share the work between threads beforehand.

use std::ffi::c_void;

use super::callbacks::{Context, from_embree, guarded};
use crate::embree::ffi;
use crate::layout::Bounds;

/// A node of up to `W` children.
#[repr(C, align(16))]
pub(super) struct Sketch<const W: usize> {
    bounds: [Bounds; W],
    children: [SketchRef; W],
    count: u32,
    /// Inner nodes below and including this one.
    nodes: u32,
    /// Leaves below.
    leaves: u32,
    /// Triangle numbers in them.
    references: u32,
}

/// A node, or a leaf: several triangles lie behind a pointer, after their number; a single one, the usual
/// case in binary trees, stands in the reference itself.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct SketchRef(*mut u8);

const LEAF_BIT: usize = 0b01;
const SINGLE_BIT: usize = 0b10;

/// The node or leaf that a [`SketchRef`] refers to.
pub(super) enum Sketched<'a, const W: usize> {
    Node(&'a Sketch<W>),
    Single(u32),
    Several(&'a [u32]),
}

/// The numbers of nodes, leaves and references below.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) nodes: u32,
    pub(super) leaves: u32,
    pub(super) references: u32,
}

impl SketchRef {
    const NOTHING: Self = Self(std::ptr::null_mut());

    /// From what the builder returns.
    pub(super) fn from_raw(raw: *mut c_void) -> Self {
        Self(raw.cast())
    }

    /// Follows the reference.
    ///
    /// # Safety
    /// It came from [`create_node`] or [`create_leaf`] of width `W` in a build without failure, whose memory
    /// lives as long as `'a`.
    pub(super) unsafe fn follow<'a, const W: usize>(self) -> Sketched<'a, W> {
        let address = self.0.addr();
        if address & SINGLE_BIT != 0 {
            return Sketched::Single((address >> 2) as u32);
        }
        // SAFETY: the caller vouches for the memory; a leaf's count stands before its numbers.
        unsafe {
            if address & LEAF_BIT == 0 {
                return Sketched::Node(&*self.0.cast());
            }
            let start = self.0.map_addr(|address| address & !LEAF_BIT).cast::<u32>();
            Sketched::Several(std::slice::from_raw_parts(start.add(1), *start as usize))
        }
    }

    /// # Safety
    /// As for [`Self::follow`].
    pub(super) unsafe fn counts<const W: usize>(self) -> Counts {
        // SAFETY: the caller vouches for it.
        match unsafe { self.follow::<W>() } {
            Sketched::Node(node) => {
                Counts { nodes: node.nodes, leaves: node.leaves, references: node.references }
            }
            Sketched::Single(_) => Counts { nodes: 0, leaves: 1, references: 1 },
            Sketched::Several(numbers) => Counts { nodes: 0, leaves: 1, references: numbers.len() as u32 },
        }
    }
}

impl<const W: usize> Sketch<W> {
    /// The children with their boxes.
    pub(super) fn children(&self) -> impl Iterator<Item = (Bounds, SketchRef)> + '_ {
        self.bounds.iter().copied().zip(self.children.iter().copied()).take(self.count as usize)
    }
}

// SAFETY: a sketch is never written once the build is over.
unsafe impl Send for SketchRef {}
// SAFETY: as above.
unsafe impl Sync for SketchRef {}

/// `RTCCreateNodeFunction`.
pub(super) unsafe extern "C" fn create_node<const W: usize>(
    allocator: ffi::RTCThreadLocalAllocator,
    _children: u32,
    user: *mut c_void,
) -> *mut c_void {
    // SAFETY: Embree hands back our context and its allocator; the room is large enough and aligned.
    unsafe {
        guarded(user, std::ptr::null_mut(), |context| {
            let Some(node) = context.allocate::<Sketch<W>>(allocator, 1) else {
                return std::ptr::null_mut();
            };
            node.write(Sketch {
                bounds: [Bounds::EMPTY; W],
                children: [SketchRef::NOTHING; W],
                count: 0,
                nodes: 1,
                leaves: 0,
                references: 0,
            });
            node.cast()
        })
    }
}

/// `RTCSetNodeBoundsFunction`.
pub(super) unsafe extern "C" fn set_bounds<const W: usize>(
    node: *mut c_void,
    bounds: *mut *const ffi::RTCBounds,
    count: u32,
    user: *mut c_void,
) {
    // SAFETY: `node` is null or came from `create_node`; `bounds` has `count` valid entries.
    unsafe {
        guarded(user, (), |_| {
            let Some(node) = node.cast::<Sketch<W>>().as_mut() else {
                return;
            };
            let bounds = std::slice::from_raw_parts(bounds, count as usize);
            for (place, &bounds) in node.bounds.iter_mut().zip(bounds) {
                *place = from_embree(&*bounds);
            }
        });
    }
}

/// `RTCSetNodeChildrenFunction`: called when everything below is done.
pub(super) unsafe extern "C" fn set_children<const W: usize>(
    node: *mut c_void,
    children: *mut *mut c_void,
    count: u32,
    user: *mut c_void,
) {
    // SAFETY: `node` is null or came from `create_node`; `children` has `count` entries, each null or made by
    // one of these functions, finished.
    unsafe {
        guarded(user, (), |_| {
            let Some(node) = node.cast::<Sketch<W>>().as_mut() else {
                return;
            };
            let children = std::slice::from_raw_parts(children, count as usize);
            for (place, &child) in node.children.iter_mut().zip(children) {
                // Only where memory ran out, and then the build fails as a whole.
                if child.is_null() {
                    return;
                }
                *place = SketchRef::from_raw(child);
                let below = place.counts::<W>();
                node.nodes += below.nodes;
                node.leaves += below.leaves;
                node.references += below.references;
            }
            node.count = count;
        });
    }
}

/// `RTCCreateLeafFunction`.
pub(super) unsafe extern "C" fn create_leaf(
    allocator: ffi::RTCThreadLocalAllocator,
    primitives: *const ffi::RTCBuildPrimitive,
    count: usize,
    user: *mut c_void,
) -> *mut c_void {
    // SAFETY: Embree hands back our context, its allocator and `count` primitives; the room is large enough.
    unsafe {
        guarded(user, std::ptr::null_mut(), |context: &Context<'_>| {
            let primitives = std::slice::from_raw_parts(primitives, count);
            if let [single] = primitives {
                let tagged = (single.primID as usize) << 2 | SINGLE_BIT | LEAF_BIT;
                return std::ptr::without_provenance_mut(tagged);
            }
            let Some(room) = context.allocate::<u32>(allocator, count + 1) else {
                return std::ptr::null_mut();
            };
            room.write(count as u32);
            for (place, primitive) in primitives.iter().enumerate() {
                room.add(place + 1).write(primitive.primID);
            }
            room.map_addr(|address| address | LEAF_BIT).cast()
        })
    }
}
