//! All results of a tuning run. Written as JSON, and shown by the report.

use serde::Serialize;
use treewright_client::{Configuration, Fingerprint, Indicators, Mode, OpenEnum, Stats};

use super::safety::{Safety, start_cost};
use super::{objective::Objective, search::Iteration, verdict::Gains, who::Who};
use crate::scene::Scene;
use crate::space::{Explained, Preset};
use crate::statistics::{BreakEven, Ratio, Summary, quantile};
use crate::{disturbance::Disturbance, frame::Renderer, integrator::Omission, measure::Standing};

/// A finished run.
#[derive(Clone, Debug, Serialize)]
pub struct TuningResults {
    /// The rendered scene.
    pub scene: SceneFacts,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Frames rendered in each trial, where a trial does not say otherwise.
    pub frames_per_trial: u32,
    /// The objective.
    pub objective: Objective,
    /// Name of the space that was tuned.
    pub space: Preset,
    /// Its parameters, each with its effect.
    pub parameters: Vec<Explained>,
    /// Where the search began.
    pub start: Configuration,
    /// Its standing.
    #[serde(rename = "start_name")]
    pub began_at: Who,
    /// The service's best configurations on the way.
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
    /// The standing of the service's answer after all of them.
    pub confirmation: Option<treewright_client::Standing>,
    /// The standing to compare with: the paper's default in its own space, else native Embree's.
    pub baseline: Who,
    /// The baseline's cost while the search ran: what the trials' costs are compared with.
    pub reference_ms: f64,
    /// The best configuration of the search.
    pub found: Configuration,
    /// The best configuration: that of the search, or a rival that beat it in the final rounds.
    pub tuned: Configuration,
    /// Its standing.
    pub best: Who,
    /// The configurations that need no search and that of the search, measured again side by side.
    pub standings: Vec<Standing>,
    /// The gains of the best one.
    pub gains: Gains,
    /// The other work of the machine in those rounds.
    pub disturbance: Disturbance,
    /// The predictor's answer for a camera that was never tuned.
    pub prediction: Option<Prediction>,
    /// Frames of trials that cost more than the start; `None` until [`TuningResults::judged`].
    pub safety: Option<Safety>,
    /// Time of questions to the service and of reports.
    pub overhead: Overhead,
    /// When tuning pays off.
    pub break_even: BreakEven,
    /// The frame of break-even; absent if it never comes.
    pub break_even_frame: Option<u64>,
    /// Counts of the fates of suggestions and reports.
    pub client: Stats,
    /// Faults that did not end the run, one sentence each.
    pub notes: Vec<String>,
}

/// The service's best configuration after some trials of the search, measured again after the search.
#[derive(Clone, Debug, Serialize)]
pub struct Milestone {
    /// Number of trials handed out by then.
    pub trials: u32,
    /// The answer that a client would have got.
    pub configuration: Configuration,
    /// Its speed over that of the search's start, in the final rounds. Absent where it was not measured.
    pub over_start: Option<Ratio>,
}

/// The description of a scene for people.
#[derive(Clone, Debug, Serialize)]
pub struct SceneFacts {
    /// Its name.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// Meshes.
    pub meshes: usize,
    /// The features that shading leaves out, and why the scene does not need them.
    pub left_out: Vec<Omission>,
    /// Omissions and additions of the loader.
    pub notes: Vec<String>,
}

impl SceneFacts {
    /// Of a scene that is rendered.
    pub fn of(scene: &Scene, renderer: &Renderer) -> Self {
        Self {
            name: scene.name.clone(),
            triangles: scene.triangles.len(),
            meshes: scene.meshes.len(),
            left_out: renderer.needs().omissions(),
            notes: scene.notes.clone(),
        }
    }
}

/// The predictor's first answer on a fresh camera, measured against the default there.
#[derive(Clone, Debug, Serialize)]
pub struct Prediction {
    /// The point of the camera path.
    pub camera_at: f32,
    /// The mode of the service's answer.
    pub mode: OpenEnum<Mode>,
    /// Its reason in one sentence.
    pub reason: String,
    /// Its answer.
    pub configuration: Configuration,
    /// Time of the answer.
    pub answer_ms: f64,
    /// The baseline and the prediction, measured side by side.
    pub standings: Vec<Standing>,
}

impl Prediction {
    /// Speed of the predicted configuration over the baseline.
    pub fn speedup(&self) -> f64 {
        self.standings.last().map_or(1.0, |standing| standing.speedup.median)
    }
}

/// Time of questions to the service and of reports.
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

    /// A contender's standing.
    pub fn standing(&self, who: &Who) -> Option<&Standing> {
        self.standings.iter().find(|standing| standing.who == *who)
    }

    /// In words, for the end of a clause: that two processes ran the rounds of the standings, if they did.
    pub fn in_processes(&self) -> &'static str {
        if self.standings.iter().any(|one| one.processes.is_some()) { " in two processes" } else { "" }
    }

    /// Speed of the best one over the baseline, median of pairs.
    pub fn speedup(&self) -> f64 {
        self.speedup_over(&self.baseline).unwrap_or(1.0)
    }

    /// Speed of the best one over another, median of pairs. `None` where one was not measured.
    pub fn speedup_over(&self, who: &Who) -> Option<f64> {
        let speedup = self.standing(&self.best)?.speedup_over(self.standing(who)?);
        (speedup.count > 0).then_some(speedup.median)
    }

    /// Frame time of a contender in the final rounds over the baseline's; `None` where one was not measured.
    pub fn relative(&self, who: &Who) -> Option<f64> {
        let speedup = self.standing(who)?.speedup_over(self.standing(&self.baseline)?);
        (speedup.count > 0 && speedup.median > 0.0).then(|| 1.0 / speedup.median)
    }

    /// The cost of the start during the search: that of its trials, else of the baseline's frames.
    pub fn start_ms(&self) -> Option<f64> {
        let of_start = self.trials.iter().filter(|trial| trial.configuration == self.start);
        let costs: Vec<f64> = of_start.filter_map(|trial| trial.cost).collect();
        start_cost(&costs, || Some(self.reference_ms * self.relative(&self.began_at)?))
    }

    /// With its [`safety`](Self::safety). A trial that was stopped counts as one frame at its bound.
    #[must_use]
    pub fn judged(self) -> Self {
        let cost = |trial: &Iteration| match trial.stopped_at() {
            Some(bound) => Some((1, bound)),
            None => Some((trial.frames(self.frames_per_trial).max(1), trial.cost?)),
        };
        let costs = self.trials.iter().filter_map(cost);
        let safety = self.start_ms().and_then(|start_ms| Safety::of(costs, start_ms));
        Self { safety, ..self }
    }

    /// Trials until the service's answer is, and stays, shown to be `factor` times as fast as the start.
    pub fn trials_until(&self, factor: f64) -> Option<u32> {
        let reaches = |milestone: &&Milestone| {
            milestone.over_start.and_then(|ratio| ratio.interval).is_some_and(|[low, _]| low >= factor)
        };
        let last = self.milestones.iter().rev().take_while(reaches).last();
        last.map(|milestone| milestone.trials)
    }

    /// The frames that were shown, and the milliseconds that were spent, until a number of trials were over.
    pub fn spent_until(&self, trials: u32) -> (u32, f64) {
        let ran = self.trials.iter().filter(|trial| trial.number <= trials);
        ran.fold((0, 0.0), |(frames, ms), trial| {
            (frames + trial.frames(self.frames_per_trial), ms + trial.total_ms)
        })
    }

    /// Number of different configurations in the trials.
    pub fn configurations(&self) -> usize {
        let texts: std::collections::BTreeSet<String> =
            self.trials.iter().map(|trial| trial.configuration.to_string()).collect();
        texts.len()
    }

    /// Whether the search found a configuration that is faster than all those that need no search.
    pub fn search_won(&self) -> bool {
        self.best == Who::Tuned
    }
}
