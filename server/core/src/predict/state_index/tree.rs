//! An exact index of points that come and go one at a time: a k-d tree whose nodes know bounding boxes.
//!
//! Bentley, "Multidimensional binary search trees used for associative searching", 1975; bounding boxes make
//! pruning follow the data's own dimension instead of the space's, which for scene indicators is low. A
//! subtree that grew lopsided is rebuilt (Galperin and Rivest, "Scapegoat trees", 1993), so that depth stays
//! logarithmic whatever order points come in. Distances are weighted axis by axis at the time of the
//! question: weights may change without a new tree. A point that is taken out leaves the boxes as they are;
//! what holds no point any more is not looked at.

/// A leaf is split when it holds more points than this.
const LEAF_MAX: usize = 24;
/// No child holds more than this share of its parent's points (and one leaf).
const SHARE_MAX: f64 = 0.7;

/// The tree. Points are numbered in the order in which they came; one that was taken out leaves its number.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct KdTree {
    width: usize,
    /// Coordinates of point `i` at `i * width`.
    points: Vec<f64>,
    /// The caller's name of point `i`.
    names: Vec<u32>,
    /// The numbers of points that were taken out, for those that come.
    vacant: Vec<u32>,
    nodes: Vec<TreeNode>,
    /// Least and greatest coordinates of node `i` at `2 * i * width`.
    boxes: Vec<f64>,
    free: Vec<u32>,
}

#[derive(Clone, Debug, PartialEq)]
struct TreeNode {
    count: u32,
    /// The number of its points when it was built, less those that were taken out since.
    built: u32,
    kind: NodeKind,
}

#[derive(Clone, Debug, PartialEq)]
enum NodeKind {
    Leaf(Vec<u32>),
    Branch { axis: u32, cut: f64, below: u32, above: u32 },
}

/// A point that was found: its name, and the square of its weighted distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct IndexEntry {
    pub(crate) name: u32,
    pub(crate) distance_2: f64,
}

impl IndexEntry {
    fn comes_before(&self, other: &IndexEntry) -> bool {
        (self.distance_2, self.name) < (other.distance_2, other.name)
    }
}

impl KdTree {
    /// An empty tree for points of `width` coordinates.
    pub(super) fn new(width: usize) -> Self {
        let root = TreeNode { count: 0, built: 0, kind: NodeKind::Leaf(Vec::new()) };
        let mut tree = KdTree {
            width,
            points: vec![],
            names: vec![],
            vacant: vec![],
            nodes: vec![root],
            boxes: vec![],
            free: vec![],
        };
        tree.boxes.extend(tree.empty_box());
        tree
    }

    /// The number of points.
    fn len(&self) -> usize {
        self.names.len() - self.vacant.len()
    }

    /// Adds a point of finite coordinates.
    pub(super) fn insert(&mut self, name: u32, point: &[f64]) {
        assert_eq!(point.len(), self.width, "a point of other coordinates");
        let slot = self.place(name, point);
        let (mut node, mut lopsided) = (0usize, None);
        loop {
            self.widen(node, slot);
            self.nodes[node].count += 1;
            let NodeKind::Branch { axis, cut, below, above } = self.nodes[node].kind else { break };
            let next = if point[axis as usize] < cut { below } else { above } as usize;
            let TreeNode { count, built, .. } = self.nodes[node];
            let most = SHARE_MAX * f64::from(count) + LEAF_MAX as f64;
            // Points that coincide stay together, so another build may part them no better than the last one.
            let has_grown = count >= built + built / 2;
            if lopsided.is_none() && has_grown && f64::from(self.nodes[next].count) > most {
                lopsided = Some(node);
            }
            node = next;
        }
        let NodeKind::Leaf(slots) = &mut self.nodes[node].kind else { return };
        slots.push(slot);
        let full = slots.len() > LEAF_MAX && self.has_extent(node);
        if let Some(root) = lopsided.or(full.then_some(node)) {
            let slots = self.dissolve(root);
            self.build(root, slots);
        }
        assert_eq!(self.nodes[0].count as usize, self.len(), "the root holds all points");
    }

    /// Gives a point its number.
    fn place(&mut self, name: u32, point: &[f64]) -> u32 {
        let Some(slot) = self.vacant.pop() else {
            self.points.extend_from_slice(point);
            self.names.push(name);
            return self.names.len() as u32 - 1;
        };
        let from = slot as usize * self.width;
        self.points[from..from + self.width].copy_from_slice(point);
        self.names[slot as usize] = name;
        slot
    }

    /// Takes out the point that was added by that name.
    pub(super) fn remove(&mut self, name: u32, point: &[f64]) {
        let mut node = 0usize;
        loop {
            let TreeNode { count, built, .. } = &mut self.nodes[node];
            assert!(*count > 0, "{name} is not there");
            // Points that come in the place of others make a tree as lopsided as further ones.
            (*count, *built) = (*count - 1, built.saturating_sub(1));
            let NodeKind::Branch { axis, cut, below, above } = self.nodes[node].kind else { break };
            node = if point[axis as usize] < cut { below } else { above } as usize;
        }
        let NodeKind::Leaf(slots) = &mut self.nodes[node].kind else { return };
        let at = slots.iter().position(|&slot| self.names[slot as usize] == name);
        assert!(at.is_some(), "{name} is not where its coordinates are");
        self.vacant.extend(at.map(|at| slots.swap_remove(at)));
        if self.nodes[0].count == 0 {
            // Where points come and go, the shape of those that are gone is of no use.
            *self = KdTree::new(self.width);
        }
        assert_eq!(self.nodes[0].count as usize, self.len(), "the root holds all points");
    }

    /// The `count` points nearest to `state`, nearest first, the first named first among equals. `further`
    /// gives what is added to the square of a point's distance, at least 0, and `None` for points to leave
    /// out.
    pub(super) fn nearest(
        &self,
        state: &[f64],
        weights: &[f64],
        count: usize,
        further: &mut dyn FnMut(u32) -> Option<f64>,
    ) -> Vec<IndexEntry> {
        let mut found: Vec<IndexEntry> = Vec::with_capacity(count + 1);
        let mut open: Vec<(f64, u32)> = vec![(0.0, 0)];
        while let Some((least, node)) = open.pop() {
            let limit = if found.len() < count { f64::INFINITY } else { found[count - 1].distance_2 };
            if least > limit || count == 0 {
                continue;
            }
            match &self.nodes[node as usize].kind {
                NodeKind::Branch { below, above, .. } => {
                    let (a, b) = (self.gap_2(*below, state, weights), self.gap_2(*above, state, weights));
                    // The nearer child is left on top.
                    let pair = if a <= b { [(b, *above), (a, *below)] } else { [(a, *below), (b, *above)] };
                    open.extend(pair.into_iter().filter(|&(_, child)| self.nodes[child as usize].count > 0));
                }
                NodeKind::Leaf(slots) => {
                    for &slot in slots {
                        let limit =
                            if found.len() < count { f64::INFINITY } else { found[count - 1].distance_2 };
                        let Some(distance_2) = distance_2(self.point(slot), state, weights, limit) else {
                            continue;
                        };
                        let name = self.names[slot as usize];
                        let new = IndexEntry { name, distance_2 };
                        if found.partition_point(|other| other.comes_before(&new)) == count {
                            continue;
                        }
                        let Some(further) = further(name) else { continue };
                        debug_assert!(further >= 0.0, "{further} further away");
                        let new = IndexEntry { name, distance_2: distance_2 + further };
                        let place = found.partition_point(|other| other.comes_before(&new));
                        if place < count {
                            found.insert(place, new);
                            found.truncate(count);
                        }
                    }
                }
            }
        }
        debug_assert!(found.windows(2).all(|pair| !pair[1].comes_before(&pair[0])), "nearest first");
        found
    }

    /// The nearest point of which no coordinate is further from `state` than `tolerance`, the first named
    /// among equals.
    pub(super) fn within(&self, state: &[f64], tolerance: f64) -> Option<IndexEntry> {
        let mut best: Option<IndexEntry> = None;
        let mut open = vec![0u32];
        while let Some(node) = open.pop() {
            let bounds = self.bounds(node);
            let (low, high) = bounds.split_at(self.width);
            // As differences are computed below, so that rounding cannot hide a point.
            let outside =
                |axis: usize| low[axis] - state[axis] > tolerance || state[axis] - high[axis] > tolerance;
            if (0..self.width).any(outside) {
                continue;
            }
            match &self.nodes[node as usize].kind {
                NodeKind::Branch { below, above, .. } => open.extend([*above, *below]),
                NodeKind::Leaf(slots) => {
                    for &slot in slots {
                        let Some(distance_2) = match_distance_2(self.point(slot), state, tolerance) else {
                            continue;
                        };
                        let new = IndexEntry { name: self.names[slot as usize], distance_2 };
                        if best.is_none_or(|best| new.comes_before(&best)) {
                            best = Some(new);
                        }
                    }
                }
            }
        }
        best
    }

    fn point(&self, slot: u32) -> &[f64] {
        &self.points[slot as usize * self.width..(slot as usize + 1) * self.width]
    }

    fn bounds(&self, node: u32) -> &[f64] {
        &self.boxes[node as usize * 2 * self.width..(node as usize + 1) * 2 * self.width]
    }

    fn empty_box(&self) -> Vec<f64> {
        [vec![f64::INFINITY; self.width], vec![f64::NEG_INFINITY; self.width]].concat()
    }

    fn widen(&mut self, node: usize, slot: u32) {
        let (width, from) = (self.width, 2 * node * self.width);
        for axis in 0..width {
            let x = self.points[slot as usize * width + axis];
            let (low, high) = (from + axis, from + width + axis);
            self.boxes[low] = self.boxes[low].min(x);
            self.boxes[high] = self.boxes[high].max(x);
        }
    }

    /// Whether the points of a node differ. Those that all coincide cannot be split.
    fn has_extent(&self, node: usize) -> bool {
        let (low, high) = self.bounds(node as u32).split_at(self.width);
        low.iter().zip(high).any(|(low, high)| low < high)
    }

    /// The square of the weighted distance from `state` to a node's box.
    fn gap_2(&self, node: u32, state: &[f64], weights: &[f64]) -> f64 {
        let (low, high) = self.bounds(node).split_at(self.width);
        let gaps = state.iter().zip(weights).zip(low.iter().zip(high)).map(|((x, weight), (low, high))| {
            let gap = (low - x).max(x - high).max(0.0);
            weight * (gap * gap)
        });
        gaps.sum()
    }

    /// Takes a subtree apart, but for its root, and gives its points.
    fn dissolve(&mut self, root: usize) -> Vec<u32> {
        let (mut slots, mut open) = (Vec::with_capacity(self.nodes[root].count as usize), vec![root as u32]);
        while let Some(node) = open.pop() {
            let kind = std::mem::replace(&mut self.nodes[node as usize].kind, NodeKind::Leaf(Vec::new()));
            match kind {
                NodeKind::Leaf(points) => slots.extend(points),
                NodeKind::Branch { below, above, .. } => {
                    open.extend([above, below]);
                    self.free.extend([above, below]);
                }
            }
        }
        assert_eq!(slots.len(), self.nodes[root].count as usize, "the points of a subtree");
        slots
    }

    /// Builds a balanced subtree at `root`.
    fn build(&mut self, root: usize, slots: Vec<u32>) {
        let mut open = vec![(root, slots)];
        while let Some((node, mut slots)) = open.pop() {
            let from = 2 * node * self.width;
            let empty = self.empty_box();
            self.boxes[from..from + empty.len()].copy_from_slice(&empty);
            slots.iter().for_each(|&slot| self.widen(node, slot));
            (self.nodes[node].count, self.nodes[node].built) = (slots.len() as u32, slots.len() as u32);
            let spread = |axis: usize| self.boxes[from + self.width + axis] - self.boxes[from + axis];
            let widest = (0..self.width).max_by(|&a, &b| spread(a).total_cmp(&spread(b)).then(b.cmp(&a)));
            let axis = match widest {
                Some(axis) if slots.len() > LEAF_MAX && spread(axis) > 0.0 => axis,
                // Points that all coincide stay together, however many.
                _ => {
                    self.nodes[node].kind = NodeKind::Leaf(slots);
                    continue;
                }
            };
            let x = |slot: &u32| self.points[*slot as usize * self.width + axis];
            let middle = slots.len() / 2;
            let (_, &mut at, _) =
                slots.select_nth_unstable_by(middle, |a, b| x(a).total_cmp(&x(b)).then(a.cmp(b)));
            let mut cut = x(&at);
            // Points at the cut go above; below must not stay empty.
            if !slots.iter().any(|slot| x(slot) < cut) {
                cut = slots.iter().map(x).filter(|x| *x > cut).fold(f64::INFINITY, f64::min);
            }
            let (low, high): (Vec<u32>, Vec<u32>) = slots.into_iter().partition(|slot| x(slot) < cut);
            assert!(!low.is_empty() && !high.is_empty(), "a cut at {cut} parts nothing");
            let (below, above) = (self.allocate(), self.allocate());
            self.nodes[node].kind = NodeKind::Branch { axis: axis as u32, cut, below, above };
            open.extend([(below as usize, low), (above as usize, high)]);
        }
    }

    fn allocate(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.nodes.push(TreeNode { count: 0, built: 0, kind: NodeKind::Leaf(Vec::new()) });
            let empty = self.empty_box();
            self.boxes.extend(empty);
            assert_eq!(self.boxes.len(), 2 * self.width * self.nodes.len(), "a box for every node");
            self.nodes.len() as u32 - 1
        })
    }
}

/// The square of the weighted distance, or `None` as soon as it must exceed `limit`.
fn distance_2(a: &[f64], b: &[f64], weights: &[f64], limit: f64) -> Option<f64> {
    debug_assert!(a.len() == b.len() && a.len() == weights.len(), "points of one space");
    let mut sum = 0.0;
    for ((a, b), weight) in a.iter().zip(b).zip(weights) {
        sum += weight * ((a - b) * (a - b));
        if sum > limit {
            return None;
        }
    }
    Some(sum)
}

/// The square of the Euclidean distance if every coordinate is within the tolerance.
pub(crate) fn match_distance_2(anchor: &[f64], state: &[f64], tolerance: f64) -> Option<f64> {
    debug_assert_eq!(anchor.len(), state.len(), "points of one space");
    let mut sum = 0.0;
    for (a, b) in anchor.iter().zip(state) {
        let difference = (a - b).abs();
        if difference > tolerance {
            return None;
        }
        sum += difference * difference;
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The answer that a tree must give, found by looking at every point.
    fn nearest(
        points: &[Vec<f64>],
        state: &[f64],
        weights: &[f64],
        count: usize,
        further: impl Fn(u32) -> Option<f64>,
    ) -> Vec<IndexEntry> {
        let all = points.iter().enumerate().filter_map(|(index, point)| {
            let distance_2 = distance_2(point, state, weights, f64::INFINITY)?;
            Some(IndexEntry { name: index as u32, distance_2: distance_2 + further(index as u32)? })
        });
        let mut all: Vec<IndexEntry> = all.collect();
        all.sort_by(|a, b| a.distance_2.total_cmp(&b.distance_2).then(a.name.cmp(&b.name)));
        all.truncate(count);
        all
    }

    fn within(points: &[Vec<f64>], state: &[f64], tolerance: f64) -> Option<IndexEntry> {
        let mut best: Option<IndexEntry> = None;
        for (index, point) in points.iter().enumerate() {
            if let Some(distance_2) = match_distance_2(point, state, tolerance)
                && best.is_none_or(|best| distance_2 < best.distance_2)
            {
                best = Some(IndexEntry { name: index as u32, distance_2 });
            }
        }
        best
    }

    fn depth(tree: &KdTree, node: u32) -> usize {
        match tree.nodes[node as usize].kind {
            NodeKind::Leaf(_) => 1,
            NodeKind::Branch { below, above, .. } => 1 + depth(tree, below).max(depth(tree, above)),
        }
    }

    #[test]
    fn points_in_rising_order_make_no_deep_tree() {
        let mut tree = KdTree::new(1);
        (0..20_000u32).for_each(|index| tree.insert(index, &[f64::from(index)]));
        assert!(depth(&tree, 0) < 30, "{}", depth(&tree, 0));
        assert_eq!(tree.names.len(), 20_000);
        assert_eq!(tree.nearest(&[777.2], &[1.0], 1, &mut |_| Some(0.0))[0].name, 777);
    }

    #[test]
    fn points_that_coincide_are_not_taken_apart_again_and_again() {
        // Taken apart for each point they would take minutes.
        let many = 200_000;
        for width in [0, 1] {
            let mut tree = KdTree::new(width);
            (0..many).for_each(|index| tree.insert(index, &vec![0.5; width]));
            assert_eq!(tree.nodes.len(), 1);
            let at = vec![0.5; width];
            assert_eq!(tree.within(&at, 0.0), Some(IndexEntry { name: 0, distance_2: 0.0 }));
            assert_eq!(tree.nearest(&at, &vec![1.0; width], 2, &mut |_| Some(0.0)).len(), 2);
        }
        // Beside others on both sides, which are still found.
        let mut tree = KdTree::new(1);
        (0..100).for_each(|index| tree.insert(index, &[f64::from(index)]));
        (100..many).for_each(|index| tree.insert(index, &[49.5]));
        (0..100).for_each(|index| tree.insert(many + index, &[f64::from(index) + 0.25]));
        assert!(depth(&tree, 0) < 30, "{}", depth(&tree, 0));
        assert_eq!(tree.nearest(&[70.2], &[1.0], 1, &mut |_| Some(0.0))[0].name, many + 70);
        assert_eq!(tree.within(&[49.5], 0.1).map(|found| found.name), Some(100));
    }

    #[test]
    fn points_that_come_in_the_place_of_others_make_no_deep_tree() {
        let mut tree = KdTree::new(1);
        for index in 0..20_000_u32 {
            tree.insert(index, &[f64::from(index)]);
            if let Some(oldest) = index.checked_sub(100) {
                tree.remove(oldest, &[f64::from(oldest)]);
            }
        }
        assert!(tree.len() == 100 && tree.names.len() == 101, "{} numbers", tree.names.len());
        assert!(depth(&tree, 0) < 30, "{}", depth(&tree, 0));
        assert_eq!(tree.nearest(&[77.2], &[1.0], 1, &mut |_| Some(0.0))[0].name, 19_900);
    }

    proptest! {
        #![proptest_config(crate::testing::cases(96))]

        #[test]
        fn points_that_were_taken_out_are_not_found_until_they_come_back(
            width in 1usize..4, grid in 1u32..9, seed in any::<u64>(), points in 1usize..200,
            steps in 1usize..800,
        ) {
            use rand::{RngExt, SeedableRng};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut coordinate = |_: usize| f64::from(random.random_range(0..=grid)) / f64::from(grid);
            let all: Vec<Vec<f64>> = (0..points).map(|_| (0..width).map(&mut coordinate).collect()).collect();
            let state: Vec<f64> = (0..width).map(&mut coordinate).collect();
            let (mut tree, mut held) = (KdTree::new(width), vec![false; points]);
            for _ in 0..steps {
                let place = random.random_range(0..points);
                match held[place] {
                    true => tree.remove(place as u32, &all[place]),
                    false => tree.insert(place as u32, &all[place]),
                }
                held[place] = !held[place];
            }
            let weights = vec![1.0; width];
            let mut looked_at = 0;
            let mut further = |_: u32| {
                looked_at += 1;
                Some(0.0)
            };
            let found = tree.nearest(&state, &weights, 7, &mut further);
            let is_there = |name: u32| held[name as usize].then_some(0.0);
            prop_assert_eq!(found, nearest(&all, &state, &weights, 7, is_there));
            let there = held.iter().filter(|held| **held).count();
            prop_assert!(looked_at <= there && tree.len() == there);
            prop_assert!(tree.names.len() <= points, "numbers are used again");
        }

        #[test]
        fn answers_are_those_of_looking_at_every_point(
            width in 1usize..6, count in 1usize..9, grid in 1u32..9, seed in any::<u64>(), points in 1usize..400,
            far in any::<bool>(), dropped in any::<bool>(), tolerance in 0.0f64..0.4,
        ) {
            use rand::{RngExt, SeedableRng};
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            // A coarse grid gives many equal distances and points that coincide.
            let mut coordinate = |_: usize| f64::from(random.random_range(0..=grid)) / f64::from(grid);
            let mut all: Vec<Vec<f64>> = (0..points).map(|_| (0..width).map(&mut coordinate).collect()).collect();
            let state: Vec<f64> = (0..width).map(&mut coordinate).collect();
            if far {
                all.iter_mut().step_by(7).for_each(|point| point[0] = 1e9 * (point[0] - 0.5));
            }
            let mut weights: Vec<f64> = (0..width).map(|axis| 1.0 / (1 + axis) as f64).collect();
            if dropped {
                weights[0] = 0.0;
            }
            let mut tree = KdTree::new(width);
            for (index, point) in all.iter().enumerate() {
                tree.insert(index as u32, point);
            }
            let further = |name: u32| (name % 5 != 4).then(|| 0.01 * f64::from(name % 3));
            for further in [&further as &dyn Fn(u32) -> Option<f64>, &|_| Some(0.0)] {
                let found = tree.nearest(&state, &weights, count, &mut |name| further(name));
                prop_assert_eq!(found, nearest(&all, &state, &weights, count, further));
            }
            prop_assert_eq!(tree.within(&state, tolerance), within(&all, &state, tolerance));
        }
    }
}
