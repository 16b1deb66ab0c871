//! The light that comes through thin sheets along a shadow ray.

use glam::Vec3;
use treewright_accel::{Intersector, Ray};

use super::surface::{Surface, WorldFacet};
use super::vertex::{DIRECT, Path, Tracing};
use super::{Counts, prepared::Prepared, random::PathRandom};
use crate::limits::SHEETS_PER_SEGMENT_MAX;

/// Sheets on the way of a shadow ray are looked up as they are: no ray is thinner.
const SHADOW: Tracing = Tracing { bounces: 0, pixel_angle: 0.0, last_rays: false };
const SHADOW_PATH: Path = Path {
    first: 0.0,
    throughput: Vec3::ONE,
    pdf: DIRECT,
    from: Vec3::ZERO,
    pixel: 0,
    random: PathRandom::NONE,
    vertex: 0,
    bounce: 0,
    sheets: 0,
};

/// Share of light through thin sheets along a blocked shadow ray. Most rays pass no place where a sheet could
/// be, and then, or if no nearest hit is found, the blocker is opaque.
pub(super) fn through_sheets<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    mut ray: Ray,
    counts: &mut Counts,
) -> Vec3 {
    if !prepared.sheets.may_be_met(&ray) {
        return Vec3::ZERO;
    }
    let mut seen = Vec3::ONE;
    for passed in 0..=SHEETS_PER_SEGMENT_MAX {
        counts.rays += 1;
        let Some(hit) = intersector.closest(&ray) else { return if passed > 0 { seen } else { Vec3::ZERO } };
        counts.hits += 1;
        let facet = &prepared.facets[hit.triangle as usize];
        let mut standing = WorldFacet::new::<true>(facet, prepared.scene.instance(hit.instance));
        let mut shading = *prepared.surface::<true>(facet);
        if shading.textured {
            shading = prepared.look_up(&SHADOW, &SHADOW_PATH, &ray, &hit, &shading, &mut standing);
        }
        let bsdf = &shading.bsdf;
        let Some(surface) = Surface::new::<true>(&standing, &ray, &hit).filter(|_| bsdf.is_thin()) else {
            return Vec3::ZERO;
        };
        seen *= bsdf.transmittance(-ray.direction.dot(surface.shading_normal));
        let next = surface.start(ray.direction);
        ray.t_max -= (next - ray.origin).length();
        ray.origin = next;
        if ray.t_max <= 0.0 {
            return seen;
        }
    }
    Vec3::ZERO
}
