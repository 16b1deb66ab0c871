//! Warm start: what a search that begins in a new state is told of other states.
//!
//! It is the states nearest to it in which a search was begun, on whatever machine: what they measured makes a
//! [`MainEffects`], and its favourite and the best of the nearest few are the first points after the default. A portfolio of
//! the best configurations of other instances is how algorithm configurators begin as well (Feurer, Springenberg and
//! Hutter, "Initializing Bayesian hyperparameter optimization via meta-learning", AAAI 2015).
//!
//! Making the guide takes some milliseconds, so what it rests on is copied and computed apart where the tuner is
//! shared (see `plan`). A beginning is all that is taken over. The search is stored with its guide, so that a tuner
//! that is restored has the same, whatever the others have learnt since.

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{NEIGHBOURS_MAX, REWARD_COST_MIN};
use crate::predict::Query;
use crate::predict::state_index::IndexEntry;
use crate::search::{Layout, MainEffects, SourceMeasurement, hears_others};
use crate::space::Space;
use crate::trial::Neighbour;
use crate::tuner::states::at;
use crate::tuner::transfer::Transfer;

/// How many states are asked, and how many measured configurations of all of them make a guide: the best of each.
const STATES: usize = 8;
const RECORDS: usize = 640;
/// How many of the states name their best as a point to begin with.
const NAMED: usize = 3;

/// What other states have measured: the place of the state among those asked, a configuration and its mean cost; the
/// nearest state first and in each the best configuration first.
#[derive(Clone, Debug)]
pub(in crate::tuner) struct MeasuredElsewhere(Vec<(usize, Configuration, f64)>);

/// What a search begins with: a guide, and points after the default.
pub(in crate::tuner) type WarmStart = (MainEffects, Vec<Vec<f64>>);

impl MeasuredElsewhere {
    pub(in crate::tuner) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Computes it: some milliseconds. `None` where nothing follows.
    pub(in crate::tuner) fn beginning(&self, space: &Space) -> Option<WarmStart> {
        let mut named: Vec<Vec<f64>> = Vec::new();
        let mut measured = Vec::new();
        for (state, configuration, mean_cost) in &self.0 {
            let x = space.encode(configuration);
            // The first of a state is its best.
            let is_best = measured.last().is_none_or(|before: &SourceMeasurement| before.state != *state);
            if is_best && *state < NAMED {
                named.push(x.clone());
            }
            let log_cost = libm::log(mean_cost.max(REWARD_COST_MIN));
            measured.push(SourceMeasurement { state: *state, x, log_cost });
        }
        let layout = Layout::of(space);
        let main_effects = MainEffects::fit(&layout, &measured)?;
        let mut first = vec![main_effects.descend(&layout, named.first()?)];
        for x in named {
            if !first.contains(&x) {
                first.push(x);
            }
        }
        Some((main_effects, first))
    }
}

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
        let others = nearest(query, STATES);
        let of = |(place, other): (usize, &IndexEntry)| {
            let ranked = self.states.results(at(other.name as usize)).ranked();
            let told = ranked.take(RECORDS / others.len());
            told.map(move |record| (place, record.configuration.clone(), record.mean_cost))
        };
        MeasuredElsewhere(others.iter().enumerate().flat_map(of).collect())
    }

    /// The states that a search was told of, for people.
    pub(in crate::tuner) fn neighbours(&self, state: StateId) -> Vec<Neighbour> {
        let here = &self.states[state];
        let query = self.states.query(&self.spec.space, &here.anchor, Some(state));
        let neighbour = |found: &IndexEntry| {
            let other = &self.states[at(found.name as usize)];
            let factor = self.states.machines().factor(other.machine, here.machine);
            let best_cost = (factor * other.results.best()?.mean_cost).min(f64::MAX);
            Some(Neighbour { state_id: other.id.get(), distance: found.distance_2.sqrt(), best_cost })
        };
        nearest(&query, STATES.min(NEIGHBOURS_MAX)).iter().filter_map(neighbour).collect()
    }
}
