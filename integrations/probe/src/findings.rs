//! The file that the preloaded library writes and the command line reads.

use serde::{Deserialize, Serialize};

/// Counts and times of one kind of query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Queries {
    pub(crate) calls: u64,
    pub(crate) rays: u64,
    /// Of all threads together, estimated from looks.
    pub(crate) total_ms: f64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Findings {
    pub(crate) closest: Queries,
    pub(crate) occluded: Queries,
    pub(crate) builds: u64,
    pub(crate) build_wall_ms: f64,
    /// Processor time of the whole process meanwhile.
    pub(crate) build_cpu_ms: f64,
    pub(crate) primitives: u64,
    pub(crate) devices: u64,
    /// All scene flags that were asked for.
    pub(crate) flags: u32,
    /// One bit for each quality that was asked for.
    pub(crate) qualities: u32,
    pub(crate) threads: u64,
    pub(crate) cpu_ms: f64,
    pub(crate) wall_ms: f64,
    pub(crate) device: String,
    pub(crate) embree: String,
}
