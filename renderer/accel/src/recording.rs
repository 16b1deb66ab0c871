//! Recorded rays: the triangles of a scene and the rays that real frames send through it, in one file.
//!
//! Made rays lie: what a benchmark says about them need not hold for a picture. So a renderer records the
//! rays of a frame by class, in the order it traces them, and a benchmark replays them. The file is the
//! [`Recording`] as JSON, whose numbers come back as they were.

use std::sync::Arc;

use glam::{Vec3, Vec3A};
use serde::{Deserialize, Serialize};

use crate::geometry::{GeometryError, Ray, Triangles};

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
    /// At most [`RECORDED_RAYS_MAX`](crate::limits::RECORDED_RAYS_MAX), all of them valid.
    pub rays: Vec<Ray>,
}

/// Triangles, without their masks, and the rays of a frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "Written", try_from = "Written")]
pub struct Recording {
    /// The rendered triangles.
    pub triangles: Arc<Triangles>,
    /// At most one a class.
    pub sets: Vec<RaySet>,
}

/// A ray in a file: origin, direction, begin, and the end of one that has an end.
type WrittenRay = ([f32; 3], [f32; 3], f32, Option<f32>);

#[derive(Serialize, Deserialize)]
struct Written {
    positions: Vec<[f32; 3]>,
    indices: Vec<[u32; 3]>,
    sets: Vec<(RayClass, Vec<WrittenRay>)>,
}

impl From<Recording> for Written {
    fn from(Recording { triangles, sets }: Recording) -> Self {
        let written = |ray: &Ray| {
            let end = Some(ray.t_max).filter(|end| end.is_finite());
            (ray.origin.to_array(), ray.direction.to_array(), ray.t_min, end)
        };
        Self {
            positions: triangles.positions().iter().map(|position| position.to_array()).collect(),
            indices: triangles.indices().to_vec(),
            sets: sets.iter().map(|set| (set.class, set.rays.iter().map(written).collect())).collect(),
        }
    }
}

impl TryFrom<Written> for Recording {
    type Error = GeometryError;

    fn try_from(written: Written) -> Result<Self, GeometryError> {
        let ray = |(origin, direction, t_min, end): WrittenRay| Ray {
            origin: Vec3::from_array(origin),
            direction: Vec3::from_array(direction),
            t_min,
            t_max: end.unwrap_or(f32::INFINITY),
        };
        let set = |(class, rays): (RayClass, Vec<WrittenRay>)| {
            let rays = rays.into_iter().map(ray).collect();
            RaySet { class, rays }
        };
        let positions = written.positions.into_iter().map(Vec3A::from_array).collect();
        let triangles = Arc::new(Triangles::new(positions, written.indices)?);
        Ok(Self { triangles, sets: written.sets.into_iter().map(set).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_and_triangles_are_checked() {
        let corners = vec![Vec3A::ZERO, Vec3A::X / 3.0, Vec3A::Y, Vec3A::ONE];
        let triangles = Triangles::new(corners, vec![[0, 1, 2], [1, 3, 2]]).expect("valid");
        let ray =
            |x, t_max| Ray { origin: Vec3::new(x, 0.1, 1.0), direction: Vec3::NEG_Z, t_min: 0.5, t_max };
        let sets = vec![
            RaySet { class: RayClass::Primary, rays: vec![ray(0.25, f32::INFINITY), ray(2.0, 0.7)] },
            RaySet { class: RayClass::Shadow, rays: vec![ray(1e-30, 1e30)] },
        ];
        let recording = Recording { triangles: Arc::new(triangles), sets };
        let text = serde_json::to_string(&recording).expect("it can be written");
        let read: Recording = serde_json::from_str(&text).expect("it can be read");
        assert_eq!(read.triangles.positions(), recording.triangles.positions());
        assert_eq!(read.triangles.indices(), recording.triangles.indices());
        assert_eq!(format!("{:?}", read.sets), format!("{:?}", recording.sets));
        let lie = serde_json::from_str::<Recording>(&text.replace("[1,3,2]", "[1,4,2]"));
        assert!(lie.expect_err("there are four").to_string().contains("names vertex 4"));
    }
}
