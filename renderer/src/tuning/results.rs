//! Everything a tuning run found out. Written as JSON, and shown by the report.

use serde::Serialize;
use treewright_client::{Configuration, Fingerprint, Indicators, Mode, OpenEnum, Stats};

use super::objective::Objective;
use super::search::Iteration;
use super::verdict::Gains;
use crate::disturbance::Disturbance;
use crate::integrator::Omission;
use crate::measure::Standing;
use crate::space::{Explained, Preset};
use crate::statistics::{BreakEven, Ratio, Summary, quantile};

/// A finished run.
#[derive(Clone, Debug, Serialize)]
pub struct TuningResults {
    /// What was rendered.
    pub scene: SceneFacts,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Frames rendered in each trial, where a trial does not say otherwise.
    pub frames_per_trial: u32,
    /// What was minimised.
    pub objective: Objective,
    /// Name of the space that was tuned.
    pub space: Preset,
    /// Its parameters, each with what it does.
    pub parameters: Vec<Explained>,
    /// Where the search began.
    pub start: Configuration,
    /// Name of its standing.
    pub start_name: String,
    /// What the service held for the best on the way.
    pub milestones: Vec<Milestone>,
    /// Where the service is, and the study's id there.
    pub server: String,
    /// The study's id.
    pub study: String,
    /// The machine.
    pub machine: Fingerprint,
    /// The state that was tuned.
    pub indicators: Indicators,
    /// Every trial of the search, and of the confirmation after it.
    pub trials: Vec<Iteration>,
    /// What the service says of its answer after all of them.
    pub confirmation: Option<treewright_client::Standing>,
    /// Name of the standing that the run is compared with: the paper's default in its own space, else native
    /// Embree's.
    pub baseline: String,
    /// The baseline's cost while the search ran: what the trials' costs are compared with.
    pub reference_ms: f64,
    /// What the search found.
    pub found: Configuration,
    /// What is best: what was found, or whatever else beat it when everybody was measured again.
    pub tuned: Configuration,
    /// Name of its standing.
    pub best: String,
    /// What anybody could have had without a search, and what the search found, measured again side by side.
    pub standings: Vec<Standing>,
    /// What the best one gains.
    pub gains: Gains,
    /// What else the machine did while that was measured.
    pub disturbance: Disturbance,
    /// The predictor's answer for a camera that was never tuned.
    pub prediction: Option<Prediction>,
    /// What asking and telling the service cost.
    pub overhead: Overhead,
    /// When tuning pays off.
    pub break_even: BreakEven,
    /// The frame of break-even; absent if it never comes.
    pub break_even_frame: Option<u64>,
    /// What became of suggestions and reports.
    pub client: Stats,
    /// What went wrong without ending the run, one sentence each.
    pub notes: Vec<String>,
}

/// What the service held for the best after some trials of the search, measured again after it.
#[derive(Clone, Debug, Serialize)]
pub struct Milestone {
    /// How many trials were handed out by then.
    pub trials: u32,
    /// What a client would have got.
    pub configuration: Configuration,
    /// How many times faster it is than where the search began, in the rounds in which everybody else ran,
    /// too. Absent where it was not measured.
    pub over_start: Option<Ratio>,
}

/// What describes a scene to people.
#[derive(Clone, Debug, Serialize)]
pub struct SceneFacts {
    /// Its name.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// Meshes.
    pub meshes: usize,
    /// What shading leaves out, and why the scene can do without.
    pub left_out: Vec<Omission>,
    /// What the loader left out or made up.
    pub notes: Vec<String>,
}

/// The predictor's first answer on a fresh camera, measured against the default there.
#[derive(Clone, Debug, Serialize)]
pub struct Prediction {
    /// The point of the camera path.
    pub camera_at: f32,
    /// How the service answered.
    pub mode: OpenEnum<Mode>,
    /// Its reason in one sentence.
    pub reason: String,
    /// Its answer.
    pub configuration: Configuration,
    /// How long the answer took.
    pub answer_ms: f64,
    /// The baseline and the prediction, measured side by side.
    pub standings: Vec<Standing>,
}

impl Prediction {
    /// How many times faster than the baseline the predicted configuration is.
    pub fn speedup(&self) -> f64 {
        self.standings.last().map_or(1.0, |standing| standing.speedup.median)
    }
}

/// What asking and telling the service cost.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Overhead {
    /// Waiting for one report to be taken and the next suggestion to come.
    pub waiting_ms: Summary,
    /// One in a hundred took longer.
    pub waiting_p99_ms: f64,
    /// Median waiting as a share of the median trial, build and frames included.
    pub share_of_frame: f64,
    /// Waiting over the whole search.
    pub waiting_total_ms: f64,
}

impl Overhead {
    /// Of the trials of a search.
    pub fn of(trials: &[Iteration]) -> Self {
        let mut waiting: Vec<f64> = trials.iter().map(|trial| trial.waiting_ms).collect();
        waiting.sort_by(f64::total_cmp);
        let total: Vec<f64> = trials.iter().map(|trial| trial.total_ms).collect();
        let (waiting_ms, total_ms) = (Summary::of(&waiting), Summary::of(&total));
        Self {
            waiting_ms,
            waiting_p99_ms: quantile(&waiting, 0.99),
            share_of_frame: if total_ms.median > 0.0 { waiting_ms.median / total_ms.median } else { 0.0 },
            waiting_total_ms: waiting.iter().sum(),
        }
    }
}

impl TuningResults {
    /// Trials that could not be built, or failed otherwise.
    pub fn failed(&self) -> usize {
        self.trials.iter().filter(|trial| trial.has_failed()).count()
    }

    /// Trials that were stopped because they had cost too much.
    pub fn stopped(&self) -> usize {
        self.trials.iter().filter(|trial| trial.stopped_at().is_some()).count()
    }

    /// The standing of that name.
    pub fn standing(&self, name: &str) -> Option<&Standing> {
        self.standings.iter().find(|standing| standing.name == name)
    }

    /// How many times faster than the baseline the best one is, median of pairs.
    pub fn speedup(&self) -> f64 {
        self.speedup_over(&self.baseline).unwrap_or(1.0)
    }

    /// How many times faster the best one is than another, median of pairs. `None` where one was not
    /// measured.
    pub fn speedup_over(&self, name: &str) -> Option<f64> {
        let speedup = self.standing(&self.best)?.speedup_over(self.standing(name)?);
        (speedup.count > 0).then_some(speedup.median)
    }

    /// After how many trials the service's answer is shown to be `factor` times as fast as the start, where
    /// it stays so: its interval lies above that.
    pub fn trials_until(&self, factor: f64) -> Option<u32> {
        let reaches = |milestone: &&Milestone| {
            milestone.over_start.and_then(|ratio| ratio.interval).is_some_and(|[low, _]| low >= factor)
        };
        let last = self.milestones.iter().rev().take_while(reaches).last();
        last.map(|milestone| milestone.trials)
    }

    /// How many different configurations the trials ran.
    pub fn configurations(&self) -> usize {
        let texts: std::collections::BTreeSet<String> =
            self.trials.iter().map(|trial| trial.configuration.to_string()).collect();
        texts.len()
    }

    /// Whether the search found something that is faster than everything anybody could have had without it.
    pub fn search_won(&self) -> bool {
        self.best == super::verdict::TUNED
    }
}
