//! Where a path meets the scene: position, normals, and how to leave again without meeting the same place.
//!
//! Barycentric weights are computed again from ray and triangle (Möller and Trumbore 1997), so that the
//! rounding of one accelerator's kernel never reaches the picture: the same triangle gives the same point.

use glam::{Affine3A, Vec3, Vec3A};
use treewright_accel::{Hit, Ray};

use crate::scene::Scene;

/// How far a new ray starts from the surface, relative to the magnitude of the hit point. A point computed
/// from barycentric weights is good to a few units in the last place of its largest coordinate; Wächter and
/// Binder (A Fast and Robust Method for Avoiding Self-Intersection, Ray Tracing Gems 2019, chapter 6) find
/// that offsets of this order hold for every coordinate range.
const OFFSET_OF_POSITION: f32 = 64.0 * f32::EPSILON;

/// The same relative to the triangle's longest edge: an intersection test loses that much of it.
const OFFSET_OF_EDGE: f32 = 8.0 * f32::EPSILON;

/// A point on a triangle, seen from a ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    /// Where it is.
    pub(super) position: Vec3,
    /// Unit normal of the triangle, on the viewer's side.
    pub(super) geometric_normal: Vec3,
    /// Unit normal for shading, on the viewer's side of both surfaces.
    pub(super) shading_normal: Vec3,
    /// Distance by which new rays start off the surface.
    offset: f32,
}

impl Surface {
    /// The point where `ray` meets the triangle of `hit`. `None` if the triangle has no area.
    pub(super) fn new(scene: &Scene, ray: &Ray, hit: &Hit) -> Option<Self> {
        let [a, b, c] = scene.placed().corners(hit.triangle, hit.instance);
        let (ab, ac) = (b - a, c - a);
        let (u, v) = barycentric(ray, a, ab, ac).unwrap_or((hit.u, hit.v));
        let mut geometric_normal = Vec3::from(ab.cross(ac)).try_normalize()?;
        if geometric_normal.dot(ray.direction) > 0.0 {
            geometric_normal = -geometric_normal;
        }
        let position = Vec3::from(a + ab * u + ac * v);
        let edge = ab.abs().max_element().max(ac.abs().max_element());
        let to_object = scene.instance(hit.instance).map(|instance| &instance.to_object);
        // A ray's way into an object's space rounds at the magnitude of the object's place as well.
        let place =
            scene.instance(hit.instance).map_or(0.0, |at| at.to_world.translation.abs().max_element());
        Some(
            Self {
                position,
                geometric_normal,
                shading_normal: shading_normal(scene, ray, hit.triangle, to_object, [1.0 - u - v, u, v])
                    .unwrap_or(geometric_normal),
                offset: OFFSET_OF_POSITION * position.abs().max_element().max(place) + OFFSET_OF_EDGE * edge,
            }
            .guarded(ray),
        )
    }

    /// Normals interpolated over coarse meshes can turn away from the viewer or from the triangle; the
    /// triangle's own normal is right then.
    fn guarded(mut self, ray: &Ray) -> Self {
        if self.shading_normal.dot(self.geometric_normal) < 0.0 {
            self.shading_normal = -self.shading_normal;
        }
        if self.shading_normal.dot(ray.direction) >= 0.0 {
            self.shading_normal = self.geometric_normal;
        }
        self
    }

    /// Where a ray in `direction` starts: off the surface, on the side it goes to.
    pub(super) fn start(&self, direction: Vec3) -> Vec3 {
        let side = self.offset.copysign(direction.dot(self.geometric_normal));
        self.position + self.geometric_normal * side
    }
}

/// Weights of the second and third corner, clamped to the triangle. `None` for a ray in its plane.
fn barycentric(ray: &Ray, a: Vec3A, ab: Vec3A, ac: Vec3A) -> Option<(f32, f32)> {
    let direction = Vec3A::from(ray.direction);
    let across = direction.cross(ac);
    let inverse = 1.0 / ab.dot(across);
    let from = Vec3A::from(ray.origin) - a;
    let u = from.dot(across) * inverse;
    let v = direction.dot(from.cross(ab)) * inverse;
    if !(u.is_finite() && v.is_finite()) {
        return None;
    }
    let u = u.clamp(0.0, 1.0);
    Some((u, v.clamp(0.0, 1.0 - u)))
}

fn shading_normal(
    scene: &Scene,
    ray: &Ray,
    triangle: u32,
    to_object: Option<&Affine3A>,
    weights: [f32; 3],
) -> Option<Vec3> {
    if scene.normals.is_empty() {
        return None;
    }
    let [a, b, c] = scene.triangles.indices()[triangle as usize].map(|vertex| scene.normals[vertex as usize]);
    let mut normal = a * weights[0] + b * weights[1] + c * weights[2];
    if let Some(to_object) = to_object {
        // Normals go to the world by the inverse's transpose.
        normal = to_object.matrix3.transpose() * normal;
    }
    let normal = normal.try_normalize()?;
    Some(if normal.dot(ray.direction) > 0.0 { -normal } else { normal })
}
