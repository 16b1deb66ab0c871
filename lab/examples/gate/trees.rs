//! A model of the renderer's whole space: two back ends, ray packets, tiles; a seventh cannot be built.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::{configuration::Configuration, space::Space, value::Value};

use crate::problem::Problem;

fn space() -> Space {
    let space = Space::builder().categorical("backend", ["embree", "custom", "native"]).default("embree");
    let space = space.integer("embree_quality", 1..=3).default(2).active_if("backend", ["embree"]);
    let space = space.boolean("embree_compact").default(false).active_if("backend", ["embree"]);
    let space = space.boolean("embree_robust").default(false).active_if("backend", ["embree"]);
    let space = space.boolean("embree_dynamic").default(false).active_if("backend", ["embree"]);
    let space = space.integer("quality", 1..=3).default(2).active_if("backend", ["custom"]);
    let space = space.categorical("branching_factor", [2, 4, 8]).default(2).active_if("backend", ["custom"]);
    let space = space.integer("max_depth", 9..=64).default(32).active_if("backend", ["custom"]);
    let block_sizes = [1, 2, 4, 8, 16, 32];
    let space = space.categorical("sah_block_size", block_sizes).default(1).active_if("quality", [2, 3]);
    let space = space.integer("min_leaf_size", 1..=32).log().default(1).active_if("backend", ["custom"]);
    let space = space.integer("max_leaf_size", 1..=32).log().default(32).active_if("backend", ["custom"]);
    let space = space.float("traversal_cost", 0.1..=10.0).log().default(1.0).active_if("quality", [2, 3]);
    let space = space.float("intersection_cost", 0.1..=10.0).log().default(1.0).active_if("quality", [2, 3]);
    let space = space.boolean("split").default(false).active_if("quality", [2, 3]);
    let space = space.float("split_budget", 1.0..=4.0).log().default(1.2).active_if("split", [true]);
    let space = space.categorical("width", [4, 8, 16]).default(8).active_if("backend", ["native"]);
    let layouts = ["full", "quantised", "compressed"];
    let space = space.categorical("layout", layouts).default("full").active_if("backend", ["native"]);
    let builders = ["binned", "sweep", "locally_ordered"];
    let space = space.categorical("builder", builders).default("binned").active_if("backend", ["native"]);
    let space = space.integer("bins", 4..=64).log().default(16).active_if("backend", ["native"]);
    let orders = ["none", "depth_first", "van_emde_boas"];
    let space = space.categorical("reorder", orders).default("none").active_if("backend", ["native"]);
    let space = space.integer("treelet", 3..=12).default(7).active_if("backend", ["native"]);
    let space = space.categorical("packet_primary", [1, 4, 8, 16]).default(1);
    let space = space.categorical("packet_shadow", [1, 4, 8, 16]).default(1);
    let space = space.categorical("packet_bounce", [1, 4, 8, 16]).default(1);
    let space = space.categorical("tile", [4, 8, 16, 32, 64, 128]).default(16);
    let space = space.categorical("order", ["rows", "morton", "hilbert"]).default("rows");
    let space = space.boolean("sort_rays").default(false);
    let space = space.integer("sort_bits", 4..=24).default(12).active_if("sort_rays", [true]);
    space.less_or_equal("min_leaf_size", "max_leaf_size").build().expect("a valid space")
}

struct Scene {
    weights: Vec<f64>,
}

impl Scene {
    fn slowdown(&self, configuration: &Configuration) -> Option<f64> {
        let number = |name: &str| configuration.get(name).and_then(Value::as_number);
        let of = |name: &str| number(name).unwrap_or(0.0);
        let is = |name: &str| configuration.get(name) == Some(&Value::Boolean(true));
        let named = |name: &str, value: &str| configuration.get(name) == Some(&Value::Text(value.into()));
        // The factor of a named choice, and that of all the others.
        let by = |name: &str, factors: &[(&str, f64)], other: f64| {
            factors.iter().find(|(value, _)| named(name, value)).map_or(other, |(_, factor)| *factor)
        };
        let w = |index: usize| self.weights[index % self.weights.len()];
        let mut factor = 1.0;
        let incoherent = if is("sort_rays") { 0.4 } else { 1.0 };
        if named("backend", "embree") {
            factor *= 1.12 + 0.1 * w(0);
            factor *= [1.25, 1.06, 1.0][of("embree_quality") as usize - 1];
            factor *= if is("embree_compact") { 1.0 + 0.2 * w(1) } else { 1.0 };
            factor *= if is("embree_robust") { 1.08 } else { 1.0 };
            factor *= if is("embree_dynamic") { 1.15 } else { 1.0 };
        } else if named("backend", "custom") {
            let (quality, branching, depth) = (of("quality"), of("branching_factor"), of("max_depth"));
            let morton = quality < 1.5;
            if depth < 11.0 || (branching < 3.0 && (morton || depth < 21.0)) || (morton && depth < 14.0) {
                return None;
            }
            factor *= [1.3, 1.05, 1.0][quality as usize - 1] * [1.9, 1.2, 1.0][branching.log2() as usize - 1];
            factor *= if depth < 13.0 { 2.2 } else { 1.0 + 0.1 * ((32.0 - depth).max(0.0) / 20.0) };
            factor *= 1.0 + 0.35 * ((of("max_leaf_size").log2() - 2.0 - 2.0 * w(2)) / 3.0).powi(2);
            factor *= 1.0 + 0.3 * (of("min_leaf_size").log2() / 5.0).powi(2);
            if !morton {
                factor *= 1.0 + 0.12 * ((of("sah_block_size").log2() - 3.0 * w(3)) / 3.0).powi(2);
                let ratio = (of("traversal_cost") / of("intersection_cost")).log2();
                factor *= 1.0 + 0.2 * ((ratio + 2.0 - 3.0 * w(4)) / 4.0).powi(2).min(1.0);
                if is("split") {
                    if of("split_budget") > 3.3 {
                        return None;
                    }
                    factor *= 1.12 - 0.25 * w(5) * (1.0 - (of("split_budget").log2() - 0.7).powi(2));
                }
            }
        } else {
            let width = of("width");
            if named("layout", "compressed") && width < 5.0
                || named("builder", "sweep") && of("treelet") > 10.0
            {
                return None;
            }
            factor *= 0.95;
            factor *= 1.0 + 0.1 * (width.log2() - 2.0 - 2.0 * w(6)).abs();
            let compressed = 1.1 - 0.12 * (width.log2() - 2.0) / 2.0;
            factor *= by("layout", &[("full", 1.08), ("quantised", 1.0)], compressed);
            let locally_ordered = 1.15 - 0.13 * ((of("treelet") - 3.0) / 9.0);
            factor *= by("builder", &[("binned", 1.06), ("sweep", 1.0)], locally_ordered);
            if named("builder", "binned") {
                factor *= 1.0 + 0.1 * (2.0 - 0.4 * of("bins").log2()).max(0.0);
            }
            let treelets = 1.0 + 0.02 * (of("treelet") - 5.0 - 3.0 * w(7)).abs();
            factor *= by("reorder", &[("none", 1.08), ("depth_first", 1.03)], treelets);
            if of("packet_bounce") > 12.0 && width < 5.0 {
                return None;
            }
        }
        let native = named("backend", "native");
        factor *=
            1.0 + 0.08 * (of("packet_primary").log2() - if native { 4.0 } else { 3.0 * w(8) }).abs() / 2.0;
        factor *= 1.0 + 0.1 * (of("packet_shadow").log2() - 2.0 - 2.0 * w(9)).abs() / 2.0;
        factor *= 1.0 + 0.12 * incoherent * of("packet_bounce").log2() / 2.0;
        factor *= 1.0 + 0.05 * (of("tile").log2() - 4.0 - w(10)).powi(2) / 2.0;
        let rows = 1.0 + 0.04 * (of("tile").log2() - 3.0).max(0.0);
        factor *= by("order", &[("rows", rows), ("morton", 1.0)], 1.005);
        if is("sort_rays") {
            factor *= 1.1 - 0.25 * w(11) + 0.01 * (of("sort_bits") - 8.0 - 8.0 * w(12)).abs();
            if of("sort_bits") > 22.0 {
                return None;
            }
        }
        Some(factor)
    }
}

pub(crate) fn problem(seed: u64) -> Problem {
    let mut random = ChaCha8Rng::seed_from_u64(seed * 13 + 1);
    let scene = Scene { weights: (0..13).map(|_| random.random()).collect() };
    Problem::new(space(), 0.07, &mut random, move |configuration| scene.slowdown(configuration))
}
