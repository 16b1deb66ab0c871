//! Options of a native Embree scene: build quality, scene flags, and those device options that do something.
//!
//! Not every option acts everywhere. Each line was found by memory, build time and answers of Embree 4.4.0,
//! and a test checks it:
//!
//! | option | acts |
//! |---|---|
//! | `quality` | with [`NativeAcceleration::Auto`], where `compact` or `robust` make high medium; named accelerations are of medium quality |
//! | `compact`, `robust` | with [`NativeAcceleration::Auto`], whose choice they are; named accelerations are what their name says, and the `v` ones are watertight |
//! | `dynamic` | always: data for a later update is kept, some 32 bytes a triangle |
//! | `split_budget` | where high quality acts |
//! | `presplit` | where high quality acts: triangles are split before the build instead of during it |
//!
//! A later refit acts with [`NativeAcceleration::Auto`]; scenes of a named acceleration are rebuilt instead.
//!
//! Left out, because they do nothing here or only harm: `max_triangles_per_leaf` (dead with the default
//! acceleration), `sah_presplit` and `dynamic` as builders (equal to `sah` for one mesh), `hugepages`,
//! lower instruction sets.

use serde::{Deserialize, Serialize};

use crate::error::BuildError;
use crate::limits::{NATIVE_SPLIT_BUDGET_RANGE, SPLIT_BUDGET};
use crate::rays::Packets;

/// Build quality of a native Embree scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NativeQuality {
    /// Morton builder.
    Low,
    /// Binned SAH: Embree's default.
    #[default]
    Medium,
    /// Binned SAH with spatial splits.
    High,
}

impl NativeQuality {
    /// All of them, from the quickest build on.
    pub const ALL: [Self; 3] = [Self::Low, Self::Medium, Self::High];

    /// Its word in configurations.
    pub fn name(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
        }
    }
}

/// Nodes and leaves of a native Embree scene: children a node, then what a leaf holds of its triangles.
/// `Triangle4` holds corner and edges, `Triangle4v` all corners and tests watertight, `Triangle4i` vertex
/// numbers; `Qbvh` nodes are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NativeAcceleration {
    /// Embree chooses by quality and flags: without flags [`NativeAcceleration::Bvh8Triangle4`] where there
    /// is AVX.
    #[default]
    Auto,
    /// Four children.
    Bvh4Triangle4,
    /// Four children, watertight.
    Bvh4Triangle4v,
    /// Eight children.
    Bvh8Triangle4,
    /// Eight children, watertight.
    Bvh8Triangle4v,
    /// Eight children, small leaves.
    Bvh8Triangle4i,
    /// Eight children in compressed nodes.
    Qbvh8Triangle4,
}

impl NativeAcceleration {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Auto,
        Self::Bvh4Triangle4,
        Self::Bvh4Triangle4v,
        Self::Bvh8Triangle4,
        Self::Bvh8Triangle4v,
        Self::Bvh8Triangle4i,
        Self::Qbvh8Triangle4,
    ];

    /// The packets in which rays are traced through it: `packets`, or single rays where Embree has no kernel
    /// for packets, as for all compressed nodes.
    ///
    /// `rtcIntersect8` and its like check that only for the scene they are given, and then trace its rays one
    /// by one. Below an instance they do not check, and call a function that is not there.
    pub(crate) fn traced(self, packets: Packets) -> Packets {
        match self {
            Self::Qbvh8Triangle4 => Packets::Single,
            _ => packets,
        }
    }

    /// Embree's name of it.
    fn tri_accel(self) -> &'static str {
        match self {
            Self::Auto => "default",
            Self::Bvh4Triangle4 => "bvh4.triangle4",
            Self::Bvh4Triangle4v => "bvh4.triangle4v",
            Self::Bvh8Triangle4 => "bvh8.triangle4",
            Self::Bvh8Triangle4v => "bvh8.triangle4v",
            Self::Bvh8Triangle4i => "bvh8.triangle4i",
            Self::Qbvh8Triangle4 => "qbvh8.triangle4",
        }
    }
}

/// Options of a native Embree scene. The default is what `rtcCommitScene` does untold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NativeOptions {
    /// Build quality.
    pub quality: NativeQuality,
    /// `RTC_SCENE_FLAG_COMPACT`.
    pub compact: bool,
    /// `RTC_SCENE_FLAG_DYNAMIC`.
    pub dynamic: bool,
    /// `RTC_SCENE_FLAG_ROBUST`.
    pub robust: bool,
    /// Nodes and leaves.
    pub acceleration: NativeAcceleration,
    /// Room for the references that spatial splits add, as a factor on the number of triangles, 1 to 4.
    /// Embree receives it to one decimal place.
    pub split_budget: f32,
    /// Split triangles before the build, not during it.
    pub presplit: bool,
}

impl Default for NativeOptions {
    fn default() -> Self {
        Self {
            quality: NativeQuality::default(),
            compact: false,
            dynamic: false,
            robust: false,
            acceleration: NativeAcceleration::default(),
            split_budget: SPLIT_BUDGET,
            presplit: false,
        }
    }
}

impl NativeOptions {
    /// Checks that every option lies in its range.
    pub fn check(&self) -> Result<(), BuildError> {
        // NaN lies in no range.
        if NATIVE_SPLIT_BUDGET_RANGE.contains(&self.split_budget) {
            return Ok(());
        }
        Err(BuildError::InvalidParameters {
            parameter: "split_budget",
            value: self.split_budget.to_string(),
            rule: "it must be 1 to 4",
        })
    }

    /// The quality the scene will have: one that does not act becomes medium.
    pub fn effective_quality(&self) -> NativeQuality {
        let is_named = self.acceleration != NativeAcceleration::Auto;
        let is_flagged = self.quality == NativeQuality::High && (self.compact || self.robust);
        if is_named || is_flagged { NativeQuality::Medium } else { self.quality }
    }

    /// The device options of such a scene; empty if it needs none.
    pub(crate) fn device_options(&self) -> String {
        if self.acceleration != NativeAcceleration::Auto {
            return format!("tri_accel={}", self.acceleration.tri_accel());
        }
        let mut options = Vec::new();
        if self.effective_quality() == NativeQuality::High {
            if self.split_budget != SPLIT_BUDGET {
                // Few different numbers, so that few devices are made.
                options.push(format!("max_spatial_split_replications={:.1}", self.split_budget));
            }
            if self.presplit {
                options.push("presplits=1".to_owned());
            }
        }
        options.join(",")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_device_hears_what_acts_and_no_more() {
        let options = NativeOptions::default();
        let high = NativeOptions { quality: NativeQuality::High, ..options };
        assert_eq!(options.device_options(), "");
        assert_eq!(high.device_options(), "");
        let option_text = |options: NativeOptions| options.device_options();
        assert_eq!(option_text(NativeOptions { split_budget: 2.0, presplit: true, ..options }), "");
        assert_eq!(
            option_text(NativeOptions { split_budget: 2.04, presplit: true, ..high }),
            "max_spatial_split_replications=2.0,presplits=1"
        );
        let named = NativeOptions { acceleration: NativeAcceleration::Bvh4Triangle4v, ..high };
        assert_eq!(
            (named.effective_quality(), option_text(named)),
            (NativeQuality::Medium, "tri_accel=bvh4.triangle4v".into())
        );
        let flagged = NativeOptions { robust: true, split_budget: 2.0, ..high };
        assert_eq!(
            (flagged.effective_quality(), option_text(flagged)),
            (NativeQuality::Medium, String::new())
        );
    }

    #[test]
    fn a_budget_out_of_range_is_refused() {
        for split_budget in [0.9, 4.1, f32::NAN, f32::INFINITY] {
            let refused = NativeOptions { split_budget, ..NativeOptions::default() }.check();
            let named =
                |error| matches!(error, BuildError::InvalidParameters { parameter: "split_budget", .. });
            assert!(refused.is_err_and(named), "{split_budget}");
        }
    }
}
