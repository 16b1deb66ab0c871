//! What is measured: native Embree, the tunable tree, and peers from the registry.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use obvhs::bvh2::Bvh2;
use obvhs::cwbvh::CwBvh;
use serde::Serialize;
use treewright_accel::recording::Recording;
use treewright_accel::{
    BuildChoice, BuildError, Builder, ChildOrder, Collapse, Device, Intersector, NativeOptions,
    NativeQuality, NodeFormat, NodeOrder, Quality, Structure, TreeParameters, Visits, build,
};

use crate::peers::{Bvh, Obvhs};
use crate::tinybvh::{Tinybvh, Tree};

/// Name of the one that all others are compared with.
pub(crate) const REFERENCE: &str = "native medium";

/// How a structure comes about.
#[derive(Clone)]
enum Recipe {
    Ours(BuildChoice),
    Bvh,
    ObvhsBinary,
    ObvhsWide,
    Tinybvh { functions: Arc<Tinybvh>, splits: bool },
}

/// Name of the tree that the [overview](crate::overview) compares with others.
pub(crate) const RECOMMENDED: &str = "recommended";

/// Who made a structure.
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

impl Recipe {
    fn maker(&self) -> Maker {
        match self {
            Self::Ours(BuildChoice::Native(_)) => Maker::Native,
            Self::Ours(_) => Maker::Treewright,
            Self::Bvh | Self::ObvhsBinary | Self::ObvhsWide | Self::Tinybvh { .. } => Maker::Peer,
        }
    }

    fn is_robust(&self) -> bool {
        match self {
            Self::Ours(BuildChoice::Native(options)) => options.robust,
            Self::Ours(BuildChoice::Tree(parameters)) => parameters.robust,
            _ => false,
        }
    }
}

fn recipes(tinybvh: Option<Arc<Tinybvh>>) -> Vec<(&'static str, Recipe)> {
    let native =
        |quality| Recipe::Ours(BuildChoice::Native(NativeOptions { quality, ..NativeOptions::default() }));
    let robust = NativeOptions { robust: true, ..NativeOptions::default() };
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
    // Where searches in the full space begin when one tree serves many frames.
    let recommended = TreeParameters {
        branching_factor: 16,
        min_leaf_size: 8,
        max_leaf_size: 32,
        block_width: 8,
        reinsertion_passes: 4,
        order: NodeOrder::DepthFirst,
        child_order: ChildOrder::Likely,
        ..optimal
    };
    let ploc = TreeParameters { builder: Builder::Ploc, ..recommended };
    // For trees that serve one frame: written as it is joined.
    let at_once = TreeParameters {
        branching_factor: 8,
        collapse: Collapse::Builder,
        order: NodeOrder::Builder,
        min_leaf_size: 16,
        ..ploc
    };
    let mut all = vec![
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
        (RECOMMENDED, tree(recommended)),
        (
            "recommended, builder's order",
            tree(TreeParameters { child_order: ChildOrder::Builder, ..recommended }),
        ),
        (
            "recommended, topmost first",
            tree(TreeParameters { child_order: ChildOrder::Topmost, ..recommended }),
        ),
        ("recommended, splits", tree(TreeParameters { quality: Quality::SahSplit, ..recommended })),
        ("recommended, PLOC", tree(ploc)),
        (
            "Morton at once",
            tree(TreeParameters { builder: Builder::Embree, quality: Quality::Morton, ..at_once }),
        ),
        (
            "Morton at once, builder's order",
            tree(TreeParameters {
                builder: Builder::Embree,
                quality: Quality::Morton,
                child_order: ChildOrder::Builder,
                ..at_once
            }),
        ),
        ("PLOC at once", tree(at_once)),
        (
            "PLOC at once, builder's order",
            tree(TreeParameters { child_order: ChildOrder::Builder, ..at_once }),
        ),
        ("native medium, robust", Recipe::Ours(BuildChoice::Native(robust))),
        ("recommended, robust", tree(TreeParameters { robust: true, ..recommended })),
        ("bvh", Recipe::Bvh),
        ("obvhs, binary", Recipe::ObvhsBinary),
        ("obvhs, 8 wide", Recipe::ObvhsWide),
    ];
    if let Some(functions) = tinybvh {
        all.push(("tinybvh, 8 wide", Recipe::Tinybvh { functions: Arc::clone(&functions), splits: false }));
        all.push(("tinybvh, 8 wide, splits", Recipe::Tinybvh { functions, splits: true }));
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
                let (maker, robust) = (recipe.maker(), recipe.is_robust());
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

/// What single rays of each set visit in the recommended tree.
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
        Recipe::Bvh => (Box::new(Bvh::build(triangles)), false),
        Recipe::ObvhsBinary => (Box::new(Obvhs::<Bvh2>::build(triangles)), false),
        Recipe::ObvhsWide => (Box::new(Obvhs::<CwBvh>::build(triangles)), false),
        Recipe::Tinybvh { functions, splits } => {
            (Box::new(Tree::build(functions, triangles, *splits)), false)
        }
    })
}
