//! Every limit of the acceleration structures, in one place.

/// Largest magnitude of a coordinate: a test multiplies three, and beyond some 1e13 hits get lost.
pub const COORDINATE_MAX: f32 = 1e12;
/// Most triangles in one structure: one build of that size takes some 20 GB, beyond what we verified.
pub const TRIANGLES_MAX: usize = 1 << 27;
/// Longest edge of a mask in pixels.
pub const MASK_EDGE_MAX: u32 = 1 << 14;
/// Most masks of one set of triangles.
pub const MASKS_MAX: usize = 1 << 16;
/// Series of Embree our C structures are laid out for: `(major, minor)`.
pub const EMBREE_SERIES: (isize, isize) = (4, 4);
/// Most build threads.
pub const THREADS_MAX: usize = 1024;
/// Permitted `max_depth`: 9 leaves one level to Embree's heuristic, 64 sizes the traversal stack.
pub const MAX_DEPTH: std::ops::RangeInclusive<u32> = 9..=64;
/// Most triangles a leaf: the Morton builder's array for a leaf is this long.
pub const LEAF_SIZE_MAX: u32 = 32;
/// Largest `sah_block_size`.
pub const SAH_BLOCK_SIZE_MAX: u32 = 32;
/// Largest cost of a step or a test in the heuristic.
pub const COST_MAX: f32 = 10.0;
/// Default room for the references of spatial splits, as a factor on the triangles; native Embree's, too.
pub const SPLIT_BUDGET: f32 = 1.2;
/// Permitted `split_budget`.
pub const SPLIT_BUDGET_RANGE: std::ops::RangeInclusive<f32> = 1.0..=2.0;
/// Most passes of insertion-based optimisation.
pub const REINSERTION_PASSES_MAX: u32 = 16;
/// Most instances in one scene.
pub const INSTANCES_MAX: usize = 1 << 24;
/// Permitted `search_radius`.
pub const SEARCH_RADIUS_RANGE: std::ops::RangeInclusive<u32> = 1..=32;
/// Permitted `cluster_size`: one cluster's part of the curve must fit into the smallest set of clusters.
pub const CLUSTER_SIZE_RANGE: std::ops::RangeInclusive<u32> = 1..=8;
/// Most rays of one class in a recording: half a gigabyte of memory.
pub const RECORDED_RAYS_MAX: usize = 1 << 24;
/// Permitted `rebuild_threshold`.
pub const REBUILD_THRESHOLD_RANGE: std::ops::RangeInclusive<f32> = 1.0..=4.0;
/// Permitted `split_budget` of a native scene.
pub const NATIVE_SPLIT_BUDGET_RANGE: std::ops::RangeInclusive<f32> = 1.0..=4.0;
/// Most Embree devices that are kept open for native scenes; each is a few kilobytes.
pub const DEVICES_MAX: usize = 16;
