//! Costs without the noise that auxiliary measurements explain, state by state.
//!
//! A study may name metrics beside those of its objective. Their regression is learnt from the state's own
//! trials (see [`Denoiser`]), and again after every few of them. The table is then restated, because its
//! costs are less what the regression explains. All of it follows from the completed trials in their order.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{DENOISED_STATES_MAX, EVIDENCE_MAX, OBSERVATIONS_MAX};
use crate::robust::{deviation, median, reach_of};
use crate::statistics::auxiliary::{Denoiser, Observation};
use crate::tuner::confirmation::Stored;

/// Number of trials after which the regression is learnt again.
const LEARNT_EVERY: u64 = 4;
/// Growth of the regression's weight after which the speeds of machines are judged again.
const WEIGHT_GROWN: f64 = 0.25;
/// Costs of zero have no logarithm.
const COST_LEAST: f64 = 1e-300;

/// A measured trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Seen {
    trial: u64,
    configuration: Stored,
    log_cost: f64,
    auxiliary: Vec<f64>,
    /// The logarithm of the factor on the client's costs at its time.
    log_factor: f64,
}

/// The measurements of one state with their auxiliary metrics.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct OfState {
    seen: Vec<Seen>,
    taken: u64,
    denoiser: Option<Denoiser>,
    /// The weight of the auxiliary measurements when the factors were last judged.
    weight: f64,
    latest: u64,
}

/// The regressions of all states, by their ids.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Auxiliaries {
    states: BTreeMap<u64, OfState>,
    clock: u64,
}

/// The costs of configurations as they are to stand in the table, each with the number of its trial.
pub(super) type Restated = Vec<(Configuration, Vec<(u64, f64)>)>;

impl OfState {
    fn cost(&self, one: &Seen) -> f64 {
        let log = match &self.denoiser {
            Some(denoiser) => denoiser.denoised(one.log_cost, &one.auxiliary),
            None => one.log_cost,
        };
        libm::exp(log - one.log_factor).min(f64::MAX)
    }

    fn of(&self, configuration: &Configuration) -> Vec<(u64, f64)> {
        let own = self.seen.iter().filter(|one| one.configuration.0 == *configuration);
        let costs: Vec<(u64, f64)> = own.map(|one| (one.trial, self.cost(one))).collect();
        costs[costs.len().saturating_sub(EVIDENCE_MAX)..].to_vec()
    }

    fn all(&self) -> Restated {
        let mut named: Vec<&Configuration> = Vec::new();
        for one in &self.seen {
            if !named.contains(&&one.configuration.0) {
                named.push(&one.configuration.0);
            }
        }
        named.into_iter().map(|configuration| (configuration.clone(), self.of(configuration))).collect()
    }

    fn learn(&mut self) {
        let mut names: Vec<&Configuration> = Vec::new();
        let mut name = |configuration| {
            names.iter().position(|known| *known == configuration).unwrap_or_else(|| {
                names.push(configuration);
                names.len() - 1
            })
        };
        let mut logs: Vec<f64> = self.seen.iter().map(|one| one.log_cost).collect();
        let middle = median(&mut logs);
        let reach = reach_of(deviation(&logs, middle));
        // One absurd report would be most of what there is to explain.
        let is_far = |one: &&Seen| (one.log_cost - middle).abs() > reach;
        let far = self.seen.iter().filter(is_far).count();
        let observations: Vec<Observation> = self
            .seen
            .iter()
            .filter(|one| far != 1 || !is_far(one))
            .map(|one| Observation {
                configuration: name(&one.configuration.0),
                log_cost: one.log_cost,
                auxiliary: one.auxiliary.clone(),
            })
            .collect();
        let learnt = Denoiser::of(&observations);
        self.denoiser = learnt.or(self.denoiser.take());
    }
}

impl Auxiliaries {
    /// Whether it is known what the auxiliary measurements of a state explain, be it nothing.
    pub(super) fn explains(&self, state: StateId) -> bool {
        self.states.get(&state.0).is_some_and(|own| own.denoiser.is_some())
    }

    /// A cost without the noise that its auxiliary measurements explain.
    pub(super) fn denoised(&self, state: StateId, cost: f64, auxiliary: &[f64]) -> f64 {
        let denoiser = self.states.get(&state.0).and_then(|own| own.denoiser.as_ref());
        denoiser.map_or(cost, |denoiser| {
            libm::exp(denoiser.denoised(libm::log(cost.max(COST_LEAST)), &logs(auxiliary))).min(f64::MAX)
        })
    }

    /// Takes a trial. Where the regression was learnt again, returns the costs of all configurations by it.
    /// It also says whether to judge the speeds of machines again, because it explains what seemed to be
    /// speed.
    pub(super) fn take(
        &mut self,
        state: StateId,
        (trial, configuration): (u64, &Configuration),
        cost: f64,
        auxiliary: &[f64],
        factor: f64,
    ) -> Option<(Restated, bool)> {
        self.clock += 1;
        if !self.states.contains_key(&state.0) && self.states.len() >= DENOISED_STATES_MAX {
            let oldest = self.states.iter().min_by_key(|(_, own)| own.latest).map(|(&state, _)| state);
            oldest.map(|state| self.states.remove(&state));
        }
        let own = self.states.entry(state.0).or_default();
        own.latest = self.clock;
        if own.seen.len() == OBSERVATIONS_MAX {
            own.seen.remove(0);
        }
        own.seen.push(Seen {
            trial,
            configuration: Stored(configuration.clone()),
            log_cost: libm::log(cost.max(COST_LEAST)),
            auxiliary: logs(auxiliary),
            log_factor: libm::log(factor),
        });
        own.taken += 1;
        if !own.taken.is_multiple_of(LEARNT_EVERY) {
            return None;
        }
        let knew = own.denoiser.is_some();
        own.learn();
        let weight = own.denoiser.as_ref()?.weight();
        let explains_more = !knew || weight > own.weight + WEIGHT_GROWN;
        if explains_more {
            own.weight = weight;
            own.seen.iter_mut().for_each(|one| one.log_factor = 0.0);
        }
        Some((own.all(), explains_more))
    }

    /// Takes trials back, and tells the costs of their configurations without them.
    pub(super) fn take_back(&mut self, state: StateId, trials: &[u64]) -> Restated {
        let Some(own) = self.states.get_mut(&state.0) else {
            return Vec::new();
        };
        let is_gone = |one: &&Seen| trials.contains(&one.trial);
        let gone: Vec<Configuration> =
            own.seen.iter().filter(is_gone).map(|one| one.configuration.0.clone()).collect();
        own.seen.retain(|one| !trials.contains(&one.trial));
        gone.into_iter().map(|configuration| (configuration.clone(), own.of(&configuration))).collect()
    }

    /// Whether it fits the space and this number of metrics.
    pub(super) fn fits(&self, space: &crate::space::Space, metrics: usize) -> bool {
        let mut seen = self.states.values().flat_map(|own| &own.seen);
        seen.all(|one| space.owns(&one.configuration.0) && one.auxiliary.len() == metrics)
    }
}

fn logs(auxiliary: &[f64]) -> Vec<f64> {
    auxiliary.iter().map(|value| libm::log(value.max(COST_LEAST))).collect()
}
