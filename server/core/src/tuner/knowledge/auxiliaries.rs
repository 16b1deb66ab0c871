//! Costs without the shares that movement and auxiliary metrics explain, state by state.
//!
//! Indicators move a little within a state, and costs with them (see [`Movement`]). A study may also name
//! metrics beside those of its objective (see [`Denoiser`]). Both regressions are learnt from the state's own
//! trials, and again after every few of them. The table is then restated, because its costs exclude the
//! explained shares. All of it follows from the completed trials in their order.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{DENOISED_STATES_MAX, EVIDENCE_MAX, OBSERVATIONS_MAX};
use crate::results::{Record, ResultTable};
use crate::robust::{deviation, median, reach_of};
use crate::statistics::auxiliary::{Denoiser, Observation};
use crate::statistics::movement::Movement;
use crate::tuner::knowledge::Stored;

/// Number of trials after which the regression is learnt again.
const LEARNT_EVERY: u64 = 4;
/// Growth of the regression's weight after which the speeds of machines are judged again.
const WEIGHT_GROWN: f64 = 0.25;
/// A movement that changes a cost by this share may have been mistaken for the machine's speed.
const MOVEMENT_SEEMS_SPEED: f64 = 0.02;
/// Costs of zero have no logarithm.
const COST_LEAST: f64 = 1e-300;

/// The data of a trial beside its cost.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Beside {
    /// Its auxiliary measurements, if the study has any.
    pub(crate) auxiliary: Vec<f64>,
    /// The distances of its indicators from the anchor of its state, as shares of their ranges.
    pub(crate) offset: Vec<f64>,
}

impl Beside {
    /// Whether it can explain nothing.
    pub(crate) fn is_nothing(&self) -> bool {
        self.auxiliary.is_empty() && !self.has_moved()
    }

    fn has_moved(&self) -> bool {
        self.offset.iter().any(|offset| *offset != 0.0)
    }
}

/// A measured trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Seen {
    trial: u64,
    configuration: Stored,
    log_cost: f64,
    auxiliary: Vec<f64>,
    #[serde(default)]
    offset: Vec<f64>,
    /// The logarithm of the factor on the client's costs at its time.
    log_factor: f64,
}

/// The measurements of one state, with the data beside their costs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct OfState {
    seen: Vec<Seen>,
    taken: u64,
    denoiser: Option<Denoiser>,
    #[serde(default)]
    movement: Option<Movement>,
    /// The weight of the auxiliary measurements when the factors were last judged.
    weight: f64,
    latest: u64,
}

/// The regressions of all states, by their ids.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Auxiliaries {
    states: BTreeMap<u64, OfState>,
    clock: u64,
}

/// The costs of configurations as they are to stand in the table, each with the number of its trial.
pub(crate) type Restated = Vec<(Configuration, Vec<(u64, f64)>)>;

impl OfState {
    /// The logarithm of a cost at the state's anchor.
    fn at_anchor(&self, log_cost: f64, offset: &[f64]) -> f64 {
        log_cost - self.movement.as_ref().map_or(0.0, |movement| movement.explained(offset))
    }

    /// The logarithm of a cost at the anchor, without the noise that auxiliary measurements explain.
    fn understood(&self, log_cost: f64, auxiliary: &[f64], offset: &[f64]) -> f64 {
        let log = self.at_anchor(log_cost, offset);
        match &self.denoiser {
            Some(denoiser) if !auxiliary.is_empty() => denoiser.denoised(log, auxiliary),
            _ => log,
        }
    }

    fn cost(&self, one: &Seen) -> f64 {
        let log = self.understood(one.log_cost, &one.auxiliary, &one.offset);
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
        let names: Vec<usize> = self.seen.iter().map(|one| name(&one.configuration.0)).collect();
        // Factors of speed that were found before are taken out again: the movement may explain them.
        let moved = self.seen.iter().zip(&names).map(|(one, &configuration)| Observation {
            configuration,
            log_cost: one.log_cost - one.log_factor,
            beside: one.offset.clone(),
        });
        let moved: Vec<Observation> = moved.filter(|one| !one.beside.is_empty()).collect();
        self.movement = Movement::of(&moved).or(self.movement.take());
        if self.seen.iter().all(|one| one.auxiliary.is_empty()) {
            return;
        }
        let at_anchor = |one: &Seen| self.at_anchor(one.log_cost, &one.offset);
        let mut logs: Vec<f64> = self.seen.iter().map(at_anchor).collect();
        let middle = median(&mut logs);
        let reach = reach_of(deviation(&logs, middle));
        // One absurd report would dominate the regression.
        let is_far = |one: &Seen| (at_anchor(one) - middle).abs() > reach;
        let far = self.seen.iter().filter(|one| is_far(one)).count();
        let counted = self.seen.iter().zip(&names).filter(|(one, _)| far != 1 || !is_far(one));
        let observations: Vec<Observation> = counted
            .map(|(one, &configuration)| Observation {
                configuration,
                log_cost: at_anchor(one),
                beside: one.auxiliary.clone(),
            })
            .collect();
        let learnt = Denoiser::of(&observations);
        self.denoiser = learnt.or(self.denoiser.take());
    }
}

impl Auxiliaries {
    /// Whether the regression on the auxiliary measurements of a state was learnt, even if it explains
    /// nothing.
    pub(crate) fn explains(&self, state: StateId) -> bool {
        self.states.get(&state.0).is_some_and(|own| own.denoiser.is_some())
    }

    /// A cost without the shares that the regressions explain.
    pub(crate) fn understood(&self, state: StateId, cost: f64, beside: &Beside) -> f64 {
        self.states.get(&state.0).map_or(cost, |own| {
            let log = libm::log(cost.max(COST_LEAST));
            let understood = own.understood(log, &logs(&beside.auxiliary), &beside.offset);
            // A cost that nothing explains keeps its last digit.
            if understood == log { cost } else { libm::exp(understood).min(f64::MAX) }
        })
    }

    /// Takes a trial. Where the regressions were learnt again, returns the costs of all configurations by
    /// them. The flag says whether to judge the speeds of machines again, because the regressions explain
    /// changes that seemed to be speed. `table` holds the earlier measurements.
    pub(crate) fn take(
        &mut self,
        state: StateId,
        (trial, configuration): (u64, &Configuration),
        cost: f64,
        beside: &Beside,
        (factor, table): (f64, &ResultTable),
    ) -> Option<(Restated, bool)> {
        self.clock += 1;
        let is_new = !self.states.contains_key(&state.0);
        if is_new && beside.is_nothing() {
            return None;
        }
        if is_new && self.states.len() >= DENOISED_STATES_MAX {
            let oldest = self.states.iter().min_by_key(|(_, own)| own.latest).map(|(&state, _)| state);
            oldest.map(|state| self.states.remove(&state));
        }
        assert!(!is_new || self.states.len() < DENOISED_STATES_MAX, "{} states", self.states.len());
        let own = self.states.entry(state.0).or_default();
        if is_new && beside.auxiliary.is_empty() {
            own.seen = at_rest(table, beside.offset.len());
        }
        own.latest = self.clock;
        if own.seen.len() >= OBSERVATIONS_MAX {
            own.seen.remove(0);
        }
        own.seen.push(Seen {
            trial,
            configuration: Stored(configuration.clone()),
            log_cost: libm::log(cost.max(COST_LEAST)),
            auxiliary: logs(&beside.auxiliary),
            offset: beside.offset.clone(),
            log_factor: libm::log(factor),
        });
        assert!(own.seen.len() <= OBSERVATIONS_MAX, "{} observations", own.seen.len());
        own.taken += 1;
        if !own.taken.is_multiple_of(LEARNT_EVERY) {
            return None;
        }
        let (knew, knew_movement) = (own.denoiser.is_some(), own.movement.is_some());
        own.learn();
        let weight = own.denoiser.as_ref().map_or(0.0, |denoiser| denoiser.weight);
        let mut explains_more = own.denoiser.is_some() && (!knew || weight > own.weight + WEIGHT_GROWN);
        if !knew_movement && let Some(movement) = &own.movement {
            let explained = own.seen.iter().map(|one| movement.explained(&one.offset).abs());
            explains_more |= explained.fold(0.0, f64::max) > MOVEMENT_SEEMS_SPEED;
        }
        if explains_more {
            own.weight = weight;
            own.seen.iter_mut().for_each(|one| one.log_factor = 0.0);
        }
        (own.denoiser.is_some() || own.movement.is_some()).then(|| (own.all(), explains_more))
    }

    /// Takes trials back, and returns the costs of their configurations without them.
    pub(crate) fn take_back(&mut self, state: StateId, trials: &[u64]) -> Restated {
        let Some(own) = self.states.get_mut(&state.0) else { return Vec::new() };
        let is_gone = |one: &&Seen| trials.contains(&one.trial);
        let gone: Vec<Configuration> =
            own.seen.iter().filter(is_gone).map(|one| one.configuration.0.clone()).collect();
        let before = own.seen.len();
        own.seen.retain(|one| !trials.contains(&one.trial));
        assert_eq!(own.seen.len() + gone.len(), before, "the gap is what is gone");
        gone.into_iter().map(|configuration| (configuration.clone(), own.of(&configuration))).collect()
    }

    /// Forgets all of a state, because its costs have changed.
    pub(crate) fn begin_again(&mut self, state: StateId) {
        self.states.remove(&state.0);
        assert!(!self.explains(state), "nothing is known of {state:?}");
    }

    /// Whether it fits the space and these numbers of metrics and indicators.
    pub(crate) fn fits(&self, space: &crate::space::Space, metrics: usize, indicators: usize) -> bool {
        let mut seen = self.states.values().flat_map(|own| &own.seen);
        seen.all(|one| {
            space.owns(&one.configuration.0)
                && one.auxiliary.len() == metrics
                && [0, indicators].contains(&one.offset.len())
        })
    }
}

/// The measurements of a state before its indicators moved, oldest first: all of them at the anchor.
fn at_rest(table: &ResultTable, indicators: usize) -> Vec<Seen> {
    let of = |record: &Record| {
        let measured = record.evidence.values().iter().zip(record.evidence.moments());
        let seen = measured.map(|(cost, moment)| Seen {
            trial: moment.map_or(0, |moment| moment.time),
            configuration: Stored(record.configuration.clone()),
            log_cost: libm::log(cost.max(COST_LEAST)),
            auxiliary: Vec::new(),
            offset: vec![0.0; indicators],
            log_factor: 0.0,
        });
        seen.collect::<Vec<_>>()
    };
    let mut seen: Vec<Seen> = table.ranked().flat_map(of).collect();
    seen.sort_by_key(|one| one.trial);
    let surplus = seen.len().saturating_sub(OBSERVATIONS_MAX - 1);
    let kept = seen.split_off(surplus);
    assert!(kept.len() < OBSERVATIONS_MAX, "there is room for one more than {}", kept.len());
    kept
}

fn logs(auxiliary: &[f64]) -> Vec<f64> {
    auxiliary.iter().map(|value| libm::log(value.max(COST_LEAST))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::Policy;
    use crate::tuner::tests::spec;

    #[test]
    fn only_metrics_and_moves_can_explain_a_cost() {
        let of = |auxiliary: &[f64], offset: &[f64]| Beside {
            auxiliary: auxiliary.to_vec(),
            offset: offset.to_vec(),
        };
        assert!(of(&[], &[]).is_nothing() && of(&[], &[0.0, 0.0]).is_nothing());
        assert!(!of(&[1.0], &[0.0]).is_nothing() && !of(&[], &[0.0, -0.1]).is_nothing());
    }

    #[test]
    fn costs_from_before_a_change_never_come_back() {
        let configuration = spec(Policy::default()).space.default_configuration();
        let mut auxiliaries = Auxiliaries::default();
        let (state, table) = (StateId(1), ResultTable::default());
        let beside = Beside { auxiliary: vec![2.0], offset: Vec::new() };
        let take = |auxiliaries: &mut Auxiliaries, trial: u64, cost: f64| {
            auxiliaries.take(state, (trial, &configuration), cost, &beside, (1.0, &table)).is_some()
        };
        (1..=3).for_each(|trial| assert!(!take(&mut auxiliaries, trial, 10.0)));
        auxiliaries.begin_again(state);
        assert!(!take(&mut auxiliaries, 4, 30.0), "there is nothing to restate");
        let restated = auxiliaries.take_back(state, &[4]);
        assert_eq!(restated, [(configuration.clone(), Vec::new())], "no cost is left");
    }
}
