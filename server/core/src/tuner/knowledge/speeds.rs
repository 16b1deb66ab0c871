//! The present speed of each client's machine.
//!
//! Clocks rise and fall, and other programs come and go. While a state is searched its incumbent is measured
//! again now and then. From the incumbent, and from every other configuration with enough measurements, the
//! [speed](Speed) of the client is estimated, and every cost is divided by its factor before it is learnt.
//! After a jump of the speed it is unknown which of the trials since the last estimate came before the jump:
//! they are taken back, and may be measured again.
//!
//! All of it follows from the completed trials in their order, so a restored tuner has it again.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{SPEEDS_MAX, UNHELD_MAX};
use crate::policy::Policy;
use crate::results::ResultTable;
use crate::robust::NOISE_PRIOR;
use crate::statistics::drift::{ShiftSums, Speed};
use crate::tuner::knowledge::Stored;

/// Number of measurements that make the cost of a configuration known. One suffices for the default, with
/// which every search begins.
const KNOWN_AFTER: usize = 4;
/// Number of trials after which the incumbent is due; twice as many once its cost agreed with the expected
/// one.
const INTERVAL: u64 = 8;
/// The interval where the speed wanders: trials next to the incumbent compare well with it at any speed.
const INTERVAL_WANDERING: u64 = 4;
/// The interval before the regression on auxiliary measurements is learnt, which needs repeats.
const INTERVAL_HURRIED: u64 = 3;
/// Further runs of the incumbent after a jump, because its new cost was only measured twice.
const SETTLING: u64 = 3;
/// Factors nearer to 1 than this number of a measurement's standard deviations may be noise, and are not
/// applied.
const FACTOR_LEAST: f64 = 2.0;

/// A trial that was learnt since the speed was last held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Unheld {
    pub(crate) trial: u64,
    pub(crate) configuration: Stored,
    pub(crate) cost: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Client {
    speed: Speed,
    /// Shifts of known costs that are no jumps.
    shifts: ShiftSums,
    /// The client's costs are divided by this, so that they are those of a machine at its usual speed.
    factor: f64,
    /// The noise of a measurement when nothing was suspected.
    noise: f64,
    /// The noise of the configuration by which the speed was last held.
    #[serde(default)]
    own_noise: f64,
    /// The state that it reported from last.
    state: u64,
    /// Trials since the speed was last held, and whether it then agreed with the expected cost.
    since: u64,
    is_calm: bool,
    /// The number of runs of the incumbent that are still due after a jump.
    settling: u64,
    unheld: Vec<Unheld>,
    latest: u64,
}

impl Default for Client {
    fn default() -> Self {
        Client {
            speed: Speed::default(),
            shifts: ShiftSums::default(),
            factor: 1.0,
            noise: NOISE_PRIOR,
            own_noise: 0.0,
            state: 0,
            since: 0,
            is_calm: false,
            settling: 0,
            unheld: Vec::new(),
            latest: 0,
        }
    }
}

/// The machines of all clients.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Speeds {
    clients: BTreeMap<String, Client>,
    clock: u64,
}

/// The result of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Held {
    /// The factor by which costs are to be divided.
    pub(crate) factor: f64,
    /// Trials to be taken back, where the speed has jumped.
    pub(crate) jumped: Option<Vec<Unheld>>,
    /// A known cost has shifted by less than a jump.
    pub(crate) is_shifted: bool,
}

impl Speeds {
    /// Takes a cost that a client measured in a state, before the state's table learns it. A cost that is not
    /// understood yet does not hold the speed; its trial is only counted. `is_again` says whether the trial
    /// measured the incumbent once more.
    pub(crate) fn take(
        &mut self,
        (client_id, trial, state): (&str, u64, StateId),
        configuration: &Configuration,
        cost: f64,
        (results, default): (&ResultTable, &Configuration),
        (holds, is_again): (bool, bool),
    ) -> Held {
        self.clock += 1;
        if !self.clients.contains_key(client_id) {
            self.make_room();
        }
        let client = self.clients.entry(client_id.to_owned()).or_default();
        client.latest = self.clock;
        if client.state != state.0 {
            client.state = state.0;
            client.unheld.clear();
            client.shifts = ShiftSums::default();
            client.since = 0;
        }
        // A suspicious measurement says nothing of the noise.
        if !client.speed.is_suspicious() {
            client.noise = results.assumed_noise();
        }
        let noise = client.noise;
        client.speed.step(noise);
        client.since += 1;
        let known = results.record(configuration).filter(|record| {
            let least = if configuration == default { 1 } else { KNOWN_AFTER };
            let is_clear = record.mean_cost > 0.0 && !record.evidence.is_torn();
            !record.infeasible && is_clear && record.evidence.count() >= least
        });
        if !holds {
            // The next repeat waits for other configurations, whether or not the cost is known by now.
            if known.is_some() || is_again && configuration != default {
                client.since = 0;
            }
            return Held { factor: 1.0, jumped: None, is_shifted: false };
        }
        client.settling = client.settling.saturating_sub(u64::from(known.is_some()));
        let (mut jumped, mut is_shifted) = (None, false);
        if let Some(known) = known {
            // A restless configuration says little of the machine. A measurement under suspicion is no noise
            // of it.
            if !client.speed.is_suspicious() {
                client.own_noise = known.evidence.log_deviation(noise).max(noise);
            }
            let noise = client.own_noise.max(noise) * (1.0 + 1.0 / known.evidence.count() as f64).sqrt();
            let (jumps, off) = (client.speed.jumps, client.speed.deviations(cost, known.mean_cost, noise));
            client.speed.hold(cost, known.mean_cost, noise);
            // What may be an accident waits for the next measurement.
            is_shifted = client.shifts.take(off) && !client.speed.is_suspicious();
            if client.speed.jumps > jumps {
                jumped = Some(std::mem::take(&mut client.unheld));
                is_shifted = false;
                (client.since, client.is_calm, client.settling) = (0, false, SETTLING);
            } else if !client.speed.is_suspicious() {
                client.unheld.clear();
                (client.since, client.is_calm) = (0, true);
            }
        }
        if is_shifted || jumped.is_some() {
            client.shifts = ShiftSums::default();
        }
        let factor = client.speed.factor();
        let factor = if libm::log(factor).abs() > FACTOR_LEAST * noise { factor } else { 1.0 };
        client.factor = factor;
        // The first measurement of the default is the reference of the speed, so it stays.
        if known.is_none() && configuration != default || client.speed.is_suspicious() {
            if client.unheld.len() == UNHELD_MAX {
                client.unheld.remove(0);
            }
            let cost = (cost / factor).min(f64::MAX);
            client.unheld.push(Unheld { trial, configuration: Stored(configuration.clone()), cost });
            assert!(client.unheld.len() <= UNHELD_MAX, "{} trials", client.unheld.len());
        }
        Held { factor, jumped, is_shifted }
    }

    /// Whether the incumbent of the client's state should be measured before anything else; it is due sooner
    /// where `hurried`, and where the machine's speed wanders. While `hurried`, costs do not hold the speed,
    /// so a suspicion from another state waits: the regression on auxiliary measurements needs other
    /// configurations than the incumbent first.
    pub(crate) fn is_due(&self, client_id: &str, state: StateId, hurried: bool, wanders: bool) -> bool {
        let Some(client) = self.clients.get(client_id).filter(|client| client.state == state.0) else {
            return false;
        };
        let interval = match hurried {
            true => INTERVAL_HURRIED,
            false if wanders => INTERVAL_WANDERING,
            false if client.is_calm => 2 * INTERVAL,
            false => INTERVAL,
        };
        let is_unsettled = client.speed.is_suspicious() || client.settling > 0;
        is_unsettled && !hurried || client.since >= interval
    }

    /// The factor on all costs of a client at the moment, where the policy follows the speed of machines.
    pub(crate) fn pace_of(&self, policy: &Policy, client_id: &str) -> f64 {
        if policy.track_speed { self.factor(client_id) } else { 1.0 }
    }

    /// The factor on a client's costs at the moment.
    pub(crate) fn factor(&self, client_id: &str) -> f64 {
        self.clients.get(client_id).map_or(1.0, |client| client.factor)
    }

    /// Resets all clients of a state, whose costs are understood differently from now on.
    pub(crate) fn reset(&mut self, state: StateId) {
        for client in self.clients.values_mut().filter(|client| client.state == state.0) {
            *client = Client { state: client.state, latest: client.latest, ..Client::default() };
        }
    }

    /// Where there are too many clients, forgets the one whose last report is oldest.
    fn make_room(&mut self) {
        if self.clients.len() >= SPEEDS_MAX {
            let oldest = self.clients.iter().min_by_key(|(_, client)| client.latest);
            if let Some(oldest) = oldest.map(|(client_id, _)| client_id.clone()) {
                self.clients.remove(&oldest);
            }
        }
        assert!(self.clients.len() < SPEEDS_MAX, "{} clients", self.clients.len());
    }

    /// Whether the configurations that it names are of the space.
    pub(crate) fn fits(&self, space: &crate::space::Space) -> bool {
        let mut unheld = self.clients.values().flat_map(|client| &client.unheld);
        unheld.all(|one| space.owns(&one.configuration.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tuner::tests::spec;

    /// Costs that are not understood yet hold no speed, so that the incumbent's need not be known.
    #[test]
    fn an_incumbent_of_other_states_is_not_repeated_without_others_between() {
        let space = spec(Policy::default()).space;
        let (incumbent, other) = (space.decode(&[0.9; 4]), space.decode(&[0.1; 4]));
        let (state, table) = (StateId(1), ResultTable::default());
        let mut speeds = Speeds::default();
        let mut repeats = Vec::new();
        for trial in 1..=12 {
            let is_again = speeds.is_due("a", state, true, false);
            let configuration = if is_again { &incumbent } else { &other };
            let known = (&table, space.default_ref());
            let held = speeds.take(("a", trial, state), configuration, 1.0, known, (false, is_again));
            assert_eq!(held, Held { factor: 1.0, jumped: None, is_shifted: false });
            repeats.extend(is_again.then_some(trial));
        }
        assert_eq!(repeats, [4, 8, 12], "one after {INTERVAL_HURRIED} others");
    }
}
