//! In which order nodes and leaves lie in memory.
//!
//! A ray goes down the tree, so what it visits one after the other should lie close together: in the same cache
//! lines, pages and prefetch streams.
//!
//! * Depth first: a node's first child lies right behind it.
//! * Van Emde Boas: the upper half of the levels lies in front, then each subtree below, all arranged the same
//!   way. Whatever the size of a cache's blocks is, few are touched on the way down (Prokop 1999; for bounding
//!   volumes Yoon and Manocha, "Cache-Efficient Layouts of Bounding Volume Hierarchies", 2006).
//! * Treelets: connected pieces of a few kilobytes, grown by the probability that a ray visits a node, which is
//!   the area of its box over that of the root (after Aila and Karras, "Architecture Considerations for Tracing
//!   Incoherent Rays", 2010). The hottest treelets come first.

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
    while let Some(link) = stack.pop() {
        sequence.push(link);
        stack.extend(children(plan, link).iter().rev().map(|child| child.link));
    }
}

/// Arranges `levels` levels from `top` down, and lists in `below` what hangs underneath. Recursion is as deep as
/// the number of levels has bits.
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
        // What the treelet has no room for begins others.
        roots.append(&mut inside);
    }
}
