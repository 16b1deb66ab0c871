//! Meshes: binary PLY as `integrations/scenes.py` writes it, and two that are generated.

use std::io;
use std::path::Path;

use glam::{Vec3, Vec3A};
use obvhs::triangle::Triangle;

#[derive(Debug)]
pub(crate) struct Mesh {
    pub(crate) name: String,
    pub(crate) triangles: Vec<Triangle>,
}

impl Mesh {
    /// The corners of the box around it.
    pub(crate) fn bounds(&self) -> (Vec3A, Vec3A) {
        let corners = self.triangles.iter().flat_map(|one| [one.v0, one.v1, one.v2]);
        corners.fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(min, max), corner| {
            (min.min(corner), max.max(corner))
        })
    }
}

/// Reads float positions and lists of three indices.
pub(crate) fn read(path: &Path) -> io::Result<Mesh> {
    let bytes = std::fs::read(path)?;
    let bad = || {
        io::Error::new(
            io::ErrorKind::InvalidData,
            format!("{} is no binary PLY of triangles", path.display()),
        )
    };
    let mark = b"end_header\n";
    let end = bytes.windows(mark.len()).position(|window| window == mark).ok_or_else(bad)?;
    let header = String::from_utf8_lossy(&bytes[..end]);
    let count =
        |what: &str| header.lines().find_map(|line| line.strip_prefix(what)?.trim().parse::<usize>().ok());
    let (vertices, faces) =
        (count("element vertex ").ok_or_else(bad)?, count("element face ").ok_or_else(bad)?);
    let body = &bytes[end + mark.len()..];
    let size = vertices.checked_mul(12).and_then(|first| first.checked_add(faces.checked_mul(13)?));
    if size != Some(body.len()) {
        return Err(bad());
    }
    let (positions, lists) = body.split_at(vertices * 12);
    let number = |four: &[u8]| <[u8; 4]>::try_from(four).unwrap_or_default();
    let corner = |index: &[u8]| {
        let place = u32::from_le_bytes(number(index)) as usize * 12;
        let point = positions.get(place..place + 12).ok_or_else(bad)?;
        let axis = |at: usize| f32::from_le_bytes(number(&point[at..at + 4]));
        Ok::<_, io::Error>(Vec3A::new(axis(0), axis(4), axis(8)))
    };
    let triangle = |list: &[u8]| {
        Ok(Triangle { v0: corner(&list[1..5])?, v1: corner(&list[5..9])?, v2: corner(&list[9..13])? })
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Mesh { name, triangles: lists.chunks_exact(13).map(triangle).collect::<io::Result<_>>()? })
}

/// A wavy height field: small triangles of one size.
pub(crate) fn field() -> Mesh {
    let at = |x: u16, z: u16| {
        let (u, v) = (f32::from(x) * 0.05, f32::from(z) * 0.05);
        Vec3A::new(u, (u * 3.0).sin() * (v * 2.0).cos(), v)
    };
    let mut triangles = Vec::new();
    for x in 0..100 {
        for z in 0..100 {
            triangles.push(Triangle { v0: at(x, z), v1: at(x + 1, z), v2: at(x, z + 1) });
            triangles.push(Triangle { v0: at(x + 1, z), v1: at(x + 1, z + 1), v2: at(x, z + 1) });
        }
    }
    Mesh { name: "field".into(), triangles }
}

/// Long thin triangles in all directions, which fill their boxes badly.
pub(crate) fn needles() -> Mesh {
    let mut state = 7u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    };
    let needle = |_| {
        let corner = Vec3::new(random(), random(), random()) * 6.0;
        let along = (Vec3::new(random(), random(), random()) - 0.5).normalize_or(Vec3::X) * 1.5;
        let [v0, v1, v2] =
            [corner, corner + along, corner + along + Vec3::new(0.01, 0.01, 0.0)].map(Vec3A::from);
        Triangle { v0, v1, v2 }
    };
    Mesh { name: "needles".into(), triangles: (0..20_000).map(needle).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_and_broken_ones_refused() {
        let path = std::env::temp_dir().join(format!("treewright-builders-{}.ply", std::process::id()));
        let mut bytes =
            b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nelement face 1\nend_header\n".to_vec();
        for number in [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.push(3);
        for index in [0u32, 1, 2] {
            bytes.extend(index.to_le_bytes());
        }
        std::fs::write(&path, &bytes).unwrap();
        let mesh = read(&path).unwrap();
        assert_eq!(mesh.bounds(), (Vec3A::ZERO, Vec3A::new(1.0, 2.0, 0.0)));
        let last = bytes.len() - 4;
        bytes[last] = 9;
        std::fs::write(&path, &bytes).unwrap();
        assert!(read(&path).is_err(), "an index beyond the vertices");
        std::fs::write(&path, &bytes[..last]).unwrap();
        assert!(read(&path).is_err(), "too short");
        std::fs::remove_file(&path).unwrap();
    }
}
