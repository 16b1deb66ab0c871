//! Warm start: what a search that begins in a new state is told of other states.
//!
//! It is the states nearest to it in which a search was begun, on whatever machine: what the nearest few measured makes a
//! [`MainEffects`], and the [portfolio] of all of them, with the guide's favourite, are the first points. A portfolio of the
//! best configurations of other instances is how algorithm configurators begin as well (Feurer, Springenberg and Hutter,
//! "Initializing Bayesian hyperparameter optimization via meta-learning", AAAI 2015).
//!
//! Making the guide takes some milliseconds, so what it rests on is copied and computed apart where the tuner is
//! shared (see `plan`). A beginning is all that is taken over. The search is stored with its guide, so that a tuner
//! that is restored has the same, whatever the others have learnt since.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{NEIGHBOURS_MAX, PORTFOLIO_STATES_MAX, REWARD_COST_MIN};
use crate::predict::Query;
use crate::predict::state_index::IndexEntry;
use crate::results::ResultTable;
use crate::search::{Layout, MainEffects, SourceMeasurement, hears_others, on_grid};
use crate::space::Space;
use crate::trial::Neighbour;
use crate::tuner::states::at;
use crate::tuner::transfer::{Transfer, portfolio};

/// How many of the nearest states make a guide, and how many of their measured configurations: the best of each.
const STATES: usize = 8;
const RECORDS: usize = 640;

/// What other states have measured: tables, the nearest state first.
#[derive(Clone, Debug)]
pub(in crate::tuner) struct MeasuredElsewhere(Vec<Arc<ResultTable>>);

/// What a search begins with.
#[derive(Clone, Debug)]
pub(in crate::tuner) struct WarmStart {
    /// A guide.
    pub(in crate::tuner) main_effects: MainEffects,
    /// Points in the order in which they are run.
    pub(in crate::tuner) first: Vec<Vec<f64>>,
    /// The best fixed configuration of the other states, which is the incumbent here where it is not the default.
    pub(in crate::tuner) incumbent: Option<Configuration>,
}

impl MeasuredElsewhere {
    pub(in crate::tuner) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many states it rests on.
    pub(super) fn states(&self) -> usize {
        self.0.len()
    }

    /// The first of the portfolio: some milliseconds.
    pub(in crate::tuner) fn best(&self, space: &Space) -> Option<Configuration> {
        portfolio::members(space, &self.0).into_iter().next()
    }

    /// Computes it: some milliseconds. `None` where nothing follows.
    pub(in crate::tuner) fn beginning(&self, space: &Space) -> Option<WarmStart> {
        let mut measured = Vec::new();
        let nearest = &self.0[..self.0.len().min(STATES)];
        for (state, results) in nearest.iter().enumerate() {
            for record in results.ranked().take(RECORDS / nearest.len()) {
                let log_cost = libm::log(record.mean_cost.max(REWARD_COST_MIN));
                measured.push(SourceMeasurement { state, x: space.encode(&record.configuration), log_cost });
            }
        }
        let layout = Layout::of(space);
        let main_effects = MainEffects::fit(&layout, &measured)?;
        let members = portfolio::members(space, &self.0);
        let mut first: Vec<Vec<f64>> = members.iter().map(|member| space.encode(member)).collect();
        let downhill = main_effects.descend(&layout, first.first()?);
        if !first.contains(&downhill) {
            first.insert(1, downhill);
        }
        // What other states expect to be best is what is to be beaten here. That needs no proof: neither it nor the default
        // is known here, and where it does badly the first few measurements say so. As it will be run: a point says a
        // number less exactly than whoever measured it.
        let incumbent = Some(space.decode(&on_grid(&first[0]))).filter(|first| first != space.default_ref());
        Some(WarmStart { main_effects, first, incumbent })
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
