//! The evidence for a search that begins: the nearest other states in which a search was begun.

use std::sync::Arc;

use crate::ids::StateId;
use crate::limits::{NEIGHBOURS_MAX, PORTFOLIO_STATES_MAX};
use crate::predict::Query;
use crate::predict::state_index::{Among, IndexEntry};
use crate::search::hears_others;
use crate::trial::Neighbour;
use crate::tuner::exploring::transfer::Transfer;
use crate::tuner::knowledge::warm_start::STATES;
use crate::tuner::knowledge::{MeasuredElsewhere, OtherState, at};

/// Number of measurements in a state from which on a result is not the luck of one.
const REPEATED: u64 = 2;

/// The states nearest to the asked one, itself left out; all in which anything was measured, or the
/// explored ones.
fn nearest(query: &Query<'_>, count: usize, explored: bool) -> Vec<IndexEntry> {
    let here = query.here.map(|here| here.id);
    let among = if explored { Among::Explored } else { Among::Ran };
    query.nearest(count, among, |other| Some(other.id) != here)
}

impl Transfer<'_> {
    /// Whether a search that begins profits from others.
    pub(crate) fn warms_up_searches(&self) -> bool {
        hears_others(self.spec.policy.search)
    }

    /// The evidence of other states for a search that begins in a state.
    pub(crate) fn evidence(&self, state: StateId) -> MeasuredElsewhere {
        let anchor = &self.states[state].anchor;
        self.evidence_for(&self.states.query(&self.spec.space, anchor, Some(state)))
    }

    /// The evidence for a state that does not exist yet.
    pub(crate) fn evidence_for(&self, query: &Query<'_>) -> MeasuredElsewhere {
        self.measured_elsewhere(query, true)
    }

    /// The other states that can answer for one without a measured configuration that can be run: the
    /// searched ones, or all where none was searched.
    pub(super) fn answers_elsewhere(&self, query: &Query<'_>) -> MeasuredElsewhere {
        let searched = self.measured_elsewhere(query, true);
        if searched.is_empty() { self.measured_elsewhere(query, false) } else { searched }
    }

    fn measured_elsewhere(&self, query: &Query<'_>, explored: bool) -> MeasuredElsewhere {
        let other = |found: &IndexEntry| {
            let state = at(found.name as usize);
            let (results, own) = (Arc::clone(&self.states[state].results), self.searches.of(state));
            let race = own.and_then(|own| own.confirming.as_ref());
            let is_settled = race.is_some_and(|race| race.is_settled(results.tried()));
            let incumbent = own.and_then(|own| own.confirmed.as_ref()).map(|confirmed| confirmed.0.clone());
            // Where nothing is ever confirmed, one measurement is all that there will be.
            let least = if self.spec.policy.confirm_rounds > 0 { REPEATED } else { 1 };
            OtherState { results, incumbent, measured_least: (!is_settled).then_some(least) }
        };
        let states: Vec<OtherState> =
            nearest(query, PORTFOLIO_STATES_MAX, explored).iter().map(other).collect();
        assert!(states.len() <= PORTFOLIO_STATES_MAX, "{} states", states.len());
        MeasuredElsewhere { states, here: query.here.map(|here| Arc::clone(&here.results)) }
    }

    /// The states whose evidence a search received, for people.
    pub(crate) fn neighbours(&self, state: StateId) -> Vec<Neighbour> {
        let here = &self.states[state];
        self.neighbours_of(&self.states.query(&self.spec.space, &here.anchor, Some(state)))
    }

    /// The explored states nearest to an asked one, for people.
    pub(super) fn neighbours_of(&self, query: &Query<'_>) -> Vec<Neighbour> {
        let neighbour = |found: &IndexEntry| {
            let other = &self.states[at(found.name as usize)];
            let best_cost = query.translate(other, other.results.best()?.mean_cost);
            Some(Neighbour { state_id: other.id.get(), distance: found.distance_2.sqrt(), best_cost })
        };
        nearest(query, STATES.min(NEIGHBOURS_MAX), true).iter().filter_map(neighbour).collect()
    }
}
