//! The open trials of a study, their leases and their holders.
//!
//! Invariants: every open trial has one lease, one entry among the running configurations of its state, and
//! one holder unless it was put aside. A client holds at most one trial of a state. Numbers rise by one.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use crate::configuration::Configuration;
use crate::ids::{StateId, TrialNumber};
use crate::limits::{EARLIER_SESSIONS_MAX, OPEN_TRIALS_PER_CLIENT_MAX, TRIALS_ASIDE_MAX};
use crate::trial::Trial;

#[derive(Clone, Debug, Default)]
pub(crate) struct OpenTrials {
    open: BTreeMap<TrialNumber, Trial>,
    /// The ends of their leases, in milliseconds of the caller's clock, soonest first.
    leases: BTreeSet<(i64, TrialNumber)>,
    held: BTreeMap<String, BTreeMap<StateId, TrialNumber>>,
    /// The number of trials that were put aside, for clients that have any.
    aside: BTreeMap<String, usize>,
    /// The number of open trials of each configuration in each state. Only looked up, so its order does not
    /// matter.
    running: HashMap<StateId, HashMap<Configuration, u32>>,
    last: TrialNumber,
}

impl OpenTrials {
    /// No open trial, where `last` is the last one handed out.
    pub(crate) fn after(last: TrialNumber) -> Self {
        OpenTrials { last, ..OpenTrials::default() }
    }

    /// The number of the last trial that was ever handed out; 0 before the first.
    pub(crate) fn last(&self) -> TrialNumber {
        self.last
    }

    pub(crate) fn len(&self) -> usize {
        self.open.len()
    }

    pub(crate) fn get(&self, number: TrialNumber) -> Option<&Trial> {
        self.open.get(&number)
    }

    /// Every open trial, by rising number.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Trial> {
        self.open.values()
    }

    pub(crate) fn of_client(&self, client_id: &str, state: StateId) -> Option<&Trial> {
        let number = self.held.get(client_id)?.get(&state)?;
        self.open.get(number)
    }

    pub(crate) fn held_by(&self, client_id: &str) -> usize {
        self.held.get(client_id).map_or(0, BTreeMap::len)
    }

    /// The number of clients that hold open trials.
    pub(crate) fn holders(&self) -> usize {
        self.held.len()
    }

    pub(crate) fn runs(&self, state: StateId, configuration: &Configuration) -> bool {
        self.running.get(&state).is_some_and(|running| running.contains_key(configuration))
    }

    pub(crate) fn runs_anything(&self, state: StateId) -> bool {
        self.running.contains_key(&state)
    }

    pub(crate) fn next_expiry_ms(&self) -> Option<i64> {
        self.leases.first().map(|&(expire_ms, _)| expire_ms)
    }

    /// The trials whose leases have run out before `now_ms`, by rising number.
    pub(crate) fn due(&self, now_ms: i64) -> BTreeSet<TrialNumber> {
        self.leases.range(..(now_ms, TrialNumber(0))).map(|&(_, number)| number).collect()
    }

    /// Enters an open trial. One that is newer than all before is the last from now on.
    pub(crate) fn enter(&mut self, trial: Trial) {
        let (number, state) = (TrialNumber(trial.number), StateId(trial.state_id));
        self.last = self.last.max(number);
        let running = self.running.entry(state).or_default();
        *running.entry(trial.configuration.clone()).or_insert(0) += 1;
        if trial.decision.put_aside {
            *self.aside.entry(trial.client_id.clone()).or_default() += 1;
        } else {
            self.held.entry(trial.client_id.clone()).or_default().insert(state, number);
        }
        self.leases.insert((trial.lease_expire_ms, number));
        self.open.insert(number, trial);
        assert!(self.last >= number && self.leases.len() >= self.open.len(), "{number:?} is open");
    }

    /// Takes an open trial out.
    pub(crate) fn remove(&mut self, number: TrialNumber) -> Option<Trial> {
        let trial = self.open.remove(&number)?;
        let state = StateId(trial.state_id);
        let had_lease = self.leases.remove(&(trial.lease_expire_ms, number));
        assert!(had_lease, "{number:?} was open without a lease");
        if let Some(running) = self.running.get_mut(&state) {
            if let Some(count) = running.get_mut(&trial.configuration) {
                assert!(*count > 0, "what runs is counted");
                *count -= 1;
                if *count == 0 {
                    running.remove(&trial.configuration);
                }
            }
            if running.is_empty() {
                self.running.remove(&state);
            }
        }
        match trial.decision.put_aside {
            true => self.forget_aside(&trial.client_id),
            false => self.let_go(&trial),
        }
        Some(trial)
    }

    /// The client of a trial does not hold it any more.
    fn let_go(&mut self, trial: &Trial) {
        if let Some(held) = self.held.get_mut(&trial.client_id) {
            held.remove(&StateId(trial.state_id));
            if held.is_empty() {
                self.held.remove(&trial.client_id);
            }
        }
    }

    /// One of the trials that were put aside for a client is not open any more.
    fn forget_aside(&mut self, client_id: &str) {
        if let Some(count) = self.aside.get_mut(client_id) {
            assert!(*count > 0, "what was put aside is counted");
            *count -= 1;
            if *count == 0 {
                self.aside.remove(client_id);
            }
        }
    }

    /// Takes an open trial from its client, which gets others in its place. It stays open under its lease.
    /// `None` where too many were put aside for the client.
    pub(crate) fn put_aside(&mut self, number: TrialNumber) -> Option<Trial> {
        let trial = self.open.get_mut(&number)?;
        let count = self.aside.get(&trial.client_id).copied().unwrap_or(0);
        let is_full = self.aside.values().sum::<usize>() >= TRIALS_ASIDE_MAX;
        if is_full || count >= OPEN_TRIALS_PER_CLIENT_MAX || trial.decision.put_aside {
            return None;
        }
        trial.decision.put_aside = true;
        let trial = trial.clone();
        self.aside.insert(trial.client_id.clone(), count + 1);
        self.let_go(&trial);
        Some(trial)
    }

    /// Notes the session that holds an open trial now, and the number of lost leases of its configuration.
    /// Another session has not shown yet that it runs the trial, which the one before left behind.
    pub(crate) fn hold_by(&mut self, number: TrialNumber, session: u64, lost_leases: u32) {
        if let Some(trial) = self.open.get_mut(&number) {
            let held = &mut trial.decision;
            if held.session != session {
                (held.heartbeat, held.left_behind) = (false, true);
                if held.earlier_sessions.len() >= EARLIER_SESSIONS_MAX {
                    held.earlier_sessions.remove(0);
                }
                held.earlier_sessions.push(held.session);
            }
            (held.session, held.lost_leases) = (session, lost_leases);
        }
    }

    /// Notes that the client of an open trial shows that it lives.
    pub(crate) fn note_heartbeat(&mut self, number: TrialNumber) {
        if let Some(trial) = self.open.get_mut(&number) {
            trial.decision.heartbeat = true;
        }
    }

    /// Gives an open trial a lease until `expire_ms`.
    pub(crate) fn renew(&mut self, number: TrialNumber, expire_ms: i64) -> Option<&Trial> {
        let trial = self.open.get_mut(&number)?;
        let had_lease = self.leases.remove(&(trial.lease_expire_ms, number));
        assert!(had_lease, "{number:?} was open without a lease");
        let is_new = self.leases.insert((expire_ms, number));
        assert!(is_new, "{number:?} has two leases");
        trial.lease_expire_ms = expire_ms;
        Some(trial)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::Choice;
    use crate::policy::Policy;
    use crate::tuner::tests::spec;

    fn trial(number: u64, client_id: &str, state_id: u64, lease_expire_ms: i64) -> Trial {
        let default = spec(Policy::default()).space.default_configuration();
        Trial {
            lease_expire_ms,
            ..Trial::new(number, client_id, state_id, default, Choice::Wanted.decided())
        }
    }

    #[test]
    fn what_is_open_is_held_leased_and_running_until_it_is_taken_out() {
        let mut trials = OpenTrials::default();
        let default = trial(1, "a", 1, 0).configuration;
        for (number, client, state, expire_ms) in [(1, "a", 1, 50), (2, "b", 1, 40), (3, "a", 2, 60)] {
            trials.enter(trial(number, client, state, expire_ms));
        }
        assert_eq!((trials.len(), trials.last(), trials.held_by("a")), (3, TrialNumber(3), 2));
        assert_eq!(trials.of_client("b", StateId(1)).map(|trial| trial.number), Some(2));
        assert_eq!(trials.next_expiry_ms(), Some(40));
        assert!(trials.due(40).is_empty(), "the last millisecond still counts");
        assert_eq!(trials.due(51).into_iter().collect::<Vec<_>>(), [TrialNumber(1), TrialNumber(2)]);

        assert_eq!(trials.renew(TrialNumber(2), 90).map(|trial| trial.lease_expire_ms), Some(90));
        assert_eq!(trials.next_expiry_ms(), Some(50));
        assert!(trials.remove(TrialNumber(1)).is_some() && trials.remove(TrialNumber(1)).is_none());
        assert!(trials.runs(StateId(1), &default), "the other client runs it still");
        assert!(trials.remove(TrialNumber(2)).is_some());
        assert!(!trials.runs_anything(StateId(1)) && trials.runs(StateId(2), &default));
        assert!(trials.remove(TrialNumber(3)).is_some());
        assert_eq!((trials.len(), trials.held_by("a"), trials.next_expiry_ms()), (0, 0, None));
        assert_eq!(trials.last(), TrialNumber(3), "numbers are never used again");
    }

    #[test]
    fn what_is_put_aside_is_open_and_its_client_holds_another() {
        let (mut trials, state) = (OpenTrials::default(), StateId(1));
        let held = |trials: &OpenTrials| trials.of_client("a", state).map(|trial| trial.number);
        for number in 1..=OPEN_TRIALS_PER_CLIENT_MAX as u64 {
            trials.enter(trial(number, "a", 1, 50));
            let aside = trials.put_aside(TrialNumber(number)).expect("there is room");
            assert!(aside.decision.put_aside);
            assert_eq!((held(&trials), trials.held_by("a")), (None, 0));
        }
        let more = OPEN_TRIALS_PER_CLIENT_MAX as u64 + 1;
        trials.enter(trial(more, "a", 1, 60));
        assert_eq!(trials.put_aside(TrialNumber(more)), None, "too many");
        let first = trials.remove(TrialNumber(1)).expect("it is open");
        assert_eq!((held(&trials), trials.due(51).len()), (Some(more), OPEN_TRIALS_PER_CLIENT_MAX - 1));
        assert!(trials.put_aside(TrialNumber(more)).is_some(), "there is room again");
        // One that comes back from the store is nobody's either.
        assert!(trials.remove(TrialNumber(2)).is_some());
        trials.enter(first);
        assert_eq!((held(&trials), trials.len()), (None, OPEN_TRIALS_PER_CLIENT_MAX));
    }

    #[test]
    fn earlier_sessions_of_a_trial_are_remembered_the_latest_last() {
        let mut trials = OpenTrials::default();
        trials.enter(trial(1, "a", 1, 50));
        (1..=EARLIER_SESSIONS_MAX as u64 + 3).for_each(|session| trials.hold_by(TrialNumber(1), session, 0));
        let decision = &trials.get(TrialNumber(1)).expect("it is open").decision;
        assert_eq!(decision.earlier_sessions.len(), EARLIER_SESSIONS_MAX);
        assert_eq!(decision.earlier_sessions.last(), Some(&(EARLIER_SESSIONS_MAX as u64 + 2)));
        assert!(decision.left_behind && !decision.put_aside);
    }
}
