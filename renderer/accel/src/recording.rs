//! Recorded rays: the triangles of a scene and the rays that real frames send through it, in one file.
//!
//! Made rays lie: what a benchmark says about them need not hold for a picture. So a renderer records the
//! rays of a frame by class, in the order it traces them, and a benchmark replays them.
//!
//! The file, every number little-endian:
//!
//! | part | content |
//! |---|---|
//! | head | 8 bytes [`MAGIC`], then the number of vertices, of triangles and of ray sets, 4 bytes each |
//! | vertices | x, y, z in single precision |
//! | triangles | three vertex numbers of 4 bytes |
//! | each set | its class (4 bytes, the place in [`RayClass::ALL`]), the number of rays (4 bytes), then per ray eight single-precision numbers: origin, `t_min`, direction, `t_max` |
//!
//! Nothing follows the last set. The counts of a file are checked against the limits before memory is taken
//! for them, and its contents as if they came from a user.

use std::error::Error;
use std::io::{self, Read, Write};
use std::sync::Arc;

use glam::{Vec3, Vec3A};
use serde::{Deserialize, Serialize};

use crate::geometry::{Ray, Triangles};
use crate::limits::{RECORDED_RAYS_MAX, TRIANGLES_MAX};

/// First bytes of a recording; the last one is the format's version.
pub const MAGIC: [u8; 8] = *b"TWRAYS\0\x01";

/// Which rays of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RayClass {
    /// From the camera.
    Primary,
    /// From what the camera sees to a light.
    FirstShadow,
    /// After the first bounce.
    FirstBounce,
    /// After the second bounce.
    SecondBounce,
    /// To a light from what bounced rays see.
    Shadow,
}

impl RayClass {
    /// All of them, in the order of a path.
    pub const ALL: [Self; 5] =
        [Self::Primary, Self::FirstShadow, Self::FirstBounce, Self::SecondBounce, Self::Shadow];

    /// Whether any hit will do.
    pub fn is_shadow(self) -> bool {
        matches!(self, Self::FirstShadow | Self::Shadow)
    }

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::FirstShadow => "first shadow",
            Self::FirstBounce => "bounce 1",
            Self::SecondBounce => "bounce 2",
            Self::Shadow => "shadow",
        }
    }
}

/// Rays of one class, in the order they were traced.
#[derive(Clone, Debug)]
pub struct RaySet {
    /// Which.
    pub class: RayClass,
    /// At most [`RECORDED_RAYS_MAX`], all of them valid.
    pub rays: Vec<Ray>,
}

/// Triangles and the rays of a frame.
#[derive(Clone, Debug)]
pub struct Recording {
    /// The rendered triangles.
    pub triangles: Arc<Triangles>,
    /// At most one a class.
    pub sets: Vec<RaySet>,
}

impl Recording {
    /// Writes the recording. Give it a buffered writer.
    pub fn write(&self, mut to: impl Write) -> io::Result<()> {
        let (positions, indices) = (self.triangles.positions(), self.triangles.indices());
        to.write_all(&MAGIC)?;
        write_count(&mut to, "vertices", positions.len(), VERTICES_MAX)?;
        write_count(&mut to, "triangles", indices.len(), TRIANGLES_MAX)?;
        write_count(&mut to, "ray sets", self.sets.len(), RayClass::ALL.len())?;
        for position in positions {
            write_floats(&mut to, &position.to_array())?;
        }
        for number in indices.as_flattened() {
            to.write_all(&number.to_le_bytes())?;
        }
        for set in &self.sets {
            to.write_all(&(set.class as u32).to_le_bytes())?;
            write_count(&mut to, "rays of one class", set.rays.len(), RECORDED_RAYS_MAX)?;
            check_rays(set.class, &set.rays)?;
            for one in &set.rays {
                write_floats(&mut to, &one.origin.to_array())?;
                write_floats(&mut to, &[one.t_min])?;
                write_floats(&mut to, &one.direction.to_array())?;
                write_floats(&mut to, &[one.t_max])?;
            }
        }
        to.flush()
    }

    /// Reads a recording and checks all of it. Give it a buffered reader.
    pub fn read(mut from: impl Read) -> io::Result<Self> {
        if read_bytes::<8>(&mut from)? != MAGIC {
            return Err(damaged(format!("this is no recording of version {}: record it again", MAGIC[7])));
        }
        let vertices = read_count(&mut from, "vertices", VERTICES_MAX)?;
        let triangles = read_count(&mut from, "triangles", TRIANGLES_MAX)?;
        let sets = read_count(&mut from, "ray sets", RayClass::ALL.len())?;
        let positions = many(vertices, || Ok(Vec3A::from_array(read_floats(&mut from)?)))?;
        let indices = many(triangles, || {
            let numbers = read_bytes::<12>(&mut from)?;
            Ok([0, 4, 8].map(|at| u32::from_le_bytes(std::array::from_fn(|byte| numbers[at + byte]))))
        })?;
        let triangles = Arc::new(Triangles::new(positions, indices).map_err(damaged)?);
        let mut read = Vec::<RaySet>::new();
        for set in 0..sets {
            let number = u32::from_le_bytes(read_bytes(&mut from)?);
            let class = RayClass::ALL
                .get(number as usize)
                .copied()
                .filter(|&class| read.iter().all(|earlier| earlier.class != class))
                .ok_or_else(|| {
                    damaged(format!(
                        "ray set {set} is of class {number}, which does not exist or was there before"
                    ))
                })?;
            let count = read_count(&mut from, "rays of one class", RECORDED_RAYS_MAX)?;
            let rays = many(count, || {
                let [ox, oy, oz, t_min, dx, dy, dz, t_max] = read_floats(&mut from)?;
                Ok(Ray { origin: Vec3::new(ox, oy, oz), direction: Vec3::new(dx, dy, dz), t_min, t_max })
            })?;
            check_rays(class, &rays)?;
            read.push(RaySet { class, rays });
        }
        match from.read(&mut [0])? {
            0 => Ok(Self { triangles, sets: read }),
            _ => Err(damaged("the recording goes on after its last ray: it is damaged, record it again")),
        }
    }
}

/// Most vertices: three for each of the most triangles.
const VERTICES_MAX: usize = 3 * TRIANGLES_MAX;

const _: () = {
    assert!(VERTICES_MAX <= u32::MAX as usize);
    assert!(RECORDED_RAYS_MAX <= u32::MAX as usize);
};

/// Room that is taken on a file's word alone. More comes as the values do.
const TRUSTED: usize = 1 << 16;

fn damaged(cause: impl Into<Box<dyn Error + Send + Sync>>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, cause)
}

/// Whether all rays could come out of a frame.
fn check_rays(class: RayClass, rays: &[Ray]) -> io::Result<()> {
    let broken = |ray: usize| {
        let class = class.name();
        damaged(format!("ray {ray} of the {class} rays is not finite or has its end before its begin"))
    };
    rays.iter().position(|ray| !ray.is_valid()).map_or(Ok(()), |ray| Err(broken(ray)))
}

fn check_count(what: &str, count: usize, limit: usize) -> io::Result<()> {
    let beyond = || damaged(format!("{count} {what} are more than the limit of {limit}"));
    if count > limit { Err(beyond()) } else { Ok(()) }
}

fn many<T>(count: usize, mut one: impl FnMut() -> io::Result<T>) -> io::Result<Vec<T>> {
    let mut all = Vec::with_capacity(count.min(TRUSTED));
    for _ in 0..count {
        all.push(one()?);
    }
    Ok(all)
}

fn write_count(to: &mut impl Write, what: &str, count: usize, limit: usize) -> io::Result<()> {
    check_count(what, count, limit)?;
    to.write_all(&(count as u32).to_le_bytes())
}

fn read_count(from: &mut impl Read, what: &str, limit: usize) -> io::Result<usize> {
    let count = u32::from_le_bytes(read_bytes(from)?) as usize;
    check_count(what, count, limit)?;
    Ok(count)
}

fn write_floats(to: &mut impl Write, floats: &[f32]) -> io::Result<()> {
    floats.iter().try_for_each(|float| to.write_all(&float.to_le_bytes()))
}

fn read_floats<const N: usize>(from: &mut impl Read) -> io::Result<[f32; N]> {
    let mut floats = [0.0; N];
    for float in &mut floats {
        *float = f32::from_le_bytes(read_bytes(from)?);
    }
    Ok(floats)
}

fn read_bytes<const N: usize>(from: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording() -> Recording {
        let corners = vec![Vec3A::ZERO, Vec3A::X, Vec3A::Y, Vec3A::ONE];
        let triangles = Triangles::new(corners, vec![[0, 1, 2], [1, 3, 2]]).expect("valid");
        let ray = |x| Ray {
            origin: Vec3::new(x, 0.25, 1.0),
            direction: Vec3::NEG_Z,
            t_min: 0.5,
            t_max: f32::INFINITY,
        };
        let sets = vec![
            RaySet { class: RayClass::Primary, rays: vec![ray(0.25), ray(2.0)] },
            RaySet { class: RayClass::Shadow, rays: vec![ray(0.5)] },
        ];
        Recording { triangles: Arc::new(triangles), sets }
    }

    fn bytes(recording: &Recording) -> Vec<u8> {
        let mut bytes = Vec::new();
        recording.write(&mut bytes).expect("it can be written");
        bytes
    }

    #[test]
    fn what_was_written_is_read() {
        let (written, bytes) = (recording(), bytes(&recording()));
        assert_eq!(bytes.len(), 20 + 4 * 12 + 2 * 12 + (8 + 2 * 32) + (8 + 32));
        let read = Recording::read(bytes.as_slice()).expect("it can be read");
        assert_eq!(read.triangles.positions(), written.triangles.positions());
        assert_eq!(read.triangles.indices(), written.triangles.indices());
        assert_eq!(format!("{:?}", read.sets), format!("{:?}", written.sets));
    }

    #[test]
    fn every_shorter_file_is_refused_and_a_longer_one_too() {
        let mut bytes = bytes(&recording());
        for length in 0..bytes.len() {
            let refused = Recording::read(&bytes[..length]).expect_err("it is refused");
            assert_eq!(refused.kind(), io::ErrorKind::UnexpectedEof, "{length}");
        }
        bytes.push(0);
        let refused = Recording::read(bytes.as_slice()).expect_err("it is refused");
        assert!(refused.to_string().contains("goes on after its last ray"), "{refused}");
    }

    #[test]
    fn lies_are_refused() {
        let good = bytes(&recording());
        let (set, second) = (20 + 48 + 24, 20 + 48 + 24 + 8 + 64);
        for (at, value, expected) in [
            (4, 0x0200_0053, "no recording of version 1"),
            (8, u32::MAX, "vertices are more than"),
            (12, u32::MAX, "triangles are more than"),
            (16, 6, "6 ray sets are more than the limit of 5"),
            (20, f32::NAN.to_bits(), "vertex 0 has a coordinate"),
            (20 + 48, 4, "triangle 0 names vertex 4"),
            (set, 5, "ray set 0 is of class 5"),
            (second, 0, "ray set 1 is of class 0"),
            (set + 4, u32::MAX, "rays of one class are more than"),
            (set + 8, f32::NAN.to_bits(), "ray 0 of the primary rays"),
        ] {
            let mut bad = good.clone();
            bad[at..at + 4].copy_from_slice(&value.to_le_bytes());
            let refused = Recording::read(bad.as_slice()).expect_err("it is refused").to_string();
            assert!(refused.contains(expected), "{refused}");
        }
    }

    #[test]
    fn a_broken_ray_is_not_written() {
        let mut recording = recording();
        recording.sets[1].rays[0].direction = Vec3::NAN;
        let refused = recording.write(Vec::new()).expect_err("it is refused");
        assert!(refused.to_string().contains("ray 0 of the shadow rays"), "{refused}");
    }
}
