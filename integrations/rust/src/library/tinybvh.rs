//! The crate `tinybvh-rs`, a Rust interface to the C++ header tinybvh: builder, layout and size of leaves.

use std::error::Error;

use glam::Vec3A;
use tinybvh_rs::{Intersection, Intersector, Ray, bvh};
use treewright_client::{Configuration, Space, SpaceError};

use super::{Cost, processor_ms, trace};
use crate::mesh::Mesh;

/// A binned builder, and one with spatial splits.
const BUILDERS: [&str; 2] = ["binned", "spatial"];
/// The binary tree that is built, and the eight-wide one that it can be turned into, whose leaves hold four.
/// The crate offers the traversal of the wide one only to programs that are compiled for AVX2
/// (`RUSTFLAGS="-C target-cpu=native"`).
const LAYOUTS: &[&str] = if cfg!(target_feature = "avx2") { &["binary", "wide"] } else { &["binary"] };

pub(super) fn space() -> Result<Space, SpaceError> {
    Space::builder()
        .categorical("tinybvh_builder", BUILDERS)
        .default("binned")
        .categorical("tinybvh_layout", LAYOUTS.iter().copied())
        .default("binary")
        // 0 leaves the leaves as the builder made them.
        .integer("tinybvh_max_leaf", 0..=8)
        .default(0)
        .active_if("tinybvh_layout", ["binary"])
        .build()
}

pub(super) fn fixed() -> Vec<(String, Configuration)> {
    let mut all = Vec::new();
    for builder in BUILDERS {
        for &layout in LAYOUTS {
            let mut one =
                Configuration::new().with("tinybvh_builder", builder).with("tinybvh_layout", layout);
            if layout == "binary" {
                one = one.with("tinybvh_max_leaf", 0);
            }
            all.push((format!("{builder} {layout}"), one));
        }
    }
    all
}

pub(super) fn run(configuration: &Configuration, mesh: &Mesh, rays: u32) -> Result<Cost, Box<dyn Error>> {
    let corners = mesh.triangles.iter().flat_map(|one| [one.v0, one.v1, one.v2]);
    let positions: Vec<[f32; 4]> = corners.map(|corner| corner.extend(0.0).to_array()).collect();
    let positions = positions.as_slice();
    let is_wide = configuration.text("tinybvh_layout")? == "wide";
    let max_leaf = if is_wide { 4 } else { u32::try_from(configuration.integer("tinybvh_max_leaf")?)? };
    let spatial = configuration.text("tinybvh_builder")? == "spatial";
    let start_ms = processor_ms();
    let built = if spatial { bvh::BVH::new_hq(positions.into()) } else { bvh::BVH::new(positions.into()) };
    let mut tree = built.map_err(|error| error.to_string())?;
    if max_leaf > 0 {
        tree.split_leaves(max_leaf);
    }
    #[cfg(target_feature = "avx2")]
    if is_wide {
        let wide = tinybvh_rs::bvh8_cpu::BVH::new(&tinybvh_rs::mbvh::BVH::new(&tree));
        let wide = wide.map_err(|error| error.to_string())?;
        return Ok(trace(mesh, rays, start_ms, |origin, direction| closest(&wide, origin, direction)));
    }
    Ok(trace(mesh, rays, start_ms, |origin, direction| closest(&tree, origin, direction)))
}

/// A ray of the size that the C++ side expects. In 0.1.0-beta.3 its rays are 128 bytes long and those of Rust
/// 64, so that the crate's own `Ray::new` overwrites 64 bytes of its caller. Hence rays are put together
/// here.
#[repr(C, align(64))]
struct Query {
    ray: Ray,
    room: [u8; 64],
}

fn closest(tree: &impl Intersector, origin: Vec3A, direction: Vec3A) -> f32 {
    let ray = Ray {
        origin: origin.to_array(),
        dir: direction.to_array(),
        r_d: direction
            .to_array()
            .map(|axis| if axis.abs() > 1e-12 { 1.0 / axis } else { tinybvh_rs::INFINITE.copysign(axis) }),
        hit: Intersection::new(),
        ..Ray::default()
    };
    let mut query = Query { ray, room: [0; 64] };
    tree.intersect(&mut query.ray);
    let t = std::hint::black_box(&query).ray.hit.t;
    if t < tinybvh_rs::INFINITE { t } else { f32::INFINITY }
}
