//! Every way to answer a ray that the crate has: back ends, builders, widths, instruction sets.

#![allow(dead_code, reason = "each test uses some of it")]

use std::sync::Arc;

use treewright_accel::{
    BuildChoice, Builder, Collapse, Device, Hit, Intersector, Isa, NativeOptions, NativeQuality, Packets,
    Quality, Ray, Structure, Tree, TreeParameters, Triangles, build,
};

pub(crate) fn device() -> Device {
    Device::open(0).expect("Embree is set up")
}

pub(crate) fn tree(triangles: &Arc<Triangles>, parameters: &TreeParameters) -> Tree {
    match build(&device(), triangles, &BuildChoice::Tree(*parameters)) {
        Ok(Structure::Tree(tree)) => tree,
        other => panic!("{parameters:?} gave {other:?}"),
    }
}

/// A tree with the kernels of each instruction set that there is.
pub(crate) fn each_isa(mut tree: Tree, mut check: impl FnMut(Isa, &Tree)) {
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        tree = tree.with_isa(isa).expect("it is available");
        check(isa, &tree);
    }
}

/// Trees of each width, and of these builders, tests and blocks.
pub(crate) fn wide_trees(kinds: &[(Quality, bool, u32)]) -> impl Iterator<Item = BuildChoice> {
    let plain = TreeParameters { max_depth: 64, ..TreeParameters::default() };
    [2, 4, 8].into_iter().flat_map(move |branching_factor| {
        kinds.iter().map(move |&(quality, robust, block_width)| {
            BuildChoice::Tree(TreeParameters { branching_factor, quality, robust, block_width, ..plain })
        })
    })
}

/// The answers to rays in packets: the nearest hits, and whether there is any.
pub(crate) fn packed(
    structure: &dyn Intersector,
    packets: Packets,
    rays: &[Ray],
) -> (Vec<Option<Hit>>, Vec<bool>) {
    let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
    structure.closest_each(packets, rays, &mut hits);
    structure.occluded_each(packets, rays, &mut occluded);
    (hits, occluded)
}

/// A tree of every kind of node, of block and of test, otherwise as `plain`.
pub(crate) fn tree_kinds(plain: TreeParameters) -> Vec<TreeParameters> {
    let mut all = Vec::new();
    for branching_factor in [2, 4, 8, 16] {
        let collapse = if branching_factor == 16 { Collapse::Optimal } else { Collapse::Builder };
        for block_width in [4, 8] {
            for robust in [false, true] {
                all.push(TreeParameters { branching_factor, collapse, block_width, robust, ..plain });
            }
        }
    }
    all
}

/// Trees of every width, block and test, and every builder.
pub(crate) fn trees() -> Vec<TreeParameters> {
    let plain = TreeParameters { max_depth: 64, max_leaf_size: 20, ..TreeParameters::default() };
    let mut all = tree_kinds(plain);
    for robust in [false, true] {
        for quality in [Quality::Morton, Quality::SahSplit] {
            all.push(TreeParameters { quality, branching_factor: 8, max_leaf_size: 4, robust, ..plain });
        }
        all.push(TreeParameters {
            branching_factor: 8,
            collapse: Collapse::Optimal,
            reinsertion_passes: 4,
            robust,
            ..plain
        });
    }
    all
}

/// These, the optimal collapse of every width and builder, our own builder with every radius, reinsertion.
pub(crate) fn all_trees() -> Vec<TreeParameters> {
    let mut all = trees();
    let qualities = [Quality::Morton, Quality::Sah, Quality::SahSplit, Quality::Sah];
    for (number, quality) in (0..).zip(qualities) {
        for builder in [Builder::Embree, Builder::Ploc] {
            all.push(TreeParameters {
                quality,
                branching_factor: 2 << number,
                collapse: Collapse::Optimal,
                builder,
                search_radius: 4 << number,
                cluster_size: 1 << number,
                reinsertion_passes: 2 * number,
                block_width: if number % 2 == 0 { 8 } else { 4 },
                max_depth: 64,
                min_leaf_size: 1 + number,
                max_leaf_size: 12,
                sah_block_size: 4,
                robust: number == 1,
                ..TreeParameters::default()
            });
        }
    }
    all
}

pub(crate) fn native_kinds() -> Vec<NativeOptions> {
    let mut all = Vec::new();
    for quality in [NativeQuality::Low, NativeQuality::Medium, NativeQuality::High] {
        for (compact, robust) in [(false, false), (true, false), (false, true)] {
            all.push(NativeOptions { quality, compact, robust, ..NativeOptions::default() });
        }
    }
    all.push(NativeOptions { dynamic: true, ..NativeOptions::default() });
    all
}

/// Builds over the triangles in every way and checks each structure, once per instruction set.
pub(crate) fn each(triangles: &Arc<Triangles>, mut check: impl FnMut(&str, &dyn Intersector)) {
    for parameters in all_trees() {
        let tree = tree(triangles, &parameters);
        tree.validate().unwrap_or_else(|fault| panic!("{parameters:?}: {fault}"));
        each_isa(tree, |isa, tree| check(&format!("{isa:?}, {parameters:?}"), tree));
    }
    for options in native_kinds() {
        let native = build(&device(), triangles, &BuildChoice::Native(options));
        let native = native.unwrap_or_else(|error| panic!("{options:?}: {error}"));
        check(&format!("{options:?}"), &native);
    }
}
