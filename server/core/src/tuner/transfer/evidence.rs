//! Which other states a search that begins is told of: those nearest to its own in which a search was begun.

use std::sync::Arc;

use crate::ids::StateId;
use crate::limits::{NEIGHBOURS_MAX, PORTFOLIO_STATES_MAX};
use crate::predict::Query;
use crate::predict::state_index::IndexEntry;
use crate::search::hears_others;
use crate::trial::Neighbour;
use crate::tuner::states::at;
use crate::tuner::transfer::Transfer;
use crate::tuner::warm_start::{MeasuredElsewhere, STATES};

/// The explored states nearest to the asked one, itself left out.
fn nearest(query: &Query<'_>, count: usize) -> Vec<IndexEntry> {
    let here = query.here.map(|here| here.id);
    query.nearest(count, true, |other| Some(other.id) != here && other.results.best().is_some())
}

impl Transfer<'_> {
    /// Whether a search that begins profits from others.
    pub(in crate::tuner) fn warms_up_searches(&self) -> bool {
        hears_others(self.spec.policy.search)
    }

    /// What a search that begins in a state can be told of others.
    pub(in crate::tuner) fn evidence(&self, state: StateId) -> MeasuredElsewhere {
        let anchor = &self.states[state].anchor;
        self.evidence_for(&self.states.query(&self.spec.space, anchor, Some(state)))
    }

    /// The same for a state that is not there yet.
    pub(in crate::tuner) fn evidence_for(&self, query: &Query<'_>) -> MeasuredElsewhere {
        let others = nearest(query, PORTFOLIO_STATES_MAX);
        let table = |other: &IndexEntry| Arc::clone(&self.states[at(other.name as usize)].results);
        MeasuredElsewhere(others.iter().map(table).collect())
    }

    /// The states that a search was told of, for people.
    pub(in crate::tuner) fn neighbours(&self, state: StateId) -> Vec<Neighbour> {
        let here = &self.states[state];
        self.neighbours_of(&self.states.query(&self.spec.space, &here.anchor, Some(state)))
    }

    /// The explored states nearest to an asked one, for people.
    pub(super) fn neighbours_of(&self, query: &Query<'_>) -> Vec<Neighbour> {
        let neighbour = |found: &IndexEntry| {
            let other = &self.states[at(found.name as usize)];
            let factor = self.states.machines().factor(other.machine, query.machine);
            let best_cost = (factor * other.results.best()?.mean_cost).min(f64::MAX);
            Some(Neighbour { state_id: other.id.get(), distance: found.distance_2.sqrt(), best_cost })
        };
        nearest(query, STATES.min(NEIGHBOURS_MAX)).iter().filter_map(neighbour).collect()
    }
}
