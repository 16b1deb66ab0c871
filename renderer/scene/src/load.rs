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
    let read_error = |source| SceneError::Read(path.to_owned(), source);
    let metadata = std::fs::metadata(path).map_err(read_error)?;
    if metadata.is_dir() {
        return Err(SceneError::Folder(path.to_owned()));
    }
    if metadata.len() > FILE_BYTES_MAX {
        return Err(SceneError::TooLarge(path.to_owned(), metadata.len()));
    }
    let (format, reader) = format_of(path)?;
    let bytes = std::fs::read(path).map_err(read_error)?;
    if bytes.is_empty() {
        return Err(SceneError::Empty(path.to_owned()));
    }
    // A parsing crate may still panic on a hostile file, which must not end the program.
    catch_unwind(AssertUnwindSafe(|| reader(path, &bytes, up))).unwrap_or_else(|_| {
        let malformed = SceneError::malformed(path, format, "export it again with another tool");
        Err(malformed("the parser gave up on its content".to_owned()))
    })
}

type Reader = fn(&Path, &[u8], Up) -> Result<Scene, SceneError>;

/// The name of a format and its reader, by extension. Readers check the content themselves, so a wrong name
/// is an error and no guess.
fn format_of(path: &Path) -> Result<(&'static str, Reader), SceneError> {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    let what = match extension.as_deref() {
        Some("gltf" | "glb") => return Ok(("glTF", gltf_file::read)),
        Some("obj") => return Ok(("OBJ", obj_file::read)),
        Some("ply") => return Ok(("PLY", ply_file::read)),
        Some("stl") => "the STL format".to_owned(),
        Some(other) => format!("the extension .{other}"),
        None => "a file without an extension".to_owned(),
    };
    let remedy = "convert it to glTF (.glb), OBJ or PLY, for example with Blender".to_owned();
    Err(SceneError::Unsupported { path: path.to_owned(), what, remedy })
}
