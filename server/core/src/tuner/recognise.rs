//! Which state are these indicators?

use crate::knowledge::KnownState;
use crate::predict::atlas::match_distance_2;
use crate::tuner::{Tuner, Work, place};

impl Tuner {
    /// The place of the state that matches the normalised indicators: every one within the study's
    /// tolerance of the state's anchor. The client's current state is kept while it matches, so that a
    /// client between two anchors does not flicker; else the nearest matching state is taken, the oldest
    /// among equally near ones. `None` when no state matches.
    pub(super) fn recognise(&self, client_id: Option<&str>, state: &[f64]) -> Option<usize> {
        let tolerance = self.spec.state_tolerance;
        if let Some(visit) = client_id.and_then(|client_id| self.visits.get(client_id)) {
            let current = place(visit.state_id);
            if match_distance_2(&self.states[current].anchor, state, tolerance).is_some() {
                return Some(current);
            }
        }
        self.atlas.within(state, tolerance)
    }

    /// Founds a state with these indicators as its anchor.
    pub(super) fn found(&mut self, anchor: Vec<f64>) -> usize {
        let id = self.states.len() as u64 + 1;
        let state = KnownState { id, anchor, explored: false, knowledge: Default::default() };
        self.atlas.note(&state);
        self.states.push(state);
        self.work.push(Work::default());
        self.history.found();
        self.states.len() - 1
    }
}
