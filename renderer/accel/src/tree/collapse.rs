//! From the binary tree to the wide tree of least expected cost.
//!
//! Dynamic programming over the binary tree, as Ylitie, Karras and Laine describe it ("Efficient Incoherent
//! Ray Traversal on GPUs Through Compressed Wide BVHs", 2017, section 3.1; the cost is that of Wald, Benthin
//! and Boulos, "Getting Rid of Packets", 2008): what does it cost at least to make a subtree into at most `i`
//! children of one wide node? For one child it becomes a leaf or a node of its own, whose children are at
//! most as many as fit; for more its two halves share them. The answers for the halves give those for the
//! whole, and going down again from the root the decisions are read off.

use super::binary::{BinaryNode, BinaryTree};
use super::plan::Plan;
use crate::layout::Bounds;
use crate::parameters::TreeParameters;

/// Fewest leaves of a subtree that is worth a task of its own.
const LEAVES_PER_TASK: u32 = 4096;

/// Levels on which tasks are split off. Below, and where the tree is very uneven, everything is done in a
/// row.
const TASK_LEVELS: u32 = 32;

/// Cost of a subtree as at most `i + 1` children of one node, for each `i`.
type Costs<const W: usize> = [f32; W];

/// What nodes and leaves cost.
struct Model {
    traversal_cost: f32,
    intersection_cost: f32,
    block: u32,
    min_leaf_size: u32,
    max_leaf_size: u32,
    /// Area of the root.
    area: f64,
}

impl Model {
    fn new(parameters: &TreeParameters, root: &BinaryNode) -> Self {
        Self {
            traversal_cost: parameters.traversal_cost,
            intersection_cost: parameters.intersection_cost,
            block: parameters.sah_block_size,
            min_leaf_size: parameters.min_leaf_size,
            max_leaf_size: parameters.max_leaf_size,
            area: root.bounds().half_area(),
        }
    }

    /// Probability that a ray that meets the root's box meets this one. Where nothing has an area, boxes are
    /// as good as equal.
    fn share(&self, node: &BinaryNode) -> f32 {
        if self.area > 0.0 { (node.bounds().half_area() / self.area) as f32 } else { 1.0 }
    }

    fn leaf(&self, node: &BinaryNode) -> f32 {
        self.share(node) * self.intersection_cost * node.leaves().div_ceil(self.block) as f32
    }

    fn must_be_leaf(&self, node: &BinaryNode) -> bool {
        node.leaves() <= self.min_leaf_size
    }

    fn may_be_leaf(&self, node: &BinaryNode) -> bool {
        node.leaves() <= self.max_leaf_size
    }

    /// The costs of an inner node from those of its children.
    #[inline(always)]
    fn costs<const W: usize>(&self, node: &BinaryNode, left: &Costs<W>, right: &Costs<W>) -> Costs<W> {
        if self.must_be_leaf(node) {
            return [self.leaf(node); W];
        }
        let mut costs = [f32::INFINITY; W];
        for children in 2..=W {
            costs[children - 1] = shared(left, right, children);
        }
        let as_node = costs[W - 1] + self.share(node) * self.traversal_cost;
        costs[0] = if self.may_be_leaf(node) { as_node.min(self.leaf(node)) } else { as_node };
        for children in 1..W {
            costs[children] = costs[children].min(costs[children - 1]);
        }
        costs
    }
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
    let model = Model::new(parameters, tree.root());
    let mut costs = vec![[0.0; W]; tree.nodes.len()];
    let (top, below) = costs.split_at_mut(2);
    top[0] = solve(tree, &model, 0, below, 2, TASK_LEVELS);

    let triangles = tree.root().leaves() as usize;
    let mut plan = Plan::with_capacity(triangles / W, triangles / 2, triangles);
    let (mut stack, mut ends) = (Vec::new(), Vec::new());
    plan.grow((tree.root().bounds(), 0), |plan, number, found| {
        let node = &tree.nodes[number];
        if model.may_be_leaf(node) && model.leaf(node) <= costs[number][0] {
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
        children(tree, &costs, number, found);
        None
    });
    plan
}

/// Costs of a node; those of the nodes below it, which follow number `first`, go into `below`.
fn solve<const W: usize>(
    tree: &BinaryTree,
    model: &Model,
    node: usize,
    below: &mut [Costs<W>],
    first: usize,
    levels: u32,
) -> Costs<W> {
    let this = &tree.nodes[node];
    if this.leaves() < LEAVES_PER_TASK || levels == 0 {
        // Children have higher numbers than their parents.
        for place in (0..below.len()).rev() {
            let number = first + place;
            below[place] = match tree.nodes[number].first_child() {
                Some(pair) => {
                    let [left, right] = [below[pair - first], below[pair + 1 - first]];
                    model.costs(&tree.nodes[number], &left, &right)
                }
                None => [model.leaf(&tree.nodes[number]); W],
            };
        }
        return match this.first_child() {
            Some(_) => model.costs(this, &below[0], &below[1]),
            None => [model.leaf(this); W],
        };
    }
    let (pair, below) = below.split_at_mut(2);
    let of_left = 2 * (tree.nodes[first].leaves() as usize - 1);
    let (below_left, below_right) = below.split_at_mut(of_left);
    let (left, right) = rayon::join(
        || solve(tree, model, first, below_left, first + 2, levels - 1),
        || solve(tree, model, first + 1, below_right, first + 2 + of_left, levels - 1),
    );
    (pair[0], pair[1]) = (left, right);
    model.costs(this, &left, &right)
}

/// Lists the children that a wide node made of `number` has.
fn children<const W: usize>(
    tree: &BinaryTree,
    costs: &[Costs<W>],
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
        let of_this = &costs[number];
        if share < W {
            while share > 1 && of_this[share - 2] == of_this[share - 1] {
                share -= 1;
            }
            if share == 1 {
                found.push((tree.nodes[number].bounds(), number));
                continue;
            }
        }
        let Some(first) = tree.nodes[number].first_child() else {
            unreachable!("a leaf costs the same as any number of children");
        };
        let (left, right) = (&costs[first], &costs[first + 1]);
        let least = shared(left, right, share);
        let of_left = (1..share).find(|of_left| left[of_left - 1] + right[share - of_left - 1] == least);
        let of_left = of_left.expect("the least of these sums is one of them");
        open[count] = (first + 1, share - of_left);
        open[count + 1] = (first, of_left);
        count += 2;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::binary::tests::{boxes, halved};
    use super::super::plan::{Link, Named};
    use super::*;
    use crate::layout::Bounds;

    /// What the plan costs by the model of its parameters, without the factor that all have in common.
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
        let Some(first) = this.first_child() else {
            return leaf;
        };
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
