//! What is measured: native Embree, the tunable tree, and peers from the registry.

use std::time::Instant;

use obvhs::bvh2::Bvh2;
use obvhs::cwbvh::CwBvh;
use treewright_accel::recording::Recording;
use treewright_accel::{
    BuildChoice, BuildError, Collapse, Device, Intersector, NativeOptions, NativeQuality, NodeFormat,
    Quality, Structure, TreeParameters, build,
};

use crate::peers::{Bvh, Obvhs};

/// Name of the one that all others are compared with.
pub(crate) const REFERENCE: &str = "native medium";

/// How a structure comes about.
#[derive(Clone, Copy)]
enum Recipe {
    Ours(BuildChoice),
    Bvh,
    ObvhsBinary,
    ObvhsWide,
}

/// A built structure.
pub(crate) struct Built {
    pub(crate) name: &'static str,
    pub(crate) intersector: Box<dyn Intersector>,
    /// Of each build.
    pub(crate) build_ms: Vec<f64>,
    /// Whether it has packets of its own, so that choosing them is worth a row.
    pub(crate) packets: bool,
}

fn recipes() -> Vec<(&'static str, Recipe)> {
    let native =
        |quality| Recipe::Ours(BuildChoice::Native(NativeOptions { quality, ..NativeOptions::default() }));
    let tree = |parameters| Recipe::Ours(BuildChoice::Tree(parameters));
    // What a laboratory found good on all of its scenes: close to what Embree does itself.
    let wide = TreeParameters {
        branching_factor: 8,
        sah_block_size: 4,
        min_leaf_size: 4,
        max_leaf_size: 28,
        max_depth: 64,
        ..TreeParameters::default()
    };
    let optimal = TreeParameters { collapse: Collapse::Optimal, ..wide };
    vec![
        (REFERENCE, native(NativeQuality::Medium)),
        ("native low", native(NativeQuality::Low)),
        ("native high", native(NativeQuality::High)),
        ("Table 1 default", tree(TreeParameters::default())),
        ("tree, 8 wide", tree(wide)),
        ("tree, 8 wide, splits", tree(TreeParameters { quality: Quality::SahSplit, ..wide })),
        ("tree, 8 wide, quantised", tree(TreeParameters { format: NodeFormat::Quantised, ..wide })),
        ("tree, 8 wide, reinserted", tree(TreeParameters { reinsertion_passes: 8, ..optimal })),
        ("tree, 16 wide", tree(TreeParameters { branching_factor: 16, ..optimal })),
        ("tree, 8 wide, Morton", tree(TreeParameters { quality: Quality::Morton, ..wide })),
        ("bvh", Recipe::Bvh),
        ("obvhs, binary", Recipe::ObvhsBinary),
        ("obvhs, 8 wide", Recipe::ObvhsWide),
    ]
}

/// Builds every structure whose name contains `filter`, in interleaved rounds. One that cannot be built for
/// this scene is left out with a word on standard error.
pub(crate) fn build_all(
    device: &Device,
    recording: &Recording,
    filter: &str,
    builds: u32,
) -> Result<Vec<Built>, BuildError> {
    let mut all: Vec<(Recipe, Built)> = Vec::new();
    for (name, recipe) in recipes() {
        if name != REFERENCE && !name.contains(filter) {
            continue;
        }
        match make(device, recording, recipe) {
            Ok((intersector, packets)) => {
                all.push((recipe, Built { name, intersector, build_ms: Vec::new(), packets }));
            }
            Err(error) if error.is_infeasible() && name != REFERENCE => {
                eprintln!("{name} is left out: {error}")
            }
            Err(error) => return Err(error),
        }
    }
    // The builds above warmed everything up and are not counted.
    for _ in 0..builds {
        for (recipe, built) in &mut all {
            let begin = Instant::now();
            let (intersector, _) = make(device, recording, *recipe)?;
            built.build_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            built.intersector = intersector;
        }
    }
    Ok(all.into_iter().map(|(_, built)| built).collect())
}

fn make(
    device: &Device,
    recording: &Recording,
    recipe: Recipe,
) -> Result<(Box<dyn Intersector>, bool), BuildError> {
    let triangles = &recording.triangles;
    Ok(match recipe {
        Recipe::Ours(choice) => match build(device, triangles, &choice)? {
            // Without the choice between kinds in front of every batch.
            Structure::Tree(tree) => (Box::new(tree), false),
            Structure::Native(native) => (Box::new(native), true),
            other => (Box::new(other), false),
        },
        Recipe::Bvh => (Box::new(Bvh::build(triangles)), false),
        Recipe::ObvhsBinary => (Box::new(Obvhs::<Bvh2>::build(triangles)), false),
        Recipe::ObvhsWide => (Box::new(Obvhs::<CwBvh>::build(triangles)), false),
    })
}
