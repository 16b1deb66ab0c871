//! The order of nodes and leaves in memory: depth first.
//!
//! A ray goes down the tree, so nodes that it visits one after the other should lie close together: in shared
//! cache lines, pages and prefetch streams. A node's largest child, the likeliest next step, lies right
//! behind it.

use super::plan::{Child, Link, Named, Plan};

/// Every node and leaf of the plan once.
pub(super) fn sequence(plan: &Plan) -> Vec<Link> {
    let mut sequence = Vec::with_capacity(plan.nodes() + plan.leaves());
    let mut stack = vec![plan.root.link];
    let mut below = Vec::new();
    while let Some(link) = stack.pop() {
        sequence.push(link);
        below.clear();
        below.extend(children(plan, link).iter().map(|child| (child.bounds.half_area(), child.link)));
        below.sort_by(|a, b| a.0.total_cmp(&b.0));
        stack.extend(below.iter().map(|&(_, link)| link));
    }
    sequence
}

fn children(plan: &Plan, link: Link) -> &[Child] {
    match link.named() {
        Named::Node(node) => plan.children(node),
        Named::Leaf(_) => &[],
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{binary::halved, binary::tests::boxes, collapse::collapse};
    use super::*;
    use crate::parameters::TreeParameters;

    proptest! {
        #[test]
        fn every_node_and_leaf_comes_once_and_the_largest_child_right_after_its_parent(leaves in boxes()) {
            let mut tree = halved(&leaves);
            tree.renumber();
            let plan = collapse::<4>(&tree, &TreeParameters { max_leaf_size: 2, ..TreeParameters::default() });
            let sequence = sequence(&plan);
            let place = |link| sequence.iter().position(|&other| other == link);
            prop_assert_eq!(sequence.len(), plan.nodes() + plan.leaves());
            prop_assert_eq!(place(plan.root.link), Some(0));
            for node in 0..plan.nodes() {
                let own = place(Link::node(node)).expect("it is there");
                let areas = plan.children(node).iter().map(|child| child.bounds.half_area());
                let largest = areas.fold(0.0, f64::max);
                for child in plan.children(node) {
                    prop_assert!(place(child.link).is_some_and(|place| place > own));
                }
                let next = plan.children(node).iter().find(|child| place(child.link) == Some(own + 1));
                prop_assert_eq!(next.map(|child| child.bounds.half_area()), Some(largest));
            }
        }
    }
}
