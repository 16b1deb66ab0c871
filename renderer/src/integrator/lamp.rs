//! The sample of a light, and emissive triangles with points on them.

use glam::Vec3;

use super::sampling::uniform_triangle;

/// A direction in which light may arrive.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit vector towards the light.
    pub direction: Vec3,
    /// Its distance; infinity for the sun and other parallel light.
    pub distance: f32,
    /// Radiance that arrives if nothing is in between.
    pub radiance: Vec3,
    /// Solid angle density. That of a light without size stands for one without bound.
    pub pdf: f32,
}

impl LightSample {
    /// Whether it can be used: not on a triangle that is seen edge on.
    #[inline(always)]
    pub(super) fn is_sound(&self) -> bool {
        self.pdf > 0.0 && self.pdf.is_finite()
    }
}

/// An emissive triangle: 64 bytes, one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Lamp {
    pub(super) corner: Vec3,
    pub(super) edges: [Vec3; 2],
    /// Unit length.
    pub(super) normal: Vec3,
    pub(super) emission: Vec3,
    /// See [`Lights::lamp_density`](super::lights::Lights::lamp_density).
    pub(super) density: f32,
}

const _: () = assert!(size_of::<Lamp>() == 64);

impl Lamp {
    /// One that is never sound.
    pub(super) const NONE: Self = Self {
        corner: Vec3::ZERO,
        edges: [Vec3::ZERO; 2],
        normal: Vec3::ZERO,
        emission: Vec3::ZERO,
        density: 0.0,
    };

    /// The share of a point's radiance that reaches a surface per area of the lamp, if nothing is in between.
    #[inline(always)]
    pub(super) fn reach(&self, position: Vec3, normal: Vec3, u: [f32; 2]) -> f32 {
        let [v, w] = uniform_triangle(u);
        let offset = self.corner + self.edges[0] * v + self.edges[1] * w - position;
        let square = offset.length_squared();
        let cosines = normal.dot(offset).max(0.0) * self.normal.dot(offset).abs();
        if square > 0.0 { cosines / (square * square) } else { 0.0 }
    }

    #[inline(always)]
    pub(super) fn sample(&self, position: Vec3, u: [f32; 2]) -> LightSample {
        let [v, w] = uniform_triangle(u);
        let offset = self.corner + self.edges[0] * v + self.edges[1] * w - position;
        let distance_squared = offset.length_squared();
        let distance = distance_squared.sqrt();
        let direction = offset * (1.0 / distance);
        let pdf = solid_angle_pdf(self.density, direction.dot(self.normal), distance_squared);
        LightSample { direction, distance, radiance: self.emission, pdf }
    }
}

/// A density over area as one over solid angle, seen from so far away at such an angle.
#[inline(always)]
pub(super) fn solid_angle_pdf(density: f32, cosine: f32, distance_squared: f32) -> f32 {
    density * distance_squared / cosine.abs()
}
