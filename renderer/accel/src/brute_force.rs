//! Every triangle against every ray, in double precision: the oracle of the tests.
//!
//! Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection" (1997), two-sided.

use std::sync::Arc;

use glam::DVec3;

use crate::geometry::{Hit, Intersector, NO_INSTANCE, Ray, Triangles};

/// No structure at all.
#[derive(Clone, Debug)]
pub struct BruteForce {
    triangles: Arc<Triangles>,
}

/// A hit before it is rounded to single precision.
struct Found {
    t: f64,
    u: f64,
    v: f64,
    triangle: usize,
}

impl BruteForce {
    /// Wraps the triangles.
    pub fn new(triangles: &Arc<Triangles>) -> Self {
        Self { triangles: Arc::clone(triangles) }
    }

    fn test(
        &self,
        triangle: usize,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<Found> {
        let [a, b, c] = self.triangles.corners(triangle).map(|corner| corner.as_dvec3());
        let (first, second) = (b - a, c - a);
        let p = direction.cross(second);
        let determinant = first.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let s = origin - a;
        let u = s.dot(p) * inverse;
        let q = s.cross(first);
        let v = direction.dot(q) * inverse;
        let t = second.dot(q) * inverse;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > t_min && t < t_max).then_some(Found {
            t,
            u,
            v,
            triangle,
        })
    }
}

impl Intersector for BruteForce {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        if !ray.is_valid() {
            return None;
        }
        let (origin, direction, t_min) =
            (ray.origin.as_dvec3(), ray.direction.as_dvec3(), f64::from(ray.t_min));
        let mut nearest: Option<Found> = None;
        for triangle in 0..self.triangles.len() {
            let t_max = nearest.as_ref().map_or(f64::from(ray.t_max), |found| found.t);
            if let Some(found) = self.test(triangle, origin, direction, t_min, t_max) {
                nearest = Some(found);
            }
        }
        nearest.map(|found| Hit {
            t: found.t as f32,
            u: found.u as f32,
            v: found.v as f32,
            triangle: u32::try_from(found.triangle).expect("TRIANGLES_MAX fits"),
            instance: NO_INSTANCE,
        })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let (t_min, t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
        ray.is_valid()
            && (0..self.triangles.len())
                .any(|triangle| self.test(triangle, origin, direction, t_min, t_max).is_some())
    }
}
