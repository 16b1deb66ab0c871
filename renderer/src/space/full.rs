//! The full space: two back ends, and the renderer's options besides its tree.
//!
//! `backend` is itself a parameter. Native Embree has its build quality and how that splits triangles. The
//! tunable tree has the rest of Table 1 and parameters that make a tree fast beyond the paper. Both share the
//! grouping of pixels and the tracing of each class of rays. A parameter that cannot act is inactive, or not
//! there at all:
//!
//! * `robust` decides which hits are found at edges. That is a question of correctness, which the user
//!   decides (`--robust`) and not the search. Embree's quality high falls back to medium with it.
//! * `compact` of Table 1 is native Embree's compact scene. It is in the paper's space alone: layouts act
//!   with medium quality, and such scenes are behind the tunable tree with AVX2
//!   (`docs/measurements/lean.md`).
//! * Spatial splits and their budget act with high quality; its values are few, because each takes a device.
//! * Of Table 1's two costs only the ratio acts: `traversal_cost` counts in triangle tests.
//! * Table 1's `static` sets a builder flag that a tree built once does not feel. How a structure follows
//!   what moves takes many frames to judge; the space `follow` has it.
//! * Trees shallower than 24 levels were never among the good ones, and every tenth of them cannot be built.
//! * Camera rays and their shadow rays go in packets of sixteen, all others alone, in the order of their
//!   pixels: neither other packets nor sorting pay, nor do other tiles or fewer threads.
//! * From the second bounce on, several rays can take turns (`bounce_flight`): 1.03 times as fast in the
//!   geometric mean of eight scenes, at most 1.09 (`docs/measurements/lean.md`). Path by path,
//!   and in scenes of instances, that is without effect.
//! * Only the best grouping of a finished tree makes nodes of sixteen, so it has a parameter of its own for
//!   the width.
//! * A scene without lights that are sampled has no shadow rays; their parameters stay part of the one space
//!   of all scenes, and are without effect there.
//!
//! The default is the best configuration known by hand, so that a search starts strong: tiles in stages,
//! packets of sixteen for camera rays and their shadow rays, and our own tree. Where one build serves many
//! frames it is grouped and improved after the build (over native medium, path by path: 1.4 to 2.2 times on
//! seven scenes). Where each frame pays for its build, our own builder makes it from runs of eight triangles
//! (over the tree of Embree's Morton builder, build and frame together: 0.89 to 1.42 times on seven scenes,
//! 1.11 in the geometric mean).

use super::explained::{Explained, boolean, choice, float, integer};
use super::{NATIVE, Premises, TUNABLE};

/// The parameters, those of the builds first.
pub(super) fn parameters(premises: &Premises) -> Vec<Explained> {
    let mut all = vec![choice(
        "backend",
        [NATIVE, TUNABLE],
        TUNABLE,
        "whose tree: Embree's own ready-made one, or the tunable one",
    )];
    all.extend(native(premises));
    all.extend(tunable(premises));
    all.push(boolean(
        "staged",
        true,
        "all camera rays of a tile, then all their shadow rays, and so on, in packets; otherwise path by path",
    ));
    all.push(
        choice(
            "bounce_flight",
            [1, 4, 8],
            4,
            "in stages, how many rays from the second bounce on take turns, so that they wait for memory together",
        )
        .only_while("backend", [TUNABLE]),
    );
    all
}

fn native(premises: &Premises) -> Vec<Explained> {
    let levels: &[&str] = if premises.robust { &["low", "medium"] } else { &["low", "medium", "high"] };
    let default = match (premises.builds_each_frame, premises.robust) {
        (true, _) => "low",
        (false, true) => "medium",
        (false, false) => "high",
    };
    let quality = choice(
        "native_quality",
        levels.iter().copied(),
        default,
        "how carefully Embree builds: low by Morton codes, medium by the surface area heuristic, high also splits triangles",
    );
    let mut all = vec![quality.only_while("backend", [NATIVE])];
    if !premises.robust {
        let high = |one: Explained| one.only_while("native_quality", ["high"]);
        all.push(high(choice(
            "native_split_budget",
            [1.2, 1.5, 2.0, 3.0],
            1.2,
            "how many references triangles may be split into, on average",
        )));
        all.push(high(boolean("native_presplit", false, "split triangles before the build, not during it")));
    }
    all
}

fn tunable(premises: &Premises) -> Vec<Explained> {
    let tunable = |one: Explained| one.only_while("backend", [TUNABLE]);
    let sah = |one: Explained| one.only_while("quality", [2, 3]);
    let each_frame = premises.builds_each_frame;
    let quality = if each_frame { 1 } else { 2 };
    let collapse = if each_frame { "builder" } else { "optimal" };
    // Leaves of less than a block leave lanes empty; a tree for one frame is built sooner with larger ones.
    let min_leaf_size = if each_frame { 16 } else { 8 };
    vec![
        tunable(choice(
            "builder",
            ["embree", "ploc"],
            if each_frame { "ploc" } else { "embree" },
            "who builds the tree: Embree's builders, or one that joins neighbours from the triangles up",
        )),
        integer(
            "quality",
            1..=3,
            quality,
            "how carefully the tree is built: 1 fast, 2 careful, 3 careful and splitting triangles",
        )
        .only_while("builder", ["embree"]),
        choice(
            "search_radius",
            [4, 8, 16, 32],
            if each_frame { 4 } else { 8 },
            "among how many neighbours either way a box looks for another",
        )
        .only_while("builder", ["ploc"]),
        choice(
            "cluster_size",
            [1, 2, 4, 8],
            if each_frame { 8 } else { 1 },
            "how many triangles next to each other begin as one box: more build faster",
        )
        .only_while("builder", ["ploc"]),
        tunable(choice(
            "collapse",
            ["builder", "optimal"],
            collapse,
            "who makes the wide boxes: the builder as it goes, or the best grouping of a finished tree",
        )),
        choice("branching_factor", [2, 4, 8], 8, "how many boxes each box holds")
            .only_while("collapse", ["builder"]),
        choice("node_width", [2, 4, 8, 16], 16, "how many boxes each box holds")
            .only_while("collapse", ["optimal"]),
        integer(
            "reinsertion_passes",
            0..=16,
            4,
            "how often the finished tree is improved by moving branches",
        )
        .only_while("collapse", ["optimal"]),
        tunable(integer("max_depth", 24..=64, 64, "how deep boxes may be nested")),
        sah(choice(
            "sah_block_size",
            [1, 2, 4, 8, 16, 32],
            4,
            "the builder counts triangles in groups of this many",
        )),
        tunable(
            integer("min_leaf_size", 1..=32, min_leaf_size, "fewest triangles in an innermost box").log(),
        ),
        tunable(integer("max_leaf_size", 1..=32, 32, "most triangles in an innermost box").log()),
        sah(float("traversal_cost", 0.1..=10.0, 1.0, "what a box test costs, in triangle tests").log()),
        float("split_budget", 1.0..=2.0, 1.2, "how many references triangles may be split into, on average")
            .only_while("quality", [3]),
        tunable(choice("block_width", [4, 8], 8, "how many triangles are tested at once")),
    ]
}
