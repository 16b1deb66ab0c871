//! The contenders: native Embree, the tunable tree, and peers from the registry.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use obvhs::bvh2::Bvh2;
use obvhs::cwbvh::CwBvh;
use serde::Serialize;
use treewright_accel::recording::Recording;
use treewright_accel::{
    BuildChoice, BuildError, Builder, Collapse, Device, Intersector, NativeOptions, NativeQuality, Quality,
    Structure, TreeParameters, Triangles, Visits, build,
};

use crate::peers::Obvhs;
use crate::tinybvh::{Tinybvh, Tree};

/// Name of the one that all others are compared with.
pub(crate) const REFERENCE: &str = "native medium";

/// Name of the tree that the [overview](crate::overview) compares with others.
pub(crate) const RECOMMENDED: &str = "recommended";

/// Builds a peer's structure.
type BuildPeer = dyn Fn(&Arc<Triangles>) -> Box<dyn Intersector>;

/// The recipe of a structure.
enum Recipe {
    Ours(BuildChoice),
    Peer(Box<BuildPeer>),
}

/// The maker of a structure.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Maker {
    /// Embree as it comes.
    Native,
    /// The tunable tree.
    Treewright,
    /// Anybody else.
    Peer,
}

/// A built structure.
pub(crate) struct Built {
    pub(crate) name: &'static str,
    pub(crate) maker: Maker,
    /// Whether no ray slips through an edge.
    pub(crate) robust: bool,
    pub(crate) intersector: Box<dyn Intersector>,
    /// Of each build.
    pub(crate) build_ms: Vec<f64>,
    /// Whether it has packets of its own, so that choosing them is worth a row.
    pub(crate) packets: bool,
}

fn recipes(tinybvh: Option<Arc<Tinybvh>>) -> Vec<(&'static str, Recipe)> {
    let native = |options| Recipe::Ours(BuildChoice::Native(options));
    let of_quality = |quality| native(NativeOptions { quality, ..NativeOptions::default() });
    let tree = |parameters| Recipe::Ours(BuildChoice::Tree(parameters));
    // Where searches in the full space begin when one tree serves many frames.
    let recommended = TreeParameters {
        branching_factor: 16,
        sah_block_size: 4,
        min_leaf_size: 8,
        max_leaf_size: 32,
        max_depth: 64,
        block_width: 8,
        collapse: Collapse::Optimal,
        reinsertion_passes: 4,
        ..TreeParameters::default()
    };
    let mut all = vec![
        (REFERENCE, of_quality(NativeQuality::Medium)),
        ("native low", of_quality(NativeQuality::Low)),
        ("native high", of_quality(NativeQuality::High)),
        (RECOMMENDED, tree(recommended)),
        ("recommended, splits", tree(TreeParameters { quality: Quality::SahSplit, ..recommended })),
        ("recommended, PLOC", tree(TreeParameters { builder: Builder::Ploc, ..recommended })),
        ("native medium, robust", native(NativeOptions { robust: true, ..NativeOptions::default() })),
        ("recommended, robust", tree(TreeParameters { robust: true, ..recommended })),
        ("obvhs, binary", Recipe::Peer(Box::new(|all| Box::new(Obvhs::<Bvh2>::build(all))))),
        ("obvhs, 8 wide", Recipe::Peer(Box::new(|all| Box::new(Obvhs::<CwBvh>::build(all))))),
    ];
    for (name, splits) in [("tinybvh, 8 wide", false), ("tinybvh, 8 wide, splits", true)] {
        let functions = tinybvh.clone();
        all.extend(functions.map(|functions| {
            (name, Recipe::Peer(Box::new(move |all| Box::new(Tree::build(&functions, all, splits)))))
        }));
    }
    all
}

/// Builds every structure whose name contains one of `filters`, in interleaved rounds. One that cannot be
/// built for this scene is left out with a word on standard error.
pub(crate) fn build_all(
    device: &Device,
    recording: &Recording,
    filters: &[String],
    builds: u32,
) -> Result<Vec<Built>, Box<dyn Error>> {
    let mut all: Vec<(Recipe, Built)> = Vec::new();
    for (name, recipe) in recipes(Tinybvh::load()?) {
        if name != REFERENCE && !filters.iter().any(|filter| name.contains(filter.as_str())) {
            continue;
        }
        match make(device, recording, &recipe) {
            Ok((intersector, packets)) => {
                let (maker, robust) = match &recipe {
                    Recipe::Ours(BuildChoice::Native(options)) => (Maker::Native, options.robust),
                    Recipe::Ours(BuildChoice::Tree(parameters)) => (Maker::Treewright, parameters.robust),
                    _ => (Maker::Peer, false),
                };
                let built = Built { name, maker, robust, intersector, build_ms: Vec::new(), packets };
                all.push((recipe, built));
            }
            Err(error) if error.is_infeasible() && name != REFERENCE => {
                eprintln!("{name} is left out: {error}")
            }
            Err(error) => return Err(error.into()),
        }
    }
    // The builds above warmed everything up and are not counted.
    for _ in 0..builds {
        for (recipe, built) in &mut all {
            let begin = Instant::now();
            let (intersector, _) = make(device, recording, recipe)?;
            built.build_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            built.intersector = intersector;
        }
    }
    Ok(all.into_iter().map(|(_, built)| built).collect())
}

/// Nodes and blocks that single rays of each set visit in the recommended tree.
pub(crate) fn visits(device: &Device, recording: &Recording) -> Result<Vec<Visits>, BuildError> {
    let recipe = recipes(None).into_iter().find(|(name, _)| *name == RECOMMENDED).map(|(_, recipe)| recipe);
    let Some(Recipe::Ours(choice)) = recipe else { unreachable!("it is one of ours") };
    let Structure::Tree(tree) = build(device, &recording.triangles, &choice)? else {
        unreachable!("it is a tree")
    };
    Ok(recording.sets.iter().map(|set| tree.visits(&set.rays, set.class.is_shadow())).collect())
}

fn make(
    device: &Device,
    recording: &Recording,
    recipe: &Recipe,
) -> Result<(Box<dyn Intersector>, bool), BuildError> {
    let triangles = &recording.triangles;
    Ok(match recipe {
        Recipe::Ours(choice) => match build(device, triangles, choice)? {
            // Without the choice between kinds in front of every batch.
            Structure::Tree(tree) => (Box::new(tree), true),
            Structure::Native(native) => (Box::new(native), true),
            other => (Box::new(other), false),
        },
        Recipe::Peer(build) => (build(triangles), false),
    })
}
