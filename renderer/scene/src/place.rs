//! The place and size of a scene as it is drawn: within the range of single precision, and around the origin
//! where its digits would be too few. Neither changes the picture.

use std::ops::Range;

use glam::{DVec3, Vec3, Vec3A};

use super::limits::{DIAGONAL_RANGE, DISTANCE_MAX};
use super::{Bounds, Material, Punctual, framing::CameraPose, objects::Objects};

/// The transform from places of a file to places of the scene: moved first, then multiplied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The place of the file, turned as the scene is, that is the scene's origin.
    pub origin: DVec3,
    /// Factor on lengths, a power of two.
    pub factor: f64,
}

impl Default for Placement {
    fn default() -> Self {
        Self { origin: DVec3::ZERO, factor: 1.0 }
    }
}

impl Placement {
    /// A place of the file in the scene.
    pub fn in_scene(&self, at: DVec3) -> Vec3 {
        ((at - self.origin) * self.factor).as_vec3()
    }
}

/// The power of two on the lengths of a scene with such a diagonal; `None` for one that is right as it is or
/// without size. A large scene stays as large as it may be, for its small parts.
pub(super) fn factor(diagonal: f32) -> Option<f32> {
    if diagonal <= 0.0 || DIAGONAL_RANGE.contains(&diagonal) {
        return None;
    }
    let fitting = if diagonal < 1.0 { 1.0 } else { *DIAGONAL_RANGE.end() };
    Some((fitting.log2() - diagonal.log2()).floor().exp2())
}

/// Whether something of such a size lies too far from the origin.
pub(super) fn is_far(centre: DVec3, diagonal: f64) -> bool {
    diagonal > 0.0 && diagonal.is_finite() && centre.length() > DISTANCE_MAX * diagonal
}

/// The middle of finite places that lie far from the origin for their extent, if they do.
pub(super) fn far_middle(places: impl Iterator<Item = DVec3>) -> Option<DVec3> {
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let around = |(min, max): (DVec3, DVec3), at: DVec3| (min.min(at), max.max(at));
    let (min, max) = places.filter(|at| at.is_finite()).fold(nothing, around);
    let middle = (min + max) * 0.5;
    is_far(middle, (max - min).length()).then_some(middle)
}

/// All lengths and places of a scene that is being assembled.
pub(super) struct Lengths<'a> {
    pub(super) positions: &'a mut [Vec3A],
    /// Ranges of the positions that are in no object.
    pub(super) in_world: &'a [Range<usize>],
    pub(super) objects: &'a mut Objects,
    pub(super) lights: &'a mut [Punctual],
    pub(super) materials: &'a mut [Material],
    pub(super) views: &'a mut [CameraPose],
}

impl Lengths<'_> {
    pub(super) fn move_by(&mut self, by: Vec3) {
        for range in self.in_world {
            self.positions[range.clone()].iter_mut().for_each(|position| *position += Vec3A::from(by));
        }
        self.objects.move_by(by);
        self.lights.iter_mut().for_each(|light| light.move_by(by));
        self.views.iter_mut().for_each(|view| view.position += by);
    }

    pub(super) fn multiply(&mut self, factor: f32) {
        self.positions.iter_mut().for_each(|position| *position *= factor);
        self.objects.multiply(factor);
        self.lights.iter_mut().for_each(|light| light.scale(factor));
        for volume in self.materials.iter_mut().filter_map(|material| material.volume.as_mut()) {
            volume.absorption /= factor;
        }
        for view in &mut *self.views {
            view.position *= factor;
            view.distance = view.distance.map(|distance| distance * factor);
        }
    }

    /// Brings places with these bounds into range, completes `placement`, and returns notes.
    pub(super) fn settle(&mut self, bounds: Bounds, placement: &mut Placement) -> Vec<String> {
        let mut notes = Vec::new();
        let diagonal = bounds.size().as_dvec3().length();
        let centre = bounds.min.as_dvec3() * 0.5 + bounds.max.as_dvec3() * 0.5;
        if !is_far(placement.origin + centre, diagonal) {
            if placement.origin != DVec3::ZERO {
                self.move_by(placement.origin.as_vec3());
                placement.origin = DVec3::ZERO;
            }
        } else if is_far(centre, diagonal) {
            let centre = centre.as_vec3();
            self.move_by(-centre);
            placement.origin += centre.as_dvec3();
        }
        if placement.origin != DVec3::ZERO {
            let DVec3 { x, y, z } = placement.origin;
            notes.push(format!(
                "The scene lies far from its origin, where single precision is not enough: it is moved by {:e},{:e},{:e}.",
                -x, -y, -z
            ));
        }
        if let Some(factor) = factor(diagonal as f32) {
            self.multiply(factor);
            placement.factor = f64::from(factor);
            notes.push(format!(
                "The scene is {:e} across, which single precision is not enough for: all lengths are multiplied by {factor:e}.",
                diagonal as f32
            ));
        }
        notes
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

    #[test]
    fn far_is_measured_by_the_size() {
        let pair = |at: f64, size: f64| [DVec3::splat(at), DVec3::splat(at + size)].into_iter();
        assert_eq!(far_middle(pair(10.0, 1.0)), None);
        assert_eq!(far_middle(pair(1e5, 1e4)), None);
        assert_eq!(far_middle(pair(0.0, 0.0)), None);
        assert_eq!(far_middle(pair(4e6, 2.0).chain([DVec3::NAN])), Some(DVec3::splat(4e6 + 1.0)));
        assert_eq!(far_middle(std::iter::empty()), None);
    }
}
