//! Each client's state, the decision that was taken when it came there, and the rest of its budget for
//! exploring.
//!
//! Invariant: a client has one visit at a time. Its account, if the policy keeps one, goes with it from visit
//! to visit for as long as the client's session lasts. Where there are more clients than a study remembers,
//! the one with the oldest last decision is forgotten, and is new if it comes back.

use std::collections::{BTreeMap, BTreeSet};

use crate::decision::{BudgetStatus, Choice, Exploit, ExploitRule, ExploitSource, Explore};
use crate::ids::{StateId, TrialNumber};
use crate::policy::{Operation, Policy};
use crate::session::SessionPolicy;
use crate::study::StudySpec;
use crate::trial::Trial;
use crate::tuner::budget::Terms;
use crate::tuner::{Account, Ask, Visit, VisitDecision};

#[derive(Clone, Debug, Default)]
pub(crate) struct Visits {
    by_client: BTreeMap<String, Visit>,
    ages: Ages,
    /// The clients that hold open trials, some of them without a visit.
    holders: BTreeSet<String>,
}

/// The clients by [`Visit::since`], the one whose last decision is longest ago first.
#[derive(Clone, Debug, Default)]
struct Ages {
    /// Those that hold no open trial.
    idle: BTreeSet<(u64, String)>,
    /// All of them, with the state each is in before it.
    of_states: BTreeSet<(u64, u64, String)>,
}

impl Ages {
    fn insert(&mut self, visit: &Visit, is_idle: bool) {
        if is_idle {
            self.idle.insert((visit.since, visit.client_id.clone()));
        }
        self.of_states.insert((visit.state_id, visit.since, visit.client_id.clone()));
    }

    fn remove(&mut self, visit: &Visit) {
        self.idle.remove(&(visit.since, visit.client_id.clone()));
        let was_there = self.of_states.remove(&(visit.state_id, visit.since, visit.client_id.clone()));
        assert!(was_there, "every visit has its age");
    }

    /// The client of a state whose last decision was taken last.
    fn latest(&self, state_id: u64) -> Option<&str> {
        let begin = |state_id| (state_id, 0, String::new());
        let mut here = self.of_states.range(begin(state_id)..begin(state_id.saturating_add(1)));
        here.next_back().map(|(_, _, client_id)| client_id.as_str())
    }
}

impl Visits {
    fn check(&self) {
        assert_eq!(self.ages.of_states.len(), self.by_client.len(), "every client has one visit and one age");
        let (idle, all) = (self.ages.idle.len(), self.by_client.len());
        assert!(idle <= all && all <= idle + self.holders.len(), "{idle} of {all} clients hold nothing");
    }

    /// Notes whether a client holds open trials. It is not forgotten then.
    pub(crate) fn note_held(&mut self, client_id: &str, holds: bool) {
        let is_new = holds && self.holders.insert(client_id.to_owned());
        let is_over = !holds && self.holders.remove(client_id);
        if let Some(visit) = self.by_client.get(client_id).filter(|_| is_new || is_over) {
            self.ages.remove(visit);
            self.ages.insert(visit, is_over);
        }
        self.check();
    }

    /// The number of clients that the study remembers.
    pub(crate) fn len(&self) -> usize {
        self.by_client.len()
    }

    pub(crate) fn of(&self, client_id: &str) -> Option<&Visit> {
        self.by_client.get(client_id)
    }

    pub(crate) fn state_of(&self, client_id: &str) -> Option<StateId> {
        self.of(client_id).map(|visit| StateId(visit.state_id))
    }

    /// The account of a client's exploring, where the policy limits it.
    pub(crate) fn account(&self, client_id: &str) -> Option<&Account> {
        self.of(client_id)?.account.as_ref()
    }

    pub(crate) fn account_mut(&mut self, client_id: &str) -> Option<&mut Account> {
        self.by_client.get_mut(client_id)?.account.as_mut()
    }

    /// Whether a client's budget, if it has one, allows for exploring, where the default runs or where not.
    pub(crate) fn affords(&self, policy: &Policy, ask: &Ask, default_runs: bool) -> bool {
        let account = Terms::of(policy).zip(self.account(&ask.client_id));
        account.is_none_or(|(terms, account)| account.leave(terms, ask.can_abort, default_runs).is_ok())
    }

    /// Enters a completed trial into its client's account; the row of the visit, if there is one.
    pub(crate) fn settle(&mut self, spec: &StudySpec, trial: &Trial) -> Option<Visit> {
        let is_default = trial.configuration == *spec.space.default_ref() || runs_as_default(trial);
        let most = most_charged(&spec.policy, trial);
        let account = self.account_mut(&trial.client_id)?;
        account.report(trial.number, trial.state_id, trial.cost.map(|cost| cost.min(most)), is_default);
        self.of(&trial.client_id).cloned()
    }

    /// For how many trials the client that came to a state last wants it to be searched, if it says so.
    pub(crate) fn room(&self, state: StateId) -> Option<usize> {
        let last = self.of(self.ages.latest(state.0)?)?;
        last.account.as_ref()?.policy.trials_per_state.map(|room| room as usize)
    }

    /// Begins a visit, which takes over the client's account.
    pub(crate) fn begin(&mut self, visit: Visit) {
        let account = self.account(&visit.client_id).cloned().or_else(|| visit.account.clone());
        if let Some(before) = self.by_client.remove(&visit.client_id) {
            self.ages.remove(&before);
        }
        self.ages.insert(&visit, !self.holders.contains(&visit.client_id));
        self.by_client.insert(visit.client_id.clone(), Visit { account, ..visit });
        self.check();
    }

    /// Forgets the client whose last decision is longest ago, of those that hold no open trial.
    pub(crate) fn forget_oldest(&mut self) -> Option<String> {
        let (_, oldest) = self.ages.idle.first()?;
        let visit = self.by_client.remove(oldest);
        assert!(visit.is_some(), "every age is that of a visit");
        let visit = visit?;
        self.ages.remove(&visit);
        self.check();
        Some(visit.client_id)
    }

    /// Gives up what clients in a state rest on, because its results are not believed any more. What they
    /// exploit is decided again at their next questions, and the references of their accounts are measured
    /// again. Returns the clients that are forgotten for that, and the changed visits of those that keep an
    /// account.
    pub(crate) fn disown(&mut self, state: StateId) -> (Vec<String>, Vec<Visit>) {
        let (mut forgotten, mut changed) = (Vec::new(), Vec::new());
        for visit in self.by_client.values_mut().filter(|visit| visit.state_id == state.0) {
            if let Some(account) = &mut visit.account {
                account.enter(0);
                if let VisitDecision::Exploit { exploit, .. } = &mut visit.decision {
                    // A study that is tuned does not keep what was exploited while it was frozen.
                    exploit.rule = ExploitRule::Frozen;
                }
                changed.push(visit.clone());
            } else if matches!(visit.decision, VisitDecision::Exploit { .. }) {
                forgotten.push(visit.clone());
            }
        }
        for visit in &forgotten {
            self.by_client.remove(&visit.client_id);
            self.ages.remove(visit);
        }
        self.check();
        (forgotten.into_iter().map(|visit| visit.client_id).collect(), changed)
    }

    /// Whether the last decision for a client was taken under another session policy.
    pub(crate) fn has_other_wishes(&self, client_id: &str, session: &SessionPolicy) -> bool {
        self.account(client_id).map_or(SessionPolicy::default(), |account| account.policy) != *session
    }

    /// Counts the next trial in its session, and returns whether it is excluded from learning. A trial
    /// carried over from elsewhere is not run, so it warms nothing up.
    pub(crate) fn is_silent(&mut self, ask: &Ask, policy: &Policy) -> bool {
        let warm_up = u64::from(policy.warm_up);
        let frozen = policy.operation == Operation::Freeze;
        let before = self.account_mut(&ask.client_id).map(|account| account.count());
        frozen || (ask.origin.is_none() && before.is_some_and(|before| before < warm_up))
    }

    /// Opens a client's account if the policy keeps one or its session has its own policy, and notes the
    /// client's state. Trials after `last` are of the session that the account is for.
    pub(crate) fn keep_account(&mut self, ask: &Ask, policy: &Policy, state: StateId, last: TrialNumber) {
        let has_wishes = !ask.session_policy.is_empty();
        let wanted = policy.regret_budget.is_some() || policy.warm_up > 0 || has_wishes;
        let Some(visit) = self.by_client.get_mut(&ask.client_id) else { return };
        let current = visit.account.take().filter(|account| account.is_of(ask.session));
        visit.account = wanted.then(|| current.unwrap_or_else(|| Account::open(ask.session, last.0 + 1)));
        if let Some(account) = &mut visit.account {
            account.policy = ask.session_policy;
            account.enter(state.0);
            // The visit is stored in any case, so its age may be updated.
            self.ages.remove(visit);
            visit.since = last.0;
            self.ages.insert(visit, !self.holders.contains(&visit.client_id));
        }
        self.check();
    }
}

/// Whether a trial runs its client's start as others run the default: it is a reference for a budget.
fn runs_as_default(trial: &Trial) -> bool {
    let is_reference =
        |one: &Exploit| one.source == ExploitSource::Default && one.rule == ExploitRule::Budget;
    trial.decision.measures_start()
        || matches!(&trial.decision.choice, Choice::Exploit(exploit) if is_reference(exploit))
}

/// The most that a trial is charged: the assumed worst for an incumbent, which is not stopped.
fn most_charged(policy: &Policy, trial: &Trial) -> f64 {
    let reference = match &trial.decision.choice {
        Choice::Explore(Explore {
            budget: BudgetStatus { set_aside: Some(_), reference_cost, .. }, ..
        }) if !trial.decision.explores() => *reference_cost,
        _ => None,
    };
    let terms = Terms::of(policy);
    terms.zip(reference).map_or(f64::INFINITY, |(terms, reference)| terms.worst(reference))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::{ExplorationEstimate, ExploreRule};
    use crate::space::Space;
    use crate::tuner::budget::Denied;
    use crate::tuner::proposal::Exploitation;

    /// A visit that explores.
    fn visit(client: &str, state_id: u64, since: u64) -> Visit {
        let estimate = ExplorationEstimate::default();
        let decision = VisitDecision::Explore { rule: ExploreRule::Dice, estimate };
        Visit { client_id: client.to_owned(), state_id, number: 1, since, decision, account: None }
    }

    #[test]
    fn who_was_decided_for_longest_ago_is_forgotten_first() {
        let mut visits = Visits::default();
        for (client, since) in [("a", 1), ("b", 2), ("c", 3), ("a", 4)] {
            visits.begin(visit(client, 1, since));
        }
        assert_eq!(visits.len(), 3);
        visits.note_held("b", true);
        visits.note_held("stranger", true);
        assert_eq!(visits.forget_oldest().as_deref(), Some("c"), "b holds a trial");
        visits.note_held("b", false);
        visits.note_held("a", true);
        assert_eq!(visits.forget_oldest().as_deref(), Some("b"));
        assert_eq!(visits.forget_oldest(), None, "a holds one now");
        visits.note_held("a", false);
        assert_eq!((visits.forget_oldest().as_deref(), visits.forget_oldest()), (Some("a"), None));
        assert_eq!(visits.len(), 0);
        // A client that already holds a trial when it comes is not forgotten either.
        visits.begin(visit("stranger", 1, 5));
        assert_eq!((visits.forget_oldest(), visits.len()), (None, 1));
    }

    #[test]
    fn the_client_that_came_to_a_state_last_says_how_long_it_is_searched() {
        let mut visits = Visits::default();
        let mut come = |client: &str, state_id, since, room| {
            let session_policy = SessionPolicy { trials_per_state: room, ..SessionPolicy::default() };
            let ask = Ask { client_id: client.into(), session_policy, ..Ask::default() };
            visits.begin(visit(client, state_id, since));
            visits.keep_account(&ask, &Policy::default(), StateId(state_id), TrialNumber(since));
            [1, 2, 3].map(|state| visits.room(StateId(state)))
        };
        assert_eq!(come("b", 2, 1, Some(7)), [None, Some(7), None]);
        assert_eq!(come("a", 2, 2, Some(9)), [None, Some(9), None]);
        assert_eq!(come("c", 1, 2, Some(5)), [Some(5), Some(9), None]);
        assert_eq!(come("a", 3, 3, None), [Some(5), Some(7), None], "it left, and wants nothing");
        assert_eq!(come("c", 2, 4, None), [None, None, None], "who came last has no wish");
    }

    #[test]
    fn an_account_goes_with_its_client_for_a_session() {
        let mut visits = Visits::default();
        let policy = Policy { regret_budget: Some(0.1), ..Policy::default() };
        let ask = |session| Ask { client_id: "a".into(), session, ..Ask::default() };
        visits.keep_account(&ask(7), &policy, StateId(1), TrialNumber(0));
        assert!(visits.account("a").is_none(), "nobody is there yet");
        visits.begin(visit("a", 1, 0));
        visits.keep_account(&ask(7), &policy, StateId(1), TrialNumber(0));
        let account = visits.account_mut("a").expect("there is a budget");
        (1..3).for_each(|number| account.report(number, 1, Some(10.0), true));
        visits.begin(visit("a", 2, 0));
        visits.keep_account(&ask(7), &policy, StateId(2), TrialNumber(1));
        assert_eq!(visits.state_of("a"), Some(StateId(2)));
        assert_eq!(
            visits.account("a").map(|account| account.left(0.1)),
            Some(2.0),
            "earned in the state before"
        );
        visits.keep_account(&ask(8), &policy, StateId(2), TrialNumber(1));
        assert_eq!(visits.account("a").map(|account| account.left(0.1)), Some(0.0), "another session");
        visits.keep_account(&ask(8), &Policy::default(), StateId(2), TrialNumber(1));
        assert!(visits.account("a").is_none(), "no budget, no account");
    }

    #[test]
    fn disowned_results_are_neither_exploited_nor_references() {
        let mut visits = Visits::default();
        let policy = Policy { regret_budget: Some(0.1), ..Policy::default() };
        let space = Space::builder().integer("a", 0..=9).default(4).build().expect("valid");
        for (client, state_id, has_account) in [("a", 1, true), ("b", 1, false), ("c", 2, true)] {
            let (configuration, source) = (space.default_configuration(), ExploitSource::Default);
            let own = Exploitation { configuration, predicted_cost: None, source, rolled_back: false };
            let decision = own.kept(ExploitRule::Dice, ExplorationEstimate::default());
            visits.begin(Visit { decision, ..visit(client, state_id, 0) });
            if has_account {
                let ask = Ask { client_id: client.into(), ..Ask::default() };
                visits.keep_account(&ask, &policy, StateId(state_id), TrialNumber(0));
                let account = visits.account_mut(client).expect("there is a budget");
                (1..3).for_each(|number| account.report(number, state_id, Some(10.0), true));
            }
        }
        let (forgotten, changed) = visits.disown(StateId(1));
        assert_eq!(forgotten, ["b"]);
        assert_eq!(changed, [visits.of("a").expect("it keeps its account").clone()]);
        let frozen = |visit: &Visit| match &visit.decision {
            VisitDecision::Exploit { exploit, .. } => exploit.rule == ExploitRule::Frozen,
            VisitDecision::Explore { .. } => false,
        };
        assert_eq!(["a", "c"].map(|client| visits.of(client).is_some_and(frozen)), [true, false]);
        let terms = Terms::of(&policy).expect("a budget");
        let leave = |client| visits.account(client).expect("it stays").leave(terms, true, true);
        assert_eq!(leave("a"), Err(Denied::NoReference));
        assert!(matches!(leave("c"), Err(Denied::TooLittle(_))));
        assert_eq!(visits.account("a").map(|account| account.left(0.1)), Some(2.0), "it earned that");
    }
}
