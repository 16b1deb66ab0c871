//! Materials that the built-in scenes share.

use glam::Vec3;

use crate::Material;

pub(super) fn matt(red: f32, green: f32, blue: f32) -> Material {
    Material { base_color: Vec3::new(red, green, blue), ..Material::default() }
}

/// A glossy dielectric such as polished stone or paint.
pub(super) fn polished(red: f32, green: f32, blue: f32, roughness: f32) -> Material {
    Material { roughness, ..matt(red, green, blue) }
}

pub(super) fn metal(red: f32, green: f32, blue: f32, roughness: f32) -> Material {
    Material { metallic: 1.0, roughness, ..matt(red, green, blue) }
}

/// Clear glass with a tint.
pub(super) fn glass(red: f32, green: f32, blue: f32) -> Material {
    Material { transmission: 1.0, roughness: 0.0, ior: 1.5, ..matt(red, green, blue) }
}

/// Something that glows; the colour is its radiance.
pub(super) fn glow(red: f32, green: f32, blue: f32) -> Material {
    Material { emission: Vec3::new(red, green, blue), ..matt(0.0, 0.0, 0.0) }
}

pub(super) fn brass() -> Material {
    metal(0.88, 0.66, 0.32, 0.22)
}

pub(super) fn steel() -> Material {
    metal(0.62, 0.64, 0.67, 0.3)
}
