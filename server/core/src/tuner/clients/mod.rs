//! The clients of a study: their visits and budgets, and the trials that they hold.

mod trials;
mod visits;

pub(crate) use trials::OpenTrials;
pub(crate) use visits::Visits;

use crate::ids::{StateId, TrialNumber};
use crate::limits::{CLIENTS_MAX, OPEN_TRIALS_PER_CLIENT_MAX};
use crate::policy::Policy;
use crate::trial::Trial;
use crate::tuner::{Ask, Prediction, TunerError, Visit, VisitDecision};

/// The clients of a study, and the trials that they hold.
#[derive(Clone, Debug)]
pub struct Clients {
    pub(crate) visits: Visits,
    pub(crate) trials: OpenTrials,
    /// Leases that end up to this time, in milliseconds, do not count as lost.
    pardoned_until_ms: i64,
}

impl Clients {
    /// Nobody has come yet.
    pub(crate) fn new() -> Self {
        Clients { visits: Visits::default(), trials: OpenTrials::default(), pardoned_until_ms: i64::MIN }
    }

    /// An open trial.
    pub fn open_trial(&self, number: u64) -> Option<&Trial> {
        self.trials.get(TrialNumber(number))
    }

    /// The open trials, by rising number.
    pub fn open_trials(&self) -> impl Iterator<Item = &Trial> {
        self.trials.all()
    }

    /// The end of the next lease, in milliseconds of the caller's clock.
    pub fn next_expiry_ms(&self) -> Option<i64> {
        self.trials.next_expiry_ms()
    }

    /// Leases that end up to `until_ms` say nothing of their configurations, because no report could be taken
    /// until then. They end as any other and do not count as lost. A time before that of an earlier call
    /// changes nothing.
    pub fn pardon_leases(&mut self, until_ms: i64) {
        self.pardoned_until_ms = self.pardoned_until_ms.max(until_ms);
    }

    /// Whether the end of a trial's lease says nothing.
    pub(crate) fn is_pardoned(&self, trial: &Trial) -> bool {
        trial.lease_expire_ms <= self.pardoned_until_ms
    }

    /// Charges nothing for a trial that was just handed out and that its client never hears of, because it
    /// gets [another](crate::tuner::Tuner::suggest_wanted).
    pub fn forgo(&mut self, trial: &Trial) {
        if let Some(account) = self.visits.account_mut(&trial.client_id) {
            account.forgo(trial.number);
        }
    }

    /// Whether a trial was ever handed out, by its number.
    pub(crate) fn handed_out(&self, trial: &Trial) -> bool {
        trial.number <= self.trials.last().0
    }

    /// Whether a client may hold one more trial, of a state that was `found` or of a new one.
    pub(crate) fn check_room(&self, client_id: &str, found: Option<StateId>) -> Result<(), TunerError> {
        let (is_new, held) = (self.visits.of(client_id).is_none(), self.trials.held_by(client_id));
        // A client without an open trial can be forgotten, unless every client holds one. Those of a pinned
        // study hold trials without a visit.
        let (visits, holders) = (self.visits.len(), self.trials.holders());
        let none_goes = visits >= CLIENTS_MAX && holders >= visits;
        if is_new && (none_goes || held == 0 && holders >= CLIENTS_MAX) {
            return Err(TunerError::TooManyClients);
        }
        let again = found.is_some_and(|state| self.trials.of_client(client_id, state).is_some());
        if !again && held >= OPEN_TRIALS_PER_CLIENT_MAX {
            return Err(TunerError::TooManyOpenTrials(client_id.to_owned()));
        }
        Ok(())
    }

    /// Notes the decision for visit `number` of a client. Where that makes one client too many, another is
    /// forgotten.
    pub(crate) fn visit(
        &mut self,
        client_id: &str,
        state: StateId,
        number: u64,
        decision: VisitDecision,
    ) -> Option<String> {
        let is_one_too_many = self.visits.of(client_id).is_none() && self.visits.len() >= CLIENTS_MAX;
        let forgotten = is_one_too_many.then(|| self.visits.forget_oldest()).flatten();
        let (client_id, since) = (client_id.to_owned(), self.trials.last().0);
        self.visits.begin(Visit { client_id, state_id: state.0, number, since, decision, account: None });
        forgotten
    }

    /// Hands out a trial of the predicted configuration.
    pub(crate) fn hand_out(
        &mut self,
        ask: &Ask,
        number: TrialNumber,
        state: StateId,
        prediction: Prediction,
        policy: &Policy,
        now_ms: i64,
    ) -> Trial {
        let Prediction { configuration, mut decision, predicted_cost, .. } = prediction;
        decision.silent = self.visits.is_silent(ask, policy);
        decision.session = ask.session;
        let trial = Trial {
            indicators: ask.indicators.clone(),
            predicted_cost,
            lease_expire_ms: now_ms.saturating_add(policy.lease_ms()),
            create_ms: now_ms,
            fingerprint: ask.fingerprint.clone(),
            ..Trial::new(number.0, &ask.client_id, state.0, configuration, decision)
        };
        assert!(number > self.trials.last(), "{number:?} was handed out before");
        self.trials.enter(trial.clone());
        self.visits.note_held(&ask.client_id, true);
        assert_eq!(self.trials.last(), number, "it is the last");
        trial
    }

    /// Hands a trial out again whose answer was lost. The client may have run it.
    pub(crate) fn hand_out_again(
        &mut self,
        client_id: &str,
        number: TrialNumber,
        policy: &Policy,
        now_ms: i64,
    ) -> Option<Trial> {
        if let Some(account) = self.visits.account_mut(client_id) {
            account.again(number.0);
        }
        self.renew(number, policy, now_ms)
    }

    /// Gives an open trial a fresh lease.
    pub(crate) fn renew(&mut self, number: TrialNumber, policy: &Policy, now_ms: i64) -> Option<Trial> {
        self.trials.renew(number, now_ms.saturating_add(policy.lease_ms())).cloned()
    }

    /// Takes an open trial from its client, which gets others in its place. It stays open under its lease.
    /// `None` where too many were put aside for the client.
    pub(crate) fn put_aside(&mut self, number: TrialNumber) -> Option<Trial> {
        let aside = self.trials.put_aside(number)?;
        self.visits.note_held(&aside.client_id, self.trials.held_by(&aside.client_id) > 0);
        Some(aside)
    }

    /// Takes a trial out of the open ones.
    pub(crate) fn end(&mut self, number: TrialNumber) -> Option<Trial> {
        let trial = self.trials.remove(number)?;
        self.visits.note_held(&trial.client_id, self.trials.held_by(&trial.client_id) > 0);
        Some(trial)
    }
}
