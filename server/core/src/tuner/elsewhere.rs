//! What a search that begins in a new state is told of other states.
//!
//! It is the states nearest to it in which a search was begun, on whatever machine: what they measured makes a
//! [`Guide`], and its favourite and the best of the nearest few are the first points after the default. A portfolio of
//! the best configurations of other instances is how algorithm configurators begin as well (Feurer, Springenberg and
//! Hutter, "Initializing Bayesian hyperparameter optimization via meta-learning", AAAI 2015).
//!
//! Making the guide takes some milliseconds, so what it rests on is copied and thought about apart where the tuner is
//! shared (see `ahead`). A beginning is all that is taken over. The search is stored with its guide, so that a tuner
//! that is restored has the same, whatever the others have learnt since.

use crate::configuration::Configuration;
use crate::limits::{NEIGHBOURS_MAX, REWARD_COST_MIN};
use crate::policy::SearchMethod;
use crate::predict::Query;
use crate::predict::atlas::Found;
use crate::search::{Elsewhere, Guide, Layout};
use crate::space::Space;
use crate::trial::Neighbour;
use crate::tuner::{Tuner, query};

/// How many states are asked, and how many measured configurations of all of them make a guide: the best of each.
const STATES: usize = 8;
const RECORDS: usize = 640;
/// How many of the states name their best as a point to begin with.
const NAMED: usize = 3;

/// What other states have measured, the nearest first and in each the best first.
#[derive(Clone, Debug)]
pub(super) struct Others(Vec<(usize, Configuration, f64)>);

/// What a search begins with: a guide, and points after the default.
pub(super) type Beginning = (Guide, Vec<Vec<f64>>);

impl Others {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Some milliseconds of thought. `None` where nothing follows from it.
    pub(super) fn beginning(&self, space: &Space) -> Option<Beginning> {
        let mut named: Vec<Vec<f64>> = Vec::new();
        let mut measured = Vec::new();
        for (state, configuration, mean_cost) in &self.0 {
            let x = space.encode(configuration);
            // The first of a state is its best.
            let is_best = measured.last().is_none_or(|before: &Elsewhere| before.state != *state);
            if is_best && *state < NAMED {
                named.push(x.clone());
            }
            let log_cost = libm::log(mean_cost.max(REWARD_COST_MIN));
            measured.push(Elsewhere { state: *state, x, log_cost });
        }
        let layout = Layout::of(space);
        let guide = Guide::of(&layout, &measured)?;
        let mut first = vec![guide.descend(&layout, named.first()?)];
        for x in named {
            if !first.contains(&x) {
                first.push(x);
            }
        }
        Some((guide, first))
    }
}

fn nearest(query: &Query<'_>, count: usize) -> Vec<Found> {
    let here = query.here.map(|here| here.id);
    query.nearest(count, true, |other| Some(other.id) != here && other.knowledge.best().is_some())
}

impl Tuner {
    /// The explored states nearest to one, itself left out.
    fn others(&self, state: usize, count: usize) -> Vec<Found> {
        let here = &self.states[state];
        let query = query(&self.spec, &self.states, &self.atlas, &self.fleet, &here.anchor, Some(state));
        nearest(&query, count)
    }

    /// Whether a search that begins profits from others.
    pub(super) fn hears_others(&self) -> bool {
        matches!(self.spec.policy.search, SearchMethod::Model | SearchMethod::Auto)
    }

    /// What a search that begins in a state can be told of others.
    pub(super) fn told_by_others(&self, state: usize) -> Others {
        self.told(&self.others(state, STATES))
    }

    /// The same for a state that is not there yet.
    pub(super) fn told_of(&self, query: &Query<'_>) -> Others {
        self.told(&nearest(query, STATES))
    }

    fn told(&self, others: &[Found]) -> Others {
        let of = |(place, other): (usize, &Found)| {
            let ranked = self.states[other.name as usize].knowledge.ranked();
            let told = ranked.take(RECORDS / others.len());
            told.map(move |record| (place, record.configuration.clone(), record.mean_cost))
        };
        Others(others.iter().enumerate().flat_map(of).collect())
    }

    /// The same states, for reasons.
    pub(super) fn neighbours(&self, state: usize) -> Vec<Neighbour> {
        let here = self.states[state].machine;
        let neighbour = |found: &Found| {
            let other = &self.states[found.name as usize];
            let factor = self.fleet.factor(other.machine, here);
            let best_cost = (factor * other.knowledge.best()?.mean_cost).min(f64::MAX);
            Some(Neighbour { state_id: other.id, distance: found.distance_2.sqrt(), best_cost })
        };
        self.others(state, STATES.min(NEIGHBOURS_MAX)).iter().filter_map(neighbour).collect()
    }
}
