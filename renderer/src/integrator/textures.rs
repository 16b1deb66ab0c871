//! Textures at a hit: the material and the normal at the point a ray meets.
//!
//! The level of a texture's pyramid follows from the width of the ray ([`Path::width`]), its slant, and the
//! number of texture pixels on the triangle. A slanting ray's footprint is long; its mean width is taken,
//! which a picture's many samples make sharp enough and never coarse.

use glam::{Vec2, Vec3, Vec4Swizzles};
use treewright_accel::{Hit, Ray};

use super::bsdf::Bsdf;
use super::prepared::{Prepared, Shading};
use super::surface::{WorldFacet, barycentric, interpolated};
use super::vertex::{Path, Tracing};
use crate::scene::Texture;

/// Least ratio of a footprint's width to its length.
const SLANT_MIN: f32 = 1.0 / 64.0;

struct Place {
    at: Vec2,
    /// Width of the ray where it meets the triangle, in texture coordinates.
    width: f32,
}

impl Prepared {
    /// The shading of a hit with textures looked up. A normal map turns the normals of `standing`.
    pub(super) fn look_up(
        &self,
        tracing: &Tracing,
        path: &Path,
        ray: &Ray,
        hit: &Hit,
        shading: &Shading,
        standing: &mut WorldFacet,
    ) -> Shading {
        let scene = &*self.scene;
        let mut material = scene.materials[shading.material as usize];
        let [a, ab, ac] = standing.corner_and_edges;
        let (u, v) = barycentric(ray.origin, ray.direction, [a, ab, ac], (hit.u, hit.v));
        let corners = scene.triangles.indices()[hit.triangle as usize];
        let [first, second, third] = corners.map(|vertex| scene.uvs[vertex as usize]);
        let (along_ab, along_ac) = (second - first, third - first);
        let across = ab.cross(ac);
        let area = across.length();
        let slant = (across.dot(ray.direction).abs() / area).max(SLANT_MIN);
        let width = path.width(tracing, a + ab * u + ac * v) / slant.sqrt();
        let stretch = (along_ab.perp_dot(along_ac).abs() / area).sqrt();
        let place = Place { at: first + along_ab * u + along_ac * v, width: width * stretch };
        let value = |number: u32| place.value(&scene.textures[number as usize]);
        if let Some(value) = material.base_color_texture.map(value) {
            material.base_color *= value.xyz();
            if material.blends {
                material.transmission = material.transmission.max(1.0 - material.opacity * value.w);
            }
        }
        if let Some(value) = material.metallic_roughness_texture.map(value) {
            material.roughness *= value.y;
            material.metallic *= value.z;
        }
        if let Some(value) = material.transmission_texture.map(value) {
            material.transmission *= value.x;
        }
        if let Some(value) = material.emission_texture.map(value) {
            material.emission *= value.xyz();
        }
        if let Some(value) = material.normal_texture.map(value) {
            let local =
                (value.xyz() * 2.0 - 1.0) * Vec3::new(material.normal_scale, material.normal_scale, 1.0);
            let normal = if standing.is_smooth { interpolated(standing.normals, u, v) } else { across };
            if let Some(normal) = bumped(local, normal, [ab, ac], [along_ab, along_ac]) {
                standing.normals = [normal; 3];
                standing.is_smooth = true;
            }
        }
        Shading { bsdf: Bsdf::new(&material), emission: material.emission, ..*shading }
    }
}

impl Place {
    #[inline]
    fn value(&self, texture: &Texture) -> glam::Vec4 {
        let size = texture.size().as_vec2();
        texture.sample(self.at, (self.width * (size.x * size.y).sqrt()).log2())
    }
}

/// A map's normal in the world: x along u, y against v, z along `normal`. Nothing without directions.
fn bumped(local: Vec3, normal: Vec3, [ab, ac]: [Vec3; 2], [along_ab, along_ac]: [Vec2; 2]) -> Option<Vec3> {
    let normal = normal.try_normalize()?;
    let turn = along_ab.perp_dot(along_ac);
    // The lengths cancel, the sign does not.
    let first = (ab * along_ac.y - ac * along_ab.y) * turn.signum();
    let second = (ac * along_ab.x - ab * along_ac.x) * turn.signum();
    let tangent = (first - normal * normal.dot(first)).try_normalize()?;
    let bitangent = normal.cross(tangent);
    let bitangent = if bitangent.dot(second) < 0.0 { -bitangent } else { bitangent };
    (tangent * local.x - bitangent * local.y + normal * local.z).try_normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_lean_the_way_the_picture_says() {
        // A triangle in the plane of the picture, whose texture stands upright: v runs down.
        let edges = [Vec3::X * 2.0, Vec3::Y * 3.0];
        let along = [Vec2::X, Vec2::NEG_Y];
        let bump =
            |local: Vec3, edges, along| bumped(local, Vec3::Z, edges, along).expect("it has a direction");
        let lean = Vec3::new(0.6, 0.0, 0.8);
        assert!((bump(lean, edges, along) - lean).length() < 1e-6, "red is to the right");
        let lean = Vec3::new(0.0, 0.6, 0.8);
        assert!((bump(lean, edges, along) - lean).length() < 1e-6, "green is up");
        // A mirrored picture leans to the left, and still up.
        let mirrored = bump(Vec3::new(0.6, 0.0, 0.8), edges, [Vec2::NEG_X, Vec2::NEG_Y]);
        assert!((mirrored - Vec3::new(-0.6, 0.0, 0.8)).length() < 1e-6);
        assert!((bump(lean, edges, [Vec2::NEG_X, Vec2::NEG_Y]) - lean).length() < 1e-6);
        assert_eq!(bumped(lean, Vec3::Z, edges, [Vec2::ZERO; 2]), None);
        assert_eq!(bumped(lean, Vec3::ZERO, edges, along), None);
    }
}
