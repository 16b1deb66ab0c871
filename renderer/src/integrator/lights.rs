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
    /// The emissive triangles, each with the instance it shines in; parallel to `table`.
    triangles: Vec<[u32; 2]>,
    table: Option<AliasTable>,
    /// Sum of area times luminance over the emissive triangles.
    power: f64,
    sun: Option<SunDisc>,
    sky: Sky,
}

/// The sun as a cone of constant radiance.
#[derive(Clone, Copy, Debug)]
struct SunDisc {
    frame: Frame,
    direction: Vec3,
    cos_half_angle: f32,
    solid_angle: f32,
    radiance: Vec3,
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

impl Lights {
    /// Collects the lights of a scene: O(triangles of emissive meshes, those of every instance counted).
    pub fn new(scene: &Scene) -> Self {
        let (mut triangles, mut weights) = (Vec::new(), Vec::new());
        for (mesh, instance) in scene.placed_meshes() {
            let strength = f64::from(luminance(scene.materials[mesh.material as usize].emission));
            if strength <= 0.0 {
                continue;
            }
            for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
                let area = f64::from(area(scene, triangle, instance));
                if area > 0.0 && area.is_finite() {
                    triangles.push([triangle, instance]);
                    weights.push(area * strength);
                }
            }
        }
        Self {
            table: AliasTable::new(&weights),
            power: weights.iter().sum(),
            triangles,
            sun: scene.sky.sun.filter(|sun| luminance(sun.irradiance) > 0.0).map(|sun| {
                // A point-like sun would have infinite radiance; a tenth of the real one's half angle is sharp enough.
                let half_angle = sun.half_angle_rad.clamp(5e-4, 1.0);
                let direction = sun.direction.normalize_or(Vec3::Y);
                SunDisc {
                    frame: Frame::new(direction),
                    direction,
                    cos_half_angle: half_angle.cos(),
                    // 1 - cos, without cancellation.
                    solid_angle: 4.0 * PI * (half_angle * 0.5).sin().powi(2),
                    radiance: sun.irradiance / (PI * half_angle.sin().powi(2)),
                }
            }),
            sky: scene.sky,
        }
    }

    /// Number of emissive triangles, those of every instance counted.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Probability that [`Lights::sample`] turns to the sun.
    fn sun_share(&self) -> f32 {
        match (self.sun.is_some(), self.table.is_some()) {
            (false, _) => 0.0,
            (true, false) => 1.0,
            (true, true) => 0.5,
        }
    }

    /// Draws a direction towards the sun or a point on an emissive triangle. `None` where there is no such
    /// light or the triangle is seen edge on.
    pub fn sample(
        &self,
        scene: &Scene,
        position: Vec3,
        choice: f32,
        pick: f32,
        u: [f32; 2],
    ) -> Option<LightSample> {
        let sun_share = self.sun_share();
        if choice < sun_share {
            let sun = self.sun.as_ref()?;
            return Some(LightSample {
                direction: sun.frame.to_world(uniform_cone(u, sun.cos_half_angle)),
                distance: f32::INFINITY,
                radiance: sun.radiance,
                pdf: sun_share / sun.solid_angle,
            });
        }
        let [triangle, instance] = self.triangles[self.table.as_ref()?.sample(pick)];
        let [a, b, c] = scene.placed().corners(triangle, instance).map(Vec3::from);
        let [v, w] = uniform_triangle(u);
        let offset = a + (b - a) * v + (c - a) * w - position;
        let distance_squared = offset.length_squared();
        let distance = distance_squared.sqrt();
        let direction = offset / distance;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let emission = scene.materials[material_of(scene, triangle)].emission;
        let pdf = self.triangle_pdf(emission, direction.dot(normal), distance_squared);
        (pdf > 0.0 && pdf.is_finite()).then_some(LightSample { direction, distance, radiance: emission, pdf })
    }

    /// Solid angle density with which [`Lights::sample`] draws a point of an emissive triangle. The
    /// triangle's area cancels: it is chosen by area times luminance, then uniformly.
    pub fn triangle_pdf(&self, emission: Vec3, cosine: f32, distance_squared: f32) -> f32 {
        if self.table.is_none() {
            return 0.0;
        }
        let density = f64::from(luminance(emission)) / self.power;
        (1.0 - self.sun_share()) * density as f32 * distance_squared / cosine.abs()
    }

    /// Radiance of the sun's disc in a direction and the density with which it is sampled.
    pub fn sun(&self, direction: Vec3) -> Option<(Vec3, f32)> {
        let sun = self.sun.as_ref()?;
        let inside = direction.dot(sun.direction) >= sun.cos_half_angle;
        inside.then(|| (sun.radiance, self.sun_share() / sun.solid_angle))
    }

    /// Radiance of the sky's gradient in a direction.
    pub fn sky(&self, direction: Vec3) -> Vec3 {
        self.sky.horizon.lerp(self.sky.zenith, direction.y.clamp(0.0, 1.0))
    }
}

fn area(scene: &Scene, triangle: u32, instance: u32) -> f32 {
    let [a, b, c] = scene.placed().corners(triangle, instance);
    0.5 * (b - a).cross(c - a).length()
}

/// Material of a triangle, by binary search over the meshes. For the few look-ups that lights need.
fn material_of(scene: &Scene, triangle: u32) -> usize {
    let mesh = scene.meshes.partition_point(|mesh| mesh.first_triangle <= triangle) - 1;
    scene.meshes[mesh].material as usize
}
