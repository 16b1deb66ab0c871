//! A binary tree over single triangles in two arrays, as the optimiser and the collapse want it.
//!
//! Node 0 is the root. The two children of a node lie side by side, at an even number and the odd one behind
//! it. So both come with one cache line, and a node finds its sibling by its own number. Number 1 is unused.

use glam::Vec3A;

use super::sketch::{SketchRef, Sketched};
use crate::layout::Bounds;

#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct BinaryNode {
    lower: [f32; 3],
    /// First of its children, or a triangle number and [`LEAF_BIT`].
    link: u32,
    upper: [f32; 3],
    /// Leaves below; 1 for a leaf.
    leaves: u32,
}

const LEAF_BIT: u32 = 1 << 31;

#[inline(always)]
pub(super) fn half_area(lower: Vec3A, upper: Vec3A) -> f32 {
    let extent = upper - lower;
    extent.x * extent.y + extent.y * extent.z + extent.z * extent.x
}

impl BinaryNode {
    pub(super) const UNUSED: Self = Self { lower: [0.0; 3], link: LEAF_BIT, upper: [0.0; 3], leaves: 0 };

    pub(super) fn leaf(bounds: Bounds, triangle: u32) -> Self {
        Self { lower: bounds.lower, link: triangle | LEAF_BIT, upper: bounds.upper, leaves: 1 }
    }

    pub(super) fn inner(bounds: Bounds, first_child: usize, leaves: u32) -> Self {
        Self { lower: bounds.lower, link: first_child as u32, upper: bounds.upper, leaves }
    }

    #[inline(always)]
    pub(super) fn lower(&self) -> Vec3A {
        Vec3A::from_array(self.lower)
    }

    #[inline(always)]
    pub(super) fn upper(&self) -> Vec3A {
        Vec3A::from_array(self.upper)
    }

    pub(super) fn bounds(&self) -> Bounds {
        Bounds { lower: self.lower, upper: self.upper }
    }

    pub(super) fn set_bounds(&mut self, bounds: Bounds) {
        (self.lower, self.upper) = (bounds.lower, bounds.upper);
    }

    /// The first of its two children, or `None` for a leaf.
    #[inline(always)]
    pub(super) fn first_child(&self) -> Option<usize> {
        (self.link & LEAF_BIT == 0).then_some(self.link as usize)
    }

    /// Its triangle, if it is a leaf.
    pub(super) fn triangle(&self) -> u32 {
        self.link & !LEAF_BIT
    }

    pub(super) fn leaves(&self) -> u32 {
        self.leaves
    }
}

#[derive(Clone, Debug)]
pub(super) struct BinaryTree {
    pub(super) nodes: Vec<BinaryNode>,
    /// Parent of each pair of siblings, by half the number of the first.
    pub(super) parents: Vec<u32>,
}

/// Fewest leaves of a subtree that is worth a task of its own.
const LEAVES_PER_TASK: u32 = 2048;

impl BinaryTree {
    /// Copies a sketch depth first: the nodes below a node follow its children.
    ///
    /// # Safety
    /// `root` is the root of a finished build, whose memory lives.
    pub(super) unsafe fn from_sketch(root: SketchRef, bounds: Bounds) -> Self {
        Self::of(InSketch { bounds, at: root })
    }

    /// Writes a tree down depth first: the nodes below a node follow its children.
    pub(super) fn of(root: impl Subtree) -> Self {
        let leaves = root.leaves() as usize;
        let mut nodes = vec![BinaryNode::UNUSED; 2 * leaves];
        let mut parents = vec![0; leaves];
        let (top, below) = nodes.split_at_mut(2);
        // Below a node of n leaves there are 2n - 2 nodes.
        top[0] = write(root, 0, below, 2, &mut parents[1..]);
        Self { nodes, parents }
    }

    pub(super) fn root(&self) -> &BinaryNode {
        &self.nodes[0]
    }

    #[inline(always)]
    pub(super) fn parent(&self, node: usize) -> usize {
        self.parents[node / 2] as usize
    }

    /// Sum of the areas of inner nodes: the part of the tree's cost that its shape decides.
    #[cfg(test)]
    pub(super) fn inner_area(&self) -> f64 {
        let inner = self.nodes.iter().filter(|node| node.first_child().is_some());
        inner.map(|node| node.bounds().half_area()).sum()
    }

    /// Numbers the nodes depth first and counts leaves again, after nodes were moved about.
    pub(super) fn renumber(&mut self) {
        let mut nodes = vec![BinaryNode::UNUSED; self.nodes.len()];
        let mut parents = vec![0; self.parents.len()];
        nodes[0] = self.nodes[0];
        let mut next = 2;
        // Nodes that still name their children by the old numbers.
        let mut stack = vec![0];
        while let Some(number) = stack.pop() {
            let Some(old) = nodes[number].first_child() else { continue };
            let new = next;
            next += 2;
            nodes[new] = self.nodes[old];
            nodes[new + 1] = self.nodes[old + 1];
            nodes[number].link = new as u32;
            parents[new / 2] = number as u32;
            stack.extend([new + 1, new]);
        }
        for number in (0..nodes.len()).rev() {
            if let Some(first) = nodes[number].first_child() {
                nodes[number].leaves = nodes[first].leaves + nodes[first + 1].leaves;
            }
        }
        *self = Self { nodes, parents };
    }
}

/// A binary tree over single triangles, or a part of one, in any form.
pub(super) trait Subtree: Send + Sized {
    fn bounds(&self) -> Bounds;

    /// Its leaves: 1 for a leaf.
    fn leaves(&self) -> u32;

    fn open(self) -> Opened<Self>;
}

pub(super) enum Opened<S> {
    Leaf(u32),
    /// Two halves.
    Node([S; 2]),
}

/// A part of a sketch. [`BinaryTree::from_sketch`] alone begins with one; its caller vouches for it.
struct InSketch {
    bounds: Bounds,
    at: SketchRef,
}

impl Subtree for InSketch {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn leaves(&self) -> u32 {
        // SAFETY: here and below, as said above.
        unsafe { self.at.leaves() }
    }

    fn open(self) -> Opened<Self> {
        // SAFETY: as above.
        let node = match unsafe { self.at.follow() } {
            Sketched::Leaf(triangle) => return Opened::Leaf(triangle),
            Sketched::Node(node) => node,
        };
        let mut children = node.children().map(|(bounds, at)| Self { bounds, at });
        let (Some(left), Some(right)) = (children.next(), children.next()) else {
            unreachable!("the builder makes nodes of two children");
        };
        Opened::Node([left, right])
    }
}

/// A tree over one or more boxes that halves their list: a bad one, but none is shallower.
pub(super) fn halved(boxes: &[Bounds]) -> BinaryTree {
    BinaryTree::of(Halves { boxes, first: 0 })
}

/// A run of a list of boxes, and the number of its first one.
struct Halves<'a> {
    boxes: &'a [Bounds],
    first: u32,
}

impl Subtree for Halves<'_> {
    fn bounds(&self) -> Bounds {
        self.boxes.iter().copied().fold(Bounds::EMPTY, Bounds::union)
    }

    fn leaves(&self) -> u32 {
        self.boxes.len() as u32
    }

    fn open(self) -> Opened<Self> {
        let (left, right) = self.boxes.split_at(self.boxes.len() / 2);
        if left.is_empty() {
            return Opened::Leaf(self.first);
        }
        let middle = self.first + left.len() as u32;
        Opened::Node([Self { boxes: left, first: self.first }, Self { boxes: right, first: middle }])
    }
}

/// Writes a subtree down: `node` is its number, the nodes below go into `below` from number `first` on.
fn write<S: Subtree>(
    subtree: S,
    node: usize,
    below: &mut [BinaryNode],
    first: usize,
    parents: &mut [u32],
) -> BinaryNode {
    let (bounds, leaves) = (subtree.bounds(), subtree.leaves());
    let [left, right] = match subtree.open() {
        Opened::Leaf(triangle) => return BinaryNode::leaf(bounds, triangle),
        Opened::Node(halves) => halves,
    };
    let leaves_left = left.leaves() as usize;
    let (pair, below) = below.split_at_mut(2);
    let (below_left, below_right) = below.split_at_mut(2 * (leaves_left - 1));
    let (own, parents) = parents.split_at_mut(1);
    let (parents_left, parents_right) = parents.split_at_mut(leaves_left - 1);
    own[0] = node as u32;
    let first_right = first + 2 + below_left.len();
    let write_left = || write(left, first, below_left, first + 2, parents_left);
    let write_right = || write(right, first + 1, below_right, first_right, parents_right);
    let (left, right) = match leaves {
        0..LEAVES_PER_TASK => (write_left(), write_right()),
        _ => rayon::join(write_left, write_right),
    };
    (pair[0], pair[1]) = (left, right);
    BinaryNode::inner(bounds, first, leaves)
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Boxes of all kinds: large, small, flat, coincident.
    pub(crate) fn boxes() -> impl Strategy<Value = Vec<Bounds>> {
        let one = (prop::array::uniform3(-8i8..8), prop::array::uniform3(0u8..5), 0.0f32..2.0).prop_map(
            |(lower, extent, fraction)| {
                let lower = lower.map(f32::from);
                let upper = [0, 1, 2].map(|axis| lower[axis] + f32::from(extent[axis]) * fraction);
                Bounds { lower, upper }
            },
        );
        prop::collection::vec(one, 1..120)
    }

    /// Every leaf is there once and unchanged, every box fits its children exactly, numbers and counts agree.
    pub(crate) fn check(tree: &BinaryTree, leaves: &[Bounds]) {
        let mut found = vec![0; leaves.len()];
        let mut stack = vec![0];
        while let Some(number) = stack.pop() {
            let node = &tree.nodes[number];
            let Some(first) = node.first_child() else {
                found[node.triangle() as usize] += 1;
                assert_eq!(node.bounds(), leaves[node.triangle() as usize]);
                continue;
            };
            let (left, right) = (&tree.nodes[first], &tree.nodes[first + 1]);
            assert_eq!(node.bounds(), left.bounds().union(right.bounds()));
            assert_eq!(node.leaves(), left.leaves() + right.leaves());
            assert_eq!(tree.parent(first), number);
            assert!(first > number, "children follow their parents");
            stack.extend([first, first + 1]);
        }
        assert!(found.iter().all(|&times| times == 1), "{found:?}");
    }
}
