//! The errors between a file's name and a scene.

use std::path::{Path, PathBuf};

use treewright_accel::{GeometryError, limits::INSTANCES_MAX};

use super::limits::{DETAIL_RANGE, FILE_BYTES_MAX, MESHES_MAX, PLACED_TRIANGLES_MAX, VERTICES_MAX};

/// Why there is no scene. Each message names the file, the cause and what to do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file that cannot be opened or read, and the system's error.
    #[error("cannot read {}: {}; check the name and the permissions", .0.display(), .1)]
    Read(PathBuf, #[source] std::io::Error),
    /// The path names a folder.
    #[error("{} is a folder; name the scene file inside it (.glb, .gltf, .obj or .ply)", .0.display())]
    Folder(PathBuf),
    /// The file has no bytes.
    #[error("{} is empty (0 bytes); export the scene again", .0.display())]
    Empty(PathBuf),
    /// A file of more bytes, these, than the limit.
    #[error("{} has {} bytes, more than the limit of {FILE_BYTES_MAX}; simplify the scene or split it", .0.display(), .1)]
    TooLarge(PathBuf, u64),
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
    /// A file with nothing to render, and what was found instead.
    #[error("{} has no triangle to render ({}); export a mesh with faces", .0.display(), .1)]
    NoTriangles(PathBuf, String),
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
    /// A moving instance of a scene, by number, has left the range of coordinates, or is flattened.
    #[error(
        "the motion leads instance {1} of {0} too far or flattens it; add --flatten, or move the scene less"
    )]
    MovedInstance(String, usize),
    /// More vertices or meshes than the limits.
    #[error("{} has more than {VERTICES_MAX} vertices or {MESHES_MAX} meshes once instances are flattened; simplify the scene", .0.display())]
    TooMany(PathBuf),
    /// A file whose instances place more triangles, this many, than the limits.
    #[error("{} places {} triangles, more than the limit of {PLACED_TRIANGLES_MAX}, or more than {INSTANCES_MAX} instances; simplify the scene", .0.display(), .1)]
    TooManyPlaced(PathBuf, u64),
    /// No built-in scene has this name.
    #[error("there is no built-in scene \"{name}\"; choose one of {known}")]
    UnknownBuiltin {
        /// The name asked for.
        name: String,
        /// The names there are, comma-separated.
        known: String,
    },
    /// An option of a built-in scene, by name, with a value out of range.
    #[error("{} of a built-in scene is {}; detail must be from {} to {}, time a finite number", .0, .1, DETAIL_RANGE.start(), DETAIL_RANGE.end())]
    BadOption(&'static str, f32),
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
