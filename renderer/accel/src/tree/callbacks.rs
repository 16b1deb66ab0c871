//! Callbacks of Embree's builder: they make nodes and leaves in our layout, in Embree's own memory.
//!
//! Leaves are filled here, in parallel and while the builder has the triangles at hand. So the whole build
//! takes as long as Embree's native one. The functions run on Embree's threads: nothing may unwind out of
//! them, so a panic is caught, noted and answered with an empty result.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::{cell::UnsafeCell, ffi::c_void};

use super::split::{Cutter, Piece};
use crate::layout::{Block, Bounds, LEAF_BLOCKS_MAX, NodeRef, TreeNode, WIDTH_MAX};
use crate::{embree::ffi, geometry::Triangles, traverse::Isa};

const _: () = {
    // `Piece` stands for both in the split callback.
    assert!(
        size_of::<Piece>() == size_of::<ffi::RTCBounds>()
            && align_of::<Piece>() <= align_of::<ffi::RTCBounds>()
    );
    assert!(size_of::<Piece>() == size_of::<ffi::RTCBuildPrimitive>());
    assert!(std::mem::offset_of!(Piece, upper) == std::mem::offset_of!(ffi::RTCBuildPrimitive, upper_x));
    assert!(std::mem::offset_of!(Piece, upper) == std::mem::offset_of!(ffi::RTCBounds, upper_x));
};

/// The state of the build for the callbacks, and their failures.
pub(crate) struct Context<'a> {
    /// A number no other build has.
    build: u64,
    pub(crate) triangles: &'a Triangles,
    pub(crate) watertight: bool,
    pub(crate) panicked: AtomicBool,
    pub(crate) out_of_memory: AtomicBool,
}

impl<'a> Context<'a> {
    pub(crate) fn new(triangles: &'a Triangles, watertight: bool) -> Self {
        static BUILDS: AtomicU64 = AtomicU64::new(1);
        Self {
            build: BUILDS.fetch_add(1, Ordering::Relaxed),
            triangles,
            watertight,
            panicked: AtomicBool::new(false),
            out_of_memory: AtomicBool::new(false),
        }
    }

    /// Takes room for `count` values, or notes that there is none.
    ///
    /// # Safety
    /// `allocator` is the one the builder handed to the running callback.
    pub(super) unsafe fn allocate<T>(
        &self,
        allocator: ffi::RTCThreadLocalAllocator,
        count: usize,
    ) -> Option<*mut T> {
        // SAFETY: the caller vouches for the allocator; Embree takes alignments up to 64.
        let room = unsafe { ffi::rtcThreadLocalAlloc(allocator, count * size_of::<T>(), align_of::<T>()) };
        if room.is_null() {
            self.out_of_memory.store(true, Ordering::Relaxed);
            return None;
        }
        Some(room.cast())
    }
}

/// Runs a callback's body with the context behind `user`; a panic is noted and gives `otherwise`.
///
/// # Safety
/// `user` is the `Context` of the running build.
pub(super) unsafe fn guarded<T>(user: *mut c_void, otherwise: T, body: impl FnOnce(&Context<'_>) -> T) -> T {
    // SAFETY: the caller vouches for it.
    let context = unsafe { &*user.cast::<Context<'_>>() };
    catch_unwind(AssertUnwindSafe(|| body(context))).unwrap_or_else(|_| {
        context.panicked.store(true, Ordering::Relaxed);
        otherwise
    })
}

/// `RTCCreateNodeFunction`.
pub(crate) unsafe extern "C" fn create_node<N: TreeNode>(
    allocator: ffi::RTCThreadLocalAllocator,
    _children: u32,
    user: *mut c_void,
) -> *mut c_void {
    // SAFETY: Embree hands back our context and its allocator; the room is large enough and aligned.
    unsafe {
        guarded(user, std::ptr::null_mut(), |context| match context.allocate::<N>(allocator, 1) {
            Some(node) => {
                node.write(N::EMPTY);
                NodeRef::to_node(node).into_raw()
            }
            None => std::ptr::null_mut(),
        })
    }
}

/// `RTCSetNodeChildrenFunction`.
pub(crate) unsafe extern "C" fn set_children<N: TreeNode>(
    node: *mut c_void,
    children: *mut *mut c_void,
    count: u32,
    user: *mut c_void,
) {
    // SAFETY: `node` is null or from `create_node`; each of `count` `children` is from these functions.
    unsafe {
        guarded(user, (), |_| {
            let Some(node) = node.cast::<N>().as_mut() else { return };
            for (place, &child) in
                node.children_mut().iter_mut().zip(std::slice::from_raw_parts(children, count as usize))
            {
                *place = if child.is_null() { NodeRef::EMPTY } else { NodeRef::from_raw(child) };
            }
        });
    }
}

/// `RTCSetNodeBoundsFunction`.
pub(crate) unsafe extern "C" fn set_bounds<N: TreeNode>(
    node: *mut c_void,
    bounds: *mut *const ffi::RTCBounds,
    count: u32,
    user: *mut c_void,
) {
    // SAFETY: `node` is null or came from `create_node`; `bounds` has `count` valid entries.
    unsafe {
        guarded(user, (), |_| {
            let Some(node) = node.cast::<N>().as_mut() else { return };
            let mut of_children = [Bounds::EMPTY; WIDTH_MAX];
            let count = (count as usize).min(N::WIDTH);
            for (place, &bounds) in of_children.iter_mut().zip(std::slice::from_raw_parts(bounds, count)) {
                *place = from_embree(&*bounds);
            }
            node.set_bounds(&of_children[..count]);
        });
    }
}

/// `RTCCreateLeafFunction`.
pub(crate) unsafe extern "C" fn create_leaf<const B: usize>(
    allocator: ffi::RTCThreadLocalAllocator,
    primitives: *const ffi::RTCBuildPrimitive,
    count: usize,
    user: *mut c_void,
) -> *mut c_void {
    // SAFETY: Embree hands back our context, its allocator and `count` primitives; the room is fit.
    unsafe {
        guarded(user, std::ptr::null_mut(), |context| {
            if count == 0 {
                return NodeRef::EMPTY.into_raw();
            }
            let primitives = std::slice::from_raw_parts(primitives, count);
            let blocks = count.div_ceil(B);
            assert!(blocks <= LEAF_BLOCKS_MAX, "Embree made a leaf of {count} triangles");
            let Some(room) = context.allocate::<Block<B>>(allocator, blocks) else {
                return std::ptr::null_mut();
            };
            for (index, chunk) in primitives.chunks(B).enumerate() {
                let numbers = chunk.iter().map(|primitive| primitive.primID);
                room.add(index).write(Block::<B>::new(numbers, context.triangles, context.watertight));
            }
            NodeRef::to_leaf(room, blocks).into_raw()
        })
    }
}

/// The triangle a thread cut last, prepared: builders ask for many cuts of one in a row.
struct LastCut {
    /// Build, triangle and axis; 0 is no build.
    key: (u64, u32, u32),
    cutter: Cutter,
}

thread_local! {
    static LAST_CUT: UnsafeCell<LastCut> =
        const { UnsafeCell::new(LastCut { key: (0, 0, 0), cutter: Cutter::NONE }) };
}

/// `RTCSplitPrimitiveFunction` for an instruction set. Nothing in it can panic.
macro_rules! split_primitive {
    ($(#[$feature:meta])* $name:ident) => {
        // SAFETY: Embree hands back our context, our primitive and two boxes; the processor has the features.
        $(#[$feature])*
        unsafe extern "C" fn $name(
            primitive: *const ffi::RTCBuildPrimitive,
            dimension: u32,
            position: f32,
            left: *mut ffi::RTCBounds,
            right: *mut ffi::RTCBounds,
            user: *mut c_void,
        ) {
            // SAFETY: as above; `primID` is a triangle's number; the last cut is this thread's alone.
            unsafe {
                let context = &*user.cast::<Context<'_>>();
                // Corner, geometry number, corner, triangle number: a box in which the numbers do no harm.
                let within = &*primitive.cast::<Piece>();
                let number = (*primitive).primID;
                let last = &mut *LAST_CUT.with(UnsafeCell::get);
                let key = (context.build, number, dimension);
                if last.key != key {
                    let triangle = context.triangles.indices().get_unchecked(number as usize);
                    let positions = context.triangles.positions();
                    let corners = triangle.map(|vertex| positions.get_unchecked(vertex as usize));
                    *last = LastCut { key, cutter: Cutter::new(corners, dimension as usize) };
                }
                let (lower, upper) = last.cutter.cut(within, position);
                left.cast::<Piece>().write(lower);
                right.cast::<Piece>().write(upper);
            }
        }
    };
}

split_primitive!(split_primitive);
#[cfg(target_arch = "x86_64")]
split_primitive!(
    #[target_feature(enable = "avx2")]
    split_primitive_avx2
);
#[cfg(target_arch = "x86_64")]
split_primitive!(
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2")]
    split_primitive_avx512
);

/// The split callback for an instruction set the processor has.
pub(crate) fn split_callback(isa: Isa) -> ffi::RTCSplitPrimitiveFunction {
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => Some(split_primitive_avx512),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => Some(split_primitive_avx2),
        _ => Some(split_primitive),
    }
}

pub(super) fn from_embree(bounds: &ffi::RTCBounds) -> Bounds {
    Bounds {
        lower: [bounds.lower_x, bounds.lower_y, bounds.lower_z],
        upper: [bounds.upper_x, bounds.upper_y, bounds.upper_z],
    }
}
