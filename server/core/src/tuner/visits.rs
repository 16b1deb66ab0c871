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

    /// Opens a client's account if the policy keeps one or its session wants something for itself, and notes where the client is. Trials after `last` are of the
    /// session that the account is for.
    pub(super) fn keep_account(&mut self, ask: &Ask, policy: &Policy, state: StateId, last: TrialNumber) {
        let has_wishes = !ask.session_policy.is_empty();
        let wanted = policy.regret_budget.is_some() || policy.warm_up > 0 || has_wishes;
        let Some(visit) = self.0.get_mut(&ask.client_id) else {
            return;
        };
        let current = visit.account.take().filter(|account| account.is_of(ask.session));
        visit.account = wanted.then(|| current.unwrap_or_else(|| Account::open(ask.session, last.0 + 1)));
        if let Some(account) = &mut visit.account {
            account.set_policy(ask.session_policy);
            account.enter(state.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::{ExplorationEstimate, ExploreRule};
    use crate::tuner::VisitDecision;

    #[test]
    fn an_account_goes_with_its_client_for_a_session() {
        let mut visits = Visits::default();
        let policy = Policy { regret_budget: Some(0.1), ..Policy::default() };
        let ask = |session| Ask { client_id: "a".into(), session, ..Ask::default() };
        let begin = |visits: &mut Visits, state_id| {
            let decision =
                VisitDecision::Explore { rule: ExploreRule::Dice, estimate: ExplorationEstimate::default() };
            visits.begin(Visit { client_id: "a".into(), state_id, number: 1, decision, account: None });
        };
        visits.keep_account(&ask(7), &policy, StateId(1), TrialNumber(0));
        assert!(visits.account("a").is_none(), "nobody is there yet");
        begin(&mut visits, 1);
        visits.keep_account(&ask(7), &policy, StateId(1), TrialNumber(0));
        visits.account_mut("a").expect("there is a budget").report(1, 1, Some(10.0), true);
        begin(&mut visits, 2);
        visits.keep_account(&ask(7), &policy, StateId(2), TrialNumber(1));
        assert_eq!(visits.state_of("a"), Some(StateId(2)));
        assert_eq!(
            visits.account("a").map(|account| account.left(0.1)),
            Some(1.0),
            "earned in the state before"
        );
        visits.keep_account(&ask(8), &policy, StateId(2), TrialNumber(1));
        assert_eq!(visits.account("a").map(|account| account.left(0.1)), Some(0.0), "another session");
        visits.keep_account(&ask(8), &Policy::default(), StateId(2), TrialNumber(1));
        assert!(visits.account("a").is_none(), "no budget, no account");
    }
}
