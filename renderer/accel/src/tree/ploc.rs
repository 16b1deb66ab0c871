//! Our own builder: a binary tree bottom up, from triangles along a space-filling curve.
//!
//! Parallel locally-ordered clustering (Meister and Bittner, 2018; Benthin et al., "PLOC++", 2022): each
//! cluster looks at a few neighbours along the curve, and pairs that choose each other are joined. Parts of
//! the curve hand up a handful of clusters to be joined with those beside them ("H-PLOC", 2024), so that a
//! thread works in its first cache. To save time, the lowest clusters are runs of the curve (`cluster_size`),
//! where least is lost.
//!
//! Equal inputs give equal trees with any number of threads and with every instruction set.

use super::binary::{BinaryTree, Opened, Subtree};
use super::clusters::{self, Cluster, ClusterLink, Clusters, LANES, Nearest, TRIANGLE};
use super::morton::{self, Key};
use crate::layout::{Bounds, WIDTH_MAX};
use crate::parameters::{Collapse, TreeParameters};
use crate::{geometry::Triangles, memory::wish_for_huge_pages, prefetch::prefetch};

/// Fewest triangles that are worth a task of their own.
const TRIANGLES_PER_TASK: usize = 4_096;
/// Triangles whose boxes are fetched ahead of their use: parts along the curve are anywhere in memory.
const FETCHED_AHEAD: usize = 64;

#[derive(Clone, Copy, Debug)]
struct Joined {
    bounds: Bounds,
    children: [ClusterLink; 2],
    triangles: u32,
    /// Whether its triangles are best tested as one leaf.
    is_leaf: bool,
    /// It is a leaf without halves, of triangles side by side on the curve from its first child's on.
    is_run: bool,
}

impl Joined {
    const UNUSED: Self = Self {
        bounds: Bounds::EMPTY,
        children: [ClusterLink(TRIANGLE); 2],
        triangles: 0,
        is_leaf: false,
        is_run: false,
    };
}

pub(super) struct Ploc {
    boxes: Vec<Bounds>,
    keys: Vec<Key>,
    nodes: Vec<Joined>,
    pub(super) root: ClusterLink,
}

/// The costs of leaves, as the collapse counts them.
#[derive(Clone, Copy)]
struct Costs {
    node: f32,
    block: f32,
    block_size: u32,
    min_leaf_size: u32,
    max_leaf_size: u32,
}

/// A build in progress. `P` less the radius clusters are looked at at most, a multiple of [`LANES`].
struct Builder<'a, const R: usize, const P: usize> {
    boxes: &'a [Bounds],
    costs: Costs,
    /// Triangles that are joined by the curve alone, and of how many the tree inside is not wanted.
    cluster_size: usize,
    run_size: usize,
    nearest: Nearest<P>,
}

impl<const R: usize, const P: usize> Builder<'_, R, P> {
    /// Most clusters of a part.
    const HANDED_UP: usize = (P - R) / 2;

    /// Adds the clusters of a part of the curve, which has the nodes from number `first` on to itself.
    fn part(&self, keys: &[Key], nodes: &mut [Joined], first: u32, clusters: &mut Clusters) {
        if keys.len() <= Self::HANDED_UP {
            self.begin(keys, nodes, (first, first), clusters);
            return;
        }
        let base = clusters.rest.len();
        let middle = Key::middle(keys);
        let (keys_left, keys_right) = keys.split_at(middle);
        let (nodes_left, nodes_right) = nodes.split_at_mut(middle);
        let first_right = first + middle as u32;
        if keys.len() > FETCHED_AHEAD {
            [keys_left, keys_right]
                .into_iter()
                .filter(|part| part.len() <= FETCHED_AHEAD)
                .flatten()
                .for_each(|key| prefetch(self.boxes, key.number() as usize));
        }
        if keys.len() < TRIANGLES_PER_TASK || keys_right.len() <= Self::HANDED_UP {
            self.part(keys_left, nodes_left, first, clusters);
            self.part(keys_right, nodes_right, first_right, clusters);
        } else {
            let mut right = Clusters::new();
            rayon::join(
                || self.part(keys_left, nodes_left, first, clusters),
                || self.part(keys_right, nodes_right, first_right, &mut right),
            );
            for (place, cluster) in right.rest.iter().enumerate() {
                clusters.push(&right.bounds(place), *cluster);
            }
        }
        self.join(clusters, base, Self::HANDED_UP, (nodes, first));
    }

    /// Adds a few triangles' first clusters, joined where the curve parts them. The nodes are those from
    /// number `first` on; `next` is the first triangle's number.
    fn begin(&self, keys: &[Key], nodes: &mut [Joined], (first, next): (u32, u32), clusters: &mut Clusters) {
        if let [key] = keys {
            let number = key.number();
            let bounds = &self.boxes[number as usize];
            let cost = self.costs.block * bounds.half_area() as f32;
            let link = ClusterLink(number | TRIANGLE);
            clusters.push(bounds, Cluster { link, free: next, triangles: 1, cost });
            return;
        }
        if self.cluster_size == 1 {
            let each = keys.iter().zip(next..);
            each.for_each(|(key, next)| {
                self.begin(std::slice::from_ref(key), nodes, (first, next), clusters)
            });
            return;
        }
        if keys.len() <= self.run_size {
            let boxes = keys.iter().map(|key| self.boxes[key.number() as usize]);
            let bounds = boxes.fold(Bounds::EMPTY, Bounds::union);
            let triangles = keys.len() as u32;
            let blocks = triangles.div_ceil(self.costs.block_size);
            let cost = self.costs.block * bounds.half_area() as f32 * blocks as f32;
            let children = [ClusterLink(next); 2];
            nodes[(next - first) as usize] =
                Joined { bounds, children, triangles, is_leaf: true, is_run: true };
            clusters.push(&bounds, Cluster { link: ClusterLink(next), free: next + 1, triangles, cost });
            return;
        }
        let middle = Key::middle(keys);
        self.begin(&keys[..middle], nodes, (first, next), clusters);
        self.begin(&keys[middle..], nodes, (first, next + middle as u32), clusters);
        if keys.len() <= self.cluster_size {
            let last = clusters.rest.len() - 1;
            self.join_two(clusters, last - 1, last, nodes, first);
            clusters.truncate(last);
        }
    }

    /// Joins the clusters from `base` on until there are at most `most`, as nodes from number `first` on.
    fn join(&self, clusters: &mut Clusters, base: usize, most: usize, (nodes, first): (&mut [Joined], u32)) {
        let mut best = [0; P];
        while clusters.rest.len() - base > most {
            // SAFETY: it was chosen for this processor.
            unsafe { (self.nearest)(clusters, base, &mut best) };
            let partner = |place: usize| place ^ (best[place] as usize & (P.next_power_of_two() - 1));
            let (mut count, before) = (0, clusters.rest.len() - base);
            for place in 0..before {
                let other = partner(place);
                let is_mutual = other < before && partner(other) == place;
                if is_mutual && other < place {
                    continue;
                }
                if is_mutual {
                    self.join_two(clusters, base + place, base + other, nodes, first);
                }
                clusters.move_to(base + count, base + place);
                count += 1;
            }
            clusters.truncate(base + count);
        }
    }

    /// Joins the cluster at `other`, which is to vanish, to that at `place`.
    fn join_two(
        &self,
        clusters: &mut Clusters,
        place: usize,
        other: usize,
        nodes: &mut [Joined],
        first: u32,
    ) {
        let bounds = clusters.bounds(place).union(clusters.bounds(other));
        let [one, two] = [clusters.rest[place], clusters.rest[other]];
        let triangles = one.triangles + two.triangles;
        let Costs { node, block, block_size, min_leaf_size, max_leaf_size } = self.costs;
        let area = bounds.half_area() as f32;
        let apart = node * area + one.cost + two.cost;
        let together = block * area * triangles.div_ceil(block_size) as f32;
        let is_leaf = triangles <= min_leaf_size || (triangles <= max_leaf_size && together <= apart);
        nodes[(one.free - first) as usize] =
            Joined { bounds, children: [one.link, two.link], triangles, is_leaf, is_run: false };
        clusters.set(place, &bounds);
        let cost = if is_leaf { together } else { apart };
        clusters.rest[place] = Cluster { link: ClusterLink(one.free), free: two.free, triangles, cost };
    }
}

fn build<const R: usize, const P: usize>(
    boxes: &[Bounds],
    keys: &[Key],
    (costs, cluster_size, run_size): (Costs, usize, usize),
    nodes: &mut [Joined],
) -> ClusterLink {
    const { assert!((P - R).is_multiple_of(LANES)) };
    let nearest = clusters::select::<R, P>();
    let builder = Builder::<'_, R, P> { boxes, costs, cluster_size, run_size, nearest };
    let mut clusters = Clusters::new();
    builder.part(keys, nodes, 0, &mut clusters);
    builder.join(&mut clusters, 0, 1, (nodes, 0));
    clusters.rest[0].link
}

impl Ploc {
    /// Builds over at least one triangle.
    pub(super) fn build(triangles: &Triangles, parameters: &TreeParameters) -> Self {
        let (boxes, around) = morton::boxes(triangles);
        let keys = morton::sorted(&boxes, &around);
        let costs = Costs {
            // A wide node stands for as many joined pairs as it has children, less one.
            node: parameters.traversal_cost / (parameters.branching_factor - 1) as f32,
            block: parameters.intersection_cost,
            block_size: parameters.sah_block_size,
            min_leaf_size: parameters.min_leaf_size,
            max_leaf_size: parameters.max_leaf_size,
        };
        let mut nodes = Vec::with_capacity(keys.len());
        wish_for_huge_pages(&nodes);
        rayon::iter::ParallelExtend::par_extend(
            &mut nodes,
            rayon::iter::repeat_n(Joined::UNUSED, keys.len()),
        );
        let cluster_size = parameters.cluster_size as usize;
        // Triangles that end in one leaf anyhow need no tree, unless the tree is to be improved first.
        let run_size = match parameters.collapse {
            Collapse::Builder => cluster_size.min(parameters.min_leaf_size as usize),
            Collapse::Optimal => 0,
        };
        let how = (costs, cluster_size, run_size);
        let root = match parameters.search_radius {
            0..8 => build::<4, 20>(&boxes, &keys, how, &mut nodes),
            8..16 => build::<8, 40>(&boxes, &keys, how, &mut nodes),
            16..32 => build::<16, 80>(&boxes, &keys, how, &mut nodes),
            _ => build::<32, 160>(&boxes, &keys, how, &mut nodes),
        };
        Self { boxes, keys, nodes, root }
    }

    pub(super) fn bounds(&self, link: ClusterLink) -> Bounds {
        match link.triangle() {
            Some(triangle) => self.boxes[triangle as usize],
            None => self.nodes[link.0 as usize].bounds,
        }
    }

    /// Triangles of a node, or 1.
    pub(super) fn triangles(&self, link: ClusterLink) -> u32 {
        if link.triangle().is_some() { 1 } else { self.nodes[link.0 as usize].triangles }
    }

    /// Whether the triangles below are best tested as one leaf.
    pub(super) fn is_leaf(&self, link: ClusterLink) -> bool {
        link.triangle().is_some() || self.nodes[link.0 as usize].is_leaf
    }

    pub(super) fn halves(&self, link: ClusterLink) -> [ClusterLink; 2] {
        let node = &self.nodes[link.0 as usize];
        debug_assert!(!node.is_run, "it has none");
        node.children
    }

    /// Appends the numbers of all triangles below.
    pub(super) fn gather(&self, link: ClusterLink, numbers: &mut Vec<u32>) {
        if let Some(triangle) = link.triangle() {
            numbers.push(triangle);
            return;
        }
        let Joined { children, triangles, is_run, .. } = self.nodes[link.0 as usize];
        if is_run {
            let run = &self.keys[children[0].0 as usize..][..triangles as usize];
            numbers.extend(run.iter().map(|key| key.number()));
        } else {
            children.into_iter().for_each(|half| self.gather(half, numbers));
        }
    }

    /// The children of a wide node of `link`: halves replace the largest while there is room for `width`.
    pub(super) fn children(&self, link: ClusterLink, width: usize, found: &mut Vec<(Bounds, ClusterLink)>) {
        /// The area of clusters that are not opened.
        const CLOSED: f64 = f64::NEG_INFINITY;
        let mut areas = [CLOSED; WIDTH_MAX];
        found.clear();
        let (mut open, mut place) = (link, 0);
        loop {
            let halves = self.halves(open);
            if found.is_empty() {
                found.push((Bounds::EMPTY, link));
            }
            areas.copy_within(place + 1..WIDTH_MAX - 1, place + 2);
            found.insert(place + 1, (Bounds::EMPTY, link));
            for (place, half) in (place..).zip(halves) {
                let bounds = self.bounds(half);
                found[place] = (bounds, half);
                areas[place] = if self.is_leaf(half) { CLOSED } else { bounds.half_area() };
                self.fetch_below(half);
            }
            if found.len() == width {
                return;
            }
            // The last of the largest.
            let mut largest = CLOSED;
            for (candidate, &area) in areas[..found.len()].iter().enumerate() {
                if area >= largest {
                    (largest, place) = (area, candidate);
                }
            }
            if largest == CLOSED {
                return;
            }
            open = found[place].1;
        }
    }

    /// Fetches the children of a node ahead of their use.
    #[inline]
    fn fetch_below(&self, link: ClusterLink) {
        if link.triangle().is_some() {
            return;
        }
        let Joined { children, is_run, .. } = self.nodes[link.0 as usize];
        if is_run {
            prefetch(&self.keys, children[0].0 as usize);
        } else {
            children
                .into_iter()
                .filter(|half| half.triangle().is_none())
                .for_each(|half| prefetch(&self.nodes, half.0 as usize));
        }
    }

    /// The tree in the form of the optimiser and the collapse.
    pub(super) fn into_binary(self) -> BinaryTree {
        BinaryTree::of((&self, self.root))
    }
}

impl Subtree for (&Ploc, ClusterLink) {
    fn bounds(&self) -> Bounds {
        self.0.bounds(self.1)
    }

    fn leaves(&self) -> u32 {
        self.0.triangles(self.1)
    }

    fn open(self) -> Opened<Self> {
        let (ploc, link) = self;
        match link.triangle() {
            Some(triangle) => Opened::Leaf(triangle),
            None => Opened::Node(ploc.halves(link).map(|half| (ploc, half))),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use glam::Vec3A;
    use proptest::prelude::*;

    use super::super::binary::tests::check;
    use super::*;

    pub(in crate::tree) fn over(boxes: &[Bounds]) -> Triangles {
        let corners = boxes.iter().flat_map(|bounds| {
            let (lower, upper) = (Vec3A::from_array(bounds.lower), Vec3A::from_array(bounds.upper));
            [lower, upper, Vec3A::new(lower.x, upper.y, lower.z)]
        });
        let positions: Vec<Vec3A> = corners.collect();
        let indices = (0..boxes.len() as u32).map(|number| [0, 1, 2].map(|corner| 3 * number + corner));
        Triangles::new(positions, indices.collect()).expect("they are finite")
    }

    fn depth(ploc: &Ploc, link: ClusterLink) -> u32 {
        match link.triangle() {
            Some(_) => 0,
            None => 1 + ploc.halves(link).map(|half| depth(ploc, half)).into_iter().max().unwrap_or(0),
        }
    }

    #[test]
    fn triangles_on_top_of_each_other_make_a_shallow_tree() {
        let same = vec![Bounds { lower: [1.0; 3], upper: [2.0; 3] }; 1 << 12];
        for (search_radius, cluster_size) in [(4, 8), (4, 1), (8, 2), (16, 4), (32, 1)] {
            let collapse = Collapse::Optimal;
            let parameters =
                TreeParameters { search_radius, cluster_size, collapse, ..TreeParameters::default() };
            let ploc = Ploc::build(&over(&same), &parameters);
            assert!(depth(&ploc, ploc.root) <= 24, "{}", depth(&ploc, ploc.root));
            check(&ploc.into_binary(), &same);
        }
    }

    proptest! {
        #[test]
        fn every_triangle_is_there_once_and_every_box_fits(
            boxes in super::super::binary::tests::boxes(),
            search_radius in prop::sample::select(vec![4u32, 8, 16, 32]),
            cluster_size in 1u32..=8,
            min_leaf_size in 1u32..=4,
        ) {
            for collapse in [Collapse::Builder, Collapse::Optimal] {
                let given = TreeParameters::default();
                let parameters = TreeParameters {
                    search_radius, cluster_size, collapse, min_leaf_size, max_leaf_size: 4, ..given
                };
                let ploc = Ploc::build(&over(&boxes), &parameters);
                let (mut open, mut numbers) = (vec![ploc.root], Vec::new());
                while let Some(link) = open.pop() {
                    if ploc.is_leaf(link) {
                        prop_assert!(ploc.triangles(link) <= 4);
                        let before = numbers.len();
                        ploc.gather(link, &mut numbers);
                        prop_assert_eq!(numbers.len() - before, ploc.triangles(link) as usize);
                        for number in &numbers[before..] {
                            let around = ploc.bounds(link).union(boxes[*number as usize]);
                            prop_assert_eq!(around, ploc.bounds(link));
                        }
                        continue;
                    }
                    let mut found = Vec::new();
                    ploc.children(link, 8, &mut found);
                    prop_assert!((2..=8).contains(&found.len()));
                    open.extend(found.iter().map(|(_, child)| *child));
                }
                numbers.sort_unstable();
                prop_assert!(numbers.into_iter().eq(0..boxes.len() as u32));
                if collapse == Collapse::Optimal {
                    check(&ploc.into_binary(), &boxes);
                }
            }
        }
    }
}
