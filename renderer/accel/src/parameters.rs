//! What a build can be told: the eleven parameters of the paper's Table 1, and native Embree's options.

use serde::{Deserialize, Serialize};

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

/// The eleven parameters of Table 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TreeParameters {
    /// Builder.
    pub quality: Quality,
    /// Children a node: 2, 4 or 8.
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
    /// Optimise memory use: Embree's native compact scene, which has none of the other parameters but `robust`.
    pub compact: bool,
    /// Watertight intersection.
    pub robust: bool,
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
        }
    }
}

/// Build quality of a native Embree scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NativeQuality {
    /// Morton builder.
    Low,
    /// Binned SAH: Embree's default.
    #[default]
    Medium,
    /// Binned SAH with spatial splits.
    High,
}

/// Options of a native Embree scene. The default is what `rtcCommitScene` does untold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct NativeOptions {
    /// Build quality.
    pub quality: NativeQuality,
    /// `RTC_SCENE_FLAG_COMPACT`.
    pub compact: bool,
    /// `RTC_SCENE_FLAG_DYNAMIC`.
    pub dynamic: bool,
    /// `RTC_SCENE_FLAG_ROBUST`.
    pub robust: bool,
}

/// Which structure to build, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BuildChoice {
    /// The paper's space: `rtcBuildBVH` into our own layout, or the native compact scene where `compact` is set.
    Tree(TreeParameters),
    /// A native Embree scene.
    Native(NativeOptions),
    /// No structure: every triangle is tested. The oracle of the tests.
    BruteForce,
}
