//! Glass and other transmitting solids: light bends on the way in and out, and is absorbed between.
//!
//! A surface whose material has a volume bounds a solid; its front is outside. Where a path meets one,
//! Fresnel's equations give the reflected share, and one of the two ways is drawn, a rough one by its visible
//! microfacets (Walter et al., EGSR 2007; Heitz, JCGT 2018).
//!
//! So a solid throws a full shadow, and focused light is found only if the light is large or far around; the
//! sun's disc is left out. Ways inside count as sheets, not as bounces. The change of radiance by the square
//! of the index, which leaving undoes, is left out.

use glam::Vec3;
use treewright_accel::Ray;

use super::bsdf::{MIRROR_ROUGHNESS, masking, visible_normal};
use super::vertex::{Context, END, Next, Path, Shadow};
use super::{places, prepared::Shading, sampling::Basis, surface::WorldFacet};
use crate::limits::SOLID_WAYS_MAX;

/// Share of unpolarised light that a smooth surface reflects (Fresnel), and the cosine on the other side.
/// `eta` is the index on the side light comes from over the other's.
pub(super) fn fresnel(cosine: f32, eta: f32) -> (f32, Option<f32>) {
    let sine_squared = eta * eta * (1.0 - cosine * cosine);
    if sine_squared >= 1.0 {
        return (1.0, None);
    }
    let other = (1.0 - sine_squared).sqrt();
    let parallel = (cosine - eta * other) / (cosine + eta * other);
    let perpendicular = (eta * cosine - other) / (eta * cosine + other);
    (0.5 * (parallel * parallel + perpendicular * perpendicular), Some(other))
}

impl Context<'_> {
    /// A solid's surface, met from outside or from within.
    #[inline(never)]
    pub(super) fn solid<const NEEDS: usize>(
        &self,
        shading: &Shading,
        standing: &WorldFacet,
        path: &mut Path,
        ray: &mut Ray,
        shadow: &mut Shadow,
    ) -> Next {
        let scene = &self.prepared.scene;
        let material = &scene.materials[shading.material as usize];
        let [_, ab, ac] = standing.corner_and_edges;
        let enters = (ab.cross(ac).dot(ray.direction) < 0.0) != standing.is_mirrored;
        if let Some(volume) = material.volume.filter(|_| !enters) {
            let way = self.surface.position.distance(ray.origin);
            path.throughput *= (volume.absorption * -way).map(f32::exp);
        }
        let [choice, way] = path.random.pair(places::of_solid(self.place));
        let share = material.transmission * (1.0 - material.metallic);
        if enters && choice >= share {
            return self.layered::<NEEDS, false>(&shading.bsdf, path, ray, shadow);
        }
        let frame = Basis::new(self.surface.shading_normal);
        let view = frame.to_local(-ray.direction);
        if view.z <= 0.0 {
            return END;
        }
        let eta = if enters { 1.0 / material.ior } else { material.ior };
        let (facet, alpha) = if material.roughness < MIRROR_ROUGHNESS {
            (Vec3::Z, None)
        } else {
            let alpha = material.roughness * material.roughness;
            (visible_normal(alpha, view, path.random.pair(self.place + 3)).normalize_or(Vec3::Z), Some(alpha))
        };
        let cosine = view.dot(facet).clamp(0.0, 1.0);
        let (reflected, other) = fresnel(cosine, eta);
        let (local, weight) = match other.filter(|_| way >= reflected) {
            Some(other) => (facet * (eta * cosine - other) - view * eta, material.base_color),
            None => (facet * (2.0 * cosine) - view, Vec3::ONE),
        };
        let refracts = local.z < 0.0;
        // A facet's light that another facet stands in the way of is lost.
        let weight = weight * alpha.map_or(1.0, |alpha| masking(alpha, local.z.abs()));
        let direction = frame.to_world(local).normalize_or_zero();
        let leaves = direction.dot(self.surface.geometric_normal) < 0.0;
        if refracts != leaves || refracts != (other.is_some() && way >= reflected) {
            return END;
        }
        let pdf = path.mirrored_pdf();
        if enters && !refracts {
            let goes_on = !self.last && self.turn(path, ray, direction, weight, pdf);
            return Next { shadow: false, goes_on };
        }
        path.throughput *= weight;
        path.sheets += 1;
        self.redirect(path, ray, direction, pdf);
        let goes_on = u32::from(path.sheets) <= SOLID_WAYS_MAX && path.throughput != Vec3::ZERO;
        Next { shadow: false, goes_on }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_and_snell_agree_with_the_textbook() {
        // Straight on: ((n - 1) / (n + 1))², both ways.
        for eta in [1.0 / 1.5, 1.5] {
            let (reflected, other) = fresnel(1.0, eta);
            assert!((reflected - 0.04).abs() < 1e-6 && other.is_some_and(|other| (other - 1.0).abs() < 1e-6));
        }
        // Brewster's angle reflects only one polarisation: tan = n.
        let brewster = (1.0_f32 / (1.0 + 1.5 * 1.5)).sqrt();
        let (reflected, other) = fresnel(brewster, 1.0 / 1.5);
        assert!((reflected - 0.5 * (5.0_f32 / 13.0).powi(2)).abs() < 1e-5, "{reflected}");
        let (there, back) = (other.expect("it passes"), fresnel(other.expect("it passes"), 1.5));
        assert!((back.0 - reflected).abs() < 1e-5, "as much is reflected from within");
        assert!(back.1.is_some_and(|cosine| (cosine - brewster).abs() < 1e-5), "{there}");
        // Beyond asin(1 / 1.5) = 41.8 degrees nothing leaves.
        assert_eq!(fresnel(42.0_f32.to_radians().cos(), 1.5), (1.0, None));
        assert!(fresnel(41.5_f32.to_radians().cos(), 1.5).1.is_some());
    }
}
