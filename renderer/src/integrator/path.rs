//! Path by path, from the camera to the lights: the simple way, and the reference for the others.

use glam::Vec3;
use treewright_accel::{Intersector, Ray};

use super::vertex::{Path, Shadow, missed};
use super::{Counts, frame::Frame, shadows::through_sheets};

/// Radiance that arrives along a camera ray.
pub(super) fn radiance<I: Intersector>(
    frame: &Frame,
    intersector: &I,
    mut path: Path,
    mut ray: Ray,
    counts: &mut Counts,
) -> Vec3 {
    let (prepared, kernel) = (frame.prepared, &frame.kernel);
    let mut radiance = Vec3::ZERO;
    let mut shadow = Shadow::BLANK;
    for stage in 0.. {
        counts.rays += 1;
        if frame.is_blind(stage) {
            if intersector.occluded(&ray) {
                counts.hits += 1;
            } else {
                radiance += missed(prepared, &frame.tracing, &path, &ray);
            }
            break;
        }
        let Some(hit) = intersector.closest(&ray) else {
            radiance += missed(prepared, &frame.tracing, &path, &ray);
            break;
        };
        counts.hits += 1;
        let (random, vertex) = (path.random, path.vertex);
        let next =
            (kernel.vertex)(prepared, &frame.tracing, &mut path, &mut ray, &hit, &mut radiance, &mut shadow);
        if next.shadow && frame.roulette.keeps_shadow(random, vertex, &mut shadow) {
            counts.shadow_rays += 1;
            if !intersector.occluded(&shadow.ray) {
                radiance += shadow.light;
            } else if kernel.needs.sheets {
                radiance += shadow.light * through_sheets(prepared, intersector, shadow.ray, counts);
            }
        }
        if !next.goes_on || !frame.keeps_path(vertex, &mut path) {
            break;
        }
    }
    radiance
}
