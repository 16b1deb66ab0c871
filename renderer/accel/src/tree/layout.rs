//! The tree in memory: nodes of two, four or eight children, and leaves of four-triangle blocks.
//!
//! A node keeps its children's bounds axis by axis (structure of arrays), so that one vector load brings
//! one plane of every child: the layout of Wald, Benthin and Boulos, "Getting Rid of Packets" (2008).
//! Leaves hold the triangles themselves, ready for a four-lane test, so that no index is followed on
//! the way of a ray. Sizes: 64, 128 or 256 bytes a node, 160 bytes a block.

use crate::geometry::Triangles;
use crate::limits::LEAF_SIZE_MAX;

/// Triangles a block.
pub(crate) const BLOCK: usize = 4;

/// Most blocks a leaf; fits the count bits of a [`NodeRef`].
pub(crate) const LEAF_BLOCKS_MAX: usize = (LEAF_SIZE_MAX as usize).div_ceil(BLOCK);

const COUNT_BITS: usize = 0b0_1111;
const LEAF_BIT: usize = 0b1_0000;
const TAG_BITS: usize = LEAF_BIT | COUNT_BITS;

const _: () = assert!(LEAF_BLOCKS_MAX <= COUNT_BITS);

/// A pointer to a node or to the blocks of a leaf. Both are aligned to 32 bytes or more, which leaves
/// five bits: whether it is a leaf, and of how many blocks.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct NodeRef(*mut u8);

impl NodeRef {
    /// A leaf of no blocks.
    pub(crate) const EMPTY: Self = Self(std::ptr::without_provenance_mut(LEAF_BIT));

    /// A reference to a node.
    pub(crate) fn to_node<const W: usize>(node: *mut Node<W>) -> Self {
        Self(node.cast())
    }

    /// A reference to `count` consecutive blocks, at most [`LEAF_BLOCKS_MAX`].
    pub(crate) fn to_leaf(blocks: *mut Block, count: usize) -> Self {
        debug_assert!(count <= LEAF_BLOCKS_MAX);
        Self(blocks.cast::<u8>().map_addr(|address| address | LEAF_BIT | count))
    }

    /// As the builder carries it.
    pub(crate) fn into_raw(self) -> *mut std::ffi::c_void {
        self.0.cast()
    }

    /// Back from the builder.
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
    /// This is not a leaf, and it refers to a `Node<W>` that lives as long as `'a`.
    #[inline(always)]
    pub(crate) unsafe fn node<'a, const W: usize>(self) -> &'a Node<W> {
        // SAFETY: the caller vouches for it; a node's address carries no tag.
        unsafe { &*self.0.cast::<Node<W>>() }
    }

    /// The blocks of the leaf.
    ///
    /// # Safety
    /// This is a leaf whose blocks live as long as `'a`.
    #[inline(always)]
    pub(crate) unsafe fn blocks<'a>(self) -> &'a [Block] {
        let count = self.0.addr() & COUNT_BITS;
        if count == 0 {
            return &[];
        }
        // SAFETY: the caller vouches for it; the tag says how many blocks there are.
        unsafe { std::slice::from_raw_parts(self.0.map_addr(|address| address & !TAG_BITS).cast(), count) }
    }
}

/// An inner node with up to `W` children. Unused places have inverted bounds and the empty leaf.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node<const W: usize> {
    /// `bounds[axis][side][child]`, side 0 being the lower one.
    pub(crate) bounds: [[[f32; W]; 2]; 3],
    pub(crate) children: [NodeRef; W],
}

const _: () = {
    assert!(size_of::<Node<2>>() == 64);
    assert!(size_of::<Node<4>>() == 128);
    assert!(size_of::<Node<8>>() == 256);
    assert!(align_of::<Node<2>>() > TAG_BITS && align_of::<Block>() > TAG_BITS);
};

impl<const W: usize> Node<W> {
    /// A node without children.
    pub(crate) const EMPTY: Self =
        Self { bounds: [[[f32::INFINITY; W], [f32::NEG_INFINITY; W]]; 3], children: [NodeRef::EMPTY; W] };

    /// Bounds of one child.
    pub(crate) fn child_bounds(&self, child: usize) -> Bounds {
        let side = |side: usize| [0, 1, 2].map(|axis| self.bounds[axis][side][child]);
        Bounds { lower: side(0), upper: side(1) }
    }
}

/// Four triangles. A plain block holds the first corner and two edges, a watertight one the three
/// corners: `vertices[which][axis][lane]`. Unused lanes hold NaN, which no test accepts.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Block {
    pub(crate) vertices: [[[f32; BLOCK]; 3]; 3],
    pub(crate) triangles: [u32; BLOCK],
}

/// What an unused lane has for a triangle number.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;

impl Block {
    /// Up to four triangles by number: with corners if `watertight`, otherwise with `v0`, `v0 - v1` and
    /// `v2 - v0`.
    pub(crate) fn new(numbers: impl Iterator<Item = u32>, triangles: &Triangles, watertight: bool) -> Self {
        let mut block = Self { vertices: [[[f32::NAN; BLOCK]; 3]; 3], triangles: [NO_TRIANGLE; BLOCK] };
        for (lane, number) in numbers.take(BLOCK).enumerate() {
            let [a, b, c] = triangles.corners(number as usize);
            let stored = if watertight { [a, b, c] } else { [a, a - b, c - a] };
            for (which, vertex) in stored.into_iter().enumerate() {
                for (axis, value) in vertex.to_array().into_iter().enumerate() {
                    block.vertices[which][axis][lane] = value;
                }
            }
            block.triangles[lane] = number;
        }
        block
    }

    /// Numbers of the triangles in use.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = u32> + '_ {
        self.triangles.iter().copied().filter(|&number| number != NO_TRIANGLE)
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) lower: [f32; 3],
    pub(crate) upper: [f32; 3],
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { lower: [f32::INFINITY; 3], upper: [f32::NEG_INFINITY; 3] };

    pub(crate) fn of_corners(corners: &[glam::Vec3A; 3]) -> Self {
        let [a, b, c] = *corners;
        Self { lower: a.min(b).min(c).to_array(), upper: a.max(b).max(c).to_array() }
    }

    pub(crate) fn union(self, other: Self) -> Self {
        let axes = [0, 1, 2];
        Self {
            lower: axes.map(|axis| self.lower[axis].min(other.lower[axis])),
            upper: axes.map(|axis| self.upper[axis].max(other.upper[axis])),
        }
    }

    pub(crate) fn contains(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.lower[axis] <= other.lower[axis] && other.upper[axis] <= self.upper[axis])
    }

    /// Half the surface area, in double precision; 0 for an empty box.
    pub(crate) fn half_area(&self) -> f64 {
        let [x, y, z] =
            [0, 1, 2].map(|axis| (f64::from(self.upper[axis]) - f64::from(self.lower[axis])).max(0.0));
        x * y + y * z + z * x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_keep_kind_and_count() {
        let mut node = Node::<4>::EMPTY;
        let mut blocks = [Block { vertices: [[[0.0; 4]; 3]; 3], triangles: [3; 4] }; LEAF_BLOCKS_MAX];
        assert!(!NodeRef::to_node(&raw mut node).is_leaf());
        let leaf = NodeRef::to_leaf(blocks.as_mut_ptr(), LEAF_BLOCKS_MAX);
        assert!(leaf.is_leaf());
        // SAFETY: both are leaves of live or no blocks.
        let (full, none) = unsafe { (leaf.blocks(), NodeRef::EMPTY.blocks()) };
        assert_eq!(full.len(), LEAF_BLOCKS_MAX);
        assert!(full.iter().all(|block| block.numbers().count() == BLOCK));
        assert!(none.is_empty() && NodeRef::EMPTY.is_leaf());
    }
}
