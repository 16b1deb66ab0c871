//! Options of a native Embree scene: build quality, scene flags, and those device options that do something.
//!
//! Not every option acts everywhere. Each line was found by memory, build time and answers of Embree 4.4.0,
//! and a test checks it:
//!
//! | option | acts |
//! |---|---|
//! | `quality` | always, but `compact` and `robust` make high medium |
//! | `compact`, `robust` | always |
//! | `dynamic` | always: data for a later update is kept, some 32 bytes a triangle |
//! | `split_budget` | where high quality acts |
//! | `presplit` | where high quality acts: triangles are split before the build instead of during it |
//!
//! Left out, because they do nothing here or only harm: nodes and leaves by name (`tri_accel`; see
//! `docs/measurements/lean.md`), `max_triangles_per_leaf` (dead with Embree's own choice of these),
//! `sah_presplit` and `dynamic` as builders (equal to `sah` for one mesh), `hugepages`, lower instruction
//! sets.

use serde::{Deserialize, Serialize};

use crate::error::BuildError;
use crate::limits::{NATIVE_SPLIT_BUDGET_RANGE, SPLIT_BUDGET};

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
    /// Room for the references of spatial splits: 1 to 4 times the triangles, to one decimal place.
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
        let is_flagged = self.quality == NativeQuality::High && (self.compact || self.robust);
        if is_flagged { NativeQuality::Medium } else { self.quality }
    }

    /// The device options of such a scene; empty if it needs none.
    pub(crate) fn device_options(&self) -> String {
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
        let flagged = NativeOptions { robust: true, split_budget: 2.0, ..high };
        assert_eq!(
            (flagged.effective_quality(), option_text(flagged)),
            (NativeQuality::Medium, String::new())
        );
    }
}
