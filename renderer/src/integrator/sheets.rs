//! The places of thin sheets, which let light through: a few boxes around all of them.
//!
//! A blocked shadow ray may have met nothing but glass, and finding out takes further queries. Panes are few
//! and lie together, so a few box tests spare most rays these queries.

use glam::Vec3;
use treewright_accel::Ray;

use crate::scene::{Bounds, Mesh, Scene};

/// Most boxes. More tests would cost as much as the query they spare.
const BOXES_MAX: usize = 12;
/// Boxes are wider by this share of their largest coordinate, for the rounding of tests and rays.
const MARGIN: f32 = 1e-5;
/// Directions are taken to be at least this slanted.
const TINY: f32 = 1e-20;

/// Boxes that between them hold every thin sheet.
#[derive(Clone, Debug, Default)]
pub(super) struct Sheets {
    boxes: Vec<Bounds>,
}

impl Sheets {
    /// Boxes around the meshes that are `thin`, wherever they are placed: O(their triangles).
    pub(super) fn new(scene: &Scene, thin: impl Fn(&Mesh) -> bool) -> Self {
        let placed = scene.placed();
        let mut sheets = Self::default();
        for (mesh, instance) in
            scene.placed_meshes().filter(|(mesh, _)| mesh.triangle_count > 0 && thin(mesh))
        {
            let mut about = Bounds::NOTHING;
            for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
                for corner in placed.corners(triangle, instance).map(Vec3::from) {
                    about = about.union(&Bounds { min: corner, max: corner });
                }
            }
            let margin = Vec3::splat(about.min.abs().max(about.max.abs()).max_element() * MARGIN);
            sheets.add(Bounds { min: about.min - margin, max: about.max + margin });
        }
        sheets
    }

    /// Adds a box; when there is no room, two that fit best become one.
    fn add(&mut self, about: Bounds) {
        self.boxes.push(about);
        if self.boxes.len() <= BOXES_MAX {
            return;
        }
        let growth = |a: &Bounds, b: &Bounds| area(&a.union(b)) - area(a) - area(b);
        let pairs = (1..self.boxes.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        let best = pairs.min_by(|&(a, b), &(c, d)| {
            growth(&self.boxes[a], &self.boxes[b]).total_cmp(&growth(&self.boxes[c], &self.boxes[d]))
        });
        if let Some((a, b)) = best {
            let merged = self.boxes.swap_remove(b);
            self.boxes[a] = self.boxes[a].union(&merged);
        }
    }

    /// Whether a ray passes a place where a sheet could be.
    #[inline]
    pub(super) fn may_be_met(&self, ray: &Ray) -> bool {
        // A component of zero would make no number of a box's face through the origin.
        let inverse = ray.direction.map(|along| 1.0 / if along.abs() > TINY { along } else { TINY });
        self.boxes.iter().any(|about| {
            let (low, high) = ((about.min - ray.origin) * inverse, (about.max - ray.origin) * inverse);
            let enter = low.min(high).max_element().max(ray.t_min);
            let leave = low.max(high).min_element().min(ray.t_max);
            enter <= leave
        })
    }
}

fn area(about: &Bounds) -> f32 {
    let size = about.max - about.min;
    size.x * size.y + size.y * size.z + size.z * size.x
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn boxed(corner: [f32; 3], size: [f32; 3]) -> Bounds {
        let corner = Vec3::from_array(corner);
        Bounds { min: corner, max: corner + Vec3::from_array(size) }
    }

    #[test]
    fn rays_that_pass_by_are_spared() {
        let mut sheets = Sheets::default();
        let ray = |origin: [f32; 3], direction: Vec3, t_max| Ray {
            origin: Vec3::from_array(origin),
            direction,
            t_min: 0.0,
            t_max,
        };
        assert!(!sheets.may_be_met(&ray([0.0; 3], Vec3::X, f32::INFINITY)));
        sheets.add(boxed([1.0, -1.0, -1.0], [0.0, 2.0, 2.0]));
        assert!(sheets.may_be_met(&ray([0.0; 3], Vec3::X, f32::INFINITY)));
        assert!(!sheets.may_be_met(&ray([0.0; 3], Vec3::X, 0.5)), "it ends before");
        assert!(!sheets.may_be_met(&ray([0.0; 3], Vec3::NEG_X, f32::INFINITY)));
        assert!(!sheets.may_be_met(&ray([0.0, 3.0, 0.0], Vec3::X, f32::INFINITY)));
    }

    proptest! {
        /// However many boxes are merged, a ray to a point in one of them is never turned away.
        #[test]
        fn no_sheet_is_overlooked(
            corners in prop::collection::vec((prop::array::uniform3(-9.0_f32..9.0), prop::array::uniform3(0.0_f32..2.0)), 1..40),
            origin in prop::array::uniform3(-12.0_f32..12.0),
            which in 0.0_f32..1.0,
            place in prop::array::uniform3(0.0_f32..1.0),
        ) {
            let boxes: Vec<Bounds> = corners.iter().map(|(corner, size)| boxed(*corner, *size)).collect();
            let mut sheets = Sheets::default();
            for about in &boxes {
                let margin = Vec3::splat(20.0 * MARGIN);
                sheets.add(Bounds { min: about.min - margin, max: about.max + margin });
            }
            prop_assert!(sheets.boxes.len() <= BOXES_MAX);
            let about = boxes[(which * boxes.len() as f32) as usize];
            let target = about.min + (about.max - about.min) * Vec3::from_array(place);
            let origin = Vec3::from_array(origin);
            let ray = Ray { origin, direction: target - origin, t_min: 0.0, t_max: 1.001 };
            prop_assert!(sheets.may_be_met(&ray));
        }
    }
}
