//! Our own builder: a binary tree bottom up, from triangles along a space-filling curve.
//!
//! Parallel locally-ordered clustering (Meister and Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume
//! Hierarchy Construction", 2018; Benthin et al., "PLOC++", 2022): each cluster looks at a few neighbours along the
//! curve for the one with which it makes the smallest box, and pairs that choose each other are joined. Done on parts
//! of the curve as Benthin, Meister, Barczak, Mehalwal, Tsakok and Kensler do ("H-PLOC: Hierarchical Parallel
//! Locally-Ordered Clustering for Bounding Volume Hierarchy Construction", 2024): a part hands up a handful of clusters,
//! which are joined with those of the part beside it. So everything a thread works on lies in its first cache, and
//! parts are as independent as the halves of a sort. Where there is no time for that, the lowest clusters are runs of
//! the curve (`cluster_size`), as those of a tree by Morton codes: most of the work is done on the lowest levels, and
//! least is lost there, since what ends up in one leaf need not be ordered at all.
//!
//! The tree is the same with any number of threads and with every instruction set.

use super::binary::{BinaryTree, Source};
use super::morton::{self, Key};
use crate::geometry::Triangles;
use crate::layout::Bounds;
use crate::memory::wish_for_huge_pages;
use crate::parameters::{Collapse, TreeParameters};
use crate::traverse::Isa;

/// Fewest triangles that are worth a task of their own.
const TRIANGLES_PER_TASK: usize = 4_096;

/// Clusters that are looked at together.
const LANES: usize = 16;

/// Marks a link as a triangle.
const TRIANGLE: u32 = 1 << 31;

/// A node of the tree, or a triangle of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ClusterLink(u32);

impl ClusterLink {
    /// Its triangle, if it is one.
    pub(super) fn triangle(self) -> Option<u32> {
        (self.0 & TRIANGLE != 0).then_some(self.0 & !TRIANGLE)
    }
}

/// Two joined clusters.
#[derive(Clone, Copy, Debug)]
struct Joined {
    bounds: Bounds,
    children: [ClusterLink; 2],
    /// Triangles below.
    triangles: u32,
    /// Whether those are best tested as one leaf.
    is_leaf: bool,
    /// It is a leaf of triangles side by side on the curve, without halves: those from its first child's number on.
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

/// The tree.
pub(super) struct Ploc {
    boxes: Vec<Bounds>,
    keys: Vec<Key>,
    nodes: Vec<Joined>,
    pub(super) root: ClusterLink,
}

/// What leaves cost, as the collapse counts it.
#[derive(Clone, Copy)]
struct Costs {
    node: f32,
    block: f32,
    block_size: u32,
    min_leaf_size: u32,
    max_leaf_size: u32,
}

/// Clusters side by side along the curve: at most `P` less the radius, behind which it must stay free. That is a multiple
/// of [`LANES`].
struct Clusters<const P: usize> {
    lower: [[f32; P]; 3],
    upper: [[f32; P]; 3],
    links: [ClusterLink; P],
    /// A place among the nodes that nobody has used: there is one for each cluster.
    free: [u32; P],
    triangles: [u32; P],
    /// Expected cost of the subtree, times the area of its box.
    costs: [f32; P],
    count: usize,
}

impl<const P: usize> Clusters<P> {
    fn new() -> Self {
        Self {
            // The box of a free place makes none but infinite ones.
            lower: [[f32::NEG_INFINITY; P]; 3],
            upper: [[f32::INFINITY; P]; 3],
            links: [ClusterLink(TRIANGLE); P],
            free: [0; P],
            triangles: [0; P],
            costs: [0.0; P],
            count: 0,
        }
    }

    fn bounds(&self, place: usize) -> Bounds {
        Bounds {
            lower: self.lower.map(|planes| planes[place]),
            upper: self.upper.map(|planes| planes[place]),
        }
    }

    fn set(&mut self, place: usize, bounds: &Bounds) {
        for axis in 0..3 {
            self.lower[axis][place] = bounds.lower[axis];
            self.upper[axis][place] = bounds.upper[axis];
        }
    }

    fn push(&mut self, bounds: &Bounds, link: ClusterLink, free: u32, triangles: u32, cost: f32) {
        let place = self.count;
        self.set(place, bounds);
        (self.links[place], self.free[place]) = (link, free);
        (self.triangles[place], self.costs[place]) = (triangles, cost);
        self.count += 1;
    }

    /// Moves a cluster forward.
    fn move_to(&mut self, to: usize, from: usize) {
        if to < from {
            let bounds = self.bounds(from);
            self.set(to, &bounds);
            (self.links[to], self.free[to]) = (self.links[from], self.free[from]);
            (self.triangles[to], self.costs[to]) = (self.triangles[from], self.costs[from]);
        }
    }

    /// Frees the places from `count` on.
    fn truncate(&mut self, count: usize) {
        let nothing = Bounds { lower: [f32::NEG_INFINITY; 3], upper: [f32::INFINITY; 3] };
        for place in count..self.count {
            self.set(place, &nothing);
        }
        self.count = count;
    }
}

/// For each cluster which of those at most `R` places away makes the smallest box with it: the exclusive or of both
/// places, behind the area's highest bits. That is the same for both of a pair, and different for the partners of one,
/// so of equal areas too there is always one pair whose two choose each other, and equal boxes are joined pair by pair.
#[inline(always)]
fn nearest<const R: usize, const P: usize>(clusters: &Clusters<P>, best: &mut [u32; P]) {
    best.fill(u32::MAX);
    let mask = P.next_power_of_two() as u32 - 1;
    let least = |a: f32, b: f32| if a < b { a } else { b };
    let most = |a: f32, b: f32| if a > b { a } else { b };
    // The compiler makes vectors of the loops over `lane`. Free places take part and come to nothing.
    for start in (0..clusters.count).step_by(LANES) {
        let [lx, ly, lz] = [0, 1, 2].map(|axis| lanes(&clusters.lower[axis], start));
        let [ux, uy, uz] = [0, 1, 2].map(|axis| lanes(&clusters.upper[axis], start));
        let mut of_start = [u32::MAX; LANES];
        for step in 1..=R {
            let other = start + step;
            let [lx_other, ly_other, lz_other] = [0, 1, 2].map(|axis| lanes(&clusters.lower[axis], other));
            let [ux_other, uy_other, uz_other] = [0, 1, 2].map(|axis| lanes(&clusters.upper[axis], other));
            let mut keys = [0; LANES];
            for lane in 0..LANES {
                let x = most(ux[lane], ux_other[lane]) - least(lx[lane], lx_other[lane]);
                let y = most(uy[lane], uy_other[lane]) - least(ly[lane], ly_other[lane]);
                let z = most(uz[lane], uz_other[lane]) - least(lz[lane], lz_other[lane]);
                let area = x * y + (x + y) * z;
                keys[lane] = (area.to_bits() & !mask) | ((start + lane) ^ (other + lane)) as u32;
            }
            let of_other: &mut [u32; LANES] =
                (&mut best[other..other + LANES]).try_into().expect("so many lanes");
            for lane in 0..LANES {
                of_start[lane] = of_start[lane].min(keys[lane]);
                of_other[lane] = of_other[lane].min(keys[lane]);
            }
        }
        for (best, own) in best[start..].iter_mut().zip(of_start) {
            *best = own.min(*best);
        }
    }
}

/// So many numbers from a place on.
#[inline(always)]
fn lanes<const P: usize>(of: &[f32; P], place: usize) -> &[f32; LANES] {
    of[place..].first_chunk().expect("behind the last cluster there is room for a radius")
}

type Nearest<const P: usize> = unsafe fn(&Clusters<P>, &mut [u32; P]);

/// # Safety
/// None is needed; it has the type of those that need processor features.
unsafe fn nearest_plain<const R: usize, const P: usize>(clusters: &Clusters<P>, best: &mut [u32; P]) {
    nearest::<R, P>(clusters, best);
}

/// # Safety
/// The processor has AVX2.
#[cfg(all(target_arch = "x86_64", kernels_avx2))]
#[target_feature(enable = "avx2")]
unsafe fn nearest_avx2<const R: usize, const P: usize>(clusters: &Clusters<P>, best: &mut [u32; P]) {
    nearest::<R, P>(clusters, best);
}

/// # Safety
/// The processor has these features.
#[cfg(all(target_arch = "x86_64", kernels_avx512))]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2")]
unsafe fn nearest_avx512<const R: usize, const P: usize>(clusters: &Clusters<P>, best: &mut [u32; P]) {
    nearest::<R, P>(clusters, best);
}

/// A build in progress. Parts hand up half of what fits into `P`, less the radius.
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
    fn part(&self, keys: &[Key], nodes: &mut [Joined], first: u32, clusters: &mut Clusters<P>) {
        if keys.len() <= Self::HANDED_UP {
            self.begin(keys, nodes, (first, first), clusters);
            return;
        }
        let middle = Key::middle(keys);
        let (keys_left, keys_right) = keys.split_at(middle);
        let (nodes_left, nodes_right) = nodes.split_at_mut(middle);
        if keys_right.len() <= Self::HANDED_UP {
            self.part(keys_left, nodes_left, first, clusters);
            let next = first + middle as u32;
            self.begin(keys_right, nodes_right, (next, next), clusters);
            self.join(clusters, Self::HANDED_UP, nodes, first);
            return;
        }
        let mut right = Clusters::new();
        let of_left = |clusters: &mut Clusters<P>| self.part(keys_left, nodes_left, first, clusters);
        let of_right =
            |right: &mut Clusters<P>| self.part(keys_right, nodes_right, first + middle as u32, right);
        if keys.len() < TRIANGLES_PER_TASK {
            let mut of_left = of_left;
            let mut of_right = of_right;
            of_left(clusters);
            of_right(&mut right);
        } else {
            let (mut of_left, mut of_right) = (of_left, of_right);
            rayon::join(|| of_left(clusters), || of_right(&mut right));
        }
        for place in 0..right.count {
            let bounds = right.bounds(place);
            clusters.push(
                &bounds,
                right.links[place],
                right.free[place],
                right.triangles[place],
                right.costs[place],
            );
        }
        self.join(clusters, Self::HANDED_UP, nodes, first);
    }

    /// Adds the first clusters of a few triangles: as many of them as one cluster may begin with are joined where the
    /// curve parts them, without a look at any neighbour. The nodes are those from number `first` on; `next` is the number
    /// of the first triangle's own.
    fn begin(
        &self,
        keys: &[Key],
        nodes: &mut [Joined],
        (first, next): (u32, u32),
        clusters: &mut Clusters<P>,
    ) {
        if let [key] = keys {
            let number = key.number();
            let bounds = &self.boxes[number as usize];
            let cost = self.costs.block * bounds.half_area() as f32;
            clusters.push(bounds, ClusterLink(number | TRIANGLE), next, 1, cost);
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
            clusters.push(&bounds, ClusterLink(next), next + 1, triangles, cost);
            return;
        }
        let middle = Key::middle(keys);
        self.begin(&keys[..middle], nodes, (first, next), clusters);
        self.begin(&keys[middle..], nodes, (first, next + middle as u32), clusters);
        if keys.len() <= self.cluster_size {
            let last = clusters.count - 1;
            self.join_two(clusters, last - 1, last, nodes, first);
            clusters.truncate(last);
        }
    }

    /// Joins clusters until there are at most so many.
    fn join(&self, clusters: &mut Clusters<P>, most: usize, nodes: &mut [Joined], first: u32) {
        let mut best = [0; P];
        while clusters.count > most {
            // SAFETY: it was chosen for this processor.
            unsafe { (self.nearest)(clusters, &mut best) };
            let partner = |place: usize| place ^ (best[place] as usize & (P.next_power_of_two() - 1));
            let (mut count, before) = (0, clusters.count);
            for place in 0..before {
                let other = partner(place);
                let is_mutual = other < before && partner(other) == place;
                if is_mutual && other < place {
                    continue;
                }
                if is_mutual {
                    self.join_two(clusters, place, other, nodes, first);
                }
                clusters.move_to(count, place);
                count += 1;
            }
            clusters.truncate(count);
        }
    }

    /// Joins the cluster at `other`, which is to vanish, to that at `place`.
    fn join_two(
        &self,
        clusters: &mut Clusters<P>,
        place: usize,
        other: usize,
        nodes: &mut [Joined],
        first: u32,
    ) {
        let bounds = clusters.bounds(place).union(clusters.bounds(other));
        let triangles = clusters.triangles[place] + clusters.triangles[other];
        let Costs { node, block, block_size, min_leaf_size, max_leaf_size } = self.costs;
        let area = bounds.half_area() as f32;
        let apart = node * area + clusters.costs[place] + clusters.costs[other];
        let together = block * area * triangles.div_ceil(block_size) as f32;
        let is_leaf = triangles <= min_leaf_size || (triangles <= max_leaf_size && together <= apart);
        let number = clusters.free[place];
        let children = [clusters.links[place], clusters.links[other]];
        nodes[(number - first) as usize] = Joined { bounds, children, triangles, is_leaf, is_run: false };
        clusters.set(place, &bounds);
        (clusters.links[place], clusters.free[place]) = (ClusterLink(number), clusters.free[other]);
        clusters.triangles[place] = triangles;
        clusters.costs[place] = if is_leaf { together } else { apart };
    }
}

fn build<const R: usize, const P: usize>(
    boxes: &[Bounds],
    keys: &[Key],
    (costs, cluster_size, run_size): (Costs, usize, usize),
    nodes: &mut [Joined],
) -> ClusterLink {
    const { assert!((P - R).is_multiple_of(LANES)) };
    let nearest: Nearest<P> = match Isa::detect() {
        #[cfg(all(target_arch = "x86_64", kernels_avx512))]
        Isa::Avx512 => nearest_avx512::<R, P>,
        #[cfg(all(target_arch = "x86_64", kernels_avx2))]
        Isa::Avx2 => nearest_avx2::<R, P>,
        _ => nearest_plain::<R, P>,
    };
    let builder = Builder::<'_, R, P> { boxes, costs, cluster_size, run_size, nearest };
    let mut clusters = Clusters::new();
    builder.part(keys, nodes, 0, &mut clusters);
    builder.join(&mut clusters, 1, nodes, 0);
    clusters.links[0]
}

impl Ploc {
    /// Builds over at least one triangle.
    pub(super) fn build(triangles: &Triangles, parameters: &TreeParameters) -> Self {
        let boxes = morton::boxes(triangles);
        let keys = morton::sorted(&boxes);
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
        // What ends in one leaf anyhow needs no tree, unless the tree is to be improved first.
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

    /// The box around a node or triangle.
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

    /// Whether what is below is best tested as one leaf.
    pub(super) fn is_leaf(&self, link: ClusterLink) -> bool {
        link.triangle().is_some() || self.nodes[link.0 as usize].is_leaf
    }

    /// The two children of a node.
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

    /// The children of a wide node made of `link`, which is no leaf: in place of the largest come its halves, as long
    /// as there is room for `width`. They stay in their order along the curve.
    pub(super) fn children(&self, link: ClusterLink, width: usize, found: &mut Vec<(Bounds, ClusterLink)>) {
        found.clear();
        found.extend(self.halves(link).map(|half| (self.bounds(half), half)));
        while found.len() < width {
            let open = found.iter().enumerate().filter(|(_, (_, link))| !self.is_leaf(*link));
            let by_area = |(place, (bounds, _)): (usize, &(Bounds, ClusterLink))| (bounds.half_area(), place);
            let Some((_, place)) = open.map(by_area).max_by(|a, b| a.0.total_cmp(&b.0)) else {
                break;
            };
            let [left, right] = self.halves(found[place].1).map(|half| (self.bounds(half), half));
            found[place] = left;
            found.insert(place + 1, right);
        }
    }

    /// The same tree as the optimiser and the collapse want it.
    pub(super) fn into_binary(self) -> BinaryTree {
        BinaryTree::copied(&self, self.root, self.bounds(self.root))
    }
}

impl Source for Ploc {
    type Item = ClusterLink;

    fn triangle(&self, item: ClusterLink) -> Option<u32> {
        item.triangle()
    }

    fn halves(&self, item: ClusterLink) -> [(Bounds, ClusterLink); 2] {
        Self::halves(self, item).map(|half| (self.bounds(half), half))
    }

    fn leaves(&self, item: ClusterLink) -> u32 {
        self.triangles(item)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;
    use proptest::prelude::*;

    use super::super::binary::tests::check;
    use super::*;

    /// Triangles as large as some boxes.
    fn over(boxes: &[Bounds]) -> Triangles {
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
