//! Options of a renderer besides its tree: the grouping of pixels, and the tracing of each class of rays.

use serde::{Deserialize, Serialize};
use treewright_accel::Packets;

/// The order of work of a frame. Pictures do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct RenderOptions {
    /// Tiles in stages (all camera rays, all their shadow rays, all first bounces, …) or path by path.
    pub staged: bool,
    /// Edge of a tile in pixels: 8, 16, 32 or 64.
    pub tile: u32,
    /// In which order tiles are begun.
    pub tile_order: TileOrder,
    /// Rays from the camera. Packets need `staged`.
    pub primary: Packets,
    /// Shadow rays of the points the camera sees.
    pub first_shadow: Packets,
    /// Rays after a bounce.
    pub bounce: Packets,
    /// Shadow rays after a bounce.
    pub shadow: Packets,
    /// The order of rays after a bounce inside a tile.
    pub sort: Sort,
    /// The number of the renderer's threads that work on a frame; 0 for all of them.
    pub threads: u32,
}

/// In which order tiles are begun.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TileOrder {
    /// Row by row.
    #[default]
    Rows,
    /// Along a Morton curve.
    Morton,
}

/// The order of rays after a bounce.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sort {
    /// As their pixels lie.
    #[default]
    None,
    /// By the octant of the direction.
    Octant,
    /// By the octant, then along a Morton curve by origin.
    OctantMorton,
}

impl Default for RenderOptions {
    /// Path by path, ray by ray: what a simple renderer does.
    fn default() -> Self {
        Self {
            staged: false,
            tile: 16,
            tile_order: TileOrder::Rows,
            primary: Packets::Single,
            first_shadow: Packets::Single,
            bounce: Packets::Single,
            shadow: Packets::Single,
            sort: Sort::None,
            threads: 0,
        }
    }
}
