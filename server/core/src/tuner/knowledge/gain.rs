//! The rules beside the epsilon-greedy draw: whether the expected gain pays for exploring, and whether an
//! exploited configuration gives way to one that was measured to be better.

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::policy::Policy;
use crate::statistics::exploration_value::{Outlook, SearchProgress, outlook};
use crate::tuner::Prospect;
use crate::tuner::knowledge::history::History;
use crate::tuner::knowledge::states::States;

/// Standard deviations by which a configuration must be dearer to be called clearly worse.
const CLEARLY: f64 = 3.0;
/// More measurements than this say nothing more about a configuration.
pub(crate) const MEASUREMENTS_COUNTED: u64 = 16;

/// The evidence of the rules.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GainEvidence<'a> {
    pub(crate) policy: &'a Policy,
    pub(crate) states: &'a States,
    pub(crate) history: &'a History,
}

impl GainEvidence<'_> {
    /// The probability of exploring a state, after the visits that it has had.
    pub(crate) fn epsilon(&self, state: StateId) -> f64 {
        if self.policy.epsilon_halves_after == 0 {
            return self.policy.epsilon;
        }
        let half = f64::from(self.policy.epsilon_halves_after);
        let epsilon = self.policy.epsilon * half / (half + self.history.visits(state) as f64);
        assert!((0.0..=1.0).contains(&epsilon), "a probability of {epsilon}");
        epsilon
    }

    /// The expected gain from going on with the search of a state for `room` trials in all, over this
    /// client's frames and all others: the next few trials first, see
    /// [`exploration_value`](crate::statistics::exploration_value).
    pub(crate) fn prospect(&self, client_id: &str, state: StateId, room: usize) -> Prospect {
        let results = self.states.results(state);
        // Configurations of clients' own choice were tried too, and do not count. Configurations that were
        // taken back after a jump of the machine's speed are no longer tried, but stay searched.
        let beside = results.tried().saturating_sub(results.searched());
        let frames = self.history.frames_ahead(client_id, state);
        // Trials that were spent on repeats are not left for anything new.
        let runs = results.runs() / self.policy.replicates.max(1) as usize;
        let repeated = runs.saturating_sub(results.searched());
        let progress = SearchProgress {
            gained: self.history.gained(state),
            tried: results.tried(),
            budget: room.saturating_add(beside).saturating_sub(repeated),
            frames,
            excess: self.history.excess(),
        };
        let Outlook { trials, gain, exploring_cost, .. } =
            outlook(&self.history.gains_elsewhere(state), &progress);
        assert!((0.0..=1.0).contains(&gain), "a gain of {gain}");
        assert!(exploring_cost >= 0.0, "exploring costs {exploring_cost}");
        Prospect { gain, frames, exploring_cost, trials }
    }

    /// Whether a configuration does clearly worse in a state than the best measured one. What was measured
    /// once, far below all others, is no best.
    pub(crate) fn does_clearly_worse(&self, state: StateId, configuration: &Configuration) -> bool {
        let results = self.states.results(state);
        let best = results.believed_best();
        let (Some(own), Some(best)) = (results.record(configuration), best) else { return false };
        // One frame is no evidence.
        if own.measurements < 2 || best.configuration == *configuration {
            return false;
        }
        let noise = results.frame_noise();
        let part = |measurements: u64| 1.0 / measurements.clamp(1, MEASUREMENTS_COUNTED) as f64;
        let chance = CLEARLY * (part(own.measurements) + part(best.measurements)).sqrt();
        // The best of many equal configurations is lucky by about this number of standard deviations.
        let luck = (2.0 * libm::log(results.tried().max(1) as f64) * part(best.measurements)).sqrt();
        let margin = noise * (chance + luck);
        assert!(margin > 0.0, "a margin of {margin}");
        own.mean_cost > best.mean_cost * (1.0 + margin)
    }
}
