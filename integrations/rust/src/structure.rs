//! The tuning space of `obvhs`: its build parameters one by one, with its own presets as fixed points to compare with.

use std::time::Duration;

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ploc::{PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use treewright_client::{Configuration, NoSuchValue, Space, SpaceError};

use crate::mesh::Mesh;

/// The presets by the crate's names.
pub(crate) const PRESETS: [(&str, BvhBuildParams); 6] = [
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

/// The space, with `medium_build` of the eight-wide tree as default.
pub(crate) fn space() -> Result<Space, SpaceError> {
    Space::builder()
        .categorical("layout", ["cwbvh", "bvh2"])
        .default("cwbvh")
        .boolean("pre_split")
        .default(false)
        .categorical("search_distance", DISTANCES.map(|(name, _)| name))
        .default("medium")
        .integer("search_depth_threshold", 0..=4)
        .default(3)
        .float("reinsertion_ratio", 0.0..=1.0)
        .default(0.05)
        .float("post_collapse_factor", 0.0..=2.0)
        .default(2.0)
        .boolean("sort_128_bit")
        .default(false)
        .integer("max_prims_per_leaf", 1..=8)
        .default(8)
        .float("traversal_cost", 0.5..=6.0)
        .default(3.0)
        .build()
}

/// A preset as a configuration.
pub(crate) fn configuration_of(layout: &str, preset: &BvhBuildParams) -> Configuration {
    let same = |one: &&(&str, PlocSearchDistance)| one.1 as u32 == preset.ploc_search_distance as u32;
    let distance = DISTANCES.iter().find(same).map_or("medium", |one| one.0);
    Configuration::new()
        .with("layout", layout)
        .with("pre_split", preset.pre_split)
        .with("search_distance", distance)
        .with("search_depth_threshold", preset.search_depth_threshold as i64)
        .with("reinsertion_ratio", f64::from(preset.reinsertion_batch_ratio))
        .with("post_collapse_factor", f64::from(preset.post_collapse_reinsertion_batch_ratio_multiplier))
        .with("sort_128_bit", matches!(preset.sort_precision, SortPrecision::U128))
        .with("max_prims_per_leaf", i64::from(preset.max_prims_per_leaf))
        .with("traversal_cost", f64::from(preset.collapse_traversal_cost))
}

fn parameters(configuration: &Configuration) -> Result<BvhBuildParams, NoSuchValue> {
    let distance = configuration.text("search_distance")?;
    let known = DISTANCES.iter().find(|one| one.0 == distance);
    let precision =
        if configuration.boolean("sort_128_bit")? { SortPrecision::U128 } else { SortPrecision::U64 };
    Ok(BvhBuildParams {
        pre_split: configuration.boolean("pre_split")?,
        ploc_search_distance: known.map_or(PlocSearchDistance::Medium, |one| one.1),
        search_depth_threshold: usize::try_from(configuration.integer("search_depth_threshold")?)
            .unwrap_or(0),
        reinsertion_batch_ratio: configuration.float("reinsertion_ratio")? as f32,
        post_collapse_reinsertion_batch_ratio_multiplier: configuration.float("post_collapse_factor")? as f32,
        sort_precision: precision,
        max_prims_per_leaf: u32::try_from(configuration.integer("max_prims_per_leaf")?).unwrap_or(1),
        collapse_traversal_cost: configuration.float("traversal_cost")? as f32,
    })
}

/// Processor time of all threads in milliseconds: what else the machine does is left out.
fn processor_ms() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    now.tv_sec as f64 * 1e3 + now.tv_nsec as f64 / 1e6
}

/// What one build and its rays took, and how many rays hit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    pub(crate) build_ms: f64,
    pub(crate) rays_ms: f64,
    pub(crate) hits: u32,
}

enum Tree {
    Wide(CwBvh),
    Binary(Bvh2),
}

/// Builds, and traces rays from the middle of the mesh and on from where they hit, as a path does.
pub(crate) fn run(configuration: &Configuration, mesh: &Mesh, rays: u32) -> Result<Cost, NoSuchValue> {
    let parameters = parameters(configuration)?;
    let start = processor_ms();
    let (mut ignored, triangles) = (Duration::default(), &mesh.triangles);
    let (tree, order) = if configuration.text("layout")? == "bvh2" {
        let tree = build_bvh2_from_tris(triangles, parameters, &mut ignored);
        let order = tree.primitive_indices.clone();
        (Tree::Binary(tree), order)
    } else {
        let tree = build_cwbvh_from_tris(triangles, parameters, &mut ignored);
        let order = tree.primitive_indices.clone();
        (Tree::Wide(tree), order)
    };
    let ordered: Vec<Triangle> = order.iter().map(|&number| triangles[number as usize]).collect();
    let build_ms = processor_ms() - start;
    let start = processor_ms();
    let hits = std::hint::black_box(trace(&tree, &ordered, mesh, rays));
    Ok(Cost { build_ms, rays_ms: processor_ms() - start, hits })
}

fn trace(tree: &Tree, ordered: &[Triangle], mesh: &Mesh, rays: u32) -> u32 {
    let (min, max) = mesh.bounds();
    let center = (min + max) * 0.5;
    let (mut random, mut origin, mut hits) = (Random(1), center, 0);
    for _ in 0..rays {
        let direction = random.direction();
        let ray = Ray::new(origin, direction, 1e-4, f32::INFINITY);
        let mut hit = RayHit::none();
        match tree {
            Tree::Wide(tree) => tree.ray_traverse(ray, &mut hit, |ray, place| ordered[place].intersect(ray)),
            Tree::Binary(tree) => {
                tree.ray_traverse(ray, &mut hit, |ray, place| ordered[place].intersect(ray))
            }
        };
        // Hits just beyond the reach of rounding begin the next path instead of being told from it.
        origin = if hit.t.is_finite() { origin + direction * (hit.t * 0.999) } else { center };
        hits += u32::from(hit.t.is_finite());
    }
    hits
}

/// Numerical Recipes' quick generator: enough to scatter rays, the same on every machine.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn direction(&mut self) -> Vec3A {
        loop {
            let point = Vec3A::new(self.next(), self.next(), self.next());
            if (1e-4..=1.0).contains(&point.length_squared()) {
                return point.normalize();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_in_the_space_and_hits_alike() {
        let (space, mesh) = (space().unwrap(), crate::mesh::field());
        let known = |name: &str| space.parameters().iter().any(|one| one.name == name);
        let mut hits = Vec::new();
        for layout in ["cwbvh", "bvh2"] {
            for (name, preset) in &PRESETS {
                let configuration = configuration_of(layout, preset);
                assert!(configuration.iter().all(|(parameter, _)| known(parameter)), "{name}");
                assert_eq!(configuration.len(), space.parameters().len(), "{name}");
                hits.push(run(&configuration, &mesh, 2000).unwrap().hits);
            }
        }
        // Paths part where two triangles are met at one distance, so not every number is the same.
        let (least, most) = (hits.iter().min().unwrap(), hits.iter().max().unwrap());
        assert!(*least > 0 && most - least <= most / 20, "{hits:?}");
    }

    #[test]
    fn the_default_is_medium_build() {
        let default = Configuration::from(space().unwrap().default_configuration());
        let medium = configuration_of("cwbvh", &BvhBuildParams::medium_build());
        for (name, value) in default.iter() {
            let close = medium.get(name).and_then(|other| Some((other.as_number()?, value.as_number()?)));
            assert!(close.map_or(medium.get(name) == Some(value), |(a, b)| (a - b).abs() < 1e-6), "{name}");
        }
    }
}
