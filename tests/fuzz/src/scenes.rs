//! Any bytes as a scene file of each format: loaded or refused with an error, and moved where they move.

use std::io::Write as _;
use std::sync::Arc;

use treewright_scene::motion::{Motion, Mover};

/// Reads a scene: a byte that says which format, and the file.
pub fn run(bytes: &[u8]) {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let ending = [".glb", ".gltf", ".ply", ".obj"][usize::from(kind) % 4];
    let folder =
        if std::path::Path::new("/dev/shm").is_dir() { "/dev/shm".into() } else { std::env::temp_dir() };
    let mut file = tempfile::Builder::new().suffix(ending).tempfile_in(folder).expect("a scratch file");
    file.write_all(bytes).expect("room for a small file");
    let Ok(scene) = treewright_scene::load(file.path()) else { return };
    if let Ok(mover) = Mover::new(Arc::new(scene), Motion::File) {
        let _ = mover.at(0.3);
    }
}
