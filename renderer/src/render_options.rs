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
    /// Rays from the camera. Packets need `staged`.
    pub primary: Packets,
    /// Shadow rays of the points the camera sees. All rays after a bounce go alone.
    pub first_shadow: Packets,
    /// The number of the renderer's threads that work on a frame; 0 for all of them.
    pub threads: u32,
}

impl Default for RenderOptions {
    /// Path by path, ray by ray: what a simple renderer does.
    fn default() -> Self {
        Self { staged: false, tile: 16, primary: Packets::Single, first_shadow: Packets::Single, threads: 0 }
    }
}
