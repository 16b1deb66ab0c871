//! The result of Embree's builder when the tree is to be collapsed afterwards: pairs of children, boxes, and
//! triangle numbers, in Embree's memory. It lives only until [`super::binary`] has read it.
//!
//! The functions that Embree calls are like those of [`super::callbacks`]. A node also counts the leaves
//! below it, so that a reader of the sketch can share the work between threads beforehand.

use std::ffi::c_void;

use super::callbacks::{from_embree, guarded};
use crate::{embree::ffi, layout::Bounds};

#[repr(C, align(16))]
pub(super) struct Sketch {
    bounds: [Bounds; 2],
    children: [SketchRef; 2],
    count: u32,
    leaves: u32,
}

/// A node, or a leaf: its one triangle's number stands in the reference itself.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct SketchRef(*mut u8);

const LEAF_BIT: usize = 1;

pub(super) enum Sketched<'a> {
    Node(&'a Sketch),
    Leaf(u32),
}

impl SketchRef {
    const NOTHING: Self = Self(std::ptr::null_mut());

    pub(super) fn from_raw(raw: *mut c_void) -> Self {
        Self(raw.cast())
    }

    /// Follows the reference.
    ///
    /// # Safety
    /// It came from [`create_node`] or [`create_leaf`] in a build without failure, whose memory lives as long
    /// as `'a`.
    pub(super) unsafe fn follow<'a>(self) -> Sketched<'a> {
        match self.0.addr() & LEAF_BIT {
            // SAFETY: the caller vouches for the memory.
            0 => Sketched::Node(unsafe { &*self.0.cast() }),
            _ => Sketched::Leaf((self.0.addr() >> 1) as u32),
        }
    }

    /// Leaves below, 1 for a leaf.
    ///
    /// # Safety
    /// As for [`Self::follow`].
    pub(super) unsafe fn leaves(self) -> u32 {
        // SAFETY: the caller vouches for it.
        match unsafe { self.follow() } {
            Sketched::Node(node) => node.leaves,
            Sketched::Leaf(_) => 1,
        }
    }
}

impl Sketch {
    pub(super) fn children(&self) -> impl Iterator<Item = (Bounds, SketchRef)> + '_ {
        self.bounds.iter().copied().zip(self.children.iter().copied()).take(self.count as usize)
    }
}

// SAFETY: a sketch is never written once the build is over.
unsafe impl Send for SketchRef {}
// SAFETY: as above.
unsafe impl Sync for SketchRef {}

/// `RTCCreateNodeFunction`.
pub(super) unsafe extern "C" fn create_node(
    allocator: ffi::RTCThreadLocalAllocator,
    _children: u32,
    user: *mut c_void,
) -> *mut c_void {
    // SAFETY: Embree hands back our context and its allocator; the room is large enough and aligned.
    unsafe {
        guarded(user, std::ptr::null_mut(), |context| {
            let Some(node) = context.allocate::<Sketch>(allocator, 1) else { return std::ptr::null_mut() };
            node.write(Sketch {
                bounds: [Bounds::EMPTY; 2],
                children: [SketchRef::NOTHING; 2],
                count: 0,
                leaves: 0,
            });
            node.cast()
        })
    }
}

/// `RTCSetNodeBoundsFunction`.
pub(super) unsafe extern "C" fn set_bounds(
    node: *mut c_void,
    bounds: *mut *const ffi::RTCBounds,
    count: u32,
    user: *mut c_void,
) {
    // SAFETY: `node` is null or came from `create_node`; `bounds` has `count` valid entries.
    unsafe {
        guarded(user, (), |_| {
            let Some(node) = node.cast::<Sketch>().as_mut() else { return };
            let bounds = std::slice::from_raw_parts(bounds, count as usize);
            for (place, &bounds) in node.bounds.iter_mut().zip(bounds) {
                *place = from_embree(&*bounds);
            }
        });
    }
}

/// `RTCSetNodeChildrenFunction`: called when everything below is done.
pub(super) unsafe extern "C" fn set_children(
    node: *mut c_void,
    children: *mut *mut c_void,
    count: u32,
    user: *mut c_void,
) {
    // SAFETY: as for `set_bounds`; each of `count` `children` is null or a finished one of these functions.
    unsafe {
        guarded(user, (), |_| {
            let Some(node) = node.cast::<Sketch>().as_mut() else { return };
            let children = std::slice::from_raw_parts(children, count as usize);
            for (place, &child) in node.children.iter_mut().zip(children) {
                // Only where memory ran out, and then the build fails as a whole.
                if child.is_null() {
                    return;
                }
                *place = SketchRef::from_raw(child);
                node.leaves += place.leaves();
            }
            node.count = count;
        });
    }
}

/// `RTCCreateLeafFunction`, for builds that are asked for one triangle a leaf.
pub(super) unsafe extern "C" fn create_leaf(
    _allocator: ffi::RTCThreadLocalAllocator,
    primitives: *const ffi::RTCBuildPrimitive,
    count: usize,
    user: *mut c_void,
) -> *mut c_void {
    // SAFETY: Embree hands back our context and `count` primitives.
    unsafe {
        guarded(user, std::ptr::null_mut(), |_| {
            let primitives = std::slice::from_raw_parts(primitives, count);
            std::ptr::without_provenance_mut((primitives[0].primID as usize) << 1 | LEAF_BIT)
        })
    }
}
