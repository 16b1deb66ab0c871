//! The upper part of a tree, for tight boxes around where it is placed.

use std::collections::BinaryHeap;

use glam::{Affine3A, Vec3A};

use crate::layout::{Bounds, NodeRef, Root, TreeNode};

/// Nodes of an object's tree that decide how tight its boxes in the world are.
const PARTS: usize = 64;

/// The boxes of the largest nodes of a tree of which none is below another; together they hold all triangles.
#[derive(Debug)]
pub(super) struct Outline {
    boxes: Vec<Bounds>,
}

/// Areas order like their bits, for they are not below zero.
fn by_size(bounds: &Bounds) -> u64 {
    bounds.half_area().max(0.0).to_bits()
}

impl Outline {
    /// Opens nodes, the largest first, until there are [`PARTS`].
    ///
    /// # Safety
    /// The root is that of a tree of nodes `N`, which lives.
    pub(super) unsafe fn of<N: TreeNode>(root: &Root) -> Self {
        let mut parts: Vec<(Bounds, NodeRef)> = vec![(root.bounds, root.node)];
        let mut closed = BinaryHeap::from([(by_size(&root.bounds), 0_usize)]);
        while parts.len() < PARTS {
            let Some((_, number)) = closed.pop() else { break };
            let (_, node) = parts[number];
            if node.is_leaf() {
                continue;
            }
            // SAFETY: the caller vouches for the tree.
            let inner = unsafe { node.node::<N>() };
            for child in 0..inner.count() {
                let part = (inner.child_bounds(child), inner.children()[child]);
                // One child takes its parent's place, the others come behind all.
                let place = if child == 0 { number } else { parts.len() };
                closed.push((by_size(&part.0), place));
                match parts.get_mut(place) {
                    Some(parent) => *parent = part,
                    None => parts.push(part),
                }
            }
        }
        Self { boxes: parts.into_iter().map(|(bounds, _)| bounds).collect() }
    }

    /// A box around the triangles after `by`: each box is turned by itself, which is tighter.
    pub(super) fn placed(&self, by: &Affine3A) -> Bounds {
        self.boxes.iter().map(|one| transformed(one, by)).fold(Bounds::EMPTY, Bounds::union)
    }
}

/// A box around `bounds` after `by`, rounded outwards (Arvo, "Transforming axis-aligned bounding boxes").
fn transformed(bounds: &Bounds, by: &Affine3A) -> Bounds {
    let (lower, upper) = (Vec3A::from_array(bounds.lower), Vec3A::from_array(bounds.upper));
    let (center, half) = (lower * 0.5 + upper * 0.5, upper * 0.5 - lower * 0.5);
    let grown = |by_axes: Vec3A| {
        by.matrix3.x_axis.abs() * by_axes.x
            + by.matrix3.y_axis.abs() * by_axes.y
            + by.matrix3.z_axis.abs() * by_axes.z
    };
    // A ray is taken into the object's space with as much rounding as a point is taken out of it.
    let rounding = (grown(center.abs() + half) + by.translation.abs()) * (8.0 * f32::EPSILON);
    let (center, reach) = (by.transform_point3a(center), grown(half) + rounding);
    Bounds { lower: (center - reach).to_array(), upper: (center + reach).to_array() }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_transformed_box_contains_its_points(
            corner in prop::array::uniform3(-100.0f32..100.0),
            size in prop::array::uniform3(0.0f32..50.0),
            rows in prop::array::uniform9(-3.0f32..3.0),
            shift in prop::array::uniform3(-1000.0f32..1000.0),
            weights in prop::array::uniform3(0.0f32..1.0),
        ) {
            let bounds = Bounds { lower: corner, upper: [0, 1, 2].map(|axis| corner[axis] + size[axis]) };
            let by = Affine3A::from_mat3_translation(glam::Mat3::from_cols_array(&rows), Vec3::from_array(shift));
            let about = transformed(&bounds, &by);
            let point = Vec3::from_array([0, 1, 2].map(|axis| (corner[axis] + size[axis] * weights[axis]).min(bounds.upper[axis])));
            let moved = by.transform_point3(point).to_array();
            let point = Bounds { lower: moved, upper: moved };
            prop_assert!(about.contains(&point), "{:?} is not in {:?}", point, about);
        }
    }
}
