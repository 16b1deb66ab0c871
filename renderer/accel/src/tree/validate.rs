//! Checks a finished tree, triangle by triangle, for tests and investigations.

use super::{Tree, walk::Met};
use crate::{layout::Bounds, parameters::Quality};

/// A fault of a tree.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TreeFault {
    /// A child's box sticks out of its parent's, whose depth this is.
    #[error("at depth {0} a child's box sticks out of its parent's")]
    ChildOutside(u32),
    /// A leaf is deeper than allowed.
    #[error("a leaf lies at depth {depth}, the limit is {limit}")]
    TooDeep {
        /// Depth of the leaf.
        depth: u32,
        /// The limit.
        limit: u32,
    },
    /// A leaf holds this number of triangles, more than the limit that follows, or none.
    #[error("a leaf holds {0} triangles, the limit is {1}")]
    LeafSize(usize, u32),
    /// A triangle, by number, is in no leaf, or in several, this many, of a tree without splits.
    #[error("triangle {0} is in {1} leaves")]
    References(usize, u32),
    /// The boxes of the leaves that hold a triangle do not cover it.
    #[error("the leaves of triangle {0} do not cover it")]
    NotCovered(usize),
    /// An instance is not found exactly once in the upper level, in a box that covers it.
    #[error("the upper level does not hold instance {0} once, in a box that covers it")]
    Instance(u32),
}

impl Tree {
    /// Checks boxes, triangles' leaves (one, or more where the builder splits), depth and leaf sizes.
    pub fn validate(&self) -> Result<(), TreeFault> {
        let mut fault = None;
        let mut leaves_of = vec![0u32; self.root.triangles.len()];
        let mut covered_by = vec![Bounds::EMPTY; self.root.triangles.len()];
        let parameters = &self.parameters;
        self.walk(&mut |met| match met {
            Met::Node { bounds, depth, children, .. } => {
                if !children.iter().all(|child| bounds.contains(child)) {
                    fault.get_or_insert(TreeFault::ChildOutside(depth));
                }
            }
            Met::Leaf { reach, depth, numbers, .. } => {
                if depth > parameters.max_depth {
                    fault.get_or_insert(TreeFault::TooDeep { depth, limit: parameters.max_depth });
                }
                if numbers.is_empty() || numbers.len() > parameters.max_leaf_size as usize {
                    fault.get_or_insert(TreeFault::LeafSize(numbers.len(), parameters.max_leaf_size));
                }
                for &number in numbers {
                    leaves_of[number as usize] += 1;
                    covered_by[number as usize] = covered_by[number as usize].union(reach);
                }
            }
        });
        for (triangle, &leaves) in leaves_of.iter().enumerate() {
            if leaves == 0 || (leaves > 1 && parameters.quality != Quality::SahSplit) {
                fault.get_or_insert(TreeFault::References(triangle, leaves));
            } else if !covered_by[triangle]
                .contains(&Bounds::of_corners(&self.root.triangles.corners(triangle)))
            {
                fault.get_or_insert(TreeFault::NotCovered(triangle));
            }
        }
        fault.map_or(Ok(()), Err)
    }
}
