//! What is minimised, and the study that tells the service so.

use serde::Serialize;
use treewright_client::{ClientError, Policy, Scale, StudySpec};

use super::reuse::FRAMES_PER_BUILD_MAX;
use super::workload;
use crate::frame::FrameTimes;
use crate::space::{Preset, TuningSpace};

/// Name of the measurement of a build, in milliseconds.
pub const BUILD_MS: &str = "build_ms";

/// Name of the measurement of a frame, in milliseconds.
pub const RENDER_MS: &str = "render_ms";

/// Name of the time to an error, in milliseconds: see [`Objective::Error`].
pub const ERROR_MS: &str = "error_ms";

/// Name of how many times as long frames took in the second half of an episode as in its first.
pub const TREND: &str = "trend";

/// Name of the processor time of a build, of all threads together, in milliseconds.
pub const BUILD_CPU_MS: &str = "build_cpu_ms";

/// Name of the processor time of a frame, of all render threads together, in milliseconds.
pub const RENDER_CPU_MS: &str = "render_cpu_ms";

/// Name of the time that all threads together waited for a processor during a build, in milliseconds.
pub const BUILD_DELAY_MS: &str = "build_delay_ms";

/// Name of the time that the render threads together waited for a processor during a frame, in milliseconds.
pub const RENDER_DELAY_MS: &str = "render_delay_ms";

/// Name of what a study minimises as it would have been if no thread had waited for a processor, in
/// milliseconds: it explains what other programs made of a cost.
pub const UNDELAYED_MS: &str = "undelayed_ms";

/// Name of how many trials a structure had served before, where it was used again.
pub const TRIALS_BEFORE: &str = "trials_before";

/// How many frames share a build in progressive rendering.
const PROGRESSIVE_FRAMES_PER_BUILD: u32 = 1000;

/// Of every random decision in these studies. It is part of what defines a study, so it is the same for all
/// clients.
const STUDY_SEED: u64 = 1;

/// The two use cases of the paper's section 7, and what light sampling is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// Progressive rendering: a structure serves a thousand frames, so a frame pays for a thousandth of its
    /// build.
    Render,
    /// Real-time rendering: the structure is built for each frame, so build and render time count.
    Total,
    /// Time to an error: a progressive frame times the number of samples a pixel that it takes until the
    /// picture's relative variance is [`TARGET_VARIANCE`](crate::noise::TARGET_VARIANCE).
    Error,
    /// A scene that moves: the mean frame of an episode, with what brings the structure along and the first
    /// build.
    Motion,
}

/// What contenders are measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Yardstick {
    /// The time of a frame.
    Frame,
    /// The time to an error.
    Noise,
    /// The mean frame of the episode that the renderer was given.
    Episode,
}

impl Objective {
    /// The scalar that is minimised.
    pub fn cost(self, times: FrameTimes) -> f64 {
        frame_cost(times, self.frames_per_build())
    }

    /// The space that only this objective judges.
    pub fn own_space(self) -> Option<Preset> {
        match self {
            Self::Render | Self::Total => None,
            Self::Error => Some(Preset::Light),
            Self::Motion => Some(Preset::Follow),
        }
    }

    /// What contenders are measured by.
    pub fn yardstick(self) -> Yardstick {
        match self {
            Self::Render | Self::Total => Yardstick::Frame,
            Self::Error => Yardstick::Noise,
            Self::Motion => Yardstick::Episode,
        }
    }

    /// How many frames share a build.
    pub fn frames_per_build(self) -> u32 {
        match self {
            Self::Render | Self::Error => PROGRESSIVE_FRAMES_PER_BUILD,
            Self::Total | Self::Motion => 1,
        }
    }

    /// Whether each frame pays for a build.
    pub fn builds_each_frame(self) -> bool {
        matches!(self, Self::Total | Self::Motion)
    }

    /// The two of the paper, in the order in which they are listed.
    pub const ALL: [Self; 2] = [Self::Render, Self::Total];

    /// Those that can be asked for, in the order in which they are listed.
    pub const KNOWN: [Self; 4] = [Self::Render, Self::Total, Self::Error, Self::Motion];

    /// What is minimised, in words.
    pub fn about(self) -> &'static str {
        match self {
            Self::Render => "render time",
            Self::Total => "total time",
            Self::Error => "time to an error",
            Self::Motion => "time of a frame in motion",
        }
    }

    /// `render`, `total`, `error` or `motion`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Render => "render",
            Self::Total => "total",
            Self::Error => "error",
            Self::Motion => "motion",
        }
    }
}

/// The study of an objective in a space, one for all scenes, sizes and machines.
pub fn specification(
    space: &TuningSpace,
    objective: Objective,
    policy: Policy,
) -> Result<StudySpec, ClientError> {
    let title = format!("treewright-render: {} in the space {}", objective.about(), space.name());
    let mut builder =
        StudySpec::builder(space.space().clone()).display_name(&title).policy(policy).seed(STUDY_SEED);
    let motion = workload::motion_schema().into_iter().filter(|_| objective == Objective::Motion);
    for (name, min, max, scale) in workload::schema().chain(motion) {
        builder = builder.indicator(name, min..=max, scale);
    }
    let build_weight = 1.0 / f64::from(objective.frames_per_build());
    let builder = match objective {
        Objective::Render | Objective::Total | Objective::Motion => {
            builder.minimise(BUILD_MS, build_weight).minimise(RENDER_MS, 1.0)
        }
        Objective::Error => builder.minimise(ERROR_MS, 1.0),
    };
    Ok(builder.auxiliary(UNDELAYED_MS).build()?)
}

/// Name of the measurement of a frame with the share of its build that is true at the time, in milliseconds.
pub const FRAME_MS: &str = "frame_ms";

/// Name of the indicator that says how many frames share a build ([`super::reuse`]).
pub const FRAMES_PER_BUILD: &str = "frames_per_build";

/// The study of clients that do not know beforehand how many frames a tree serves: they say how many it seems
/// to be, and report a frame with that share of its build.
pub fn auto_specification(space: &TuningSpace, policy: Policy) -> Result<StudySpec, ClientError> {
    let title = format!("treewright-render: whatever is true of the frames, in the space {}", space.name());
    let builder =
        StudySpec::builder(space.space().clone()).display_name(&title).policy(policy).seed(STUDY_SEED);
    let most = f64::from(FRAMES_PER_BUILD_MAX);
    let frames = (FRAMES_PER_BUILD, 1.0, most, Scale::Log);
    let all = workload::schema().chain([frames]);
    let builder =
        all.fold(builder, |builder, (name, min, max, scale)| builder.indicator(name, min..=max, scale));
    Ok(builder.minimise(FRAME_MS, 1.0).auxiliary(UNDELAYED_MS).build()?)
}

/// The id of that study, e.g. `auto-full`.
pub fn auto_study_id(space: &TuningSpace) -> String {
    format!("auto-{}", space.name())
}

/// A frame with its share of a build that serves so many frames, in milliseconds; where its noise was
/// measured, as many frames as it takes to the error.
pub fn frame_cost(times: FrameTimes, frames_per_build: u32) -> f64 {
    let frame_ms = times.build_ms / f64::from(frames_per_build) + times.render_ms;
    times.noise.map_or(frame_ms, |noise| frame_ms * noise.samples_to_error)
}

/// The id of that study, e.g. `render-full`.
pub fn study_id(objective: Objective, space: &TuningSpace) -> String {
    format!("{}-{}", objective.name(), space.name())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Premises;

    #[test]
    fn all_scenes_share_a_study_of_an_objective_and_a_space() {
        let space = |robust, animated, instanced| {
            TuningSpace::new(Preset::Full, &Premises { robust, animated, instanced, ..Premises::all() })
        };
        assert_eq!(study_id(Objective::Render, &space(false, false, false)), "render-full");
        assert_eq!(
            study_id(Objective::Total, &space(true, true, true)),
            "total-full-robust-moving-instanced"
        );
        assert_eq!(study_id(Objective::Total, &TuningSpace::paper()), "total-paper");
    }

    #[test]
    fn what_is_not_known_beforehand_is_an_indicator() {
        let spec = auto_specification(&TuningSpace::paper(), Policy::new()).expect("it is sound");
        assert_eq!(spec.indicators.indicators().len(), 21);
        assert_eq!(spec.objective.terms().len(), 1);
        assert_eq!(frame_cost(FrameTimes::of(64.0, 10.0), 16), 14.0);
        assert_eq!(auto_study_id(&TuningSpace::paper()), "auto-paper");
    }

    #[test]
    fn costs_are_what_the_study_minimises() {
        let times = FrameTimes::of(30.0, 12.0);
        for (objective, cost) in [(Objective::Render, 12.03), (Objective::Total, 42.0)] {
            let spec = specification(&TuningSpace::paper(), objective, Policy::new());
            let spec = spec.expect("it is sound");
            let measured = |metric: &str| {
                if metric == BUILD_MS { times.build_ms } else { times.render_ms }
            };
            let sum: f64 =
                spec.objective.terms().iter().map(|term| term.weight * measured(&term.metric)).sum();
            assert!((objective.cost(times) - cost).abs() < 1e-9 && (sum - cost).abs() < 1e-9);
            assert_eq!(spec.indicators.indicators().len(), 20);
        }
    }
}
