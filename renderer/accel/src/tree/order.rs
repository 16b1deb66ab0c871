//! The order of nodes and leaves in memory.
//!
//! A ray goes down the tree, so nodes that it visits one after the other should lie close together: in the
//! same cache lines, pages and prefetch streams.
//!
//! * Depth first: a node's largest child, the likeliest next step, lies right behind it.
//! * Van Emde Boas: the upper half of the levels lies in front, then each subtree below, all arranged the
//!   same way. The way down touches few of a cache's blocks, for blocks of any size (Prokop 1999; for
//!   bounding volumes Yoon and Manocha, "Cache-Efficient Layouts of Bounding Volume Hierarchies", 2006).
//! * Treelets: connected pieces of a few kilobytes, grown by the probability that a ray visits a node, which
//!   is the area of its box over that of the root (after Aila and Karras, "Architecture Considerations for
//!   Tracing Incoherent Rays", 2010). The hottest treelets come first.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::plan::{Child, Link, Named, Plan};
use crate::parameters::NodeOrder;

/// Nodes and leaves a treelet: of the most common layout (256 bytes a node) about a page of 4 KiB.
const TREELET: usize = 16;

/// Every node and leaf of the plan once.
pub(super) fn sequence(plan: &Plan, order: NodeOrder) -> Vec<Link> {
    let mut sequence = Vec::with_capacity(plan.nodes() + plan.leaves());
    match order {
        NodeOrder::Builder => {
            sequence.extend((0..plan.nodes()).map(Link::node));
            sequence.extend((0..plan.leaves()).map(Link::leaf));
        }
        NodeOrder::DepthFirst => depth_first(plan, &mut sequence),
        NodeOrder::VanEmdeBoas => {
            van_emde_boas(plan, plan.root.link, plan.depth + 1, &mut sequence, &mut Vec::new());
        }
        NodeOrder::Treelets => treelets(plan, &mut sequence),
    }
    sequence
}

fn children(plan: &Plan, link: Link) -> &[Child] {
    match link.named() {
        Named::Node(node) => plan.children(node),
        Named::Leaf(_) => &[],
    }
}

fn depth_first(plan: &Plan, sequence: &mut Vec<Link>) {
    let mut stack = vec![plan.root.link];
    let mut below = Vec::new();
    while let Some(link) = stack.pop() {
        sequence.push(link);
        below.clear();
        below.extend(children(plan, link).iter().map(|child| (child.bounds.half_area(), child.link)));
        below.sort_by(|a, b| a.0.total_cmp(&b.0));
        stack.extend(below.iter().map(|&(_, link)| link));
    }
}

/// Arranges `levels` levels from `top` down, and lists in `below` what hangs underneath. Recursion is as deep
/// as the number of levels has bits.
fn van_emde_boas(plan: &Plan, top: Link, levels: u32, sequence: &mut Vec<Link>, below: &mut Vec<Link>) {
    if levels == 1 {
        sequence.push(top);
        below.extend(children(plan, top).iter().map(|child| child.link));
        return;
    }
    let upper = levels / 2;
    let mut middle = Vec::new();
    van_emde_boas(plan, top, upper, sequence, &mut middle);
    for link in middle {
        van_emde_boas(plan, link, levels - upper, sequence, below);
    }
}

/// A node or leaf that could come next; the larger, the sooner, and of equal ones the one met first.
struct Candidate {
    area: f64,
    met: usize,
    link: Link,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.area.total_cmp(&other.area).then(other.met.cmp(&self.met))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

fn treelets(plan: &Plan, sequence: &mut Vec<Link>) {
    let mut met = 0;
    let mut candidate = |child: &Child| {
        met += 1;
        Candidate { area: child.bounds.half_area(), met, link: child.link }
    };
    let mut roots = BinaryHeap::from([candidate(&plan.root)]);
    let mut inside = BinaryHeap::new();
    while let Some(root) = roots.pop() {
        inside.push(root);
        for _ in 0..TREELET {
            let Some(hottest) = inside.pop() else {
                break;
            };
            sequence.push(hottest.link);
            inside.extend(children(plan, hottest.link).iter().map(&mut candidate));
        }
        // Nodes that the treelet has no room for begin others.
        roots.append(&mut inside);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::binary::tests::{boxes, halved};
    use super::super::collapse::collapse;
    use super::*;
    use crate::parameters::TreeParameters;

    proptest! {
        #[test]
        fn every_node_and_leaf_comes_once_and_after_its_parent(leaves in boxes()) {
            let mut tree = halved(&leaves);
            tree.renumber();
            let plan = collapse::<4>(&tree, &TreeParameters { max_leaf_size: 2, ..TreeParameters::default() });
            for order in
                [NodeOrder::Builder, NodeOrder::DepthFirst, NodeOrder::VanEmdeBoas, NodeOrder::Treelets]
            {
                let sequence = sequence(&plan, order);
                let place = |link| sequence.iter().position(|&other| other == link);
                prop_assert_eq!(sequence.len(), plan.nodes() + plan.leaves());
                prop_assert_eq!(place(plan.root.link), Some(0));
                for node in 0..plan.nodes() {
                    for child in plan.children(node) {
                        prop_assert!(place(Link::node(node)) < place(child.link), "{:?}", order);
                    }
                }
            }
        }
    }
}
