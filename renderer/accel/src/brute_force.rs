//! Every triangle against every ray, in double precision: the oracle of the tests.
//!
//! Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection" (1997), two-sided.

use std::sync::Arc;

use glam::DVec3;

use crate::geometry::{Hit, Intersector, NO_INSTANCE, Ray, Triangles};
use crate::{error::BuildError, instances::Instances};

/// No structure at all.
#[derive(Clone, Debug)]
pub struct BruteForce {
    triangles: Arc<Triangles>,
    instances: Option<Arc<Instances>>,
}

/// A hit before it is rounded to single precision.
struct Found {
    t: f64,
    u: f64,
    v: f64,
    triangle: u32,
    instance: u32,
}

impl BruteForce {
    /// Wraps the triangles.
    pub fn new(triangles: &Arc<Triangles>) -> Self {
        Self { triangles: Arc::clone(triangles), instances: None }
    }

    /// Wraps triangles that stand where instances place them. Corners go to the world in double precision.
    pub fn instanced(triangles: &Arc<Triangles>, instances: &Arc<Instances>) -> Self {
        Self { triangles: Arc::clone(triangles), instances: Some(Arc::clone(instances)) }
    }

    /// Takes over moved triangles, and instances if they moved.
    pub(crate) fn update(
        &mut self,
        triangles: &Arc<Triangles>,
        instances: Option<&Arc<Instances>>,
    ) -> Result<(), BuildError> {
        BuildError::same_count(self.triangles.len(), triangles.len())?;
        self.instances = match &self.instances {
            Some(own) => Some(own.followed_by(instances)?),
            None if instances.is_some() => return Err(BuildError::OtherInstances),
            None => None,
        };
        self.triangles = Arc::clone(triangles);
        Ok(())
    }

    /// Every triangle with its corners in the world and the instance it stands in.
    fn each(&self) -> impl Iterator<Item = ([DVec3; 3], u32, u32)> {
        let all = 0..self.triangles.len() as u32;
        let corners =
            |triangle: u32| self.triangles.corners(triangle as usize).map(|corner| corner.as_dvec3());
        let flat = self.instances.is_none().then_some(all).into_iter().flatten();
        let flat = flat.map(move |triangle| (corners(triangle), triangle, NO_INSTANCE));
        let placed = self.instances.iter().flat_map(move |instances| {
            instances.placed().iter().enumerate().flat_map(move |(number, instance)| {
                let to_world = instance.to_world.as_daffine3();
                let range = instances.objects()[instance.object as usize].clone();
                range.map(move |triangle| {
                    (corners(triangle).map(|at| to_world.transform_point3(at)), triangle, number as u32)
                })
            })
        });
        flat.chain(placed)
    }

    /// Whether a triangle is solid where a ray meets it. Masks are read as every back end reads them.
    fn is_solid(&self, ray: &Ray, triangle: u32, instance: u32) -> bool {
        let placed = self.instances.as_ref().and_then(|instances| instances.placed().get(instance as usize));
        match placed {
            Some(instance) => {
                self.triangles.is_met(triangle as usize, &instance.ray_in_object(ray, ray.t_max))
            }
            None => self.triangles.is_met(triangle as usize, ray),
        }
    }

    /// The nearest hit, or the first one found if `any` will do.
    fn search(&self, ray: &Ray, any: bool) -> Option<Found> {
        if !ray.is_valid() {
            return None;
        }
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let (t_min, mut t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
        let mut nearest = None;
        for (corners, triangle, instance) in self.each() {
            if let Some([t, u, v]) =
                test(corners, origin, direction).filter(|[t, ..]| *t > t_min && *t < t_max)
                && self.is_solid(ray, triangle, instance)
            {
                nearest = Some(Found { t, u, v, triangle, instance });
                t_max = t;
                if any {
                    break;
                }
            }
        }
        nearest
    }
}

/// Where the line meets the triangle: distance and weights of the second and third corner.
fn test([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<[f64; 3]> {
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
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some([second.dot(q) * inverse, u, v])
}

impl Intersector for BruteForce {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.search(ray, false).map(|found| Hit {
            t: found.t as f32,
            u: found.u as f32,
            v: found.v as f32,
            triangle: found.triangle,
            instance: found.instance,
        })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.search(ray, true).is_some()
    }
}
