//! From a path to a scene: picks the reader, checks sizes, and turns a parser's panic into an error.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use super::{Scene, SceneError, Up, gltf_file, limits::FILE_BYTES_MAX, obj_file, ply_file};

/// Reads a scene file: glTF (`.gltf`, `.glb`), Wavefront OBJ with its MTL (`.obj`), or PLY (`.ply`).
///
/// Coordinates are taken as they stand (glTF defines metres; the others define nothing), nothing is
/// rescaled. Textures are read as PNG, JPEG, TGA or BMP. [`Scene::notes`] lists omissions and additions.
///
/// # Errors
/// [`SceneError`], naming the file, the cause and the remedy, for anything that cannot be read. Bad single
/// triangles are no error: they are dropped and counted in the notes.
pub fn load(path: impl AsRef<Path>) -> Result<Scene, SceneError> {
    load_upright(path, Up::Y)
}

/// Loads a file in which another axis points up: the whole scene is turned so that y does.
///
/// # Errors
/// As [`load`].
pub fn load_upright(path: impl AsRef<Path>, up: Up) -> Result<Scene, SceneError> {
    let path = path.as_ref();
    let read_error = |source| SceneError::Read { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(read_error)?;
    if metadata.is_dir() {
        return Err(SceneError::Folder(path.to_owned()));
    }
    if metadata.len() > FILE_BYTES_MAX {
        return Err(SceneError::TooLarge { path: path.to_owned(), bytes: metadata.len() });
    }
    let format = Format::of(path)?;
    let bytes = std::fs::read(path).map_err(read_error)?;
    if bytes.is_empty() {
        return Err(SceneError::Empty(path.to_owned()));
    }
    // A parsing crate may still panic on a hostile file, which must not end the program.
    catch_unwind(AssertUnwindSafe(|| match format {
        Format::Gltf => gltf_file::read(path, &bytes, up),
        Format::Obj => obj_file::read(path, &bytes, up),
        Format::Ply => ply_file::read(path, &bytes, up),
    }))
    .unwrap_or_else(|_| {
        let malformed = SceneError::malformed(path, format.name(), "export it again with another tool");
        Err(malformed("the parser gave up on its content".to_owned()))
    })
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Gltf,
    Obj,
    Ply,
}

impl Format {
    /// By extension. The readers check the content themselves, so a wrong name is an error and no guess.
    fn of(path: &Path) -> Result<Self, SceneError> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let refuse = |what: String| {
            Err(SceneError::Unsupported {
                path: path.to_owned(),
                what,
                remedy: "convert it to glTF (.glb), OBJ or PLY, for example with Blender".to_owned(),
            })
        };
        match extension.as_deref() {
            Some("gltf" | "glb") => Ok(Self::Gltf),
            Some("obj") => Ok(Self::Obj),
            Some("ply") => Ok(Self::Ply),
            Some("stl") => refuse("the STL format".to_owned()),
            Some(other) => refuse(format!("the extension .{other}")),
            None => refuse("a file without an extension".to_owned()),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Gltf => "glTF",
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
        }
    }
}
