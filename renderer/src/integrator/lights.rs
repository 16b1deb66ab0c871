//! What shines: emissive triangles chosen by power, the sun, and the sky.
//!
//! Emissive triangles shine to both sides, because the winding in scene files cannot be relied on. The sky's
//! gradient is smooth and is left to the surfaces' own sampling; triangles and sun are also sampled directly.

use std::f32::consts::PI;

use glam::Vec3;

use super::sampling::{AliasTable, Frame, luminance, uniform_cone, uniform_triangle};
use crate::scene::{Scene, Sky};

/// The lights of a scene, ready to be sampled.
#[derive(Clone, Debug)]
pub struct Lights {
    /// The emissive triangles, parallel to `table`.
    lamps: Vec<Lamp>,
    table: Option<AliasTable>,
    /// Density over area with which a point that emits luminance 1 is sampled.
    density: f32,
    sun: Option<SunDisc>,
    /// Probability that [`Lights::sample`] turns to the sun.
    sun_share: f32,
    sky: Sky,
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
    /// See [`Lights::lamp_density`].
    pub(super) density: f32,
}

const _: () = assert!(size_of::<Lamp>() == 64);

impl Lamp {
    /// A point on it, seen from a position.
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

/// The sun as a cone of constant radiance.
#[derive(Clone, Copy, Debug)]
pub(super) struct SunDisc {
    frame: Frame,
    direction: Vec3,
    cos_half_angle: f32,
    radiance: Vec3,
    /// Solid angle density with which it is sampled.
    pdf: f32,
}

impl SunDisc {
    /// A point on its disc.
    #[inline(always)]
    pub(super) fn sample(&self, u: [f32; 2]) -> LightSample {
        LightSample {
            direction: self.frame.to_world(uniform_cone(u, self.cos_half_angle)),
            distance: f32::INFINITY,
            radiance: self.radiance,
            pdf: self.pdf,
        }
    }
}

/// A direction in which light may arrive.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit vector towards the light.
    pub direction: Vec3,
    /// How far it is; infinity for the sun.
    pub distance: f32,
    /// Radiance that arrives if nothing is in between.
    pub radiance: Vec3,
    /// Solid angle density.
    pub pdf: f32,
}

impl LightSample {
    /// Whether it can be used: not on a triangle that is seen edge on.
    #[inline(always)]
    pub(super) fn is_sound(&self) -> bool {
        self.pdf > 0.0 && self.pdf.is_finite()
    }
}

impl Lights {
    /// Collects the lights of a scene: O(triangles of emissive meshes, those of every instance counted).
    pub fn new(scene: &Scene) -> Self {
        let (mut lamps, mut weights) = (Vec::new(), Vec::new());
        let placed = scene.placed();
        for (mesh, instance) in scene.placed_meshes() {
            let emission = scene.materials[mesh.material as usize].emission;
            let strength = f64::from(luminance(emission));
            if strength <= 0.0 {
                continue;
            }
            for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
                let [a, b, c] = placed.corners(triangle, instance).map(Vec3::from);
                let across = (b - a).cross(c - a);
                let area = f64::from(0.5 * across.length());
                if area > 0.0 && area.is_finite() {
                    let normal = across.normalize_or_zero();
                    lamps.push(Lamp { corner: a, edges: [b - a, c - a], normal, emission, density: 0.0 });
                    weights.push(area * strength);
                }
            }
        }
        let table = AliasTable::new(&weights);
        let sun = scene.sky.sun.filter(|sun| luminance(sun.irradiance) > 0.0);
        let sun_share = match (sun, &table) {
            (None, _) => 0.0,
            (Some(_), None) => 1.0,
            (Some(_), Some(_)) => 0.5,
        };
        let power: f64 = weights.iter().sum();
        let density = if table.is_some() { ((1.0 - f64::from(sun_share)) / power) as f32 } else { 0.0 };
        for lamp in &mut lamps {
            lamp.density = density * luminance(lamp.emission);
        }
        let sun = sun.map(|sun| {
            // A point-like sun would have infinite radiance; a tenth of the real one's half angle is sharp enough.
            let half_angle = sun.half_angle_rad.clamp(5e-4, 1.0);
            let direction = sun.direction.normalize_or(Vec3::Y);
            // 1 - cos, without cancellation.
            let solid_angle = 4.0 * PI * (half_angle * 0.5).sin().powi(2);
            SunDisc {
                frame: Frame::new(direction),
                direction,
                cos_half_angle: half_angle.cos(),
                radiance: sun.irradiance / (PI * half_angle.sin().powi(2)),
                pdf: sun_share / solid_angle,
            }
        });
        Self { lamps, table, density, sun, sun_share, sky: scene.sky }
    }

    /// Number of emissive triangles, those of every instance counted.
    pub fn triangle_count(&self) -> usize {
        self.lamps.len()
    }

    /// Whether emissive triangles are sampled.
    pub fn has_lamps(&self) -> bool {
        self.table.is_some()
    }

    /// Whether a sun is sampled.
    pub fn has_sun(&self) -> bool {
        self.sun.is_some()
    }

    /// Draws a direction towards the sun or a point on an emissive triangle. `None` where there is no such
    /// light or the triangle is seen edge on. `LAMPS` and `SUN` are false where the scene has none.
    #[inline(always)]
    pub fn sample<const LAMPS: bool, const SUN: bool>(
        &self,
        position: Vec3,
        [choice, pick]: [f32; 2],
        u: [f32; 2],
    ) -> Option<LightSample> {
        if SUN
            && let Some(sun) = &self.sun
            && (!LAMPS || choice < self.sun_share)
        {
            return Some(sun.sample(u));
        }
        if !LAMPS {
            return None;
        }
        let light = self.lamp(pick)?.sample(position, u);
        light.is_sound().then_some(light)
    }

    /// The emissive triangle that belongs to a number in [0, 1). `None` if there is none.
    #[inline(always)]
    pub(super) fn lamp(&self, pick: f32) -> Option<&Lamp> {
        Some(&self.lamps[self.table.as_ref()?.sample(pick)])
    }

    /// The sun, and the probability that [`Lights::sample`] turns to it.
    #[inline(always)]
    pub(super) fn sun_disc(&self) -> (Option<&SunDisc>, f32) {
        (self.sun.as_ref(), self.sun_share)
    }

    /// Density over area with which [`Lights::sample`] draws a point that emits so much. The triangle's area
    /// cancels: it is chosen by area times luminance, then uniformly.
    pub fn lamp_density(&self, emission: Vec3) -> f32 {
        self.density * luminance(emission)
    }

    /// Radiance of the sun's disc in a direction and the density with which it is sampled.
    #[inline(always)]
    pub fn sun(&self, direction: Vec3) -> Option<(Vec3, f32)> {
        let sun = self.sun.as_ref()?;
        let inside = direction.dot(sun.direction) >= sun.cos_half_angle;
        inside.then_some((sun.radiance, sun.pdf))
    }

    /// Radiance of the sky's gradient in a direction.
    #[inline(always)]
    pub fn sky(&self, direction: Vec3) -> Vec3 {
        self.sky.horizon + (self.sky.zenith - self.sky.horizon) * direction.y.clamp(0.0, 1.0)
    }
}

/// A density over area as one over solid angle, seen from so far away at such an angle.
#[inline(always)]
pub(super) fn solid_angle_pdf(density: f32, cosine: f32, distance_squared: f32) -> f32 {
    density * distance_squared / cosine.abs()
}
