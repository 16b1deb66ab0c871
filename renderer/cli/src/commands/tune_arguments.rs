//! Arguments of `treewright-render tune`.

use std::{path::PathBuf, time::Duration};

use clap::Args;
use treewright_client::{Policy, SessionPolicy};
use treewright_renderer::limits::{FRAMES_PER_TRIAL_MAX, ITERATIONS_MAX, PATIENCE_S_MAX, ROUNDS_MAX};
use treewright_renderer::space::{Narrowing, Preset};
use treewright_renderer::{measure::Conditions, tuning::objective::Objective};
use treewright_scene::Camera;

use crate::arguments::{SpaceArguments, StartArguments, ViewArguments, objective, unit_interval};
use crate::{
    episode_arguments::EpisodeArguments, episode_arguments::ReuseArguments, error::CliError, error::Result,
    narrowing::NarrowingArguments, server::ServerArguments,
};

/// Largest factor of `--abort-above`, which stops nothing that a scene can cost.
const ABORT_ABOVE_MAX: f64 = 1e6;
/// That factor where none is given.
const ABORT_ABOVE: f64 = 4.0;

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(super) server: ServerArguments,
    #[command(flatten)]
    pub(super) view: ViewArguments,
    #[command(flatten)]
    pub(super) space: SpaceArguments,
    #[command(flatten)]
    pub(super) narrowing: NarrowingArguments,
    #[command(flatten)]
    pub(super) start: StartArguments,

    /// Tune as the paper does: its space without `compact`, the stochastic Nelder-Mead search, nothing run
    /// twice and nothing confirmed by the service (`treewright policy --preset paper`).
    #[arg(long, conflicts_with = "space")]
    pub(super) paper: bool,

    /// Objective to minimise.
    #[arg(long, value_parser = objective(), default_value = Objective::Render.name())]
    pub(super) objective: Objective,

    /// Most trials of the search. Trials that repeat a configuration on a structure that is still there are
    /// cheap. A search ends earlier where more of it does not pay: see --worth. The race of the best few that
    /// follows has at most as many trials again, or 60; the end tells both.
    #[arg(long, value_name = "N", default_value_t = 80, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ITERATIONS_MAX)))]
    pub(super) iterations: u32,

    /// For how long you will render with the result, in seconds. From eight trials on, whenever their number
    /// has doubled or grown by half, the search ends if more trials would take longer than what they are
    /// expected to save of that time. With `inf` all trials run.
    #[arg(long, value_name = "SECONDS", default_value = "600", conflicts_with = "paper", value_parser = worth)]
    pub(super) worth: f64,

    /// Frames rendered with each configuration; their median counts. More frames make the search slower but
    /// more reliable. Default: 1. The objectives `error` and `motion` have numbers of their own.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(FRAMES_PER_TRIAL_MAX)))]
    frames: Option<u32>,

    #[command(flatten)]
    pub(super) episode: EpisodeArguments,
    #[command(flatten)]
    pub(super) reuse: ReuseArguments,

    /// Interleaved rounds in which the winner is measured again, beside the start and native Embree, each
    /// with builds of its own as far as a minute goes. From six on, half of them (rounded up) run in a second
    /// process, which may measure some per cent differently; intervals hold that. A configuration that is not
    /// shown to be faster than the start there does not replace it. Fewer than six rounds show nothing by
    /// themselves. After two minutes there are no more than six.
    #[arg(long, value_name = "N", default_value_t = 21, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    pub(super) rounds: u32,

    /// Another configuration of this space to run against the winner, as JSON; can be repeated.
    #[arg(long, value_name = "FILE")]
    pub(super) candidate: Vec<PathBuf>,

    /// Probability of exploring in a new state while this command runs.
    #[arg(long, value_name = "P", default_value_t = 1.0, value_parser = unit_interval)]
    pub(super) epsilon: f32,

    /// Stop a trial once it has cost this many times as much as the best so far, whatever the study's policy
    /// says; its build is always finished. With `inf` every trial runs to its end, as with the objective
    /// `error`. Default: 4.
    #[arg(long, value_name = "FACTOR", conflicts_with = "paper", allow_negative_numbers = true, value_parser = factor)]
    abort_above: Option<f64>,

    /// Longest wait for an answer of the daemon, in seconds. One that is slow, or is started again, loses no
    /// trial. After that the search goes on with the last good configuration.
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..=PATIENCE_S_MAX))]
    patience_s: u64,

    /// Write all results, including every trial, as JSON.
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,

    /// Write a report as a web page.
    #[arg(long, value_name = "FILE.html")]
    pub(super) report: Option<PathBuf>,
}

impl Arguments {
    /// With the space that `--paper` asks for.
    ///
    /// # Errors
    /// The objective has no use for what is given.
    pub(super) fn with_space(&self) -> Result<Self> {
        let mut arguments = self.clone();
        if self.paper {
            arguments.space.space = Preset::Paper;
            arguments.narrowing.fix.push(Narrowing::fix("compact=false").map_err(CliError::Failed)?);
        }
        arguments.objective = arguments.reuse.of(arguments.objective)?;
        arguments.space = arguments.space.judged_by(arguments.objective)?;
        arguments.check_use()?;
        Ok(arguments)
    }

    /// Refuses options that trials of the objective would ignore.
    fn check_use(&self) -> Result<()> {
        let ignored = match self.objective {
            Objective::Error if self.frames.is_some() => ("--frames", "draws a number of samples of its own"),
            Objective::Error if self.abort_above.is_some() => {
                ("--abort-above", "runs every trial to its end")
            }
            Objective::Motion if self.frames.is_some() => ("--frames", "renders the frames of --episode"),
            _ => return Ok(()),
        };
        let (option, cause) = ignored;
        let name = self.objective.name();
        Err(CliError::Usage(format!("--objective {name} {cause}; leave {option} out")))
    }

    pub(super) fn frames(&self) -> u32 {
        self.frames.unwrap_or(1)
    }

    pub(super) fn conditions(&self, camera: Camera) -> Conditions {
        Conditions {
            view: self.view.frame.view(camera),
            size: self.view.size.0,
            rounds: self.rounds,
            frames_per_build: self.objective.frames_per_build(),
            yardstick: self.objective.yardstick(),
        }
    }

    pub(super) fn patience(&self) -> Duration {
        Duration::from_secs(self.patience_s)
    }

    /// For how long will be rendered with the result. The paper runs all trials.
    pub(super) fn worth(&self) -> Duration {
        if self.paper {
            Duration::MAX
        } else {
            Duration::try_from_secs_f64(self.worth).unwrap_or(Duration::MAX)
        }
    }

    /// The policy of this run alone, whose search has `room` trials; the study's belongs to its operator.
    pub(super) fn session_policy(&self, room: u32) -> SessionPolicy {
        SessionPolicy {
            epsilon: Some(f64::from(self.epsilon)),
            trials_per_state: Some(room),
            // Said also where nothing is to be stopped: else the factor of the study's policy would hold.
            abort_above: (!self.paper)
                .then_some(self.abort_above.unwrap_or(ABORT_ABOVE).min(ABORT_ABOVE_MAX)),
            ..SessionPolicy::default()
        }
    }

    pub(super) fn policy(&self) -> Policy {
        if self.paper { Policy::paper() } else { Policy::new() }
    }
}

/// A time in seconds that may be without end.
fn worth(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 => Ok(seconds),
        _ => Err("it must be a number of seconds above 0, or inf".to_owned()),
    }
}

/// Reads the largest cost of a trial, as a factor on that of the best.
fn factor(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(factor) if factor > 1.0 && factor <= ABORT_ABOVE_MAX || factor == f64::INFINITY => Ok(factor),
        _ => Err("it must be a number above 1 and at most 1000000, or inf".to_owned()),
    }
}
