//! Which state are these indicators, on this machine?

use std::cmp::Reverse;

use crate::knowledge::KnownState;
use crate::limits::SIBLINGS_MAX;
use crate::predict::atlas::match_distance_2;
use crate::trial::Fingerprint;
use crate::tuner::{Tuner, Work, place};

impl Tuner {
    /// The place of the machine's state that matches the normalised indicators: every one within the study's
    /// tolerance of the state's anchor. The client's current state is kept while it matches, so that a
    /// client between two anchors does not flicker; else the nearest matching state is taken, the oldest
    /// among equally near ones. `None` when no state matches.
    pub(super) fn recognise(
        &self,
        client_id: &str,
        fingerprint: Option<&Fingerprint>,
        state: &[f64],
    ) -> Option<usize> {
        let machine = self.fleet.find(fingerprint)?;
        let tolerance = self.spec.state_tolerance;
        if let Some(visit) = self.visits.get(client_id) {
            let current = &self.states[place(visit.state_id)];
            if current.machine == machine && match_distance_2(&current.anchor, state, tolerance).is_some() {
                return Some(place(visit.state_id));
            }
        }
        self.atlas.within(machine, state, tolerance)
    }

    /// The state of the machine, if one is named that has been there, else of any.
    pub(super) fn recognise_for(&self, fingerprint: Option<&Fingerprint>, state: &[f64]) -> Option<usize> {
        let own = fingerprint.and_then(|_| self.fleet.find(fingerprint));
        let there = own.and_then(|machine| self.atlas.within(machine, state, self.spec.state_tolerance));
        there.or_else(|| self.recognise_anywhere(state))
    }

    /// The same without a machine: of those that know the state the one with the most frames, the first among
    /// equals.
    fn recognise_anywhere(&self, state: &[f64]) -> Option<usize> {
        let matches = self.atlas.within_each(state, self.spec.state_tolerance);
        matches.min_by_key(|&state| Reverse(self.history.frames(state)))
    }

    /// Founds a state of a machine with these indicators as its anchor.
    pub(super) fn found(&mut self, anchor: Vec<f64>, fingerprint: Option<&Fingerprint>) -> usize {
        let state = self.states.len();
        let (machine, displaced) = self.fleet.found(fingerprint);
        let others = self.atlas.within_each(&anchor, self.spec.state_tolerance);
        let mut siblings: Vec<usize> =
            others.filter(|&other| self.states[other].machine != machine).collect();
        siblings.sort_by_key(|&other| (self.fleet.level(machine, self.states[other].machine), other));
        siblings.truncate(SIBLINGS_MAX);
        for &sibling in &siblings {
            let theirs = &mut self.work[sibling].siblings;
            if theirs.len() < SIBLINGS_MAX {
                theirs.push(state as u32);
            }
        }
        if let Some(displaced) = displaced {
            self.atlas.displace(displaced);
        }
        let known = KnownState {
            id: state as u64 + 1,
            anchor,
            machine,
            explored: false,
            knowledge: Default::default(),
        };
        self.atlas.note(&known);
        self.states.push(known);
        let siblings = siblings.into_iter().map(|sibling| sibling as u32).collect();
        self.work.push(Work { siblings, ..Work::default() });
        self.history.found();
        state
    }
}
