//! The figures of one study: the cost of its frames, their regret, and the errors and the age of its models.

use treewright_core::cost_view::CostView;
use treewright_core::trial::{Mode, Trial, TrialState};
use treewright_core::tuner::{Change, StudyCounts, Tuner};

/// The modes of trials, in the order of [`FrameCounts`]'s sums.
pub(crate) const MODES: [(Mode, &str); 4] = [
    (Mode::Default, "default"),
    (Mode::Explore, "explore"),
    (Mode::Exploit, "exploit"),
    (Mode::Pinned, "pinned"),
];

/// Counts of reports since the study came into memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FrameCounts {
    /// Reported frames with a cost, and those costs, by mode.
    pub(crate) frames: [u64; MODES.len()],
    pub(crate) cost: [f64; MODES.len()],
    /// Their cost above that of the best known configuration of their state at that time.
    pub(crate) regret: [f64; MODES.len()],
    /// The sums of their values of a metric that is maximised and counts alone; else 0.
    pub(crate) reached: [f64; MODES.len()],
    pub(crate) expired: u64,
    /// The time at which the models last learnt, by the daemon's clock.
    pub(crate) learnt_ms: Option<i64>,
}

impl FrameCounts {
    pub(crate) fn add(&mut self, tuner: &Tuner, changes: &[Change]) {
        let view = tuner.spec().objective.view();
        for trial in changes.iter().flat_map(|change| &change.trials) {
            match trial.state {
                TrialState::Completed => self.complete(tuner, trial, &view),
                TrialState::Expired => self.expired += 1,
                TrialState::Open | TrialState::Abandoned => {}
            }
        }
    }

    fn complete(&mut self, tuner: &Tuner, trial: &Trial, view: &CostView) {
        self.learnt_ms = trial.complete_ms.max(self.learnt_ms);
        let Some(cost) = trial.cost else {
            return;
        };
        let mode = MODES.iter().position(|(mode, _)| *mode == trial.mode());
        assert!(mode.is_some(), "{:?} is not among the modes", trial.mode());
        let mode = mode.unwrap_or_default();
        debug_assert!(cost.is_finite() && trial.complete_ms.is_some(), "trial {} is open", trial.number);
        self.frames[mode] += 1;
        self.cost[mode] += cost;
        self.reached[mode] += view.maximum(cost).unwrap_or(0.0);
        if let Some(best) = tuner.knowledge().best_cost(trial.state_id) {
            self.regret[mode] += (cost - best).max(0.0);
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct StudyFigures {
    pub(crate) study: String,
    pub(crate) statistics: StudyCounts,
    /// Counts since it came into memory.
    pub(crate) tally: FrameCounts,
    /// The metric that is maximised and counts alone.
    pub(crate) maximised: Option<String>,
    /// Mean relative error of each predictor, as the absolute logarithm, on trials it had not learnt.
    pub(crate) errors: Vec<(&'static str, f64)>,
    /// Completed trials that the last checkpoint does not cover: they would be learnt again at a start.
    pub(crate) unsaved_trials: u64,
    /// The time since the models last learnt, in milliseconds; none before the first report in memory.
    pub(crate) model_age_ms: Option<i64>,
}
