//! The upward axis of a file. Scenes use y; programs for construction and printing mostly use z.

use glam::{DVec3, Mat3, Vec3};

/// The axis of a file that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// As the format of glTF says.
    #[default]
    Y,
    /// A quarter turn about x: the front becomes the bottom.
    Z,
    /// A quarter turn about z.
    X,
}

impl Up {
    /// A place or direction of the file in the scene. No digit is lost.
    pub(super) fn turned(self, vector: Vec3) -> Vec3 {
        self.turned_far(vector.as_dvec3()).as_vec3()
    }

    /// The turn in double precision.
    pub(super) fn turned_far(self, vector: DVec3) -> DVec3 {
        match self {
            Self::Y => vector,
            Self::Z => DVec3::new(vector.x, vector.z, -vector.y),
            Self::X => DVec3::new(-vector.y, vector.x, vector.z),
        }
    }

    pub(super) fn matrix(self) -> Mat3 {
        Mat3::from_cols(self.turned(Vec3::X), self.turned(Vec3::Y), self.turned(Vec3::Z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_turn_is_one_and_brings_its_axis_up() {
        for (up, axis) in [(Up::X, Vec3::X), (Up::Y, Vec3::Y), (Up::Z, Vec3::Z)] {
            assert_eq!(up.turned(axis), Vec3::Y);
            assert_eq!(up.matrix().determinant(), 1.0);
            assert_eq!(up.matrix() * Vec3::new(1.0, 2.0, 3.0), up.turned(Vec3::new(1.0, 2.0, 3.0)));
        }
    }
}
