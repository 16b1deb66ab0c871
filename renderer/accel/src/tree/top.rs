//! A binary tree over boxes, top down, for the upper level of two.
//!
//! Built by the binned surface area heuristic (Wald, "On fast Construction of SAH-based Bounding Volume
//! Hierarchies", 2007). It is then optimised and collapsed as trees over triangles are.

use glam::{Affine3A, Vec3A};

use super::binary::{BinaryTree, Opened, Subtree};
use crate::layout::Bounds;

/// Bins an axis.
const BINS: usize = 16;

/// Depth at which the heuristic stops and sets are halved, so that the deepest tree is known.
const HEURISTIC_DEPTH: usize = 32;

/// A box around `bounds` after `by`, rounded outwards: the box of the box (Arvo, "Transforming axis-aligned
/// bounding boxes", 1990).
pub(crate) fn transformed(bounds: &Bounds, by: &Affine3A) -> Bounds {
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

/// A box under construction.
#[derive(Clone, Copy)]
struct Item {
    lower: Vec3A,
    upper: Vec3A,
    number: u32,
}

impl Item {
    fn center(&self) -> Vec3A {
        self.lower * 0.5 + self.upper * 0.5
    }
}

/// A box in registers.
#[derive(Clone, Copy)]
struct Around {
    lower: Vec3A,
    upper: Vec3A,
}

impl Around {
    const NOTHING: Self = Self { lower: Vec3A::INFINITY, upper: Vec3A::NEG_INFINITY };

    fn with(self, lower: Vec3A, upper: Vec3A) -> Self {
        Self { lower: self.lower.min(lower), upper: self.upper.max(upper) }
    }

    fn of(items: &[Item]) -> Self {
        items.iter().fold(Self::NOTHING, |around, item| around.with(item.lower, item.upper))
    }

    fn half_area(&self) -> f32 {
        let size = (self.upper - self.lower).max(Vec3A::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

/// A binary tree over at least one box, whose leaves are numbered like the boxes. As deep as the heuristic
/// may go and the halving of all boxes after it.
pub(super) fn binary_over(boxes: &[Bounds]) -> BinaryTree {
    let mut items: Vec<Item> = (0..)
        .zip(boxes)
        .map(|(number, bounds)| Item {
            lower: Vec3A::from_array(bounds.lower),
            upper: Vec3A::from_array(bounds.upper),
            number,
        })
        .collect();
    BinaryTree::of(Set { items: &mut items, depth: 0 })
}

/// Boxes that a subtree is made over.
struct Set<'a> {
    items: &'a mut [Item],
    /// Levels above it.
    depth: usize,
}

impl Subtree for Set<'_> {
    fn bounds(&self) -> Bounds {
        let around = Around::of(self.items);
        Bounds { lower: around.lower.to_array(), upper: around.upper.to_array() }
    }

    fn leaves(&self) -> u32 {
        self.items.len() as u32
    }

    fn open(self) -> Opened<Self> {
        let Self { items, depth } = self;
        if let [item] = items {
            return Opened::Leaf(item.number);
        }
        let middle = if depth < HEURISTIC_DEPTH { partition(items) } else { items.len() / 2 };
        let (left, right) = items.split_at_mut(middle);
        Opened::Node([left, right].map(|items| Self { items, depth: depth + 1 }))
    }
}

/// Orders a set of two or more so that what belongs to the left half comes first, and says where the right
/// half begins. Both get at least one.
fn partition(items: &mut [Item]) -> usize {
    let centers =
        items.iter().fold(Around::NOTHING, |around, item| around.with(item.center(), item.center()));
    let size = centers.upper - centers.lower;
    let scale = Vec3A::splat(BINS as f32 * 0.9999) / size;
    let bin = |item: &Item, axis: usize| {
        (((item.center()[axis] - centers.lower[axis]) * scale[axis]) as usize).min(BINS - 1)
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| size[axis] > 0.0 && scale[axis].is_finite()) {
        let mut bins = [(Around::NOTHING, 0usize); BINS];
        for item in &*items {
            let (around, count) = &mut bins[bin(item, axis)];
            *around = around.with(item.lower, item.upper);
            *count += 1;
        }
        let cost = |(around, count): &(Around, usize)| {
            if *count == 0 { 0.0 } else { around.half_area() * *count as f32 }
        };
        let join = |a: (Around, usize), b: &(Around, usize)| (a.0.with(b.0.lower, b.0.upper), a.1 + b.1);
        let mut right_costs = [0.0f32; BINS];
        let mut right = (Around::NOTHING, 0);
        for index in (1..BINS).rev() {
            right = join(right, &bins[index]);
            right_costs[index] = cost(&right);
        }
        let mut left = (Around::NOTHING, 0);
        for index in 1..BINS {
            left = join(left, &bins[index - 1]);
            let total = cost(&left) + right_costs[index];
            let divides = left.1 > 0 && left.1 < items.len();
            if divides && best.is_none_or(|(lowest, ..)| total < lowest) {
                best = Some((total, axis, index));
            }
        }
    }
    // All centers in one place: any halves are as good.
    let Some((_, axis, index)) = best else {
        return items.len() / 2;
    };
    let mut middle = 0;
    for item in 0..items.len() {
        if bin(&items[item], axis) < index {
            items.swap(middle, item);
            middle += 1;
        }
    }
    middle
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::super::binary::tests::{boxes, check};
    use super::*;

    /// Levels below the root.
    fn depth(tree: &BinaryTree) -> usize {
        let mut deepest = 0;
        let mut stack = vec![(0, 0)];
        while let Some((number, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            if let Some(first) = tree.nodes[number].first_child() {
                stack.extend([(first, depth + 1), (first + 1, depth + 1)]);
            }
        }
        deepest
    }

    #[test]
    fn equal_boxes_are_halved_and_lopsided_sets_stay_shallow() {
        let same = vec![Bounds { lower: [0.0; 3], upper: [1.0; 3] }; 1024];
        let tree = binary_over(&same);
        check(&tree, &same);
        assert_eq!(depth(&tree), 10);
        // Each box is far bigger than all before it together: the heuristic peels off one at a time.
        let nested: Vec<Bounds> = (0..120)
            .map(|step| {
                let size = 2f32.powi(step - 70);
                Bounds { lower: [size; 3], upper: [1.5 * size; 3] }
            })
            .collect();
        let tree = binary_over(&nested);
        check(&tree, &nested);
        assert!(depth(&tree) <= HEURISTIC_DEPTH + 7);
    }

    proptest! {
        #[test]
        fn every_box_is_found_once(boxes in boxes()) {
            check(&binary_over(&boxes), &boxes);
        }

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
