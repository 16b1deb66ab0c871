//! The crate `bvh`: its builder takes no options, so the only choice is the way through the tree.

use std::cell::Cell;
use std::error::Error;

use ::bvh::aabb::{Aabb, Bounded, IntersectsAabb};
use ::bvh::bounding_hierarchy::{BHShape, BoundingHierarchy};
use ::bvh::bvh::Bvh;
use ::bvh::flat_bvh::FlatBvh;
use ::bvh::ray::Ray as CrateRay;
use ::obvhs::ray::Ray;
use ::obvhs::triangle::Triangle;
use glam::Vec3A;
use nalgebra::{Point3, Vector3};
use treewright_client::{Configuration, Space, SpaceError};

use super::{Cost, processor_ms, trace};
use crate::mesh::Mesh;

/// Ways through the tree. `collect` is what the crate's documentation shows: every box that the ray meets, in
/// a list. `culled` visits them one by one and leaves out those behind the nearest hit so far.
/// `nearest_child` visits the nearer child first and looks at all. `flat` walks the array that the crate
/// makes of a tree.
const TRAVERSALS: [&str; 4] = ["collect", "culled", "nearest_child", "flat"];

pub(super) fn space() -> Result<Space, SpaceError> {
    Space::builder().categorical("bvh_traversal", TRAVERSALS).default("collect").build()
}

pub(super) fn fixed() -> Vec<(String, Configuration)> {
    let one = |name: &str| (name.to_owned(), Configuration::new().with("bvh_traversal", name));
    TRAVERSALS.map(one).to_vec()
}

/// A triangle as the crate wants it. Whether a ray meets it is computed by `obvhs`: the crate's own test
/// leaves out triangles that are seen from behind.
#[derive(Debug)]
struct Shape {
    triangle: Triangle,
    node: usize,
}

impl Bounded<f32, 3> for Shape {
    fn aabb(&self) -> Aabb<f32, 3> {
        let Triangle { v0, v1, v2 } = self.triangle;
        let (lower, upper) = (v0.min(v1).min(v2), v0.max(v1).max(v2));
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

/// A ray that refuses boxes behind the nearest hit so far.
struct Culling {
    ray: CrateRay<f32, 3>,
    nearest: Cell<f32>,
}

impl IntersectsAabb<f32, 3> for Culling {
    fn intersects_aabb(&self, aabb: &Aabb<f32, 3>) -> bool {
        self.ray.intersection_slice_for_aabb(aabb).is_some_and(|(begin, _)| begin <= self.nearest.get())
    }
}

fn crate_ray(origin: Vec3A, direction: Vec3A) -> CrateRay<f32, 3> {
    CrateRay::new(Point3::from(origin.to_array()), Vector3::from(direction.to_array()))
}

fn nearest<'a>(origin: Vec3A, direction: Vec3A, candidates: impl IntoIterator<Item = &'a Shape>) -> f32 {
    let ray = Ray::new(origin, direction, 0.0, f32::INFINITY);
    candidates.into_iter().fold(f32::INFINITY, |least, shape| least.min(shape.triangle.intersect(&ray)))
}

pub(super) fn run(configuration: &Configuration, mesh: &Mesh, rays: u32) -> Result<Cost, Box<dyn Error>> {
    let mut shapes: Vec<Shape> = mesh.triangles.iter().map(|&triangle| Shape { triangle, node: 0 }).collect();
    let traversal = configuration.text("bvh_traversal")?;
    let start_ms = processor_ms();
    let tree: Bvh<f32, 3> = Bvh::build(&mut shapes);
    Ok(match traversal {
        "flat" => {
            let flat: FlatBvh<f32, 3> = tree.flatten();
            trace(mesh, rays, start_ms, |origin, direction| {
                nearest(origin, direction, flat.traverse(&crate_ray(origin, direction), &shapes))
            })
        }
        "culled" => trace(mesh, rays, start_ms, |origin, direction| {
            let ray = Ray::new(origin, direction, 0.0, f32::INFINITY);
            let query = Culling { ray: crate_ray(origin, direction), nearest: Cell::new(f32::INFINITY) };
            for shape in tree.traverse_iterator(&query, &shapes) {
                query.nearest.set(query.nearest.get().min(shape.triangle.intersect(&ray)));
            }
            query.nearest.get()
        }),
        "nearest_child" => trace(mesh, rays, start_ms, |origin, direction| {
            let ray = crate_ray(origin, direction);
            nearest(origin, direction, tree.nearest_child_traverse_iterator(&ray, &shapes))
        }),
        _ => trace(mesh, rays, start_ms, |origin, direction| {
            nearest(origin, direction, tree.traverse(&crate_ray(origin, direction), &shapes))
        }),
    })
}
