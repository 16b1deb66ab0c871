//! The open trials of a study: their leases, and who holds what.
//!
//! Invariants: every open trial has one lease, one holder and one entry among what runs in its state; a client holds
//! at most one trial of a state; numbers rise by one.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use crate::configuration::Configuration;
use crate::ids::{StateId, TrialNumber};
use crate::trial::Trial;

/// The open trials.
#[derive(Clone, Debug, Default)]
pub(super) struct OpenTrials {
    open: BTreeMap<TrialNumber, Trial>,
    /// When their leases run out, in milliseconds of the caller's clock, soonest first.
    leases: BTreeSet<(i64, TrialNumber)>,
    held: BTreeMap<String, BTreeMap<StateId, TrialNumber>>,
    /// How many open trials run each configuration in each state. Only looked up, so its order does not matter.
    running: HashMap<StateId, HashMap<Configuration, u32>>,
    last: TrialNumber,
}

impl OpenTrials {
    /// No open trial, after so many that were handed out.
    pub(super) fn after(last: TrialNumber) -> Self {
        OpenTrials { last, ..OpenTrials::default() }
    }

    /// The number of the last trial that was ever handed out; 0 before the first.
    pub(super) fn last(&self) -> TrialNumber {
        self.last
    }

    /// How many are open.
    pub(super) fn len(&self) -> usize {
        self.open.len()
    }

    /// An open trial.
    pub(super) fn get(&self, number: TrialNumber) -> Option<&Trial> {
        self.open.get(&number)
    }

    /// The open trial that a client holds for a state.
    pub(super) fn of_client(&self, client_id: &str, state: StateId) -> Option<&Trial> {
        let number = self.held.get(client_id)?.get(&state)?;
        self.open.get(number)
    }

    /// How many open trials a client holds.
    pub(super) fn held_by(&self, client_id: &str) -> usize {
        self.held.get(client_id).map_or(0, BTreeMap::len)
    }

    /// Whether a configuration is being run in a state.
    pub(super) fn runs(&self, state: StateId, configuration: &Configuration) -> bool {
        self.running.get(&state).is_some_and(|running| running.contains_key(configuration))
    }

    /// Whether anything is being run in a state.
    pub(super) fn runs_anything(&self, state: StateId) -> bool {
        self.running.contains_key(&state)
    }

    /// When the next lease runs out.
    pub(super) fn next_expiry_ms(&self) -> Option<i64> {
        self.leases.first().map(|&(expire_ms, _)| expire_ms)
    }

    /// The trials whose leases have run out before `now_ms`, by rising number.
    pub(super) fn due(&self, now_ms: i64) -> BTreeSet<TrialNumber> {
        self.leases.range(..(now_ms, TrialNumber(0))).map(|&(_, number)| number).collect()
    }

    /// Enters an open trial. One that is newer than all before is the last from now on.
    pub(super) fn enter(&mut self, trial: Trial) {
        let (number, state) = (TrialNumber(trial.number), StateId(trial.state_id));
        self.last = self.last.max(number);
        let running = self.running.entry(state).or_default();
        *running.entry(trial.configuration.clone()).or_insert(0) += 1;
        self.held.entry(trial.client_id.clone()).or_default().insert(state, number);
        self.leases.insert((trial.lease_expire_ms, number));
        self.open.insert(number, trial);
    }

    /// Takes an open trial out.
    pub(super) fn remove(&mut self, number: TrialNumber) -> Option<Trial> {
        let trial = self.open.remove(&number)?;
        let state = StateId(trial.state_id);
        self.leases.remove(&(trial.lease_expire_ms, number));
        if let Some(running) = self.running.get_mut(&state) {
            if let Some(count) = running.get_mut(&trial.configuration) {
                *count -= 1;
                if *count == 0 {
                    running.remove(&trial.configuration);
                }
            }
            if running.is_empty() {
                self.running.remove(&state);
            }
        }
        if let Some(held) = self.held.get_mut(&trial.client_id) {
            held.remove(&state);
            if held.is_empty() {
                self.held.remove(&trial.client_id);
            }
        }
        Some(trial)
    }

    /// Gives an open trial a lease until `expire_ms`.
    pub(super) fn renew(&mut self, number: TrialNumber, expire_ms: i64) -> Option<&Trial> {
        let trial = self.open.get_mut(&number)?;
        self.leases.remove(&(trial.lease_expire_ms, number));
        self.leases.insert((expire_ms, number));
        trial.lease_expire_ms = expire_ms;
        Some(trial)
    }
}
