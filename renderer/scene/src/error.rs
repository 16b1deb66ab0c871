//! The errors between a file's name and a scene.

use std::path::{Path, PathBuf};

use treewright_accel::{GeometryError, limits::INSTANCES_MAX};

use super::limits::{DETAIL_RANGE, FILE_BYTES_MAX, MESHES_MAX, PLACED_TRIANGLES_MAX, VERTICES_MAX};

/// Why there is no scene. Each message names the file, the cause and what to do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}; check the name and the permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The path names a folder.
    #[error("{} is a folder; name the scene file inside it (.glb, .gltf, .obj or .ply)", .0.display())]
    Folder(PathBuf),
    /// The file has no bytes.
    #[error("{} is empty (0 bytes); export the scene again", .0.display())]
    Empty(PathBuf),
    /// The file is beyond the limit.
    #[error("{} has {bytes} bytes, more than the limit of {FILE_BYTES_MAX}; simplify the scene or split it", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// A format or feature that is not read.
    #[error("{}: {what} is not supported; {remedy}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The unsupported feature.
        what: String,
        /// The remedy.
        remedy: String,
    },
    /// The content does not follow its format.
    #[error("{} cannot be read as {format}: {cause}; {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Name of the format.
        format: &'static str,
        /// The fault and its place.
        cause: String,
        /// The remedy.
        remedy: &'static str,
    },
    /// Nothing to render.
    #[error("{} has no triangle to render ({found}); export a mesh with faces", path.display())]
    NoTriangles {
        /// The file.
        path: PathBuf,
        /// The kind that was found instead.
        found: String,
    },
    /// The geometry was refused.
    #[error("{}, mesh \"{mesh}\": {source}; repair or simplify the mesh and export it again", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// The mesh being added.
        mesh: String,
        /// Why.
        source: GeometryError,
    },
    /// Instances can be moved, but not deformed each in its own way.
    #[error(
        "{0} is made of instances, which cannot be deformed; take a motion of parts, such as crowd, or add --flatten to copy them into the world"
    )]
    Instanced(String),
    /// The file has no such animation.
    #[error(
        "{name} has no animation \"{wanted}\" that moves a mesh; it has: {known}. Choose one of these, or another motion"
    )]
    NoAnimation {
        /// The scene.
        name: String,
        /// The name or number asked for.
        wanted: String,
        /// Numbers and names of those there are, comma-separated.
        known: String,
    },
    /// Moving parts have left the range of coordinates.
    #[error("the motion leads too far: {0}; move the scene less, or make it smaller")]
    Moved(#[from] GeometryError),
    /// A moving instance has left the range of coordinates, or is flattened.
    #[error(
        "the motion leads instance {instance} of {name} too far or flattens it; add --flatten, or move the scene less"
    )]
    MovedInstance {
        /// The scene.
        name: String,
        /// Number of the instance.
        instance: usize,
    },
    /// More vertices or meshes than the limits.
    #[error("{} has more than {VERTICES_MAX} vertices or {MESHES_MAX} meshes once instances are flattened; simplify the scene", .0.display())]
    TooMany(PathBuf),
    /// Instances place more triangles than the limits.
    #[error("{} places {placed} triangles, more than the limit of {PLACED_TRIANGLES_MAX}, or more than {INSTANCES_MAX} instances; simplify the scene", path.display())]
    TooManyPlaced {
        /// The file.
        path: PathBuf,
        /// Triangles of all instances.
        placed: u64,
    },
    /// No built-in scene has this name.
    #[error("there is no built-in scene \"{name}\"; choose one of {known}")]
    UnknownBuiltin {
        /// The name asked for.
        name: String,
        /// The names there are, comma-separated.
        known: String,
    },
    /// An option of a built-in scene is out of range.
    #[error("{option} of a built-in scene is {value}; detail must be from {} to {}, time a finite number", DETAIL_RANGE.start(), DETAIL_RANGE.end())]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f32,
    },
}

impl SceneError {
    /// A function that makes errors of a file that does not follow its format, by their causes.
    pub(super) fn malformed(
        path: &Path,
        format: &'static str,
        remedy: &'static str,
    ) -> impl Fn(String) -> Self + Copy {
        move |cause| Self::Malformed { path: path.to_owned(), format, cause, remedy }
    }
}

/// The parser's messages span lines and quote the input whole.
pub(super) fn one_line(message: &str) -> String {
    let joined = message.split_whitespace().collect::<Vec<_>>().join(" ");
    match joined.char_indices().nth(200) {
        Some((cut, _)) => format!("{}…", &joined[..cut]),
        None => joined,
    }
}
