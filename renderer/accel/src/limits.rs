//! Every limit of the acceleration structures, in one place.

/// Largest magnitude of a coordinate. Beyond about 1.8e18 products of coordinates leave the range of
/// single precision and native Embree drops triangles silently; three orders of magnitude are kept in reserve.
pub const COORDINATE_MAX: f32 = 1e15;

/// Most triangles in one structure. Spatial splits hand out 27 bits of geometry numbers.
pub const TRIANGLES_MAX: usize = 1 << 27;
