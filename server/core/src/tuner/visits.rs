//! Each client's state, the decision that was taken when it came there, and the rest of its budget for
//! exploring.
//!
//! Invariant: a client has one visit at a time, and its account, if the policy keeps one, goes with it from
//! visit to visit for as long as the client's session lasts. Where there are more clients than a study
//! remembers, the one with the oldest last decision is forgotten, and is new if it comes back.

use std::collections::{BTreeMap, BTreeSet};

use crate::ids::{StateId, TrialNumber};
use crate::policy::Policy;
use crate::tuner::{Account, Ask, Visit};

/// The visits of a study, by client.
#[derive(Clone, Debug, Default)]
pub(super) struct Visits {
    by_client: BTreeMap<String, Visit>,
    /// The clients by [`Visit::since`], the longest forgotten first.
    by_age: BTreeSet<(u64, String)>,
}

impl Visits {
    fn check(&self) {
        assert_eq!(self.by_age.len(), self.by_client.len(), "every client has one visit and one age");
    }

    /// The number of clients that the study remembers.
    pub(super) fn len(&self) -> usize {
        self.by_client.len()
    }

    /// The visit of a client.
    pub(super) fn of(&self, client_id: &str) -> Option<&Visit> {
        self.by_client.get(client_id)
    }

    /// The state a client is in.
    pub(super) fn state_of(&self, client_id: &str) -> Option<StateId> {
        self.of(client_id).map(|visit| StateId(visit.state_id))
    }

    /// The account of a client's exploring, where the policy limits it.
    pub(super) fn account(&self, client_id: &str) -> Option<&Account> {
        self.of(client_id)?.account.as_ref()
    }

    /// The account of a client, to be charged.
    pub(super) fn account_mut(&mut self, client_id: &str) -> Option<&mut Account> {
        self.by_client.get_mut(client_id)?.account.as_mut()
    }

    /// For how many trials the client that came to a state last wants it to be searched, if it says so.
    pub(super) fn room(&self, state: StateId) -> Option<usize> {
        let here = self.by_client.values().filter(|visit| visit.state_id == state.0);
        let last = here.max_by_key(|visit| visit.since)?;
        last.account.as_ref()?.policy().trials_per_state.map(|room| room as usize)
    }

    /// Begins a visit, which takes over the client's account.
    pub(super) fn begin(&mut self, visit: Visit) {
        let account = self.account(&visit.client_id).cloned().or_else(|| visit.account.clone());
        let client_id = visit.client_id.clone();
        self.by_age.insert((visit.since, client_id.clone()));
        let since = visit.since;
        let before = self.by_client.insert(client_id, Visit { account, ..visit });
        if let Some(before) = before.filter(|before| before.since != since) {
            let had_age = self.by_age.remove(&(before.since, before.client_id));
            assert!(had_age, "every visit has its age");
        }
        self.check();
    }

    /// Forgets the client whose last decision is longest ago, of those for which `holds` is false.
    pub(super) fn forget_oldest(&mut self, holds: impl Fn(&str) -> bool) -> Option<String> {
        let oldest = self.by_age.iter().find(|(_, client_id)| !holds(client_id))?.clone();
        self.by_age.remove(&oldest);
        let visit = self.by_client.remove(&oldest.1);
        assert!(visit.is_some(), "every age is that of a visit");
        self.check();
        Some(oldest.1)
    }

    /// Opens a client's account if the policy keeps one or its session has its own policy, and notes the
    /// client's state. Trials after `last` are of the session that the account is for.
    pub(super) fn keep_account(&mut self, ask: &Ask, policy: &Policy, state: StateId, last: TrialNumber) {
        let has_wishes = !ask.session_policy.is_empty();
        let wanted = policy.regret_budget.is_some() || policy.warm_up > 0 || has_wishes;
        let Some(visit) = self.by_client.get_mut(&ask.client_id) else {
            return;
        };
        let current = visit.account.take().filter(|account| account.is_of(ask.session));
        visit.account = wanted.then(|| current.unwrap_or_else(|| Account::open(ask.session, last.0 + 1)));
        if let Some(account) = &mut visit.account {
            account.set_policy(ask.session_policy);
            account.enter(state.0);
            // The visit is stored in any case, so its age may be updated.
            self.by_age.remove(&(visit.since, visit.client_id.clone()));
            visit.since = last.0;
            self.by_age.insert((visit.since, visit.client_id.clone()));
        }
        self.check();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::{ExplorationEstimate, ExploreRule};
    use crate::tuner::VisitDecision;

    #[test]
    fn who_was_decided_for_longest_ago_is_forgotten_first() {
        let mut visits = Visits::default();
        let mut begin = |client: &str, since| {
            let decision =
                VisitDecision::Explore { rule: ExploreRule::Dice, estimate: ExplorationEstimate::default() };
            let client_id = client.to_owned();
            visits.begin(Visit { client_id, state_id: 1, number: 1, since, decision, account: None });
        };
        for (client, since) in [("a", 1), ("b", 2), ("c", 3), ("a", 4)] {
            begin(client, since);
        }
        assert_eq!(visits.len(), 3);
        let mut forget = |holder: &str| visits.forget_oldest(|client| client == holder);
        assert_eq!(forget("b").as_deref(), Some("c"), "b holds a trial");
        assert_eq!(forget("").as_deref(), Some("b"));
        assert_eq!((forget("a"), forget("").as_deref(), forget("")), (None, Some("a"), None));
        assert_eq!(visits.len(), 0);
    }

    #[test]
    fn an_account_goes_with_its_client_for_a_session() {
        let mut visits = Visits::default();
        let policy = Policy { regret_budget: Some(0.1), ..Policy::default() };
        let ask = |session| Ask { client_id: "a".into(), session, ..Ask::default() };
        let begin = |visits: &mut Visits, state_id| {
            let decision =
                VisitDecision::Explore { rule: ExploreRule::Dice, estimate: ExplorationEstimate::default() };
            visits.begin(Visit {
                client_id: "a".into(),
                state_id,
                number: 1,
                since: 0,
                decision,
                account: None,
            });
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
