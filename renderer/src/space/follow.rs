//! The space of scenes that move: the tree, the period of its builds, and its updates in between.
//!
//! The objective is the mean time of a frame over an episode, the first build included. The grouping of rays
//! is that of the recommended configuration. Builders of the trees are those that the full space starts with:
//! quick for a frame of its own, good for a thousand frames, and Embree's own two.

use serde::{Deserialize, Serialize};
use treewright_accel::{BuildChoice, Builder, NativeOptions, NativeQuality, TreeParameters};

use super::explained::{Explained, choice, float, integer};
use super::{Choice, Premises, Preset, TuningSpace};
use crate::follow::NEVER;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum KeptTree {
    /// As for a frame of its own.
    Quick,
    /// In between: joined from pairs of triangles, collapsed at least cost, improved once.
    Middle,
    /// As for a thousand frames.
    Good,
    /// Embree's of quality low.
    NativeLow,
    /// Embree's of quality medium.
    NativeMedium,
}

pub(super) fn parameters() -> Vec<Explained> {
    let own = ["quick", "middle", "good"];
    vec![
        choice(
            "tree",
            own.into_iter().chain(["native_low", "native_medium"]),
            "quick",
            "which tree is built: a quick, a middling or a good one, or Embree's own",
        ),
        integer(
            "period",
            1..=i64::from(NEVER),
            i64::from(NEVER),
            "number of frames after which all is rebuilt, 64 means never; in between boxes are fitted to what moved",
        )
        .log(),
        float(
            "repair_above",
            1.02..=4.0,
            1.15,
            "how many times the cost at its last build a part may have before it is rebuilt",
        )
        .log()
        .only_while("tree", own),
    ]
}

/// The recommended grouping of rays of the full space, for all trees.
pub(super) fn base(premises: &Premises) -> Choice {
    TuningSpace::new(Preset::Full, &Premises { builds_each_frame: true, ..*premises }).default_choice()
}

pub(super) fn build(tree: KeptTree, premises: &Premises) -> BuildChoice {
    let native = |quality| {
        let (robust, dynamic) = (premises.robust, true);
        BuildChoice::Native(NativeOptions { quality, robust, dynamic, ..NativeOptions::default() })
    };
    let recommended = |builds_each_frame| {
        let premises = Premises { builds_each_frame, ..*premises };
        TuningSpace::new(Preset::Full, &premises).default_choice().build
    };
    match tree {
        KeptTree::Quick => recommended(true),
        KeptTree::Middle => middle(recommended(false)),
        KeptTree::Good => recommended(false),
        KeptTree::NativeLow => native(NativeQuality::Low),
        KeptTree::NativeMedium => native(NativeQuality::Medium),
    }
}

/// A tree between a quick one and a `good` one, in build time and in quality.
fn middle(good: BuildChoice) -> BuildChoice {
    let BuildChoice::Tree(good) = good else { return good };
    let (builder, search_radius, cluster_size, reinsertion_passes) = (Builder::Ploc, 8, 2, 1);
    BuildChoice::Tree(TreeParameters { builder, search_radius, cluster_size, reinsertion_passes, ..good })
}

#[cfg(test)]
mod tests {
    use treewright_accel::Update;

    use super::*;
    use crate::space::parse;

    #[test]
    fn each_value_says_what_is_built_and_when() {
        for robust in [false, true] {
            let premises = Premises { robust, ..Premises::all() };
            let space = TuningSpace::new(Preset::Follow, &premises);
            let of = |text: &str| {
                let choice = space.choice(&parse(text).expect("words")).expect("it is one of the space");
                assert_eq!(choice.update.check(), Ok(()), "{text}");
                choice
            };
            let default = of("");
            assert_eq!((default.update, default.period), (Update::partial(1.15), NEVER));
            assert_eq!(default.build, build(KeptTree::Quick, &premises));
            assert_eq!(of("period=1").update, Update::Rebuild);
            assert_eq!(of("tree=good,repair_above=2").update, Update::partial(2.0));
            assert_eq!((of("tree=native_low").update, of("tree=native_low").period), (Update::Refit, NEVER));
            assert_eq!(of("tree=native_medium,period=8").period, 8);
            let trees = ["quick", "middle", "good", "native_low", "native_medium"];
            for (number, one) in trees.iter().enumerate() {
                let built = |tree: &str| of(&format!("tree={tree}")).build;
                assert!(trees[..number].iter().all(|other| built(other) != built(one)), "{one}");
                let is_watertight = match built(one) {
                    BuildChoice::Tree(tree) => tree.robust,
                    BuildChoice::Native(native) => native.robust,
                    BuildChoice::BruteForce => false,
                };
                assert_eq!(is_watertight, robust, "{one}");
            }
            assert_eq!(space.name(), if robust { "follow-robust" } else { "follow" });
        }
    }
}
