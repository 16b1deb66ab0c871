//! The eleven parameters of the paper's Table 1, for reproduction; `docs/paper.md` says where ranges differ.
//!
//! Two rules make parameters inactive: `compact` is Embree's own compact structure and has none of the
//! others but `robust` (section 4.1), and the Morton builder (quality 1) ignores the block size and both
//! costs (section 3.2). Leaves of more than 32 triangles overrun the builder, so the leaf sizes end there.

use super::explained::{Explained, boolean, choice, float, integer};

/// The parameters of Table 1 with their recommended values as defaults.
pub(super) fn parameters() -> Vec<Explained> {
    let tree = |one: Explained| one.only_while("compact", [false]);
    let sah = |one: Explained| one.only_while("quality", [2, 3]);
    vec![
        boolean("compact", false, "use Embree's memory-saving structure instead"),
        boolean("robust", false, "watertight tests at edges, at some cost"),
        tree(integer(
            "quality",
            1..=3,
            2,
            "how carefully the tree is built: 1 fast, 2 careful, 3 careful and splitting triangles",
        )),
        tree(choice("branching_factor", [2, 4, 8], 2, "how many boxes each box holds")),
        tree(integer("max_depth", 9..=64, 32, "how deep boxes may be nested")),
        sah(choice(
            "sah_block_size",
            [1, 2, 4, 8, 16, 32],
            1,
            "the builder counts triangles in groups of this many",
        )),
        tree(integer("min_leaf_size", 1..=32, 1, "fewest triangles in an innermost box")),
        tree(integer("max_leaf_size", 1..=32, 32, "most triangles in an innermost box")),
        sah(float("traversal_cost", 0.0..=10.0, 1.0, "what the builder believes a box test costs")),
        sah(float("intersection_cost", 0.1..=10.0, 1.0, "what the builder believes a triangle test costs")),
        tree(boolean("static", false, "promise that the geometry will not change")),
    ]
}
