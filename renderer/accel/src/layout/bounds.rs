//! Axis-aligned boxes.

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) lower: [f32; 3],
    pub(crate) upper: [f32; 3],
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { lower: [f32::INFINITY; 3], upper: [f32::NEG_INFINITY; 3] };

    pub(crate) fn of_corners(corners: &[glam::Vec3A; 3]) -> Self {
        let [a, b, c] = *corners;
        Self { lower: a.min(b).min(c).to_array(), upper: a.max(b).max(c).to_array() }
    }

    pub(crate) fn union(self, other: Self) -> Self {
        let axes = [0, 1, 2];
        Self {
            lower: axes.map(|axis| self.lower[axis].min(other.lower[axis])),
            upper: axes.map(|axis| self.upper[axis].max(other.upper[axis])),
        }
    }

    /// The common part of both; inverted if there is none.
    pub(crate) fn overlap(self, other: Self) -> Self {
        let axes = [0, 1, 2];
        Self {
            lower: axes.map(|axis| self.lower[axis].max(other.lower[axis])),
            upper: axes.map(|axis| self.upper[axis].min(other.upper[axis])),
        }
    }

    pub(crate) fn contains(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.lower[axis] <= other.lower[axis] && other.upper[axis] <= self.upper[axis])
    }

    /// Half the surface area, in double precision; 0 for an empty box.
    pub(crate) fn half_area(&self) -> f64 {
        let [x, y, z] =
            [0, 1, 2].map(|axis| (f64::from(self.upper[axis]) - f64::from(self.lower[axis])).max(0.0));
        x * y + y * z + z * x
    }
}
