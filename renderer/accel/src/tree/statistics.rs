//! Counts of a tree, and its cost by the surface area heuristic.

use serde::Serialize;

use super::{Tree, walk::Met};

/// Shape and size of a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TreeStatistics {
    /// Inner nodes.
    pub nodes: usize,
    /// Leaves.
    pub leaves: usize,
    /// Levels below the root: 0 if the root is a leaf.
    pub depth: u32,
    /// Triangles summed over all leaves: more than the triangles there are if the builder split some.
    pub triangle_references: usize,
    /// Bytes of nodes and leaves, without the slack of the allocator.
    pub bytes: usize,
    /// Expected nodes visited and triangles tested by a ray that hits the root (MacDonald and Booth, 1990).
    pub sah_cost: f64,
}

impl Tree {
    /// Counts the tree by walking it: takes milliseconds per million triangles.
    pub fn statistics(&self) -> TreeStatistics {
        let mut statistics = TreeStatistics::default();
        let root_area = self.root.bounds.half_area();
        let share = |area: f64| {
            if root_area > 0.0 { area / root_area } else { 1.0 }
        };
        self.walk(&mut |met| match met {
            Met::Node { bounds, depth, bytes, .. } => {
                statistics.nodes += 1;
                statistics.depth = statistics.depth.max(depth);
                statistics.bytes += bytes;
                statistics.sah_cost += share(bounds.half_area());
            }
            Met::Leaf { bounds, depth, bytes, numbers, .. } => {
                statistics.leaves += 1;
                statistics.depth = statistics.depth.max(depth);
                statistics.bytes += bytes;
                statistics.triangle_references += numbers.len();
                statistics.sah_cost += share(bounds.half_area()) * numbers.len() as f64;
            }
        });
        statistics
    }
}
