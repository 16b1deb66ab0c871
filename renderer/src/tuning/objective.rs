//! What is minimised, and the study that tells the service so.

use serde::Serialize;
use treewright_client::{ClientError, Policy, Scale, StudySpec};

use crate::frame::FrameTimes;
use crate::space::TuningSpace;
use treewright_scene::indicators::{IndicatorScale, SCHEMA};

/// Name of the measurement of a build, in milliseconds.
pub const BUILD_MS: &str = "build_ms";

/// Name of the measurement of a frame, in milliseconds.
pub const RENDER_MS: &str = "render_ms";

/// How many frames share a build in progressive rendering.
const PROGRESSIVE_FRAMES_PER_BUILD: u32 = 1000;

/// Longest study id that the service takes.
const STUDY_ID_MAX: usize = 64;

/// The two use cases of the paper's section 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// Progressive rendering: a structure serves a thousand frames, so a frame pays for a thousandth of its build.
    Render,
    /// Real-time rendering: the structure is built for each frame, so build and render time count.
    Total,
}

impl Objective {
    /// The scalar that is minimised.
    pub fn cost(self, times: FrameTimes) -> f64 {
        times.build_ms / f64::from(self.frames_per_build()) + times.render_ms
    }

    /// How many frames share a build.
    pub fn frames_per_build(self) -> u32 {
        match self {
            Self::Render => PROGRESSIVE_FRAMES_PER_BUILD,
            Self::Total => 1,
        }
    }

    /// Whether each frame pays for a build.
    pub fn builds_each_frame(self) -> bool {
        self == Self::Total
    }

    /// Both, in the order in which they are listed.
    pub const ALL: [Self; 2] = [Self::Render, Self::Total];

    /// `render` or `total`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Render => "render",
            Self::Total => "total",
        }
    }
}

/// The study of a scene: this space, Table 2's indicators, this objective.
pub fn specification(
    space: &TuningSpace,
    title: &str,
    objective: Objective,
    policy: Policy,
    seed: u64,
) -> Result<StudySpec, ClientError> {
    let mut builder = StudySpec::builder(space.space().clone()).display_name(title).policy(policy).seed(seed);
    for indicator in &SCHEMA {
        let scale = match indicator.scale {
            IndicatorScale::Linear => Scale::Linear,
            IndicatorScale::Log => Scale::Log,
        };
        builder = builder.indicator(indicator.name, indicator.min..=indicator.max, scale);
    }
    let build_weight = 1.0 / f64::from(objective.frames_per_build());
    Ok(builder.minimise(BUILD_MS, build_weight).minimise(RENDER_MS, 1.0).build()?)
}

/// An id of the letters the service takes, made of what tells studies apart.
pub fn study_id(
    scene: &str,
    objective: Objective,
    size: impl std::fmt::Display,
    space: &TuningSpace,
) -> String {
    let scene: String = scene
        .to_lowercase()
        .chars()
        .map(|letter| {
            if letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_' { letter } else { '-' }
        })
        .collect();
    let end = format!("-{}-{size}-{}", objective.name(), space.name());
    let mut id = if scene.starts_with(|letter: char| letter.is_ascii_lowercase()) {
        scene
    } else {
        format!("scene-{scene}")
    };
    // All characters are one byte long by now.
    id.truncate(STUDY_ID_MAX.saturating_sub(end.len()));
    id + &end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::{Premises, Preset};

    #[test]
    fn ids_follow_the_contract() {
        let still = Premises { animated: false, instanced: false, ..Premises::all() };
        let full = TuningSpace::new(Preset::Full, &still);
        let id = |name: &str, objective, size| study_id(name, objective, size, &full);
        assert_eq!(
            id("Sponza Atrium.v2", Objective::Render, "320x240"),
            "sponza-atrium-v2-render-320x240-full"
        );
        assert_eq!(id("7even", Objective::Total, "8x8"), "scene-7even-total-8x8-full");
        let other = TuningSpace::new(Preset::Full, &Premises { robust: true, ..Premises::all() });
        for name in ["", "ÄÖ", &"x".repeat(500)] {
            let id = study_id(name, Objective::Total, "16384x16384", &other);
            assert!(
                id.len() <= STUDY_ID_MAX && id.starts_with(|letter: char| letter.is_ascii_lowercase()),
                "{id}"
            );
            assert!(id.ends_with("-total-16384x16384-full-robust-moving-instanced"));
        }
        assert_ne!(id("a", Objective::Render, "8x8"), id("a", Objective::Total, "8x8"));
    }

    #[test]
    fn costs_are_what_the_study_minimises() {
        let times = FrameTimes { build_ms: 30.0, render_ms: 12.0 };
        for (objective, cost) in [(Objective::Render, 12.03), (Objective::Total, 42.0)] {
            let spec = specification(&TuningSpace::paper(), "test", objective, Policy::new(), 1);
            let spec = spec.expect("it is sound");
            let measured = |metric: &str| {
                if metric == BUILD_MS { times.build_ms } else { times.render_ms }
            };
            let sum: f64 =
                spec.objective.terms().iter().map(|term| term.weight * measured(&term.metric)).sum();
            assert!((objective.cost(times) - cost).abs() < 1e-9 && (sum - cost).abs() < 1e-9);
            assert_eq!(spec.indicators.indicators().len(), 17);
        }
    }
}
