//! Parameters of a build: the eleven of the paper's Table 1, and further ones that make a tree fast.

use serde::{Deserialize, Serialize};

use crate::error::BuildError;
use crate::limits::{
    CLUSTER_SIZE_RANGE, COST_MAX, LEAF_SIZE_MAX, MAX_DEPTH, REBUILD_THRESHOLD_RANGE, REINSERTION_PASSES_MAX,
    SAH_BLOCK_SIZE_MAX, SEARCH_RADIUS_RANGE, SPLIT_BUDGET, SPLIT_BUDGET_RANGE,
};
pub use crate::native_options::{NativeOptions, NativeQuality};

/// Builder of the tunable tree (Table 1 `quality` 1, 2, 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// 1: Morton codes.
    Morton,
    /// 2: binned surface area heuristic.
    Sah,
    /// 3: binned surface area heuristic with spatial (primitive) splits.
    SahSplit,
}

/// Whose builder makes the tunable tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Builder {
    /// Embree's, by [`Quality`].
    #[default]
    Embree,
    /// Our own: locally-ordered clustering of triangles along a Morton curve.
    Ploc,
}

/// The eleven parameters of Table 1, and behind them those that make a tree fast beyond the paper. The
/// defaults of the latter are the values that the paper's space fixes.
///
/// Not every parameter matters in every configuration:
///
/// | when | inactive |
/// |---|---|
/// | `compact` | all others but `robust`: the tree is Embree's own |
/// | `quality` is [`Quality::Morton`] | `sah_block_size`, `traversal_cost`, `intersection_cost` (paper, section 3.2); `max_leaf_size` acts only near the depth limit |
/// | `quality` is not [`Quality::SahSplit`] | `split_budget` |
/// | `builder` is [`Builder::Ploc`] | `quality`, `split_budget`, `static_scene` |
/// | `builder` is [`Builder::Embree`] | `search_radius`, `cluster_size` |
/// | `collapse` is [`Collapse::Builder`] | `reinsertion_passes` |
/// | always | of the two costs only their ratio acts; `static_scene` sets a builder flag that a tree built once and never updated does not feel (paper, section 4.1, finds the same of the last three) |
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TreeParameters {
    /// Builder.
    pub quality: Quality,
    /// Children a node: 2, 4 or 8; with [`Collapse::Optimal`] also 16.
    pub branching_factor: u32,
    /// Depth limit, 9 to 64. Builds that need more fail.
    pub max_depth: u32,
    /// Triangles counted in blocks of this size by the heuristic: a power of two, 1 to 32.
    pub sah_block_size: u32,
    /// Fewest triangles a leaf, 1 to `max_leaf_size`.
    pub min_leaf_size: u32,
    /// Most triangles a leaf, `min_leaf_size` to 32.
    pub max_leaf_size: u32,
    /// Cost of a traversal step in the heuristic, 0 to 10.
    pub traversal_cost: f32,
    /// Cost of a triangle test in the heuristic, above 0 to 10.
    pub intersection_cost: f32,
    /// Optimise for a static scene (otherwise Embree's dynamic flag is set).
    pub static_scene: bool,
    /// Embree's native compact scene, which has none of the other parameters but `robust`.
    pub compact: bool,
    /// Watertight intersection.
    pub robust: bool,
    /// Triangles a block of a leaf: 4 or 8, tested at once.
    pub block_width: u32,
    /// Whose builder.
    pub builder: Builder,
    /// Neighbours along the curve, either way, that a cluster may join: 1 to 32, with [`Builder::Ploc`].
    pub search_radius: u32,
    /// The most neighbouring triangles on the curve that begin as one cluster: 1 to 8. More build faster and
    /// a little worse. Acts with [`Builder::Ploc`] only.
    pub cluster_size: u32,
    /// The way to the wide tree.
    pub collapse: Collapse,
    /// Passes of insertion-based optimisation, 0 to 16. Acts with [`Collapse::Optimal`] only.
    pub reinsertion_passes: u32,
    /// Room for the references of spatial splits: 1 to 2 times the triangles, with [`Quality::SahSplit`].
    pub split_budget: f32,
}

/// The way to a tree of many children a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Collapse {
    /// The builder makes wide nodes at once, as in the paper. They lie in memory as its threads made them.
    #[default]
    Builder,
    /// The wide tree and leaves of least expected cost over a binary tree, by dynamic programming.
    Optimal,
}

impl Default for TreeParameters {
    /// The recommended configuration of Table 1.
    fn default() -> Self {
        Self {
            quality: Quality::Sah,
            branching_factor: 2,
            max_depth: 32,
            sah_block_size: 1,
            min_leaf_size: 1,
            max_leaf_size: 32,
            traversal_cost: 1.0,
            intersection_cost: 1.0,
            static_scene: false,
            compact: false,
            robust: false,
            block_width: 4,
            builder: Builder::Embree,
            search_radius: 8,
            cluster_size: 1,
            collapse: Collapse::Builder,
            reinsertion_passes: 0,
            split_budget: SPLIT_BUDGET,
        }
    }
}

impl TreeParameters {
    /// Checks that every active parameter lies in its range and that they fit together.
    pub fn check(&self) -> Result<(), BuildError> {
        if self.compact {
            return Ok(());
        }
        let Self { branching_factor, max_depth, sah_block_size, min_leaf_size, max_leaf_size, .. } = self;
        let Self { traversal_cost, intersection_cost, block_width, reinsertion_passes, .. } = self;
        let Self { split_budget, search_radius, cluster_size, .. } = self;
        let check = |fits: bool, parameter, value: &dyn std::fmt::Display, rule| match fits {
            true => Ok(()),
            false => Err(BuildError::InvalidParameters { parameter, value: value.to_string(), rule }),
        };
        let name = "branching_factor";
        check([2, 4, 8, 16].contains(branching_factor), name, branching_factor, "it must be 2, 4, 8 or 16")?;
        // Not every builder of Embree makes nodes of sixteen.
        let can_be_made = *branching_factor < 16 || self.collapse == Collapse::Optimal;
        check(can_be_made, name, branching_factor, "16 needs the optimal collapse")?;
        check(MAX_DEPTH.contains(max_depth), "max_depth", max_depth, "it must be 9 to 64")?;
        let is_power = sah_block_size.is_power_of_two() && *sah_block_size <= SAH_BLOCK_SIZE_MAX;
        check(is_power, "sah_block_size", sah_block_size, "it must be a power of two, 1 to 32")?;
        let leaf_sizes = 1..=LEAF_SIZE_MAX;
        check(leaf_sizes.contains(max_leaf_size), "max_leaf_size", max_leaf_size, "it must be 1 to 32")?;
        let fits = (1..=*max_leaf_size).contains(min_leaf_size);
        check(fits, "min_leaf_size", min_leaf_size, "it must be 1 to max_leaf_size")?;
        // NaN lies in no range.
        let fits = (0.0..=COST_MAX).contains(traversal_cost);
        check(fits, "traversal_cost", traversal_cost, "it must be 0 to 10")?;
        let fits = (f32::MIN_POSITIVE..=COST_MAX).contains(intersection_cost);
        check(fits, "intersection_cost", intersection_cost, "it must be above 0, to 10")?;
        check([4, 8].contains(block_width), "block_width", block_width, "it must be 4 or 8")?;
        let fits = *reinsertion_passes <= REINSERTION_PASSES_MAX;
        check(fits, "reinsertion_passes", reinsertion_passes, "it must be 0 to 16")?;
        check(SPLIT_BUDGET_RANGE.contains(split_budget), "split_budget", split_budget, "it must be 1 to 2")?;
        let fits = SEARCH_RADIUS_RANGE.contains(search_radius);
        check(fits, "search_radius", search_radius, "it must be 1 to 32")?;
        check(CLUSTER_SIZE_RANGE.contains(cluster_size), "cluster_size", cluster_size, "it must be 1 to 8")
    }
}

/// The update of a structure after triangles have moved. `rebuild_threshold` acts with the partial one only,
/// for which native scenes refit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Update {
    /// It is rebuilt.
    #[default]
    Rebuild,
    /// The triangles of a node stay together; boxes follow.
    Refit,
    /// As [`Update::Refit`], then parts are rebuilt whose SAH cost has grown too much since their build.
    Partial {
        /// Greatest ratio of the cost to that of the last build: 1 to 4.
        rebuild_threshold: f32,
    },
}

impl Update {
    /// A threshold to begin with.
    pub const REBUILD_THRESHOLD: f32 = 1.3;

    /// A partial update with this threshold.
    pub const fn partial(rebuild_threshold: f32) -> Self {
        Self::Partial { rebuild_threshold }
    }

    /// Checks that the threshold, where there is one, lies in its range.
    pub fn check(&self) -> Result<(), BuildError> {
        match *self {
            Self::Partial { rebuild_threshold } if !REBUILD_THRESHOLD_RANGE.contains(&rebuild_threshold) => {
                Err(BuildError::InvalidParameters {
                    parameter: "rebuild_threshold",
                    value: rebuild_threshold.to_string(),
                    rule: "it must be 1 to 4",
                })
            }
            _ => Ok(()),
        }
    }
}

/// Which structure to build, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BuildChoice {
    /// The paper's space: `rtcBuildBVH` into our own layout, or the native scene where `compact` is set.
    Tree(TreeParameters),
    /// A native Embree scene.
    Native(NativeOptions),
    /// No structure: every triangle is tested. The oracle of the tests.
    BruteForce,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_1_is_valid_and_each_mistake_is_named() {
        let good = TreeParameters::default();
        assert_eq!(good.check(), Ok(()));
        let sixteen = TreeParameters { branching_factor: 16, collapse: Collapse::Optimal, ..good };
        assert_eq!(sixteen.check(), Ok(()));
        let bad = [
            (TreeParameters { branching_factor: 3, ..good }, "branching_factor"),
            (TreeParameters { branching_factor: 16, ..good }, "branching_factor"),
            (
                TreeParameters { branching_factor: 32, collapse: Collapse::Optimal, ..good },
                "branching_factor",
            ),
            (TreeParameters { block_width: 6, ..good }, "block_width"),
            (TreeParameters { search_radius: 0, ..good }, "search_radius"),
            (TreeParameters { search_radius: 33, ..good }, "search_radius"),
            (TreeParameters { cluster_size: 0, ..good }, "cluster_size"),
            (TreeParameters { cluster_size: 9, ..good }, "cluster_size"),
            (TreeParameters { max_depth: 8, ..good }, "max_depth"),
            (TreeParameters { max_depth: 65, ..good }, "max_depth"),
            (TreeParameters { sah_block_size: 0, ..good }, "sah_block_size"),
            (TreeParameters { sah_block_size: 3, ..good }, "sah_block_size"),
            (TreeParameters { sah_block_size: 64, ..good }, "sah_block_size"),
            (TreeParameters { max_leaf_size: 33, ..good }, "max_leaf_size"),
            (TreeParameters { max_leaf_size: 0, ..good }, "max_leaf_size"),
            (TreeParameters { min_leaf_size: 0, ..good }, "min_leaf_size"),
            (TreeParameters { min_leaf_size: 9, max_leaf_size: 8, ..good }, "min_leaf_size"),
            (TreeParameters { traversal_cost: f32::NAN, ..good }, "traversal_cost"),
            (TreeParameters { traversal_cost: -1.0, ..good }, "traversal_cost"),
            (TreeParameters { intersection_cost: 0.0, ..good }, "intersection_cost"),
            (TreeParameters { intersection_cost: f32::INFINITY, ..good }, "intersection_cost"),
        ];
        for (parameters, name) in bad {
            match parameters.check() {
                Err(BuildError::InvalidParameters { parameter, .. }) => assert_eq!(parameter, name),
                other => panic!("{parameters:?} gave {other:?}"),
            }
            // Nothing but `robust` acts beside `compact`.
            assert_eq!(TreeParameters { compact: true, ..parameters }.check(), Ok(()));
        }
    }
}
