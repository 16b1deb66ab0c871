//! Every limit of scenes but that of [triangles](treewright_accel::limits::TRIANGLES_MAX).

/// Largest scene file that is read, in bytes.
pub const FILE_BYTES_MAX: u64 = 8 << 30;
/// Most vertices of a scene: a numbering with 32 bits needs a free value for unused ones.
pub const VERTICES_MAX: usize = 1 << 29;
/// Most meshes of a scene after instances are flattened.
pub const MESHES_MAX: usize = 1 << 20;
/// Most triangles that instances place: indicators look at each of them, for some seconds.
pub const PLACED_TRIANGLES_MAX: u64 = 1 << 30;
/// Meshes of several nodes become instances when that saves more triangles than this.
pub const INSTANCING_SAVES_MIN: u64 = 1_000_000;
/// Deepest nesting of nodes in a glTF file.
pub const NODE_DEPTH_MAX: usize = 256;
/// Most numbers in the keys of a file's animations: 256 MB.
pub const KEY_NUMBERS_MAX: usize = 1 << 26;
/// Most vertices that move, each counted again for each of its morph targets: some 1.6 GB.
pub const POSED_VERTICES_MAX: usize = 1 << 26;
/// Longest edge of a texture in pixels.
pub const TEXTURE_EDGE_MAX: u32 = 1 << 14;
/// Most pixels of all textures of a scene: some 1.4 GB with their smaller copies.
pub const TEXTURE_PIXELS_MAX: u64 = 1 << 28;
/// Largest image file that is read, in bytes.
pub const IMAGE_BYTES_MAX: u64 = 1 << 30;
/// Longest edge of an environment map in pixels.
pub const ENVIRONMENT_EDGE_MAX: u32 = 1 << 14;
/// Most cameras taken from a file; a file with more is usually an animation exported frame by frame.
pub const CAMERAS_MAX: usize = 256;
/// Range of the `detail` of a built-in scene: up to some 8 million triangles, 80 million placed.
pub const DETAIL_RANGE: std::ops::RangeInclusive<f32> = 0.001..=8.0;
/// Most lights without size taken from a file.
pub const PUNCTUAL_LIGHTS_MAX: usize = 1 << 16;
/// Diagonals of scenes that are drawn in the lengths of their files.
pub const DIAGONAL_RANGE: std::ops::RangeInclusive<f32> = 1e-6..=1e7;
/// Distance of a scene's middle in diagonals beyond which it is drawn around the origin.
pub const DISTANCE_MAX: f64 = 64.0;
/// Angles of view of a camera in degrees: below, neighbouring rays would be equal in single precision.
pub const FOV_RANGE_DEG: std::ops::RangeInclusive<f32> = 0.01..=170.0;
