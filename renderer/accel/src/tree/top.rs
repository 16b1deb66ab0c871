//! The upper level of two: a tree over boxes, one box a leaf.
//!
//! Built by the binned surface area heuristic (Wald, "On fast Construction of SAH-based Bounding Volume
//! Hierarchies", 2007), two splits to a node of four children. Walked like the lower level: nearest child
//! first, with everything behind the best hit left out. What lies in a leaf costs a walk of its own, so no
//! two share one. Four lanes of plain vectors serve every machine: a ray spends its time below.

use glam::{Affine3A, BVec4A, Vec3, Vec3A, Vec4};

use crate::geometry::Ray;
use crate::layout::Bounds;
use crate::limits::INSTANCES_MAX;

/// Bins an axis.
const BINS: usize = 16;

/// Depth at which the heuristic stops and sets are halved, so that the deepest tree is known.
const HEURISTIC_DEPTH: usize = 32;

/// Most levels: below the heuristic's each quarters its set, or leaves its quarters one apart.
const DEPTH_MAX: usize = HEURISTIC_DEPTH + INSTANCES_MAX.ilog2() as usize / 2 + 2;

/// Most entries on the stack of a walk: three a level stay behind.
const STACK: usize = 3 * DEPTH_MAX + 1;

/// Marks a child that is a box's number rather than a node's.
const LEAF: u32 = 1 << 31;

const _: () = assert!(INSTANCES_MAX < LEAF as usize);

/// Four boxes. Unused places have inverted ones, which no ray meets.
#[derive(Clone, Copy, Debug)]
struct Four {
    /// By axis.
    lower: [Vec4; 3],
    upper: [Vec4; 3],
    children: [u32; 4],
}

impl Four {
    const EMPTY: Self =
        Self { lower: [Vec4::INFINITY; 3], upper: [Vec4::NEG_INFINITY; 3], children: [LEAF; 4] };

    fn bounds(&self, child: usize) -> Bounds {
        Bounds {
            lower: [0, 1, 2].map(|axis| self.lower[axis][child]),
            upper: [0, 1, 2].map(|axis| self.upper[axis][child]),
        }
    }
}

/// A tree over numbered boxes.
#[derive(Clone, Debug)]
pub(crate) struct Top {
    /// Children come after their parents; the first is the root. None over no box.
    nodes: Vec<Four>,
}

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

impl Top {
    /// Builds over numbered boxes; empty ones are left out.
    ///
    /// # Panics
    /// On more boxes than [`INSTANCES_MAX`].
    pub(crate) fn build(boxes: impl Iterator<Item = (u32, Bounds)>) -> Self {
        let mut items: Vec<Item> = boxes
            .filter(|(_, bounds)| bounds.lower[0] <= bounds.upper[0])
            .map(|(number, bounds)| Item {
                lower: Vec3A::from_array(bounds.lower),
                upper: Vec3A::from_array(bounds.upper),
                number,
            })
            .collect();
        assert!(items.len() <= INSTANCES_MAX, "the number of instances is limited");
        let mut top = Self { nodes: Vec::with_capacity(items.len() / 2 + 1) };
        if !items.is_empty() {
            top.grow(&mut items, 0);
        }
        top
    }

    /// Adds the node over a set, its subtrees after it, and returns its number.
    fn grow(&mut self, items: &mut [Item], depth: usize) -> u32 {
        let number = self.nodes.len();
        self.nodes.push(Four::EMPTY);
        let mut sets: Vec<&mut [Item]> = vec![items];
        while sets.len() < 4 {
            // Near the end of the heuristic what counts is that sets become small.
            let area = |set: &[Item]| if depth < HEURISTIC_DEPTH { Around::of(set).half_area() } else { 0.0 };
            let Some((widest, ..)) = (sets.iter().enumerate())
                .filter(|(_, set)| set.len() > 1)
                .map(|(place, set)| (place, area(set), set.len()))
                .max_by(|a, b| a.1.total_cmp(&b.1).then(a.2.cmp(&b.2)))
            else {
                break;
            };
            let set = sets.swap_remove(widest);
            let middle = if depth < HEURISTIC_DEPTH { partition(set) } else { set.len() / 2 };
            let (left, right) = set.split_at_mut(middle);
            sets.extend([left, right]);
        }
        for (child, set) in sets.into_iter().enumerate() {
            let around = Around::of(set);
            for axis in 0..3 {
                self.nodes[number].lower[axis][child] = around.lower[axis];
                self.nodes[number].upper[axis][child] = around.upper[axis];
            }
            let below = match set {
                [item] => LEAF | item.number,
                _ => self.grow(set, depth + 1),
            };
            self.nodes[number].children[child] = below;
        }
        number as u32
    }

    /// Bytes of its nodes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..])
    }

    /// The box around everything.
    pub(crate) fn bounds(&self) -> Bounds {
        let Some(root) = self.nodes.first() else {
            return Bounds::EMPTY;
        };
        (0..4).map(|child| root.bounds(child)).fold(Bounds::EMPTY, Bounds::union)
    }

    /// Calls `visit` for every child in use with its depth, its box, and the number of a leaf's box.
    pub(crate) fn walk(&self, visit: &mut impl FnMut(u32, Bounds, Option<u32>)) {
        let mut stack = vec![(0u32, 0u32)];
        while let Some((number, depth)) = stack.pop() {
            let Some(node) = self.nodes.get(number as usize) else {
                return;
            };
            for child in (0..4).filter(|&child| node.lower[0][child] <= node.upper[0][child]) {
                let below = node.children[child];
                let leaf = (below & LEAF != 0).then_some(below & !LEAF);
                visit(depth + 1, node.bounds(child), leaf);
                if leaf.is_none() {
                    stack.push((below, depth + 1));
                }
            }
        }
    }

    /// Calls `meet` for the boxes a ray meets before the end of its segment, roughly in order; `meet` returns
    /// the new end, and boxes that begin behind it are passed by. An end of minus infinity ends the walk.
    #[inline]
    pub(crate) fn meet(&self, ray: &Ray, mut meet: impl FnMut(u32, f32) -> f32) {
        if self.nodes.is_empty() {
            return;
        }
        let slabs = Slabs::new(ray);
        let mut t_max = ray.t_max;
        let mut stack = [(0u32, 0.0f32); STACK];
        let mut top = 1;
        stack[0] = (0, ray.t_min);
        while top > 0 {
            top -= 1;
            let (child, t) = stack[top];
            if t > t_max {
                continue;
            }
            if child & LEAF != 0 {
                t_max = meet(child & !LEAF, t_max);
                continue;
            }
            let node = &self.nodes[child as usize];
            let (met, times) = slabs.test(node, t_max);
            let bottom = top;
            let mut left = met.bitmask();
            while left != 0 {
                let child = left.trailing_zeros() as usize;
                left &= left - 1;
                // Farthest first, so that the nearest is taken up next. There are at most four.
                let entry = (node.children[child], times[child]);
                let mut place = top;
                while place > bottom && stack[place - 1].1 < entry.1 {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = entry;
                top += 1;
            }
        }
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

/// A ray prepared for tests against four boxes: the slab test of Kay and Kajiya (1986), with planes moved
/// apart and far distances rounded up so that no rounding loses a box (Ize, "Robust BVH Ray Traversal", 2013).
struct Slabs {
    reciprocal: Vec3,
    near_origin: Vec3,
    far_origin: Vec3,
    t_min: f32,
}

/// Divisors are at least so large: products with coordinates stay finite.
const DIVISOR_MIN: f32 = 1e-18;

impl Slabs {
    #[inline]
    fn new(ray: &Ray) -> Self {
        let safe = |component: f32| 1.0 / if component.abs() < DIVISOR_MIN { DIVISOR_MIN } else { component };
        let reciprocal = Vec3::new(safe(ray.direction.x), safe(ray.direction.y), safe(ray.direction.z));
        // The difference of plane and origin errs by half a unit of the larger; the boxes hold their own slack.
        let pad = ray.origin.abs() * (2.0 * f32::EPSILON);
        let towards = pad.copysign(reciprocal);
        Self {
            reciprocal,
            near_origin: ray.origin + towards,
            far_origin: ray.origin - towards,
            t_min: ray.t_min,
        }
    }

    /// Which boxes begin before `t_max`, and where.
    #[inline]
    fn test(&self, node: &Four, t_max: f32) -> (BVec4A, Vec4) {
        let (mut near, mut far) = (Vec4::splat(self.t_min), Vec4::splat(t_max));
        for axis in 0..3 {
            let (mut enter, mut leave) = (node.lower[axis], node.upper[axis]);
            if self.reciprocal[axis] < 0.0 {
                std::mem::swap(&mut enter, &mut leave);
            }
            let enter =
                (enter - self.near_origin[axis]) * (self.reciprocal[axis] * (1.0 - 2.0 * f32::EPSILON));
            let leave =
                (leave - self.far_origin[axis]) * (self.reciprocal[axis] * (1.0 + 2.0 * f32::EPSILON));
            near = near.max(enter);
            far = far.min(leave);
        }
        (near.cmple(far), near)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn boxes(count: usize, size: f32) -> impl Strategy<Value = Vec<Bounds>> {
        let one = (prop::array::uniform3(-10.0f32..10.0), prop::array::uniform3(0.0f32..1.0)).prop_map(
            move |(lower, extent)| Bounds {
                lower,
                upper: [0, 1, 2].map(|axis| lower[axis] + extent[axis] * size),
            },
        );
        prop::collection::vec(one, 0..count)
    }

    fn build(boxes: &[Bounds]) -> Top {
        Top::build(boxes.iter().enumerate().map(|(number, bounds)| (number as u32, *bounds)))
    }

    /// Depth, after checking that every box is found once, inside all boxes above it.
    fn check(top: &Top, boxes: &[Bounds]) -> u32 {
        let (mut seen, mut deepest) = (vec![0; boxes.len()], 0);
        let whole = top.bounds();
        top.walk(&mut |depth, bounds, leaf| {
            deepest = deepest.max(depth);
            assert!(whole.contains(&bounds));
            if let Some(number) = leaf {
                seen[number as usize] += 1;
                assert_eq!(bounds, boxes[number as usize]);
            }
        });
        let expected: Vec<i32> =
            boxes.iter().map(|bounds| i32::from(bounds.lower[0] <= bounds.upper[0])).collect();
        assert_eq!(seen, expected);
        deepest
    }

    #[test]
    fn equal_boxes_are_halved() {
        let same = vec![Bounds { lower: [0.0; 3], upper: [1.0; 3] }; 1000];
        assert_eq!(check(&build(&same), &same), 5);
        assert_eq!(check(&build(&[]), &[]), 0);
        let one = [Bounds { lower: [1.0; 3], upper: [1.0; 3] }, Bounds::EMPTY];
        assert_eq!(check(&build(&one), &one), 1);
    }

    #[test]
    fn a_lopsided_set_stays_within_the_stack() {
        // Each box is far bigger than all before it together: the heuristic peels off one at a time.
        let nested: Vec<Bounds> = (0..120)
            .map(|step| {
                let size = 2f32.powi(step - 70);
                Bounds { lower: [size; 3], upper: [1.5 * size; 3] }
            })
            .collect();
        let deepest = check(&build(&nested), &nested);
        assert!(deepest as usize <= DEPTH_MAX, "{deepest}");
    }

    proptest! {
        #[test]
        fn a_ray_meets_every_box_on_its_way(
            boxes in boxes(60, 4.0),
            origin in prop::array::uniform3(-12.0f32..12.0),
            target in prop::array::uniform3(-12.0f32..12.0),
        ) {
            let top = build(&boxes);
            check(&top, &boxes);
            let (origin, target) = (Vec3::from_array(origin), Vec3::from_array(target));
            let ray = Ray { origin, direction: target - origin, t_min: 0.0, t_max: 1.0 };
            let mut met = vec![false; boxes.len()];
            top.meet(&ray, |number, t_max| {
                met[number as usize] = true;
                t_max
            });
            for (bounds, met) in boxes.iter().zip(met) {
                // Points of the segment, in double precision.
                let inside = (0..=400).any(|step| {
                    let at = origin.as_dvec3().lerp(target.as_dvec3(), f64::from(step) / 400.0);
                    (0..3).all(|axis| f64::from(bounds.lower[axis]) <= at[axis] && at[axis] <= f64::from(bounds.upper[axis]))
                });
                prop_assert!(met || !inside);
            }
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
