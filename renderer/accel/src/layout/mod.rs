//! The tree in memory: nodes of two to sixteen children, and leaves of blocks of four or eight triangles.
//!
//! A node keeps its children's bounds axis by axis (structure of arrays), so that one vector load brings
//! one plane of every child: the layout of Wald, Benthin and Boulos, "Getting Rid of Packets" (2008).
//! Leaves hold the triangles themselves, ready for a test of all lanes at once, so that no index is
//! followed on the way of a ray.
//!
//! | bytes, by number of children or triangles | 2 | 4 | 8 | 16 |
//! |---|---|---|---|---|
//! | a node | 64 | 128 | 256 | 512 |
//! | a block | | 160 | 320 | |

mod block;
mod bounds;
mod node;
mod part;

pub(crate) use block::{Block, is_any_met, is_met};
pub(crate) use bounds::Bounds;
pub(crate) use node::{Node, TreeNode};
pub(crate) use part::PlacedPart;

use std::sync::Arc;

use crate::{geometry::Triangles, limits::LEAF_SIZE_MAX, prefetch::prefetch_line};

pub(crate) const WIDTH_MAX: usize = 16;
/// Fewest triangles a block.
const BLOCK_MIN: usize = 4;
/// Most blocks a leaf; fits the count bits of a [`NodeRef`].
pub(crate) const LEAF_BLOCKS_MAX: usize = (LEAF_SIZE_MAX as usize).div_ceil(BLOCK_MIN);
/// Bytes of a cache line.
const LINE: usize = 64;
const COUNT_BITS: usize = 0b0_1111;
const LEAF_BIT: usize = 0b1_0000;
const TAG_BITS: usize = LEAF_BIT | COUNT_BITS;

const _: () = {
    assert!(LEAF_BLOCKS_MAX <= COUNT_BITS);
    assert!(align_of::<Node<2>>() > TAG_BITS);
    assert!(align_of::<Block<4>>() > TAG_BITS && align_of::<Block<8>>() > TAG_BITS);
    assert!(align_of::<PlacedPart>() > TAG_BITS);
};

/// A pointer to a node or a leaf's items, aligned to 32 bytes or more, which leaves five bits: whether it is
/// a leaf, and of how many items.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct NodeRef(*mut u8);

// SAFETY: only unsafe code follows it, which says why no other thread writes there meanwhile.
unsafe impl Send for NodeRef {}
// SAFETY: as above.
unsafe impl Sync for NodeRef {}

impl NodeRef {
    /// A leaf of no blocks.
    pub(crate) const EMPTY: Self = Self(std::ptr::without_provenance_mut(LEAF_BIT));
    /// No leaf of any tree: what a walk finds at the bottom of its stack.
    pub(crate) const END: Self = Self(std::ptr::without_provenance_mut(LEAF_BIT | 1));

    #[inline(always)]
    pub(crate) fn is_end(self) -> bool {
        self.0.addr() == Self::END.0.addr()
    }

    pub(crate) fn to_node<N: TreeNode>(node: *mut N) -> Self {
        Self(node.cast())
    }

    /// A reference to `count` consecutive items, at most [`LEAF_BLOCKS_MAX`].
    pub(crate) fn to_leaf<T>(items: *mut T, count: usize) -> Self {
        debug_assert!(count <= LEAF_BLOCKS_MAX && align_of::<T>() > TAG_BITS);
        Self(items.cast::<u8>().map_addr(|address| address | LEAF_BIT | count))
    }

    pub(crate) fn into_raw(self) -> *mut std::ffi::c_void {
        self.0.cast()
    }

    pub(crate) fn from_raw(raw: *mut std::ffi::c_void) -> Self {
        Self(raw.cast())
    }

    #[inline(always)]
    pub(crate) fn is_leaf(self) -> bool {
        self.0.addr() & LEAF_BIT != 0
    }

    /// The node.
    ///
    /// # Safety
    /// This is not a leaf, and it refers to an `N` that lives as long as `'a`.
    #[inline(always)]
    pub(crate) unsafe fn node<'a, N: TreeNode>(self) -> &'a N {
        // SAFETY: the caller vouches for it; a node's address carries no tag.
        unsafe { &*self.0.cast::<N>() }
    }

    /// The node, to be changed.
    ///
    /// # Safety
    /// As for [`NodeRef::node`], and there is no other reference to it meanwhile.
    pub(crate) unsafe fn node_mut<'a, N: TreeNode>(self) -> &'a mut N {
        // SAFETY: as above.
        unsafe { &mut *self.0.cast::<N>() }
    }

    /// The blocks of the leaf, to be changed.
    ///
    /// # Safety
    /// As for [`NodeRef::blocks`], and there is no other reference to them meanwhile.
    pub(crate) unsafe fn blocks_mut<'a, const B: usize>(self) -> &'a mut [Block<B>] {
        let count = self.0.addr() & COUNT_BITS;
        if count == 0 {
            return &mut [];
        }
        // SAFETY: the caller vouches for it; the tag says how many blocks there are.
        unsafe {
            std::slice::from_raw_parts_mut(self.0.map_addr(|address| address & !TAG_BITS).cast(), count)
        }
    }

    /// The blocks of the leaf.
    ///
    /// # Safety
    /// This is a leaf of `Block<B>` that live as long as `'a`.
    #[inline(always)]
    pub(crate) unsafe fn blocks<'a, const B: usize>(self) -> &'a [Block<B>] {
        // SAFETY: the caller vouches for it.
        unsafe { self.items() }
    }

    /// The items of the leaf.
    ///
    /// # Safety
    /// This is a leaf of `T` that live as long as `'a`.
    #[inline(always)]
    pub(crate) unsafe fn items<'a, T>(self) -> &'a [T] {
        let count = self.0.addr() & COUNT_BITS;
        if count == 0 {
            return &[];
        }
        // SAFETY: the caller vouches for it; the tag says how many items there are.
        unsafe { std::slice::from_raw_parts(self.0.map_addr(|address| address & !TAG_BITS).cast(), count) }
    }

    /// Asks for the node `N` or the leaf's first item `T` to be brought into the cache; where nodes are no
    /// smaller, without a choice, and a leaf's second item comes along in part.
    #[inline(always)]
    pub(crate) fn prefetch<N: TreeNode, T>(self) {
        let (node, item) = (size_of::<N>(), size_of::<T>());
        let bytes = if node >= item || !self.is_leaf() { node } else { item };
        let first = self.0.map_addr(|address| address & !TAG_BITS).cast_const();
        let mut offset = 0;
        while offset < bytes {
            prefetch_line(first.wrapping_add(offset));
            offset += LINE;
        }
        // Items need not begin with a line.
        prefetch_line(first.wrapping_add(bytes - 1));
    }
}

/// Where a ray begins, the box of everything, and the triangles in it, whose masks rays ask.
#[derive(Clone, Debug)]
pub(crate) struct Root {
    pub(crate) node: NodeRef,
    pub(crate) bounds: Bounds,
    pub(crate) triangles: Arc<Triangles>,
}

/// Evaluates an expression with the node type of the parameters: `for_node!(parameters, N => f::<N>())`.
macro_rules! for_node {
    ($parameters:expr, $N:ident => $body:expr) => {
        for_node!($parameters, $N => $body, [2 4 8] 16)
    };
    ($parameters:expr, $N:ident => $body:expr, [$($width:tt)*] $last:tt) => {
        match $parameters.branching_factor {
            $($width => { type $N = $crate::layout::Node<$width>; $body })*
            _ => { type $N = $crate::layout::Node<$last>; $body }
        }
    };
}

/// Compiles an expression for each width of blocks and evaluates the one of these parameters.
macro_rules! for_block {
    ($parameters:expr, $B:ident => $body:expr) => {{
        if $parameters.block_width == 4 {
            const $B: usize = 4;
            $body
        } else {
            const $B: usize = 8;
            $body
        }
    }};
}

pub(crate) use {for_block, for_node};
