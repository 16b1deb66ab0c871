//! Statistics of a study's states in general: the length of stays, and the gains and costs of searching. All
//! of it follows from the completed trials in their order, so a restored tuner has it again.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::configuration::RawConfiguration;
use crate::ids::StateId;
use crate::limits::{CLIENTS_MAX, GAIN_STATES_MAX};
use crate::statistics::exploration_value::{Gains, OCTAVES};
use crate::tuner::knowledge::states::place;

/// Prior of an exploring trial's cost above the best known configuration, as a share.
const EXCESS_PRIOR: f64 = 0.5;
/// Weight of that expectation, in trials.
const EXCESS_PRIOR_TRIALS: f64 = 4.0;
/// Most excess that one trial counts with: one absurd measurement is no rule.
const EXCESS_MAX: f64 = 10.0;
/// Excess cost of a trial that cannot be run: a build that fails and a frame in its place.
const EXCESS_INFEASIBLE: f64 = 1.0;

/// The visits to one state and the progress of its search.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct StateHistory {
    visits: u64,
    frames: u64,
    /// The estimated share by which each completed octave of its search lowered the best cost: the trials
    /// until 2 configurations were tried, until 4, until 8, ...
    gained: Vec<f64>,
    /// The best configuration at the end of the last octave.
    best: Option<RawConfiguration>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct History {
    /// Shared with checkpoints that are being saved.
    states: Vec<Arc<StateHistory>>,
    /// The state of each client's last report, and the number of its reports there in a row. When half of the
    /// number that a study remembers is reached, they become the earlier ones. The former earlier ones are
    /// forgotten unless they have reported again since.
    clients: BTreeMap<String, (usize, u64)>,
    earlier_clients: BTreeMap<String, (usize, u64)>,
    visits: u64,
    frames: u64,
    excess: f64,
    explored: u64,
}

impl History {
    /// A new state.
    pub(crate) fn found(&mut self) {
        self.states.push(Arc::default());
    }

    /// The number of states.
    pub(crate) fn len(&self) -> usize {
        self.states.len()
    }

    /// Counts a frame that a client reported from a state.
    pub(crate) fn frame(&mut self, client_id: &str, state: StateId) {
        let state = place(state);
        if !self.clients.contains_key(client_id) {
            if self.clients.len() >= CLIENTS_MAX / 2 {
                self.earlier_clients = std::mem::take(&mut self.clients);
            }
            let earlier = self.earlier_clients.remove(client_id).unwrap_or((state, 0));
            self.clients.insert(client_id.to_owned(), earlier);
            assert!(self.clients.len() <= CLIENTS_MAX / 2, "{} clients", self.clients.len());
        }
        let stays = match self.clients.get_mut(client_id) {
            Some((current, length)) if *current == state && *length > 0 => {
                *length += 1;
                true
            }
            Some(current) => {
                *current = (state, 1);
                false
            }
            None => false,
        };
        let history = Arc::make_mut(&mut self.states[state]);
        history.frames += 1;
        history.visits += u64::from(!stays);
        assert!(history.visits <= history.frames, "{} visits, {} frames", history.visits, history.frames);
        self.frames += 1;
        self.visits += u64::from(!stays);
        assert!(self.visits <= self.frames, "{} visits, {} frames", self.visits, self.frames);
        assert!(self.frames >= history.frames, "{} frames of {}", history.frames, self.frames);
    }

    /// Whether an octave of a state's search has ended without being noted, after `tried` tried
    /// configurations.
    pub(crate) fn octave_is_over(&self, state: StateId, tried: usize) -> bool {
        let history = &self.states[place(state)];
        match &history.best {
            None => tried >= 1,
            Some(_) => history.gained.len() + 1 < OCTAVES && tried >= 2 << history.gained.len(),
        }
    }

    /// The best configuration at the end of the last octave of a state's search.
    pub(crate) fn best_then(&self, state: StateId) -> Option<&RawConfiguration> {
        self.states[place(state)].best.as_ref()
    }

    /// Notes the end of an octave: the best configuration now, and the share by which it costs less than the
    /// best before.
    pub(crate) fn octave_ends(&mut self, state: StateId, best: RawConfiguration, gain: f64) {
        let history = Arc::make_mut(&mut self.states[place(state)]);
        if history.best.is_some() {
            assert!(!gain.is_nan() && history.gained.len() < OCTAVES, "{gain} after {:?}", history.gained);
            history.gained.push(gain.clamp(0.0, 1.0));
        }
        history.best = Some(best);
    }

    /// The gain of each octave of a state's search.
    pub(crate) fn gained(&self, state: StateId) -> &[f64] {
        &self.states[place(state)].gained
    }

    /// Forgets the progress of a state's search, because its costs have changed. Its visits still count.
    pub(crate) fn begin_again(&mut self, state: StateId) {
        let history = Arc::make_mut(&mut self.states[place(state)]);
        (history.gained, history.best) = (Vec::new(), None);
        assert!(self.octave_is_over(state, 1), "nothing was noted");
    }

    /// Notes the excess cost of an exploring trial, as a share of the best known cost; `None` when it cannot
    /// be run.
    pub(crate) fn explored(&mut self, excess: Option<f64>) {
        self.excess += excess.unwrap_or(EXCESS_INFEASIBLE).clamp(0.0, EXCESS_MAX);
        self.explored += 1;
    }

    pub(crate) fn visits(&self, state: StateId) -> u64 {
        self.states[place(state)].visits
    }

    pub(crate) fn frames(&self, state: StateId) -> u64 {
        self.states[place(state)].frames
    }

    /// For how many frames in a row a client has reported from a state.
    pub(crate) fn stay(&self, client_id: &str, state: StateId) -> u64 {
        let known = self.clients.get(client_id).or_else(|| self.earlier_clients.get(client_id));
        known.filter(|(current, _)| *current == place(state)).map_or(0, |(_, length)| *length)
    }

    /// The number of further frames that a state is expected to see. It has as many visits again as it has
    /// had, of the mean length of its visits, drawn towards that of all states. A stay lasts for as long
    /// again as it has lasted (a process without a scale of its own is half over on average: Gott,
    /// "Implications of the Copernican principle for our future prospects", 1993).
    pub(crate) fn frames_ahead(&self, client_id: &str, state: StateId) -> f64 {
        let mean = if self.visits == 0 { 1.0 } else { self.frames as f64 / self.visits as f64 };
        let history = &self.states[place(state)];
        let length = (history.frames as f64 + mean) / (history.visits as f64 + 1.0);
        let ahead = (length * history.visits.max(1) as f64).max(self.stay(client_id, state) as f64);
        assert!(ahead > 0.0 && mean >= 1.0, "{ahead} frames, {mean} in a visit");
        ahead
    }

    /// The gains of octaves of searches in other states.
    pub(crate) fn gains_elsewhere(&self, state: StateId) -> Gains {
        let mut gains = Gains::default();
        // The states met last stand for all of a large study.
        let others = self.states.iter().enumerate().rev().take(GAIN_STATES_MAX);
        for (_, history) in others.filter(|(other, _)| *other != place(state)) {
            history.gained.iter().enumerate().for_each(|(octave, &gain)| gains.note(octave, gain));
        }
        gains
    }

    /// The cost of an exploring trial above the best known configuration, as a share of that one's cost.
    pub(crate) fn excess(&self) -> f64 {
        let all = self.excess + EXCESS_PRIOR * EXCESS_PRIOR_TRIALS;
        let excess = all / (self.explored as f64 + EXCESS_PRIOR_TRIALS);
        assert!((0.0..=EXCESS_MAX).contains(&excess), "an excess of {excess}");
        excess
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tuner::knowledge::states::at;

    #[test]
    fn stays_are_counted_by_client_and_state() {
        let mut history = History::default();
        history.found();
        history.found();
        for (client, state) in [("a", 0), ("a", 0), ("b", 0), ("a", 1), ("a", 0)] {
            history.frame(client, at(state));
        }
        assert_eq!((history.visits(at(0)), history.frames(at(0))), (3, 4));
        assert_eq!((history.visits(at(1)), history.frames(at(1))), (1, 1));
        assert_eq!((history.stay("a", at(0)), history.stay("a", at(1)), history.stay("c", at(0))), (1, 0, 0));
        // Three more visits of (4 + 5/4) / 4 frames.
        assert!((history.frames_ahead("a", at(0)) - 3.0 * 5.25 / 4.0).abs() < 1e-12);
        (0..99).for_each(|_| history.frame("a", at(0)));
        assert!(history.frames_ahead("a", at(0)) >= 100.0);
    }

    #[test]
    fn of_many_clients_those_that_reported_last_are_remembered() {
        let mut history = History::default();
        history.found();
        for number in 0..5 * CLIENTS_MAX {
            history.frame("steady", at(0));
            history.frame(&format!("passing {number}"), at(0));
        }
        assert_eq!(history.stay("steady", at(0)), 5 * CLIENTS_MAX as u64);
        assert_eq!(history.visits(at(0)), 5 * CLIENTS_MAX as u64 + 1);
        assert_eq!(history.stay("passing 0", at(0)), 0);
        assert!(history.clients.len() + history.earlier_clients.len() <= CLIENTS_MAX);
    }

    #[test]
    fn gains_are_learnt_from_other_states_octave_by_octave() {
        let mut history = History::default();
        (0..5).for_each(|_| history.found());
        let nothing = history.gains_elsewhere(at(0));
        let best = || RawConfiguration::new();
        for state in 1..5 {
            assert!(!history.octave_is_over(at(state), 0) && history.octave_is_over(at(state), 1));
            history.octave_ends(at(state), best(), 0.0);
            for (octave, gain) in [0.0, 0.1, 0.0].into_iter().enumerate() {
                assert!(!history.octave_is_over(at(state), (2 << octave) - 1));
                assert!(history.octave_is_over(at(state), 2 << octave));
                history.octave_ends(at(state), best(), gain);
            }
        }
        let gains = history.gains_elsewhere(at(0));
        assert!(gains.expected(1) > 0.05 && gains.expected(2) < nothing.expected(2));
        assert_eq!(history.gained(at(1)), [0.0, 0.1, 0.0]);
        assert_eq!(history.gains_elsewhere(at(9 - 8)).expected(3), nothing.expected(3));
        // A state that costs something else begins again.
        history.frame("a", at(1));
        history.begin_again(at(1));
        assert!(history.gained(at(1)).is_empty() && history.best_then(at(1)).is_none());
        assert_eq!((history.gained(at(2)).len(), history.frames(at(1))), (3, 1));
    }

    #[test]
    fn absurd_costs_count_for_no_more_than_the_limit() {
        let mut history = History::default();
        assert_eq!(history.excess(), EXCESS_PRIOR);
        history.explored(Some(1e300));
        history.explored(None);
        assert!((history.excess() - 13.0 / 6.0).abs() < 1e-12);
    }
}
