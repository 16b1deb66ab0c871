//! Which state are these indicators?

use crate::knowledge::KnownState;
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
        let mut nearest: Option<(usize, f64)> = None;
        for (index, known) in self.states.iter().enumerate() {
            if let Some(distance_2) = match_distance_2(&known.anchor, state, tolerance)
                && nearest.is_none_or(|(_, least)| distance_2 < least)
            {
                nearest = Some((index, distance_2));
            }
        }
        nearest.map(|(index, _)| index)
    }

    /// Founds a state with these indicators as its anchor.
    pub(super) fn found(&mut self, anchor: Vec<f64>) -> usize {
        let id = self.states.len() as u64 + 1;
        self.states.push(KnownState { id, anchor, explored: false, knowledge: Default::default() });
        self.work.push(Work::default());
        self.states.len() - 1
    }
}

/// The square of the Euclidean distance if every indicator is within the tolerance; most states are left
/// at the first indicator that is not.
fn match_distance_2(anchor: &[f64], state: &[f64], tolerance: f64) -> Option<f64> {
    let mut sum = 0.0;
    for (a, b) in anchor.iter().zip(state) {
        let difference = (a - b).abs();
        if difference > tolerance {
            return None;
        }
        sum += difference * difference;
    }
    Some(sum)
}
