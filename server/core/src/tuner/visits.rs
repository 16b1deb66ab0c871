//! Where each client is, what was decided when it came there, and what exploring may still cost it.
//!
//! Invariant: a client has one visit at a time, and its account, if the policy keeps one, goes with it from visit to
//! visit for as long as the client's session lasts.

use std::collections::BTreeMap;

use crate::ids::{StateId, TrialNumber};
use crate::policy::Policy;
use crate::tuner::{Account, Ask, Visit};

/// The visits of a study, by client.
#[derive(Clone, Debug, Default)]
pub(super) struct Visits(BTreeMap<String, Visit>);

impl Visits {
    /// How many clients the study has seen.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// Where a client is.
    pub(super) fn of(&self, client_id: &str) -> Option<&Visit> {
        self.0.get(client_id)
    }

    /// The state a client is in.
    pub(super) fn state_of(&self, client_id: &str) -> Option<StateId> {
        self.of(client_id).map(|visit| StateId(visit.state_id))
    }

    /// What exploring may still cost a client, where the policy limits it.
    pub(super) fn account(&self, client_id: &str) -> Option<&Account> {
        self.of(client_id)?.account.as_ref()
    }

    /// The same, to be charged.
    pub(super) fn account_mut(&mut self, client_id: &str) -> Option<&mut Account> {
        self.0.get_mut(client_id)?.account.as_mut()
    }

    /// Begins a visit, which takes over the client's account.
    pub(super) fn begin(&mut self, visit: Visit) {
        let account = self.account(&visit.client_id).cloned().or_else(|| visit.account.clone());
        self.0.insert(visit.client_id.clone(), Visit { account, ..visit });
    }

    /// Opens a client's account if the policy keeps one, and notes where the client is. Trials after `last` are of the
    /// session that the account is for.
    pub(super) fn keep_account(&mut self, ask: &Ask, policy: &Policy, state: StateId, last: TrialNumber) {
        let wanted = policy.regret_budget.is_some() || policy.warm_up > 0;
        let Some(visit) = self.0.get_mut(&ask.client_id) else {
            return;
        };
        let current = visit.account.take().filter(|account| account.is_of(ask.session));
        visit.account = wanted.then(|| current.unwrap_or_else(|| Account::open(ask.session, last.0 + 1)));
        if let Some(account) = &mut visit.account {
            account.enter(state.0);
        }
    }
}
