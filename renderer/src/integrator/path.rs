//! One path: from the camera, over at most so many bounces, to the lights.
//!
//! At each point a light is sampled directly, and the surface's own sampling finds lights and sky; the two
//! are weighed by the power heuristic (Veach 1997). Thin sheets let paths and shadow rays pass straight
//! through, which is no bounce: the path keeps its density, so that both techniques still see the same light.

use glam::Vec3;
use treewright_accel::{Intersector, Ray};

use super::bsdf::Scatter;
use super::random::PathRandom;
use super::sampling::{Frame, power_heuristic};
use super::surface::Surface;
use super::{Counts, Prepared};
use crate::limits::SHEETS_PER_SEGMENT_MAX;

/// A shadow ray ends this share before the light, so that it does not meet the light itself.
const SHADOW_SHARE: f32 = 1.0 - 1e-4;

/// How the current ray came about: what a light it meets must be weighed against.
#[derive(Clone, Copy)]
enum Origin {
    /// The camera, or only perfect mirrors since: no other technique finds these lights.
    Direct,
    /// A perfect mirror after a rough surface. The same, but the sun's tiny disc is left out: such
    /// caustics are too rare to converge and would only leave bright dots.
    Caustic,
    /// A rough lobe at this point with this density.
    Rough { position: Vec3, pdf: f32 },
}

/// Radiance that arrives along a camera ray.
pub(super) fn radiance<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    mut ray: Ray,
    bounces: u32,
    random: &mut PathRandom,
    counts: &mut Counts,
) -> Vec3 {
    let scene = &*prepared.scene;
    let lights = &prepared.lights;
    let mut radiance = Vec3::ZERO;
    let mut throughput = Vec3::ONE;
    let mut origin = Origin::Direct;
    let mut bounce = 0;
    let mut sheets = 0;
    loop {
        counts.rays += 1;
        let Some(hit) = intersector.closest(&ray) else {
            radiance += throughput * (lights.sky(ray.direction) + weighed_sun(prepared, &ray, origin));
            return radiance;
        };
        counts.hits += 1;
        let material = prepared.material_of[hit.triangle as usize] as usize;
        let Some(surface) = Surface::new(scene, &ray, &hit) else {
            return radiance;
        };
        let emission = scene.materials[material].emission;
        if emission != Vec3::ZERO {
            let weight = match origin {
                Origin::Direct | Origin::Caustic => 1.0,
                Origin::Rough { position, pdf } => {
                    let cosine = surface.geometric_normal.dot(ray.direction);
                    let distance_squared = surface.position.distance_squared(position);
                    power_heuristic(pdf, lights.triangle_pdf(emission, cosine, distance_squared))
                }
            };
            radiance += throughput * emission * weight;
        }
        let bsdf = &prepared.bsdfs[material];
        let frame = Frame::new(surface.shading_normal);
        let view = frame.to_local(-ray.direction);
        let last = bounce == bounces;

        let (choice, pick, u) = (random.single(), random.single(), random.pair());
        if let Some(light) = lights.sample(scene, surface.position, choice, pick, u) {
            let value = bsdf.evaluate(view, frame.to_local(light.direction));
            let outside = light.direction.dot(surface.geometric_normal) > 0.0;
            if outside && value != Vec3::ZERO {
                let start = surface.start(light.direction);
                let reach = light.distance * SHADOW_SHARE;
                let seen = visibility(prepared, intersector, start, light.direction, reach, counts);
                // After the last bounce the surface's own sampling does not follow, so nothing is shared.
                let other = if last { 0.0 } else { bsdf.pdf(view, frame.to_local(light.direction)) };
                let weight = power_heuristic(light.pdf, other) / light.pdf;
                radiance += throughput * value * light.radiance * seen * weight;
            }
        }

        let (choice, u) = (random.single(), random.pair());
        let Some(sample) = bsdf.sample(view, choice, u) else {
            return radiance;
        };
        let through = sample.scatter == Scatter::Through;
        if through {
            sheets += 1;
            if sheets > SHEETS_PER_SEGMENT_MAX {
                return radiance;
            }
        } else {
            if last {
                return radiance;
            }
            bounce += 1;
            sheets = 0;
        }
        throughput *= sample.weight;
        let direction =
            if through { ray.direction } else { frame.to_world(sample.direction).normalize_or_zero() };
        // A direction above the shading normal's horizon but below the triangle's would start inside the solid.
        if throughput == Vec3::ZERO || (!through && direction.dot(surface.geometric_normal) <= 0.0) {
            return radiance;
        }
        origin = match (sample.scatter, origin) {
            (Scatter::Through, _) => origin,
            (Scatter::Rough, _) => Origin::Rough { position: surface.position, pdf: sample.pdf },
            (Scatter::Mirror, Origin::Direct) => Origin::Direct,
            (Scatter::Mirror, Origin::Caustic | Origin::Rough { .. }) => Origin::Caustic,
        };
        ray = Ray { origin: surface.start(direction), direction, t_min: 0.0, t_max: f32::INFINITY };
    }
}

/// Radiance of the sun's disc, if the ray ends in it.
fn weighed_sun(prepared: &Prepared, ray: &Ray, origin: Origin) -> Vec3 {
    match (prepared.lights.sun(ray.direction), origin) {
        (None, _) | (_, Origin::Caustic) => Vec3::ZERO,
        (Some((radiance, _)), Origin::Direct) => radiance,
        (Some((radiance, sun_pdf)), Origin::Rough { pdf, .. }) => radiance * power_heuristic(pdf, sun_pdf),
    }
}

/// Share of light that comes through: 1 or 0, or the tint of the thin sheets in between.
fn visibility<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    start: Vec3,
    direction: Vec3,
    reach: f32,
    counts: &mut Counts,
) -> Vec3 {
    let mut ray = Ray { origin: start, direction, t_min: 0.0, t_max: reach };
    counts.shadow_rays += 1;
    if !intersector.occluded(&ray) {
        return Vec3::ONE;
    }
    if !prepared.has_sheets {
        return Vec3::ZERO;
    }
    let mut seen = Vec3::ONE;
    for _ in 0..=SHEETS_PER_SEGMENT_MAX {
        counts.rays += 1;
        let Some(hit) = intersector.closest(&ray) else {
            return seen;
        };
        counts.hits += 1;
        let bsdf = &prepared.bsdfs[prepared.material_of[hit.triangle as usize] as usize];
        let Some(surface) = Surface::new(&prepared.scene, &ray, &hit).filter(|_| bsdf.is_thin()) else {
            return Vec3::ZERO;
        };
        seen *= bsdf.transmittance(-direction.dot(surface.shading_normal));
        let next = surface.start(direction);
        ray.t_max -= (next - ray.origin).length();
        ray.origin = next;
        if ray.t_max <= 0.0 {
            return seen;
        }
    }
    Vec3::ZERO
}
