//! A configuration as work for the renderer.

use serde::de::value::{Error, StrDeserializer};
use serde::{Deserialize, Serialize};
use treewright_accel::{BuildChoice, NativeOptions, NativeQuality, Packets, Quality, TreeParameters, Update};
use treewright_client::{Configuration, Value};

use super::follow::{self, KeptTree};
use super::{Premises, TUNABLE};
use crate::{follow::NEVER, light_sampling::LightSampling, render_options::RenderOptions};

/// The structure to build, and the way to render with it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// The acceleration structure.
    pub build: BuildChoice,
    /// The grouping of pixels and the tracing of rays.
    pub render: RenderOptions,
    /// The update of the structure in a scene that moves.
    #[serde(default)]
    pub update: Update,
    /// Frames of a scene that moves after which it is rebuilt; [`NEVER`] for never.
    #[serde(default = "never")]
    pub period: u32,
    /// Options of light sampling.
    #[serde(default)]
    pub light: LightSampling,
}

fn never() -> u32 {
    NEVER
}

impl From<BuildChoice> for Choice {
    /// Rendered as a simple renderer does: path by path, ray by ray.
    fn from(build: BuildChoice) -> Self {
        Self {
            build,
            render: RenderOptions::default(),
            update: Update::Rebuild,
            period: NEVER,
            light: LightSampling::default(),
        }
    }
}

impl Choice {
    /// The paper's recommended default.
    pub fn paper_default() -> Self {
        BuildChoice::Tree(TreeParameters::default()).into()
    }

    /// Embree's own structure, used the way its tutorials do.
    pub fn native(quality: NativeQuality) -> Self {
        BuildChoice::Native(NativeOptions { quality, ..NativeOptions::default() }).into()
    }
}

pub(super) fn of_paper(complete: &Configuration) -> Choice {
    let values = Values(complete);
    let mut tree = values.table_1(&TreeParameters::default());
    tree.static_scene = values.boolean("static");
    tree.compact = values.boolean("compact");
    tree.robust = values.boolean("robust");
    BuildChoice::Tree(tree).into()
}

/// A complete configuration of light sampling, with the tree and the grouping of rays of `base`.
pub(super) fn of_light(complete: &Configuration, base: &Choice) -> Choice {
    let (values, default) = (Values(complete), LightSampling::default());
    let light = LightSampling {
        candidates: values.whole("candidates", default.candidates),
        lamps: values.word("lamps", default.lamps),
        lamp_weight: values.number("lamp_weight", default.lamp_weight),
        sky: values.word("sky", default.sky),
        shadow_roulette: values.number("shadow_roulette", default.shadow_roulette),
        path_roulette: values.number("path_roulette", default.path_roulette),
    };
    Choice { light, ..*base }
}

/// A complete configuration of the space of scenes that move, with the grouping of rays of `base`.
pub(super) fn of_follow(complete: &Configuration, base: &Choice, premises: &Premises) -> Choice {
    let values = Values(complete);
    let tree = values.word("tree", KeptTree::Quick);
    let period = values.whole("period", NEVER);
    let rebuild_threshold = values.number("repair_above", Update::REBUILD_THRESHOLD);
    let update = match (period, tree) {
        (1, _) => Update::Rebuild,
        (_, KeptTree::Quick | KeptTree::Middle | KeptTree::Good) => Update::partial(rebuild_threshold),
        (_, KeptTree::NativeLow | KeptTree::NativeMedium) => Update::Refit,
    };
    Choice { build: follow::build(tree, premises), update, period, ..*base }
}

pub(super) fn of_full(complete: &Configuration, robust: bool) -> Choice {
    let values = Values(complete);
    let tunable = values.text("backend") == Some(TUNABLE);
    let build = if tunable { BuildChoice::Tree(values.tree(robust)) } else { values.native(robust) };
    let staged = values.boolean("staged");
    // Path by path there are no rays that could take turns.
    let bounce_flight = match values.whole("bounce_flight", 1) {
        4 if staged => Packets::Four,
        8 if staged => Packets::Eight,
        _ => Packets::Single,
    };
    let render = RenderOptions { staged, bounce_flight };
    Choice { render, ..Choice::from(build) }
}

/// Reads values; a missing value is inactive and keeps the default of its field.
struct Values<'a>(&'a Configuration);

impl Values<'_> {
    fn native(&self, robust: bool) -> BuildChoice {
        let default = NativeOptions::default();
        BuildChoice::Native(NativeOptions {
            quality: self.word("native_quality", default.quality),
            robust,
            split_budget: self.number("native_split_budget", default.split_budget),
            presplit: self.boolean("native_presplit"),
            ..default
        })
    }

    fn tree(&self, robust: bool) -> TreeParameters {
        let default = TreeParameters::default();
        let table_1 = self.table_1(&default);
        TreeParameters {
            robust,
            branching_factor: self.whole("node_width", table_1.branching_factor),
            block_width: self.whole("block_width", default.block_width),
            builder: self.word("builder", default.builder),
            search_radius: self.whole("search_radius", default.search_radius),
            cluster_size: self.whole("cluster_size", default.cluster_size),
            collapse: self.word("collapse", default.collapse),
            reinsertion_passes: self.whole("reinsertion_passes", default.reinsertion_passes),
            split_budget: self.number("split_budget", default.split_budget),
            ..table_1
        }
    }

    /// The parameters that both spaces spell alike.
    fn table_1(&self, default: &TreeParameters) -> TreeParameters {
        TreeParameters {
            quality: match self.whole("quality", 2) {
                1 => Quality::Morton,
                3 => Quality::SahSplit,
                _ => Quality::Sah,
            },
            branching_factor: self.whole("branching_factor", default.branching_factor),
            max_depth: self.whole("max_depth", default.max_depth),
            sah_block_size: self.whole("sah_block_size", default.sah_block_size),
            min_leaf_size: self.whole("min_leaf_size", default.min_leaf_size),
            max_leaf_size: self.whole("max_leaf_size", default.max_leaf_size),
            traversal_cost: self.number("traversal_cost", default.traversal_cost),
            intersection_cost: self.number("intersection_cost", default.intersection_cost),
            ..*default
        }
    }

    fn text(&self, name: &str) -> Option<&str> {
        match self.0.get(name) {
            Some(Value::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// A value of an enum, by the name it has in JSON.
    fn word<T: for<'de> Deserialize<'de>>(&self, name: &str, default: T) -> T {
        let read = |text| T::deserialize(StrDeserializer::<Error>::new(text));
        self.text(name).and_then(|text| read(text).ok()).unwrap_or(default)
    }

    fn whole(&self, name: &str, default: u32) -> u32 {
        match self.0.get(name) {
            Some(Value::Integer(value)) => u32::try_from(*value).unwrap_or(default),
            _ => default,
        }
    }

    fn number(&self, name: &str, default: f32) -> f32 {
        match self.0.get(name) {
            Some(Value::Float(value)) => *value as f32,
            _ => default,
        }
    }

    fn boolean(&self, name: &str) -> bool {
        matches!(self.0.get(name), Some(Value::Boolean(true)))
    }
}
