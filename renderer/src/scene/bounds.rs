//! Axis-aligned boxes around triangles.

use glam::{Vec3, Vec3A};
use treewright_accel::Triangles;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Bounds {
    /// The box around every triangle; a point at the origin when there is none.
    pub fn of(triangles: &Triangles) -> Self {
        let positions = triangles.positions();
        let (mut min, mut max) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for corner in triangles.indices().iter().flatten() {
            let position = positions[*corner as usize];
            min = min.min(position);
            max = max.max(position);
        }
        if min.x > max.x {
            Self { min: Vec3::ZERO, max: Vec3::ZERO }
        } else {
            Self { min: min.into(), max: max.into() }
        }
    }

    /// The middle.
    pub fn center(&self) -> Vec3 {
        // Halved first: the sum of two large coordinates must not overflow.
        self.min * 0.5 + self.max * 0.5
    }

    /// Edge lengths.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// Length of the diagonal.
    pub fn diagonal(&self) -> f32 {
        self.size().length()
    }

    /// Whether a point lies inside or on the surface.
    pub fn contains(&self, point: Vec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// The eight corners.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|corner| {
            Vec3::new(
                if corner & 1 == 0 { self.min.x } else { self.max.x },
                if corner & 2 == 0 { self.min.y } else { self.max.y },
                if corner & 4 == 0 { self.min.z } else { self.max.z },
            )
        })
    }
}
