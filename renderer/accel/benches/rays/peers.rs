//! Two crates of the registry as further peers: `bvh` and `obvhs`, used as their documentation advises.
//!
//! Neither knows of packets. `bvh` has no distance culling of its own, so the query carries the nearest hit
//! so far and refuses boxes behind it. `obvhs` comes as a binary tree and as a compressed eight-wide one; its
//! triangles are put into the order of the tree's leaves.

use std::cell::Cell;
use std::time::Duration;

use bvh::aabb::{Aabb, Bounded, IntersectsAabb};
use bvh::bounding_hierarchy::{BHShape, BoundingHierarchy};
use glam::{Vec3, Vec3A};
use nalgebra::{Point3, Vector3};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::RayHit;
use obvhs::triangle::Triangle;
use treewright_accel::{Hit, Intersector, NO_INSTANCE, Ray, Triangles};

/// A triangle as `bvh` wants it.
struct Shape {
    corners: [Vec3; 3],
    number: u32,
    node: usize,
}

impl Bounded<f32, 3> for Shape {
    fn aabb(&self) -> Aabb<f32, 3> {
        let [a, b, c] = self.corners;
        let (lower, upper) = (a.min(b).min(c), a.max(b).max(c));
        Aabb::with_bounds(Point3::from(lower.to_array()), Point3::from(upper.to_array()))
    }
}

impl BHShape<f32, 3> for Shape {
    fn set_bh_node_index(&mut self, node: usize) {
        self.node = node;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// A tree of the crate `bvh`.
pub(crate) struct Bvh {
    tree: bvh::bvh::Bvh<f32, 3>,
    shapes: Vec<Shape>,
}

/// A ray that refuses boxes behind the nearest hit so far.
struct Culling {
    ray: bvh::ray::Ray<f32, 3>,
    /// Length of the direction: the crate normalises it.
    scale: f32,
    t_max: Cell<f32>,
}

impl IntersectsAabb<f32, 3> for Culling {
    fn intersects_aabb(&self, aabb: &Aabb<f32, 3>) -> bool {
        let slice = self.ray.intersection_slice_for_aabb(aabb);
        slice.is_some_and(|(begin, _)| begin <= self.t_max.get() * self.scale)
    }
}

impl Bvh {
    pub(crate) fn build(triangles: &Triangles) -> Self {
        let mut shapes: Vec<Shape> = (0..triangles.len())
            .map(|number| Shape {
                corners: triangles.corners(number).map(Vec3::from),
                number: number as u32,
                node: 0,
            })
            .collect();
        Self { tree: bvh::bvh::Bvh::build_par(&mut shapes), shapes }
    }

    /// Visits candidates until `stop` says so of a hit.
    fn search(&self, ray: &Ray, mut stop: impl FnMut(&Hit) -> bool) {
        let [origin, direction] = [ray.origin, ray.direction].map(|vector| vector.to_array());
        let query = Culling {
            ray: bvh::ray::Ray::new(Point3::from(origin), Vector3::from(direction)),
            scale: ray.direction.length(),
            t_max: Cell::new(ray.t_max),
        };
        for shape in self.tree.traverse_iterator(&query, &self.shapes) {
            if let Some((t, u, v)) = meet(&shape.corners, ray, query.t_max.get()) {
                query.t_max.set(t);
                if stop(&Hit { t, u, v, triangle: shape.number, instance: NO_INSTANCE }) {
                    return;
                }
            }
        }
    }
}

impl Intersector for Bvh {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut nearest = None;
        self.search(ray, |hit| {
            nearest = Some(*hit);
            false
        });
        nearest
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let mut met = false;
        self.search(ray, |_| {
            met = true;
            true
        });
        met
    }
}

/// Moeller and Trumbore's test (1997): distance and weights.
#[inline(always)]
fn meet([a, b, c]: &[Vec3; 3], ray: &Ray, t_max: f32) -> Option<(f32, f32, f32)> {
    let (first, second) = (*b - *a, *c - *a);
    let p = ray.direction.cross(second);
    let inverse = 1.0 / first.dot(p);
    let s = ray.origin - *a;
    let u = s.dot(p) * inverse;
    let q = s.cross(first);
    let v = ray.direction.dot(q) * inverse;
    let t = second.dot(q) * inverse;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > ray.t_min && t < t_max).then_some((t, u, v))
}

/// Trees of the crate `obvhs` over triangles in the order of its leaves.
pub(crate) struct Obvhs<T> {
    tree: T,
    ordered: Vec<Triangle>,
    numbers: Vec<u32>,
}

/// Makes a tree of `obvhs` with its slowest and best preset.
macro_rules! obvhs {
    ($tree:ty, $build:path) => {
        impl Obvhs<$tree> {
            pub(crate) fn build(triangles: &Triangles) -> Self {
                let all: Vec<Triangle> = (0..triangles.len())
                    .map(|number| {
                        let [v0, v1, v2] = triangles.corners(number);
                        Triangle { v0, v1, v2 }
                    })
                    .collect();
                let tree = $build(&all, BvhBuildParams::slow_build(), &mut Duration::default());
                let numbers = tree.primitive_indices.clone();
                let ordered = numbers.iter().map(|&number| all[number as usize]).collect();
                Self { tree, ordered, numbers }
            }
        }

        impl Intersector for Obvhs<$tree> {
            fn closest(&self, ray: &Ray) -> Option<Hit> {
                let query = to_obvhs(ray);
                let mut hit = RayHit::none();
                self.tree.ray_traverse(query, &mut hit, |ray, place| self.ordered[place].intersect(ray));
                (hit.primitive_id != obvhs::ray::INVALID_ID).then(|| Hit {
                    t: hit.t,
                    // The crate tells them on request only.
                    u: 0.0,
                    v: 0.0,
                    triangle: self.numbers[hit.primitive_id as usize],
                    instance: NO_INSTANCE,
                })
            }

            fn occluded(&self, ray: &Ray) -> bool {
                !self.tree.ray_traverse_miss(to_obvhs(ray), |ray, place| self.ordered[place].intersect(ray))
            }
        }
    };
}

obvhs!(Bvh2, build_bvh2_from_tris);
obvhs!(CwBvh, build_cwbvh_from_tris);

fn to_obvhs(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new(Vec3A::from(ray.origin), Vec3A::from(ray.direction), ray.t_min, ray.t_max)
}
