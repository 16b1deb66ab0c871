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

use std::io::{self, Read, Write};
use std::sync::Arc;

use glam::{Vec3, Vec3A};
use serde::{Deserialize, Serialize};

use crate::geometry::{GeometryError, Ray, Triangles};
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

/// Why a recording was not read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file ends early, or the system failed.
    #[error("the recording cannot be read or written: {0}")]
    Io(#[from] io::Error),
    /// Not such a file, or one of another version.
    #[error("this is no recording of version {}: record it again", MAGIC[7])]
    NotARecording,
    /// A number beyond its limit.
    #[error("{count} {what} are more than the limit of {limit}")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// The number that was given.
        count: usize,
        /// The limit.
        limit: usize,
    },
    /// A class that does not exist or comes twice.
    #[error("ray set {set} is of class {class}, which does not exist or was there before")]
    BadClass {
        /// Number of the set.
        set: usize,
        /// The class in the file.
        class: u32,
    },
    /// A ray that could not come out of a frame.
    #[error("ray {ray} of the {} rays is not finite or has its end before its begin", class.name())]
    BadRay {
        /// Which set.
        class: RayClass,
        /// Number of the ray.
        ray: usize,
    },
    /// Something follows the last set.
    #[error("the recording goes on after its last ray: it is damaged, record it again")]
    Trailing,
    /// The triangles are none.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

impl Recording {
    /// Writes the recording. Give it a buffered writer.
    pub fn write(&self, mut to: impl Write) -> Result<(), RecordingError> {
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
            for (ray, one) in set.rays.iter().enumerate() {
                if !one.is_valid() {
                    return Err(RecordingError::BadRay { class: set.class, ray });
                }
                write_floats(&mut to, &one.origin.to_array())?;
                write_floats(&mut to, &[one.t_min])?;
                write_floats(&mut to, &one.direction.to_array())?;
                write_floats(&mut to, &[one.t_max])?;
            }
        }
        Ok(to.flush()?)
    }

    /// Reads a recording and checks all of it. Give it a buffered reader.
    pub fn read(mut from: impl Read) -> Result<Self, RecordingError> {
        if read_bytes::<8>(&mut from)? != MAGIC {
            return Err(RecordingError::NotARecording);
        }
        let vertices = read_count(&mut from, "vertices", VERTICES_MAX)?;
        let triangles = read_count(&mut from, "triangles", TRIANGLES_MAX)?;
        let sets = read_count(&mut from, "ray sets", RayClass::ALL.len())?;
        let positions = many(vertices, || Ok(Vec3A::from_array(read_floats(&mut from)?)))?;
        let indices = many(triangles, || {
            let numbers = read_bytes::<12>(&mut from)?;
            Ok([0, 4, 8].map(|at| u32::from_le_bytes(std::array::from_fn(|byte| numbers[at + byte]))))
        })?;
        let triangles = Arc::new(Triangles::new(positions, indices)?);
        let mut read = Vec::<RaySet>::new();
        for set in 0..sets {
            let number = u32::from_le_bytes(read_bytes(&mut from)?);
            let class = RayClass::ALL
                .get(number as usize)
                .copied()
                .filter(|&class| read.iter().all(|earlier| earlier.class != class))
                .ok_or(RecordingError::BadClass { set, class: number })?;
            let count = read_count(&mut from, "rays of one class", RECORDED_RAYS_MAX)?;
            let rays = many(count, || {
                let [ox, oy, oz, t_min, dx, dy, dz, t_max] = read_floats(&mut from)?;
                Ok(Ray { origin: Vec3::new(ox, oy, oz), direction: Vec3::new(dx, dy, dz), t_min, t_max })
            })?;
            if let Some(ray) = rays.iter().position(|ray| !ray.is_valid()) {
                return Err(RecordingError::BadRay { class, ray });
            }
            read.push(RaySet { class, rays });
        }
        match from.read(&mut [0])? {
            0 => Ok(Self { triangles, sets: read }),
            _ => Err(RecordingError::Trailing),
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

fn many<T>(
    count: usize,
    mut one: impl FnMut() -> Result<T, RecordingError>,
) -> Result<Vec<T>, RecordingError> {
    let mut all = Vec::with_capacity(count.min(TRUSTED));
    for _ in 0..count {
        all.push(one()?);
    }
    Ok(all)
}

fn write_count(
    to: &mut impl Write,
    what: &'static str,
    count: usize,
    limit: usize,
) -> Result<(), RecordingError> {
    let number = u32::try_from(count).ok().filter(|_| count <= limit);
    let number = number.ok_or(RecordingError::TooMany { what, count, limit })?;
    Ok(to.write_all(&number.to_le_bytes())?)
}

fn read_count(from: &mut impl Read, what: &'static str, limit: usize) -> Result<usize, RecordingError> {
    let count = u32::from_le_bytes(read_bytes(from)?) as usize;
    if count > limit { Err(RecordingError::TooMany { what, count, limit }) } else { Ok(count) }
}

fn write_floats(to: &mut impl Write, floats: &[f32]) -> io::Result<()> {
    floats.iter().try_for_each(|float| to.write_all(&float.to_le_bytes()))
}

fn read_floats<const N: usize>(from: &mut impl Read) -> Result<[f32; N], RecordingError> {
    let mut floats = [0.0; N];
    for float in &mut floats {
        *float = f32::from_le_bytes(read_bytes(from)?);
    }
    Ok(floats)
}

fn read_bytes<const N: usize>(from: &mut impl Read) -> Result<[u8; N], RecordingError> {
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
            assert!(matches!(Recording::read(&bytes[..length]), Err(RecordingError::Io(_))), "{length}");
        }
        bytes.push(0);
        assert!(matches!(Recording::read(bytes.as_slice()), Err(RecordingError::Trailing)));
    }

    #[test]
    fn lies_are_refused() {
        let good = bytes(&recording());
        let with = |at: usize, value: u32| {
            let mut bad = good.clone();
            bad[at..at + 4].copy_from_slice(&value.to_le_bytes());
            Recording::read(bad.as_slice()).expect_err("it is refused")
        };
        let (set, second) = (20 + 48 + 24, 20 + 48 + 24 + 8 + 64);
        assert!(matches!(with(4, 0x0200_0053), RecordingError::NotARecording));
        assert!(matches!(with(8, u32::MAX), RecordingError::TooMany { what: "vertices", .. }));
        assert!(matches!(with(12, u32::MAX), RecordingError::TooMany { what: "triangles", .. }));
        assert!(matches!(with(16, 6), RecordingError::TooMany { what: "ray sets", .. }));
        assert!(matches!(with(20, f32::NAN.to_bits()), RecordingError::Geometry(_)));
        assert!(matches!(with(20 + 48, 4), RecordingError::Geometry(_)));
        assert!(matches!(with(set, 5), RecordingError::BadClass { set: 0, class: 5 }));
        assert!(matches!(with(second, 0), RecordingError::BadClass { set: 1, class: 0 }));
        assert!(matches!(with(set + 4, u32::MAX), RecordingError::TooMany { .. }));
        let bad_ray = with(set + 8, f32::NAN.to_bits());
        assert!(matches!(bad_ray, RecordingError::BadRay { class: RayClass::Primary, ray: 0 }), "{bad_ray}");
    }

    #[test]
    fn a_broken_ray_is_not_written() {
        let mut recording = recording();
        recording.sets[1].rays[0].direction = Vec3::NAN;
        let refused = recording.write(Vec::new());
        assert!(matches!(refused, Err(RecordingError::BadRay { class: RayClass::Shadow, ray: 0 })));
    }
}
