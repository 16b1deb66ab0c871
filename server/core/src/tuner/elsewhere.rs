//! What a search that begins in a new state is told of other states.
//!
//! It is the states nearest to it in which a search was begun, on whatever machine: what they measured makes a
//! [`Guide`], and its favourite and the best of the nearest few are the first points after the default. A portfolio of
//! the best configurations of other instances is how algorithm configurators begin as well (Feurer, Springenberg and
//! Hutter, "Initializing Bayesian hyperparameter optimization via meta-learning", AAAI 2015).
//!
//! A beginning is all that is taken over. The search is stored with its guide, so that a tuner that is restored has
//! the same, whatever the others have learnt since.

use crate::limits::{NEIGHBOURS_MAX, REWARD_COST_MIN};
use crate::predict::atlas::Found;
use crate::search::{Elsewhere, Guide, Layout};
use crate::trial::Neighbour;
use crate::tuner::{Tuner, query};

/// How many states are asked, and how many measured configurations of all of them make a guide: the best of each.
const STATES: usize = 8;
const RECORDS: usize = 640;
/// How many of the states name their best as a point to begin with.
const NAMED: usize = 3;

impl Tuner {
    /// The explored states nearest to one, itself left out.
    fn others(&self, state: usize, count: usize) -> Vec<Found> {
        let here = &self.states[state];
        let query = query(&self.spec, &self.states, &self.atlas, &self.fleet, &here.anchor, Some(state));
        query.nearest(count, true, |other| other.id != here.id && other.knowledge.best().is_some())
    }

    /// A guide for a state, and points to begin with. `None` where nothing is known of others.
    pub(super) fn elsewhere(&self, state: usize) -> Option<(Guide, Vec<Vec<f64>>)> {
        let space = &self.spec.space;
        let others = self.others(state, STATES);
        let mut measured = Vec::new();
        let mut named: Vec<Vec<f64>> = Vec::new();
        for (place, other) in others.iter().enumerate() {
            let knowledge = &self.states[other.name as usize].knowledge;
            for (rank, record) in knowledge.ranked().take(RECORDS / others.len()).enumerate() {
                let x = space.encode(&record.configuration);
                if rank == 0 && place < NAMED {
                    named.push(x.clone());
                }
                let log_cost = libm::log(record.mean_cost.max(REWARD_COST_MIN));
                measured.push(Elsewhere { state: place, x, log_cost });
            }
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
