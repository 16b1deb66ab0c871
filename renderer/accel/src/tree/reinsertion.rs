//! Makes a finished binary tree cheaper by taking subtrees out and putting them back where they cost least.
//!
//! Insertion-based optimisation (Bittner, Hapala and Havran, 2013) in its parallel form (Meister and Bittner,
//! "Parallel Reinsertion for Bounding Volume Hierarchy Optimization", 2018). In each pass many nodes look for
//! a better place in a tree that stands still. Then the moves of most gain come first, and those that no
//! longer pay are given up: the cost never rises. Nothing depends on the number of threads.

use rayon::prelude::*;

use super::binary::{BinaryNode, BinaryTree, half_area};

/// In the first passes one node of this number looks for a better place; four such nearly suffice.
const EARLY_SHARE: usize = 32;
const EARLY_PASSES: u32 = 4;
/// In later passes one node of this number does.
const LATE_SHARE: usize = 8;
/// Fewest searches that are worth a task of their own.
const SEARCHES_PER_TASK: usize = 256;
/// Most nodes that a search looks below: where everything overlaps, passes would be quadratic.
const LOOKED_BELOW_MAX: usize = 1024;

/// A node that should become the sibling of another.
#[derive(Clone, Copy, Debug)]
struct Move {
    node: u32,
    sibling: u32,
    gain: f32,
}

/// Runs `passes` passes. Afterwards the numbers are depth first again.
pub(super) fn optimise(tree: &mut BinaryTree, passes: u32) {
    for pass in 0..passes {
        let mut moves: Vec<Move> = candidates(tree, pass)
            .par_iter()
            .with_min_len(SEARCHES_PER_TASK)
            .map_init(Vec::new, |stack, &node| search(tree, node as usize, stack).0)
            .flatten_iter()
            .collect();
        moves.sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.node.cmp(&b.node)));
        let mut touched = vec![false; tree.nodes.len()];
        for Move { node, sibling, .. } in moves {
            carry_out(tree, node as usize, sibling as usize, &mut touched);
        }
    }
    if passes > 0 {
        tree.renumber();
    }
}

/// The nodes of this pass by the measure of Bittner, Hapala and Havran (section 3.2): parents that are large,
/// also beside the sum and the smaller one of their children.
fn candidates(tree: &BinaryTree, pass: u32) -> Vec<u32> {
    let area = |number: usize| {
        let node = &tree.nodes[number];
        half_area(node.lower(), node.upper())
    };
    // The root and its children stay where they are.
    let mut all: Vec<u32> = (4..tree.nodes.len() as u32).collect();
    let share = if pass < EARLY_PASSES { EARLY_SHARE } else { LATE_SHARE };
    let count = all.len().div_ceil(share);
    if count < SEARCHES_PER_TASK {
        return all;
    }
    let promise = |pair: usize| {
        let (left, right) = (area(pair), area(pair + 1));
        let parent = area(tree.parent(pair));
        if parent <= 0.0 {
            return 0.0;
        }
        // Children without area would divide by zero.
        let larger_than = |other: f32| parent / other.max(parent * 1e-6);
        parent * larger_than(0.5 * (left + right)) * larger_than(left.min(right))
    };
    let promises: Vec<f32> = (0..tree.parents.len())
        .into_par_iter()
        .with_min_len(SEARCHES_PER_TASK)
        .map(|pair| if pair < 2 { 0.0 } else { promise(2 * pair) })
        .collect();
    let of = |number: &u32| promises[*number as usize / 2];
    all.select_nth_unstable_by(count - 1, |a, b| of(b).total_cmp(&of(a)).then(a.cmp(b)));
    all.truncate(count);
    // Neighbours in the tree look at common nodes.
    all.sort_unstable();
    all
}

/// Finds the best new sibling for `node`, if any is better, and the number of nodes looked below. `stack` is
/// room to work in.
///
/// The search climbs from the parent, which goes as well, to the root and adds up the areas saved. From each
/// height it looks down beside the path, at most [`LOOKED_BELOW_MAX`] nodes. A place gains the area saved,
/// less the new parent's box, less the growth of the boxes above it.
fn search(tree: &BinaryTree, node: usize, stack: &mut Vec<(f32, usize)>) -> (Option<Move>, usize) {
    let moved = &tree.nodes[node];
    let (lower, upper) = (moved.lower(), moved.upper());
    let area = half_area(lower, upper);
    let mut best = Move { node: node as u32, sibling: 0, gain: 0.0 };
    let with = |other: &BinaryNode| half_area(other.lower().min(lower), other.upper().max(upper));
    let own = |other: &BinaryNode| half_area(other.lower(), other.upper());

    let parent = tree.parent(node);
    let mut saved = own(&tree.nodes[parent]);
    // The box of the node on the path without the moved node.
    let sibling = &tree.nodes[node ^ 1];
    let (mut rest_lower, mut rest_upper) = (sibling.lower(), sibling.upper());
    // The sibling itself would grow to the size of the parent, which uses up the saved area but for its own.
    let mut beside = (own(sibling), node ^ 1);
    let mut pivot = parent;
    let mut looked = 0;
    loop {
        // Each entry is a node and what would be left of the savings below it.
        stack.clear();
        stack.push(beside);
        while looked < LOOKED_BELOW_MAX
            && let Some((potential, inner)) = stack.pop()
        {
            if potential - area <= best.gain {
                continue;
            }
            looked += 1;
            let Some(first) = tree.nodes[inner].first_child() else { continue };
            let mut below = [first, first + 1].map(|child| {
                let other = &tree.nodes[child];
                let left = potential - with(other);
                if left > best.gain {
                    best = Move { sibling: child as u32, gain: left, ..best };
                }
                (left + own(other), child)
            });
            // The better one is taken from the stack first.
            if below[0].0 > below[1].0 {
                below.swap(0, 1);
            }
            stack.extend(below.into_iter().filter(|(potential, _)| potential - area > best.gain));
        }
        if pivot == 0 {
            break;
        }
        // One step up: the other child of the pivot's parent, itself and the nodes below it.
        let other = pivot ^ 1;
        let node_beside = &tree.nodes[other];
        let left = saved - with(node_beside);
        if left > best.gain {
            best = Move { sibling: other as u32, gain: left, ..best };
        }
        beside = (left + own(node_beside), other);
        rest_lower = rest_lower.min(node_beside.lower());
        rest_upper = rest_upper.max(node_beside.upper());
        pivot = tree.parent(pivot);
        saved += own(&tree.nodes[pivot]) - half_area(rest_lower, rest_upper);
        // Beside the ancestor as it will be: both together are as large as it was.
        let left = saved - own(&tree.nodes[pivot]);
        if left > best.gain {
            best = Move { sibling: pivot as u32, gain: left, ..best };
        }
    }
    ((best.gain > 0.0).then_some(best), looked)
}

/// Makes `node` the sibling of `sibling`, unless an earlier move interferes or nothing is gained.
fn carry_out(tree: &mut BinaryTree, node: usize, sibling: usize, touched: &mut [bool]) {
    let (old_sibling, parent) = (node ^ 1, tree.parent(node));
    let involved = [node, sibling, old_sibling, parent];
    if involved.iter().any(|&number| touched[number]) || sibling == parent || sibling == old_sibling {
        return;
    }
    // An earlier move may have brought the place below the node.
    let mut above = sibling;
    while above != 0 {
        if above == node {
            return;
        }
        above = tree.parent(above);
    }
    let change = relink(tree, node, parent, sibling);
    if change < 0.0 {
        involved.iter().for_each(|&number| touched[number] = true);
    } else {
        undo(tree, node, parent, sibling);
    }
}

/// Puts a copy of a node at another number.
fn place(tree: &mut BinaryTree, number: usize, node: BinaryNode) {
    tree.nodes[number] = node;
    if let Some(first) = node.first_child() {
        tree.parents[first / 2] = number as u32;
    }
}

/// Moves `node` from below `parent` to beside `sibling`, and gives the change of the sum of inner areas. The
/// numbers rotate: sibling to parent, `sibling` to old sibling, new parent to `sibling`; pairs stay pairs.
fn relink(tree: &mut BinaryTree, node: usize, parent: usize, sibling: usize) -> f64 {
    let mut change = -tree.nodes[parent].bounds().half_area();
    let lone = tree.nodes[node ^ 1];
    place(tree, parent, lone);
    let joined = tree.nodes[sibling];
    place(tree, node ^ 1, joined);
    let bounds = joined.bounds().union(tree.nodes[node].bounds());
    place(tree, sibling, BinaryNode::inner(bounds, node & !1, 0));
    change += bounds.half_area();
    change + refit_above(tree, parent) + refit_above(tree, sibling)
}

/// Takes back [`relink`] with these arguments.
fn undo(tree: &mut BinaryTree, node: usize, parent: usize, sibling: usize) {
    let joined = tree.nodes[node ^ 1];
    place(tree, sibling, joined);
    let lone = tree.nodes[parent];
    place(tree, node ^ 1, lone);
    let bounds = lone.bounds().union(tree.nodes[node].bounds());
    place(tree, parent, BinaryNode::inner(bounds, node & !1, 0));
    refit_above(tree, parent);
    refit_above(tree, sibling);
}

/// Fits the boxes above a node, as far as they change, and gives the change of their areas.
fn refit_above(tree: &mut BinaryTree, mut node: usize) -> f64 {
    let mut change = 0.0;
    while node != 0 {
        let (left, right) = (tree.nodes[node & !1].bounds(), tree.nodes[node | 1].bounds());
        node = tree.parent(node);
        let old = tree.nodes[node].bounds();
        let new = left.union(right);
        if old == new {
            break;
        }
        change += new.half_area() - old.half_area();
        tree.nodes[node].set_bounds(new);
    }
    change
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::binary::halved;
    use super::super::binary::tests::{boxes, check};
    use super::*;
    use crate::layout::Bounds;

    proptest! {
        #[test]
        fn the_tree_stays_right_and_never_gets_dearer(leaves in boxes()) {
            let mut tree = halved(&leaves);
            tree.renumber();
            let mut area = tree.inner_area();
            for _ in 0..6 {
                optimise(&mut tree, 1);
                check(&tree, &leaves);
                let after = tree.inner_area();
                prop_assert!(after <= area * (1.0 + 1e-12), "{area} became {after}");
                area = after;
            }
        }

        #[test]
        fn the_number_of_threads_changes_nothing(leaves in boxes()) {
            let optimised = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
                let mut tree = halved(&leaves);
                pool.install(|| optimise(&mut tree, 4));
                format!("{tree:?}")
            };
            prop_assert_eq!(optimised(1), optimised(3));
        }
    }

    /// The number of nodes that the searches of a pass look below.
    fn looked(tree: &BinaryTree, pass: u32) -> usize {
        let mut stack = Vec::new();
        candidates(tree, pass).iter().map(|&node| search(tree, node as usize, &mut stack).1).sum()
    }

    /// Boxes of needles of every direction that cross in one place.
    fn crossing(count: usize) -> Vec<Bounds> {
        let turn = |share: f64| (share * std::f64::consts::TAU).sin_cos();
        let needle = |number: usize| {
            let share = (number as f64 + 0.5) / count as f64;
            let (sin, cos) = turn(number as f64 * 0.618_033_988_749_895);
            let radius = (1.0 - (2.0 * share - 1.0).powi(2)).sqrt();
            let half =
                [radius * cos, 2.0 * share - 1.0, radius * sin].map(|extent| extent.abs() as f32 + 0.002);
            Bounds { lower: half.map(|extent| -extent), upper: half }
        };
        (0..count).map(needle).collect()
    }

    #[test]
    fn where_everything_overlaps_the_work_grows_no_faster_than_the_scene() {
        let work = |count: usize| {
            let mut tree = halved(&crossing(count));
            let mut work = 0;
            for pass in 0..EARLY_PASSES {
                work += looked(&tree, pass);
                optimise(&mut tree, 1);
            }
            work as f64
        };
        let (less, more) = (work(8_000), work(32_000));
        let log = |count: f64| count * count.log2();
        assert!(more < 5.0 * less, "four times the needles: {less} and {more}");
        // A build sorts once, in this number of steps.
        assert!(more < 20.0 * log(32_000.0), "{more} and {}", log(32_000.0));
    }

    #[test]
    fn a_shuffled_row_of_boxes_is_put_in_order() {
        // Neighbours lie far apart in the list: the first tree is as bad as can be.
        let at = |place: usize| {
            let x = ((place * 37) % 128) as f32;
            Bounds { lower: [x, 0.0, 0.0], upper: [x + 1.0, 1.0, 1.0] }
        };
        let leaves: Vec<Bounds> = (0..128).map(at).collect();
        let mut tree = halved(&leaves);
        let before = tree.inner_area();
        optimise(&mut tree, 16);
        check(&tree, &leaves);
        let mut sorted = leaves.clone();
        sorted.sort_by(|a, b| a.lower[0].total_cmp(&b.lower[0]));
        let best = halved(&sorted).inner_area();
        let after = tree.inner_area();
        assert!(after < 0.5 * before && after < 1.2 * best, "{before} became {after}, {best} is possible");
    }
}
