//! What a study's trials tell of states in general: how long clients stay, how much searching gained and what it
//! cost. All of it follows from the completed trials in their order, so a restored tuner has it again.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::ids::StateId;
use crate::limits::{CLIENTS_MAX, GAIN_STATES_MAX};
use crate::tuner::states::place;

/// The gain that is expected where no search has shown one: the paper's average over its scenes.
const GAIN_PRIOR: f64 = 0.11;
/// What an exploring trial is expected to cost above the best known configuration before any did, as a share.
const EXCESS_PRIOR: f64 = 0.5;
/// How many trials that expectation is worth.
const EXCESS_PRIOR_TRIALS: f64 = 4.0;
/// A trial that costs more counts for so much: one absurd measurement is no rule.
const EXCESS_MAX: f64 = 10.0;
/// What a trial costs that cannot be run: a build that fails and a frame in its place.
const EXCESS_INFEASIBLE: f64 = 1.0;
/// So many states must have shown what a search gains before their largest gain is believed to be the largest.
const STATES_FOR_LARGEST: usize = 3;

/// The visits to one state and the progress of its search.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct StateHistory {
    visits: u64,
    frames: u64,
    /// The best cost when the number of tried configurations first reached 1, 2, 4, 8, ...
    best_at: Vec<f64>,
    best: f64,
}

/// The histories of all states of a study.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct History {
    /// Shared with what is being saved.
    states: Vec<Arc<StateHistory>>,
    /// Where each client reported from last, and how often in a row.
    clients: BTreeMap<String, (usize, u64)>,
    visits: u64,
    frames: u64,
    excess: f64,
    explored: u64,
}

impl History {
    /// A new state.
    pub(super) fn found(&mut self) {
        self.states.push(Arc::default());
    }

    /// How many states there are.
    pub(super) fn len(&self) -> usize {
        self.states.len()
    }

    /// Counts a frame that a client reported from a state.
    pub(super) fn frame(&mut self, client_id: &str, state: StateId) {
        let state = place(state);
        let stays = match self.clients.get_mut(client_id) {
            Some((current, length)) if *current == state => {
                *length += 1;
                true
            }
            Some(current) => {
                *current = (state, 1);
                false
            }
            None => {
                if self.clients.len() < CLIENTS_MAX {
                    self.clients.insert(client_id.to_owned(), (state, 1));
                }
                false
            }
        };
        let history = Arc::make_mut(&mut self.states[state]);
        history.frames += 1;
        history.visits += u64::from(!stays);
        self.frames += 1;
        self.visits += u64::from(!stays);
    }

    /// Notes how far the search of a state is.
    pub(super) fn progress(&mut self, state: StateId, tried: usize, best: f64) {
        let history = Arc::make_mut(&mut self.states[place(state)]);
        history.best = best;
        while tried >= 1 << history.best_at.len() {
            history.best_at.push(best);
        }
    }

    /// Notes what an exploring trial cost above the best known, as a share of that; `None` when it cannot be run.
    pub(super) fn explored(&mut self, excess: Option<f64>) {
        self.excess += excess.unwrap_or(EXCESS_INFEASIBLE).clamp(0.0, EXCESS_MAX);
        self.explored += 1;
    }

    /// How often clients came to a state.
    pub(super) fn visits(&self, state: StateId) -> u64 {
        self.states[place(state)].visits
    }

    /// How many frames were reported from a state.
    pub(super) fn frames(&self, state: StateId) -> u64 {
        self.states[place(state)].frames
    }

    /// For how many frames in a row a client has reported from a state.
    pub(super) fn stay(&self, client_id: &str, state: StateId) -> u64 {
        self.clients
            .get(client_id)
            .filter(|(current, _)| *current == place(state))
            .map_or(0, |(_, length)| *length)
    }

    /// How many more frames a state is expected to see: as many visits again as it has had, of the length that
    /// visits to it have, drawn towards those of all states; and a stay lasts on for as long as it has lasted (what
    /// has no scale of its own is half over on average: Gott, "Implications of the Copernican principle for our
    /// future prospects", 1993).
    pub(super) fn frames_ahead(&self, client_id: &str, state: StateId) -> f64 {
        let mean = if self.visits == 0 { 1.0 } else { self.frames as f64 / self.visits as f64 };
        let history = &self.states[place(state)];
        let length = (history.frames as f64 + mean) / (history.visits as f64 + 1.0);
        (length * history.visits.max(1) as f64).max(self.stay(client_id, state) as f64)
    }

    /// What going on with a search after so many configurations gained in the other states: on average, drawn
    /// towards the paper's, and at most; shares of the cost.
    pub(super) fn gains(&self, state: StateId, tried: usize) -> (f64, f64) {
        let (own, power) = (place(state), tried.max(1).ilog2() as usize);
        let (mut sum, mut count, mut largest) = (GAIN_PRIOR, 1, 0.0f64);
        // The states met last stand for all of a large study.
        let latest = self.states.iter().enumerate().rev().take(GAIN_STATES_MAX);
        for (other, history) in latest {
            if other == own || history.best_at.len() < power + 2 {
                continue;
            }
            let then = history.best_at[power];
            let gain = if then > 0.0 { (1.0 - history.best / then).max(0.0) } else { 0.0 };
            sum += gain;
            count += 1;
            largest = largest.max(gain);
        }
        let at_most = if count > STATES_FOR_LARGEST { largest } else { largest.max(GAIN_PRIOR) };
        (sum / count as f64, at_most)
    }

    /// What an exploring trial costs above the best known configuration, as a share of its cost.
    pub(super) fn excess(&self) -> f64 {
        (self.excess + EXCESS_PRIOR * EXCESS_PRIOR_TRIALS) / (self.explored as f64 + EXCESS_PRIOR_TRIALS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tuner::states::at;

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
    fn gains_are_learnt_from_other_states() {
        let mut history = History::default();
        (0..5).for_each(|_| history.found());
        assert_eq!(history.gains(at(0), 0), (GAIN_PRIOR, GAIN_PRIOR));
        for state in 1..5 {
            for (tried, best) in [(1, 10.0), (2, 10.0), (4, 9.0), (8, 9.0)] {
                history.progress(at(state), tried, best);
            }
        }
        let (mean, most) = history.gains(at(0), 1);
        assert!((mean - (0.11 + 4.0 * 0.1) / 5.0).abs() < 1e-12);
        assert!((most - 0.1).abs() < 1e-12);
        // After four configurations nothing more was found anywhere.
        assert_eq!(history.gains(at(0), 4).1, 0.0);
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
