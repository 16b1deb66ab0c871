//! From the binary tree to the wide tree of least expected cost.
//!
//! Dynamic programming over the binary tree finds the least cost of making a subtree into at most `i`
//! children of one wide node (Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through
//! Compressed Wide BVHs", 2017, section 3.1), at the cost of Wald, Benthin and Boulos, "Getting Rid of
//! Packets", 2008. One child is a leaf or a node; more are shared by the two halves.

use super::binary::{BinaryNode, BinaryTree};
use super::plan::Plan;
use crate::{layout::Bounds, parameters::TreeParameters};

/// Fewest leaves of a subtree that is worth a task of its own.
const LEAVES_PER_TASK: u32 = 4096;
/// Levels on which tasks are split off; below them everything is done in a row.
const TASK_LEVELS: u32 = 32;

/// Cost of a subtree as at most `i + 1` children of one node, for each `i`.
type Costs<const W: usize> = [f32; W];

struct Model {
    parameters: TreeParameters,
    /// Area of the root.
    area: f64,
}

impl Model {
    /// Probability that a ray that meets the root's box meets this one; about 1 where nothing has an area.
    fn share(&self, node: &BinaryNode) -> f32 {
        if self.area > 0.0 { (node.bounds().half_area() / self.area) as f32 } else { 1.0 }
    }

    fn leaf(&self, node: &BinaryNode) -> f32 {
        let blocks = node.leaves().div_ceil(self.parameters.sah_block_size);
        self.share(node) * self.parameters.intersection_cost * blocks as f32
    }

    fn must_be_leaf(&self, node: &BinaryNode) -> bool {
        node.leaves() <= self.parameters.min_leaf_size
    }

    fn may_be_leaf(&self, node: &BinaryNode) -> bool {
        node.leaves() <= self.parameters.max_leaf_size
    }

    /// The costs of an inner node from those of its children, and its decision.
    #[inline(always)]
    fn costs<const W: usize>(
        &self,
        node: &BinaryNode,
        left: &Costs<W>,
        right: &Costs<W>,
    ) -> (Costs<W>, Decision) {
        if self.must_be_leaf(node) {
            return ([self.leaf(node); W], Decision::LEAF);
        }
        let mut costs = [f32::INFINITY; W];
        for children in 2..=W {
            costs[children - 1] = shared(left, right, children);
        }
        let mut decision = Decision::NONE;
        decision.split(W, first_split(left, right, W, costs[W - 1]));
        let as_node = costs[W - 1] + self.share(node) * self.parameters.traversal_cost;
        let as_leaf = if self.may_be_leaf(node) { self.leaf(node) } else { f32::INFINITY };
        costs[0] = as_node.min(as_leaf);
        if self.may_be_leaf(node) && as_leaf <= costs[0] {
            decision = Decision(decision.0 | Decision::LEAF.0);
        }
        for children in 2..=W {
            match costs[children - 1] < costs[children - 2] {
                true if children < W => {
                    decision.split(children, first_split(left, right, children, costs[children - 1]));
                }
                true => {}
                false => costs[children - 1] = costs[children - 2],
            }
        }
        (costs, decision)
    }

    fn of_leaf<const W: usize>(&self, node: &BinaryNode) -> (Costs<W>, Decision) {
        ([self.leaf(node); W], Decision::LEAF)
    }
}

/// How a subtree becomes children of a wide node: whether it is a leaf as one child, and for each greater
/// number the children of its first half, four bits each. 0 means that fewer cost as little.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Decision(u64);

impl Decision {
    const NONE: Self = Self(0);
    const LEAF: Self = Self(1);

    fn split(&mut self, children: usize, of_left: usize) {
        self.0 |= (of_left as u64) << Self::place(children);
    }

    fn is_leaf(self) -> bool {
        self.0 & Self::LEAF.0 != 0
    }

    /// Number of `children` for the first half; 0 where fewer children cost as little.
    fn of_left(self, children: usize) -> usize {
        (self.0 >> Self::place(children) & 0xf) as usize
    }

    /// Two children come first, behind the bit of the leaf; sixteen end with the word.
    fn place(children: usize) -> usize {
        4 * (children - 1)
    }
}

/// The least number of children for the first half with which the sum is `least`.
#[inline(always)]
fn first_split<const W: usize>(left: &Costs<W>, right: &Costs<W>, children: usize, least: f32) -> usize {
    (1..children).find(|of_left| left[of_left - 1] + right[children - of_left - 1] == least).unwrap_or(1)
}

/// Least cost of two subtrees that share `children` children.
#[inline(always)]
fn shared<const W: usize>(left: &Costs<W>, right: &Costs<W>, children: usize) -> f32 {
    (1..children)
        .map(|of_left| left[of_left - 1] + right[children - of_left - 1])
        .fold(f32::INFINITY, f32::min)
}

/// The wide tree of `W` children a node. The binary tree must be numbered depth first.
pub(super) fn collapse<const W: usize>(tree: &BinaryTree, parameters: &TreeParameters) -> Plan {
    let model = Model { parameters: *parameters, area: tree.root().bounds().half_area() };
    let mut decisions = vec![Decision::NONE; tree.nodes.len()];
    let (top, below) = decisions.split_at_mut(2);
    top[0] = solve::<W>(tree, &model, 0, below, 2, TASK_LEVELS).1;

    let triangles = tree.root().leaves() as usize;
    let mut plan = Plan::with_capacity(triangles / W, triangles / 2, triangles);
    let (mut stack, mut ends) = (Vec::new(), Vec::new());
    plan.grow((tree.root().bounds(), 0), |plan, number, found| {
        if decisions[number].is_leaf() {
            ends.clear();
            stack.push(number);
            while let Some(number) = stack.pop() {
                let node = &tree.nodes[number];
                match node.first_child() {
                    Some(first) => stack.extend([first + 1, first]),
                    None => ends.push(node.triangle()),
                }
            }
            return Some(plan.add_leaf(ends.iter().copied()));
        }
        children::<W>(tree, &decisions, number, found);
        None
    });
    plan
}

/// Costs of a node and what to do with it; decisions for nodes from number `first` on go into `below`.
fn solve<const W: usize>(
    tree: &BinaryTree,
    model: &Model,
    node: usize,
    below: &mut [Decision],
    first: usize,
    levels: u32,
) -> (Costs<W>, Decision) {
    let this = &tree.nodes[node];
    if this.leaves() < LEAVES_PER_TASK || levels == 0 {
        let mut costs = vec![[0.0; W]; below.len()];
        // Children have higher numbers than their parents.
        for place in (0..below.len()).rev() {
            let node = &tree.nodes[first + place];
            (costs[place], below[place]) = match node.first_child() {
                Some(pair) => model.costs(node, &costs[pair - first], &costs[pair + 1 - first]),
                None => model.of_leaf(node),
            };
        }
        return match this.first_child() {
            Some(_) => model.costs(this, &costs[0], &costs[1]),
            None => model.of_leaf(this),
        };
    }
    let (pair, below) = below.split_at_mut(2);
    let of_left = 2 * (tree.nodes[first].leaves() as usize - 1);
    let (below_left, below_right) = below.split_at_mut(of_left);
    let (left, right) = rayon::join(
        || solve::<W>(tree, model, first, below_left, first + 2, levels - 1),
        || solve::<W>(tree, model, first + 1, below_right, first + 2 + of_left, levels - 1),
    );
    (pair[0], pair[1]) = (left.1, right.1);
    model.costs(this, &left.0, &right.0)
}

/// Lists the children that a wide node made of `number` has.
fn children<const W: usize>(
    tree: &BinaryTree,
    decisions: &[Decision],
    number: usize,
    found: &mut Vec<(Bounds, usize)>,
) {
    // Nodes and as how many children they are to appear.
    let mut open = [(0, 0); W];
    open[0] = (number, W);
    let mut count = 1;
    while count > 0 {
        count -= 1;
        let (number, mut share) = open[count];
        let decision = decisions[number];
        while share > 1 && decision.of_left(share) == 0 {
            share -= 1;
        }
        if share == 1 {
            found.push((tree.nodes[number].bounds(), number));
            continue;
        }
        let Some(first) = tree.nodes[number].first_child() else {
            unreachable!("a leaf is never split");
        };
        let of_left = decision.of_left(share);
        open[count] = (first + 1, share - of_left);
        open[count + 1] = (first, of_left);
        count += 2;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::plan::{Link, Named};
    use super::super::{binary::halved, binary::tests::boxes};
    use super::*;
    use crate::layout::Bounds;

    /// Cost of the plan by the model of its parameters, without the factor that all plans have in common.
    fn cost(plan: &Plan, link: Link, bounds: Bounds, parameters: &TreeParameters) -> f64 {
        match link.named() {
            Named::Leaf(leaf) => {
                let blocks = plan.triangles(leaf).len().div_ceil(parameters.sah_block_size as usize);
                bounds.half_area() * f64::from(parameters.intersection_cost) * blocks as f64
            }
            Named::Node(node) => {
                let below = plan.children(node).iter();
                let below: f64 = below.map(|child| cost(plan, child.link, child.bounds, parameters)).sum();
                bounds.half_area() * f64::from(parameters.traversal_cost) + below
            }
        }
    }

    /// Least cost of a subtree as at most `share` children, by trying everything.
    fn least<const W: usize>(
        tree: &BinaryTree,
        node: usize,
        share: usize,
        parameters: &TreeParameters,
    ) -> f64 {
        let this = &tree.nodes[node];
        let area = this.bounds().half_area();
        let blocks = this.leaves().div_ceil(parameters.sah_block_size);
        let leaf = area * f64::from(parameters.intersection_cost) * f64::from(blocks);
        if this.leaves() <= parameters.min_leaf_size {
            return leaf;
        }
        let Some(first) = this.first_child() else { return leaf };
        let halves = |share: usize| {
            (1..share)
                .map(|left| {
                    least::<W>(tree, first, left, parameters)
                        + least::<W>(tree, first + 1, share - left, parameters)
                })
                .fold(f64::INFINITY, f64::min)
        };
        let mut best = halves(W) + area * f64::from(parameters.traversal_cost);
        if this.leaves() <= parameters.max_leaf_size {
            best = best.min(leaf);
        }
        if share > 1 { best.min(halves(share)) } else { best }
    }

    fn check<const W: usize>(leaves: &[Bounds], parameters: &TreeParameters) -> Result<(), TestCaseError> {
        let mut tree = halved(leaves);
        tree.renumber();
        let plan = collapse::<W>(&tree, parameters);
        let mut found = vec![0; leaves.len()];
        for leaf in 0..plan.leaves() {
            let triangles = plan.triangles(leaf);
            prop_assert!((1..=parameters.max_leaf_size as usize).contains(&triangles.len()));
            triangles.iter().for_each(|&triangle| found[triangle as usize] += 1);
        }
        prop_assert!(found.iter().all(|&times| times == 1));
        for node in 0..plan.nodes() {
            prop_assert!((2..=W).contains(&plan.children(node).len()));
        }
        let cost = cost(&plan, plan.root.link, plan.root.bounds, parameters);
        let least = least::<W>(&tree, 0, 1, parameters);
        prop_assert!((cost - least).abs() <= 1e-4 * least, "{cost} is not {least}");
        Ok(())
    }

    fn parameters() -> impl Strategy<Value = TreeParameters> {
        let sizes = (1u32..=8).prop_flat_map(|max| (1..=max, Just(max)));
        let costs = (0.0f32..4.0, 0.1f32..4.0);
        (sizes, costs, prop::sample::select(vec![1u32, 2, 4])).prop_map(
            |((min_leaf_size, max_leaf_size), (traversal_cost, intersection_cost), sah_block_size)| {
                TreeParameters {
                    min_leaf_size,
                    max_leaf_size,
                    traversal_cost,
                    intersection_cost,
                    sah_block_size,
                    ..TreeParameters::default()
                }
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        #[test]
        fn no_other_wide_tree_is_cheaper(leaves in boxes(), parameters in parameters()) {
            let few = &leaves[..leaves.len().min(12)];
            check::<2>(few, &parameters)?;
            check::<4>(few, &parameters)?;
            check::<8>(few, &parameters)?;
            check::<16>(few, &parameters)?;
        }
    }
}
