//! The contenders: native Embree, the tunable tree, and peers from the registry.

use std::{error::Error, sync::Arc};

use obvhs::{bvh2::Bvh2, cwbvh::CwBvh};
use treewright_accel::recording::{RayClass, RaySet, Recording};
use treewright_accel::{
    BuildChoice, BuildError, Builder, Collapse, Device, Intersector, NativeOptions, NativeQuality, Quality,
    Structure, TreeParameters, Triangles, Visits, build,
};

use crate::peers::Obvhs;
use crate::tinybvh::{Tinybvh, Tree};

/// Name of the tree that the [overview](crate::overview) compares with others.
pub(crate) const RECOMMENDED: &str = "recommended";

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Maker {
    /// Embree as it comes.
    Native,
    /// The tunable tree.
    Treewright,
    /// Anybody else.
    Peer,
}

pub(crate) struct Built {
    pub(crate) name: &'static str,
    pub(crate) maker: Maker,
    /// Whether no ray slips through an edge.
    pub(crate) robust: bool,
    pub(crate) intersector: Box<dyn Intersector>,
    /// Whether it has packets of its own, so that choosing them is worth a row.
    pub(crate) packets: bool,
}

/// Where searches in the full space begin when one tree serves many frames.
fn recommended() -> TreeParameters {
    TreeParameters {
        branching_factor: 16,
        sah_block_size: 4,
        min_leaf_size: 8,
        max_leaf_size: 32,
        max_depth: 64,
        block_width: 8,
        collapse: Collapse::Optimal,
        reinsertion_passes: 4,
        ..TreeParameters::default()
    }
}

fn choices() -> [(&'static str, BuildChoice); 8] {
    let native =
        |quality, robust| BuildChoice::Native(NativeOptions { quality, robust, ..NativeOptions::default() });
    let tree = BuildChoice::Tree;
    [
        ("native medium", native(NativeQuality::Medium, false)),
        ("native low", native(NativeQuality::Low, false)),
        ("native high", native(NativeQuality::High, false)),
        (RECOMMENDED, tree(recommended())),
        ("recommended, splits", tree(TreeParameters { quality: Quality::SahSplit, ..recommended() })),
        ("recommended, PLOC", tree(TreeParameters { builder: Builder::Ploc, ..recommended() })),
        ("native medium, robust", native(NativeQuality::Medium, true)),
        ("recommended, robust", tree(TreeParameters { robust: true, ..recommended() })),
    ]
}

/// Builds every structure. One that cannot be built for this scene is left out with a word on standard error.
pub(crate) fn build_all(device: &Device, triangles: &Arc<Triangles>) -> Result<Vec<Built>, Box<dyn Error>> {
    let mut all = Vec::new();
    for (name, choice) in choices() {
        let (maker, robust) = match &choice {
            BuildChoice::Native(options) => (Maker::Native, options.robust),
            BuildChoice::Tree(parameters) => (Maker::Treewright, parameters.robust),
            BuildChoice::BruteForce => unreachable!("it is none of them"),
        };
        // Without the choice between kinds in front of every batch.
        let intersector: Box<dyn Intersector> = match build(device, triangles, &choice) {
            Ok(Structure::Tree(tree)) => Box::new(tree),
            Ok(Structure::Native(native)) => Box::new(native),
            Ok(other) => Box::new(other),
            Err(error) if error.is_infeasible() => {
                eprintln!("{name} is left out: {error}");
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        all.push(Built { name, maker, robust, intersector, packets: true });
    }
    let mut peer = |name: &'static str, intersector: Box<dyn Intersector>| {
        all.push(Built { name, maker: Maker::Peer, robust: false, intersector, packets: false });
    };
    peer("obvhs, binary", Box::new(Obvhs::<Bvh2>::build(triangles)));
    peer("obvhs, 8 wide", Box::new(Obvhs::<CwBvh>::build(triangles)));
    if let Some(functions) = Tinybvh::load()? {
        peer("tinybvh, 8 wide", Box::new(Tree::build(&functions, triangles, false)));
        peer("tinybvh, 8 wide, splits", Box::new(Tree::build(&functions, triangles, true)));
    }
    Ok(all)
}

/// Class and number of the rays of each set, and what they visit one by one in the recommended tree.
pub(crate) fn visits(
    device: &Device,
    recording: &Recording,
) -> Result<Vec<(RayClass, usize, Visits)>, BuildError> {
    let Structure::Tree(tree) = build(device, &recording.triangles, &BuildChoice::Tree(recommended()))?
    else {
        unreachable!("it is a tree")
    };
    let of_set = |set: &RaySet| (set.class, set.rays.len(), tree.visits(&set.rays, set.class.is_shadow()));
    Ok(recording.sets.iter().map(of_set).collect())
}
