//! The crate `obvhs`: its build parameters one by one, with its own presets to compare with.

use std::error::Error;
use std::time::Duration;

use ::obvhs::BvhBuildParams;
use ::obvhs::bvh2::builder::build_bvh2_from_tris;
use ::obvhs::cwbvh::builder::build_cwbvh_from_tris;
use ::obvhs::ploc::{PlocSearchDistance, SortPrecision};
use ::obvhs::ray::{Ray, RayHit};
use ::obvhs::triangle::Triangle;
use glam::Vec3A;
use treewright_client::{Configuration, NoSuchValue, Space, SpaceError};

use super::{Cost, processor_ms, trace};
use crate::mesh::Mesh;

/// The presets by the crate's names.
const PRESETS: [(&str, BvhBuildParams); 6] = [
    ("medium_build", BvhBuildParams::medium_build()),
    ("fastest_build", BvhBuildParams::fastest_build()),
    ("very_fast_build", BvhBuildParams::very_fast_build()),
    ("fast_build", BvhBuildParams::fast_build()),
    ("slow_build", BvhBuildParams::slow_build()),
    ("very_slow_build", BvhBuildParams::very_slow_build()),
];

/// Search distances by name, near to far.
const DISTANCES: [(&str, PlocSearchDistance); 5] = [
    ("minimum", PlocSearchDistance::Minimum),
    ("very_low", PlocSearchDistance::VeryLow),
    ("low", PlocSearchDistance::Low),
    ("medium", PlocSearchDistance::Medium),
    ("high", PlocSearchDistance::High),
];

/// The parameters, with `medium_build` of the eight-wide tree as default.
pub(super) fn space() -> Result<Space, SpaceError> {
    Space::builder()
        .categorical("obvhs_layout", ["cwbvh", "bvh2"])
        .default("cwbvh")
        .boolean("obvhs_pre_split")
        .default(false)
        .categorical("obvhs_search_distance", DISTANCES.map(|(name, _)| name))
        .default("medium")
        .integer("obvhs_search_depth_threshold", 0..=4)
        .default(3)
        .float("obvhs_reinsertion_ratio", 0.0..=1.0)
        .default(0.05)
        .float("obvhs_post_collapse_factor", 0.0..=2.0)
        .default(2.0)
        .boolean("obvhs_sort_128_bit")
        .default(false)
        .integer("obvhs_max_prims_per_leaf", 1..=8)
        .default(8)
        .float("obvhs_traversal_cost", 0.5..=6.0)
        .default(3.0)
        .build()
}

/// The presets, for both layouts.
pub(super) fn fixed() -> Vec<(String, Configuration)> {
    let of = |layout: &'static str| {
        PRESETS
            .iter()
            .map(move |(name, preset)| (format!("{layout} {name}"), configuration_of(layout, preset)))
    };
    ["cwbvh", "bvh2"].into_iter().flat_map(of).collect()
}

fn configuration_of(layout: &str, preset: &BvhBuildParams) -> Configuration {
    let same = |one: &&(&str, PlocSearchDistance)| one.1 as u32 == preset.ploc_search_distance as u32;
    let distance = DISTANCES.iter().find(same).map_or("medium", |one| one.0);
    Configuration::new()
        .with("obvhs_layout", layout)
        .with("obvhs_pre_split", preset.pre_split)
        .with("obvhs_search_distance", distance)
        .with("obvhs_search_depth_threshold", preset.search_depth_threshold as i64)
        .with("obvhs_reinsertion_ratio", f64::from(preset.reinsertion_batch_ratio))
        .with(
            "obvhs_post_collapse_factor",
            f64::from(preset.post_collapse_reinsertion_batch_ratio_multiplier),
        )
        .with("obvhs_sort_128_bit", matches!(preset.sort_precision, SortPrecision::U128))
        .with("obvhs_max_prims_per_leaf", i64::from(preset.max_prims_per_leaf))
        .with("obvhs_traversal_cost", f64::from(preset.collapse_traversal_cost))
}

fn build_parameters(configuration: &Configuration) -> Result<BvhBuildParams, NoSuchValue> {
    let distance = configuration.text("obvhs_search_distance")?;
    let known = DISTANCES.iter().find(|one| one.0 == distance);
    let precision =
        if configuration.boolean("obvhs_sort_128_bit")? { SortPrecision::U128 } else { SortPrecision::U64 };
    Ok(BvhBuildParams {
        pre_split: configuration.boolean("obvhs_pre_split")?,
        ploc_search_distance: known.map_or(PlocSearchDistance::Medium, |one| one.1),
        search_depth_threshold: usize::try_from(configuration.integer("obvhs_search_depth_threshold")?)
            .unwrap_or(0),
        reinsertion_batch_ratio: configuration.float("obvhs_reinsertion_ratio")? as f32,
        post_collapse_reinsertion_batch_ratio_multiplier: configuration.float("obvhs_post_collapse_factor")?
            as f32,
        sort_precision: precision,
        max_prims_per_leaf: u32::try_from(configuration.integer("obvhs_max_prims_per_leaf")?).unwrap_or(1),
        collapse_traversal_cost: configuration.float("obvhs_traversal_cost")? as f32,
    })
}

/// Triangles in the order of a tree's leaves.
fn ordered(mesh: &Mesh, order: &[u32]) -> Vec<Triangle> {
    order.iter().map(|&number| mesh.triangles[number as usize]).collect()
}

fn ray_from(origin: Vec3A, direction: Vec3A) -> Ray {
    Ray::new(origin, direction, 0.0, f32::INFINITY)
}

pub(super) fn run(configuration: &Configuration, mesh: &Mesh, rays: u32) -> Result<Cost, Box<dyn Error>> {
    let parameters = build_parameters(configuration)?;
    let is_binary = configuration.text("obvhs_layout")? == "bvh2";
    let start_ms = processor_ms();
    let mut ignored = Duration::default();
    Ok(if is_binary {
        let tree = build_bvh2_from_tris(&mesh.triangles, parameters, &mut ignored);
        let triangles = ordered(mesh, &tree.primitive_indices);
        trace(mesh, rays, start_ms, |origin, direction| {
            let mut hit = RayHit::none();
            tree.ray_traverse(ray_from(origin, direction), &mut hit, |ray, place| {
                triangles[place].intersect(ray)
            });
            hit.t
        })
    } else {
        let tree = build_cwbvh_from_tris(&mesh.triangles, parameters, &mut ignored);
        let triangles = ordered(mesh, &tree.primitive_indices);
        trace(mesh, rays, start_ms, |origin, direction| {
            let mut hit = RayHit::none();
            tree.ray_traverse(ray_from(origin, direction), &mut hit, |ray, place| {
                triangles[place].intersect(ray)
            });
            hit.t
        })
    })
}
