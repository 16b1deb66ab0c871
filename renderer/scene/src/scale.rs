//! Scenes so small or large that squares and fourth powers of their lengths leave the range of single
//! precision: they are drawn larger or smaller, which changes nothing in the picture.

use glam::Vec3A;

use super::framing::CameraPose;
use super::limits::DIAGONAL_RANGE;
use super::objects::Objects;
use super::{Material, Punctual};

/// The factor on the lengths of a scene with such a diagonal, a power of two; `None` for one that is right as
/// it is, and for one without size. A large scene stays as large as it may be, because it may have small
/// parts.
pub(super) fn factor(diagonal: f32) -> Option<f32> {
    if diagonal <= 0.0 || DIAGONAL_RANGE.contains(&diagonal) {
        return None;
    }
    let fitting = if diagonal < 1.0 { 1.0 } else { *DIAGONAL_RANGE.end() };
    Some((fitting.log2() - diagonal.log2()).floor().exp2())
}

/// All lengths of a scene that is being assembled.
pub(super) struct Lengths<'a> {
    pub(super) positions: &'a mut [Vec3A],
    pub(super) objects: &'a mut Objects,
    pub(super) lights: &'a mut [Punctual],
    pub(super) materials: &'a mut [Material],
    pub(super) views: &'a mut [CameraPose],
}

impl Lengths<'_> {
    /// Multiplies them by a factor.
    pub(super) fn multiply(self, factor: f32) {
        self.positions.iter_mut().for_each(|position| *position *= factor);
        self.objects.multiply(factor);
        self.lights.iter_mut().for_each(|light| *light = light.scaled(factor));
        for volume in self.materials.iter_mut().filter_map(|material| material.volume.as_mut()) {
            volume.absorption /= factor;
        }
        for view in self.views {
            view.position *= factor;
            view.distance = view.distance.map(|distance| distance * factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_out_of_range_is_changed() {
        for diagonal in [0.0, 1e-6, 1e-3, 1.0, 1e7] {
            assert_eq!(factor(diagonal), None);
        }
        for diagonal in [1e-30, 1e-10, 9e-7, 1.1e7, 1e9, 1e12_f32] {
            let factor = factor(diagonal).expect("it is changed");
            assert_eq!(factor.log2().fract(), 0.0);
            let result = diagonal * factor;
            let range = if diagonal < 1.0 { 0.5..=1.0 } else { 0.5e7..=1e7 };
            assert!(range.contains(&result), "{diagonal} became {result}");
        }
    }
}
