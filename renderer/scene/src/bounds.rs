//! Axis-aligned boxes around triangles.

use glam::{Affine3A, BVec3, Vec3, Vec3A};
use treewright_accel::Triangles;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Self::NOTHING
    }
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

    /// A box without a point in it, the start of a union.
    pub const NOTHING: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box around both.
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// A box around this one after `by` (Arvo, 1990), rounded outwards. Nothing stays nothing.
    pub fn transformed(&self, by: &Affine3A) -> Self {
        if self.min.x > self.max.x {
            return *self;
        }
        let (center, half) = (self.center(), (self.max - self.min) * 0.5);
        let columns = by.matrix3;
        let grown = |by: Vec3| {
            columns.x_axis.abs() * by.x + columns.y_axis.abs() * by.y + columns.z_axis.abs() * by.z
        };
        let rounding = (grown(center.abs() + half) + by.translation.abs()) * (8.0 * f32::EPSILON);
        let reach = grown(half) + rounding;
        let center = by.transform_point3a(center.into());
        Self { min: (center - reach).into(), max: (center + reach).into() }
    }

    /// Whether a ray from `origin`, of any length in `direction`, meets the box.
    pub fn is_met(&self, origin: Vec3A, direction: Vec3A) -> bool {
        let slack = (self.size() * 1e-4).max(Vec3::splat(f32::MIN_POSITIVE));
        let to_lower = (Vec3A::from(self.min - slack) - origin) / direction;
        let to_upper = (Vec3A::from(self.max + slack) - origin) / direction;
        // A ray inside a slab that it runs along divides zero by zero; min and max let the other operand win.
        let enter = to_lower.min(to_upper).max_element();
        let leave = to_lower.max(to_upper).min_element();
        enter <= leave && leave >= 0.0
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
            let is_upper = BVec3::new(corner & 1 != 0, corner & 2 != 0, corner & 4 != 0);
            Vec3::select(is_upper, self.max, self.min)
        })
    }
}
