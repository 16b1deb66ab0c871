//! Objectives, and the study of each.

use serde::Serialize;
use treewright_client::{ClientError, Measurements, Policy, StudySpec};

use super::workload;
use crate::space::{Preset, TuningSpace};
use crate::{frame::FrameTimes, noise::HALF_SAMPLES};

// Metrics of studies, in milliseconds: a build, a frame, a frame with its true share of a build, the time to
// an error, and the cost without waiting, which explains what other programs cost.
const BUILD_MS: &str = "build_ms";
const RENDER_MS: &str = "render_ms";
const FRAME_MS: &str = "frame_ms";
const ERROR_MS: &str = "error_ms";
const UNDELAYED_MS: &str = "undelayed_ms";
/// Number of frames that share a build in progressive rendering.
const PROGRESSIVE_FRAMES_PER_BUILD: u32 = 1000;
/// Seed of every random decision in these studies: a part of their definition, for all clients.
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
    /// A tree that serves this many frames, each of which pays for its share of the build. The number is a
    /// part of the state, so one study holds all of them.
    Auto(u32),
}

/// The measure of contenders.
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
            Self::Render | Self::Total | Self::Auto(_) => None,
            Self::Error => Some(Preset::Light),
            Self::Motion => Some(Preset::Follow),
        }
    }

    /// The measure of contenders.
    pub fn yardstick(self) -> Yardstick {
        match self {
            Self::Render | Self::Total | Self::Auto(_) => Yardstick::Frame,
            Self::Error => Yardstick::Noise,
            Self::Motion => Yardstick::Episode,
        }
    }

    /// Number of frames that share a build.
    pub fn frames_per_build(self) -> u32 {
        match self {
            Self::Render | Self::Error => PROGRESSIVE_FRAMES_PER_BUILD,
            Self::Total | Self::Motion => 1,
            Self::Auto(frames) => frames.max(1),
        }
    }

    /// That number where the user gives it; it is then a part of the state.
    pub fn frames_asked(self) -> Option<u32> {
        match self {
            Self::Auto(_) => Some(self.frames_per_build()),
            Self::Render | Self::Total | Self::Error | Self::Motion => None,
        }
    }

    /// Whether each frame pays for a build.
    pub fn builds_each_frame(self) -> bool {
        self.frames_per_build() == 1
    }

    /// Whether searches begin with a tree that is built for a frame alone: the safer start.
    pub fn begins_with_cheap_builds(self) -> bool {
        matches!(self, Self::Total | Self::Motion | Self::Auto(_))
    }

    /// The two of the paper, in the order in which they are listed.
    pub const ALL: [Self; 2] = [Self::Render, Self::Total];
    /// The objectives that can be asked for, in the order of lists.
    pub const KNOWN: [Self; 5] = [Self::Render, Self::Total, Self::Error, Self::Motion, Self::Auto(1)];

    /// The objective in words.
    pub fn about(self) -> &'static str {
        match self {
            Self::Render => "render time",
            Self::Total => "total time",
            Self::Error => "time to an error",
            Self::Motion => "time of a frame in motion",
            Self::Auto(_) => "time of a frame with its share of a build",
        }
    }

    /// `render`, `total`, `error`, `motion` or `auto`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Render => "render",
            Self::Total => "total",
            Self::Error => "error",
            Self::Motion => "motion",
            Self::Auto(_) => "auto",
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
    let reuse = [workload::reuse_schema()].into_iter().filter(|_| matches!(objective, Objective::Auto(_)));
    for (name, min, max, scale) in workload::schema().chain(motion).chain(reuse) {
        builder = builder.indicator(name, min..=max, scale);
    }
    let build_weight = 1.0 / f64::from(objective.frames_per_build());
    let builder = match objective {
        Objective::Render | Objective::Total | Objective::Motion => {
            builder.minimise(BUILD_MS, build_weight).minimise(RENDER_MS, 1.0)
        }
        Objective::Error => builder.minimise(ERROR_MS, 1.0),
        Objective::Auto(_) => builder.minimise(FRAME_MS, 1.0),
    };
    Ok(builder.auxiliary(UNDELAYED_MS).build()?)
}

/// Cost of a frame with its share of a build in milliseconds, times the frames to the error if noisy.
pub fn frame_cost(times: FrameTimes, frames_per_build: u32) -> f64 {
    let frame_ms = times.build_ms / f64::from(frames_per_build) + times.render_ms;
    times.noise.map_or(frame_ms, |noise| frame_ms * noise.samples_to_error)
}

/// The id of that study, e.g. `total-paper`.
pub fn study_id(objective: Objective, space: &TuningSpace) -> String {
    format!("{}-{}", objective.name(), space_in_ids(space))
}

/// The name of a space in its studies' ids, with a number if it had other parameters once.
pub fn space_in_ids(space: &TuningSpace) -> String {
    let number = match space.preset() {
        Preset::Full => "-3",
        Preset::Light => "-5",
        Preset::Paper | Preset::Follow => "",
    };
    space.name() + number
}

/// The measurements of a trial of `frames` frames for an objective; noise has its standard error.
pub fn measurements(times: Option<FrameTimes>, frames: u32, objective: Objective) -> Measurements {
    let Some(times) = times else { return Measurements::new() };
    let cost_ms = objective.cost(times);
    let rendered = match objective {
        Objective::Error => 2 * HALF_SAMPLES,
        _ => times.frames.unwrap_or(frames),
    };
    let all = [
        (BUILD_MS, Some(times.build_ms)),
        (RENDER_MS, Some(times.render_ms)),
        (UNDELAYED_MS, Some(objective.cost(times.undelayed()))),
        ("frames", Some(f64::from(rendered))),
        ("build_cpu_ms", times.build_cpu_ms),
        ("render_cpu_ms", times.render_cpu_ms),
        ("build_delay_ms", times.build_delay_ms),
        ("render_delay_ms", times.render_delay_ms),
        ("trials_before", times.trials_before.map(f64::from)),
        ("trend", times.trend),
        // No study declares it: it does not explain other programs.
        ("structure_bytes", times.structure_bytes.map(|bytes| bytes as f64)),
        (FRAME_MS, matches!(objective, Objective::Auto(_)).then_some(cost_ms)),
        (ERROR_MS, times.noise.map(|_| cost_ms)),
        ("relative_variance", times.noise.map(|noise| noise.relative_variance)),
    ];
    let measured: Measurements = all.into_iter().filter_map(|(name, value)| Some((name, value?))).collect();
    let noise = times.noise.filter(|noise| noise.relative_variance > 0.0);
    noise.into_iter().fold(measured, |measured, noise| {
        let error_ms = cost_ms * noise.standard_error / noise.relative_variance;
        let measured = measured.with_standard_error("relative_variance", noise.standard_error);
        measured.with_standard_error(ERROR_MS, error_ms)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{noise::FrameNoise, space::Premises};

    #[test]
    fn a_trial_reports_how_many_frames_it_rendered() {
        let frames = |objective, times| measurements(Some(times), 3, objective).get("frames");
        let times = FrameTimes::of(5.0, 2.0);
        assert_eq!(frames(Objective::Render, times), Some(3.0));
        assert_eq!(frames(Objective::Motion, FrameTimes { frames: Some(24), ..times }), Some(24.0));
        assert_eq!(frames(Objective::Error, times), Some(8.0), "two halves of four samples");
    }

    #[test]
    fn the_time_to_an_error_has_the_standard_error_of_the_variance() {
        let noise =
            FrameNoise { relative_variance: 0.5, standard_error: 0.125, samples_to_error: 400.0, bias: None };
        let times = FrameTimes { noise: Some(noise), ..FrameTimes::of(0.0, 2.0) };
        let measured = measurements(Some(times), 1, Objective::Error);
        assert_eq!(measured.get("error_ms"), Some(800.0));
        let named = measured.clone().with_standard_error("error_ms", 200.0);
        assert_eq!(named.with_standard_error("relative_variance", 0.125), measured);
        let without = measurements(Some(FrameTimes::of(0.0, 2.0)), 1, Objective::Render);
        assert_ne!(without.clone().with_standard_error("render_ms", 1.0), without);
    }

    #[test]
    fn all_scenes_share_a_study_of_an_objective_and_a_space() {
        let space = |robust| TuningSpace::new(Preset::Full, &Premises { robust, ..Premises::all() });
        assert_eq!(study_id(Objective::Render, &space(false)), "render-full-3");
        assert_eq!(study_id(Objective::Total, &space(true)), "total-full-robust-3");
        assert_eq!(study_id(Objective::Total, &TuningSpace::paper()), "total-paper");
        assert_eq!(space_in_ids(&space(true)), "full-robust-3");
    }

    #[test]
    fn a_space_with_other_parameters_has_another_id() {
        for (objective, preset, id, parameters) in [
            (
                Objective::Error,
                Preset::Light,
                "error-light-lamps-sky-5",
                "candidates lamps lamp_weight sky shadow_roulette path_roulette",
            ),
            (Objective::Motion, Preset::Follow, "motion-follow", "tree period repair_above"),
        ] {
            let space = TuningSpace::new(preset, &Premises::all());
            let names: Vec<&str> =
                space.space().parameters().iter().map(|parameter| parameter.name.as_str()).collect();
            assert_eq!((study_id(objective, &space).as_str(), names.join(" ").as_str()), (id, parameters));
        }
    }

    #[test]
    fn one_study_holds_every_number_of_frames_that_share_a_build() {
        let of = |frames| {
            specification(&TuningSpace::paper(), Objective::Auto(frames), Policy::new()).expect("it is sound")
        };
        assert_eq!(of(1), of(1024));
        assert_eq!(of(1).indicators.indicators().len(), 21);
        assert_eq!(of(1).objective.terms().len(), 1);
        assert_eq!(Objective::Auto(16).cost(FrameTimes::of(64.0, 10.0)), 14.0);
        assert_eq!(study_id(Objective::Auto(16), &TuningSpace::paper()), "auto-paper");
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
