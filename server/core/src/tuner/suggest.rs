//! The first half of a client's frame: what to run next.

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{CLIENTS_MAX, OPEN_TRIALS_PER_CLIENT_MAX, STATES_MAX};
use crate::policy::Operation;
use crate::trial::{Explanation, Mode, Reason, Rule, Trial, TrialState};
use crate::tuner::decide::plain_reason;
use crate::tuner::{Ask, Change, Decision, Prediction, Tuner, TunerError, Visit, checks};

impl Tuner {
    /// Hands out a trial under a lease, and tells what must be stored before the client may hear of it.
    ///
    /// A client that still holds an open trial for the state gets that one again with a fresh lease (its
    /// answer was lost), unless the policy began or ceased to pin since, or the client's regret budget does not
    /// allow it to be run once more. `now_ms` is the caller's clock.
    pub fn suggest(&mut self, ask: &Ask, now_ms: i64) -> Result<(Trial, Change), TunerError> {
        let fixed = self.pinned();
        self.trial(ask, fixed, now_ms)
    }

    /// Hands out a trial of a configuration that the client wants to measure, as if the policy pinned it for
    /// this one question: the client's visit and the state's search stay as they are.
    pub fn suggest_wanted(
        &mut self,
        ask: &Ask,
        wanted: RawConfiguration,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        let configuration = self.spec.space.configuration(wanted)?;
        let summary = "The client asked for this configuration.".into();
        let explanation = Explanation::of(Rule::Wanted);
        let reason = Reason { explanation, ..plain_reason("wanted", summary) };
        let wanted =
            Prediction { configuration, mode: Mode::Pinned, predicted_cost: None, reason, insight: None };
        self.trial(ask, Some(wanted), now_ms)
    }

    fn trial(
        &mut self,
        ask: &Ask,
        pinned: Option<Prediction>,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        checks::client_id(&ask.client_id)?;
        checks::fingerprint(ask.fingerprint.as_ref())?;
        let normalised = self.spec.indicators.normalise(&ask.indicators)?;
        let found = self.recognise(&ask.client_id, ask.fingerprint.as_ref(), &normalised);
        self.check_room(&ask.client_id, found)?;
        // From here on nothing fails.
        let state = found.unwrap_or_else(|| self.found(normalised.clone(), ask.fingerprint.as_ref()));
        let state_id = self.states[state].id;
        let mut change = Change::default();
        let changes_before = self.work[state].changes;
        let visit_before = self.visits.get(&ask.client_id).cloned();
        let pinned = pinned.or_else(|| self.in_shadow(&normalised, state));
        if pinned.is_none() {
            self.visit(&ask.client_id, &normalised, state);
            self.keep_account(ask, state_id);
        }
        let held = self.held.get(&ask.client_id).and_then(|held| held.get(&state_id)).copied();
        let trial = match held.map(|number| (number, self.still_fits(number, pinned.as_ref()))) {
            Some((number, true)) => {
                if let Some(account) = self.account_mut(&ask.client_id) {
                    account.again(number);
                }
                self.renew(number, now_ms)
            }
            stale => {
                if let Some((number, _)) = stale {
                    change.trials.extend(self.take_back(number, TrialState::Abandoned));
                }
                let number = self.last_trial + 1;
                let prediction = pinned.unwrap_or_else(|| self.answer(ask, number, &normalised, state));
                Some(self.hand_out(ask, number, state_id, prediction, now_ms))
            }
        };
        let trial = trial.expect("a held trial is open");
        change.trials.push(trial.clone());
        let visit = self.visits.get(&ask.client_id);
        change.visits.extend(visit.filter(|visit| Some(*visit) != visit_before.as_ref()).cloned());
        if found.is_none() || self.work[state].changes != changes_before {
            change.states.push(self.state_record(state));
        }
        Ok((trial, change))
    }

    fn check_room(&self, client_id: &str, found: Option<usize>) -> Result<(), TunerError> {
        if found.is_none() && self.states.len() >= STATES_MAX {
            return Err(TunerError::TooManyStates);
        }
        if !self.visits.contains_key(client_id) && self.visits.len() >= CLIENTS_MAX {
            return Err(TunerError::TooManyClients);
        }
        let Some(held) = self.held.get(client_id) else {
            return Ok(());
        };
        let again = found.is_some_and(|state| held.contains_key(&self.states[state].id));
        if !again && held.len() >= OPEN_TRIALS_PER_CLIENT_MAX {
            return Err(TunerError::TooManyOpenTrials { client_id: client_id.to_owned() });
        }
        Ok(())
    }

    /// What every client gets while the study only looks on.
    fn in_shadow(&self, normalised: &[f64], state: usize) -> Option<Prediction> {
        if self.spec.policy.operation != Operation::Shadow {
            return None;
        }
        let would = self.exploitation(normalised, Some(state));
        let explanation = Explanation {
            instead_of: Some(would.configuration.to_raw()),
            expected_gain: would
                .predicted_cost
                .zip(self.default_cost(state))
                .and_then(|(cost, default)| Some((default - cost) / default).filter(|gain| gain.is_finite())),
            ..Explanation::of(Rule::Shadow)
        };
        let summary = "The study answers the default and learns silently.".into();
        Some(Prediction {
            configuration: self.spec.space.default_configuration(),
            mode: Mode::Default,
            predicted_cost: self.default_cost(state),
            reason: Reason { explanation, ..plain_reason("shadow", summary) },
            insight: None,
        })
    }

    /// Notes a change of the client's state and decides for the new visit. A kept configuration that proved
    /// infeasible or clearly worse than another here meanwhile is decided anew, and so is whether exploring pays
    /// whenever a stay has doubled its length.
    fn visit(&mut self, client_id: &str, normalised: &[f64], state: usize) {
        let Some(number) = self.decides(client_id, Some(state)) else {
            return;
        };
        let state_id = self.states[state].id;
        let (decision, weighed) = self.decide(client_id, number, normalised, state);
        let account = self.visits.get(client_id).and_then(|visit| visit.account.clone());
        let visit = Visit { client_id: client_id.to_owned(), state_id, number, decision, weighed, account };
        self.visits.insert(visit.client_id.clone(), visit);
    }

    /// The number of the visit that a decision is to be taken for in a state, known or not; `None` where the last
    /// one holds.
    pub(super) fn decides(&self, client_id: &str, state: Option<usize>) -> Option<u64> {
        let Some(visit) = self.visits.get(client_id) else {
            return Some(1);
        };
        let Some(state) = state.filter(|&state| visit.state_id == self.states[state].id) else {
            return Some(visit.number + 1);
        };
        match &visit.decision {
            Decision::Exploit { configuration, reason, .. }
                if self.states[state].knowledge.is_infeasible(configuration)
                    || self.gives_way(state, configuration)
                    || self.is_weighed_again(client_id, state, reason) =>
            {
                Some(visit.number)
            }
            _ => None,
        }
    }

    fn gives_way(&self, state: usize, configuration: &Configuration) -> bool {
        self.spec.policy.roll_back && self.does_clearly_worse(state, configuration)
    }

    fn is_weighed_again(&self, client_id: &str, state: usize, reason: &Reason) -> bool {
        let stay = self.history.stay(client_id, state);
        let weighed = reason.explanation.rule == Some(Rule::Gain);
        weighed && self.spec.policy.weigh_gain && stay > 1 && stay.is_power_of_two()
    }

    /// Whether a held trial is what the policy would still have the client run.
    pub(super) fn still_fits(&self, number: u64, pinned: Option<&Prediction>) -> bool {
        let Some(trial) = self.open.get(&number) else {
            return false;
        };
        let policy = &self.spec.policy;
        match pinned {
            Some(pinned) => trial.mode == pinned.mode && trial.configuration == pinned.configuration,
            None if trial.mode == Mode::Pinned => false,
            None if trial.mode == Mode::Explore => {
                // What an earlier session explored, or what was handed out before there was a budget, is not covered;
                // nor is another run where there is too little left for one.
                let account = self.visits.get(&trial.client_id).and_then(|visit| visit.account.as_ref());
                let covered = policy
                    .regret_budget
                    .is_none_or(|budget| account.is_some_and(|account| account.covers_again(number, budget)));
                policy.operation == Operation::Tune && covered
            }
            None => trial.reason.explanation.rule != Some(Rule::Shadow),
        }
    }

    fn answer(&mut self, ask: &Ask, number: u64, normalised: &[f64], state: usize) -> Prediction {
        match self.visits.get(&ask.client_id).map(|visit| &visit.decision) {
            Some(Decision::Exploit { configuration, mode, predicted_cost, reason }) => Prediction {
                configuration: configuration.clone(),
                mode: *mode,
                predicted_cost: *predicted_cost,
                reason: reason.as_ref().clone(),
                insight: None,
            },
            _ if self.spec.policy.operation == Operation::Freeze => {
                let mut prediction = self.exploitation(normalised, Some(state));
                prediction.reason.explanation = Explanation::of(Rule::Frozen);
                prediction
            }
            _ => self.explore_within_means(ask, number, normalised, state),
        }
    }

    fn hand_out(
        &mut self,
        ask: &Ask,
        number: u64,
        state_id: u64,
        mut prediction: Prediction,
        now_ms: i64,
    ) -> Trial {
        prediction.reason.explanation.silent = self.is_silent(&ask.client_id);
        let trial = Trial {
            number,
            client_id: ask.client_id.clone(),
            state_id,
            indicators: ask.indicators.clone(),
            configuration: prediction.configuration,
            mode: prediction.mode,
            predicted_cost: prediction.predicted_cost,
            reason: prediction.reason,
            lease_expire_ms: now_ms.saturating_add(self.spec.policy.lease_ms()),
            state: TrialState::Open,
            measurements: Default::default(),
            cost: None,
            outcome: None,
            late: false,
            create_ms: now_ms,
            complete_ms: None,
            completion: None,
            fingerprint: ask.fingerprint.clone(),
        };
        self.last_trial = number;
        self.enter(trial.clone());
        trial
    }

    /// Gives an open trial a fresh lease.
    pub(super) fn renew(&mut self, number: u64, now_ms: i64) -> Option<Trial> {
        let lease_expire_ms = now_ms.saturating_add(self.spec.policy.lease_ms());
        let trial = self.open.get_mut(&number)?;
        self.leases.remove(&(trial.lease_expire_ms, number));
        self.leases.insert((lease_expire_ms, number));
        trial.lease_expire_ms = lease_expire_ms;
        Some(trial.clone())
    }
}
