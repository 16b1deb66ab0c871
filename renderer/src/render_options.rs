//! Options of a renderer besides its tree.

use serde::{Deserialize, Serialize};
use treewright_accel::Packets;

/// The order of work of a frame. Pictures do not depend on it. The default is what a simple renderer does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct RenderOptions {
    /// Tiles in stages, the first two of them in packets of sixteen; or path by path, ray by ray.
    pub staged: bool,
    /// In stages, the grouping of rays from the second bounce on, and of their shadow rays.
    #[serde(default)]
    pub bounce_flight: Packets,
}

impl RenderOptions {
    /// Edge of a tile in pixels.
    pub(crate) fn tile(self) -> u32 {
        if self.staged { 32 } else { 16 }
    }
}
