//! The first half of a client's frame: its next configuration.

use crate::decision::{BudgetStatus, Choice, Decision, ExploitRule, ExplorationEstimate, ExploreRule};
use crate::ids::{StateId, TrialNumber};
use crate::limits::{CLIENTS_MAX, OPEN_TRIALS_PER_CLIENT_MAX, STATES_MAX, STATES_OF_NEW_MACHINES_MAX};
use crate::policy::Operation;
use crate::trial::{Mode, Rule, Trial, TrialState};
use crate::tuner::plan::Planned;
use crate::tuner::proposal::Ground;
use crate::tuner::{Ask, Change, Prediction, Question, Tuner, TunerError, Visit, VisitDecision};

impl Tuner {
    /// Answers a question: with the `wanted` configuration where there is one, else by the policy.
    pub(super) fn answer(
        &mut self,
        question: Question<'_>,
        wanted: Option<Prediction>,
        mut planned: Planned,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        let Question { ask, normalised, state: found } = question;
        planned.keep_in(&mut self.knowledge.assessments);
        self.check_room(&ask.client_id, found)?;
        // From here on nothing fails.
        let state = found.unwrap_or_else(|| self.found(normalised.clone(), ask.fingerprint.as_ref()));
        let mut change = Change::default();
        let changes_before = self.searches.changes(state);
        if let Some(lost) = self.lose_to_restart(ask, state, now_ms) {
            change.trials.extend(lost.trials);
            change.visits.extend(lost.visits);
        }
        let visit_before = self.visits.of(&ask.client_id).cloned();
        let fixed = wanted.or_else(|| self.in_shadow(ask, &normalised, state, &planned));
        if fixed.is_none() {
            change.forgotten.extend(self.visit(ask, &normalised, state, &planned));
            self.visits.keep_account(ask, &self.spec.policy, state, self.trials.last());
        }
        let held = self.trials.of_client(&ask.client_id, state);
        let held = held.map(|trial| (TrialNumber(trial.number), self.still_fits(ask, trial, fixed.as_ref())));
        let trial = match held {
            Some((number, true)) => self.hand_out_again(ask, number, now_ms),
            stale => {
                if let Some((number, _)) = stale {
                    change.trials.extend(self.take_back(number, TrialState::Abandoned));
                }
                let number = self.trials.last().next();
                let prediction = match fixed {
                    Some(fixed) => fixed,
                    None => self.by_policy(ask, number, &normalised, state, &mut planned),
                };
                Some(self.hand_out(ask, number, state, prediction, now_ms))
            }
        };
        change.trials.push(trial.expect("a held trial is open"));
        let visit = self.visits.of(&ask.client_id);
        let visit = visit.filter(|visit| Some(*visit) != visit_before.as_ref());
        if let Some(visit) = visit {
            change.visits.retain(|earlier| earlier.client_id != visit.client_id);
            change.visits.push(visit.clone());
        }
        if found.is_none() || self.searches.changes(state) != changes_before {
            change.states.push(self.standings().row(state));
        }
        let trial = change.trials[change.trials.len() - 1].clone();
        assert_eq!((trial.state, trial.state_id), (TrialState::Open, state.0), "it is open in the state");
        assert_eq!(trial.client_id, ask.client_id, "the trial of another client");
        Ok((trial, change))
    }

    fn check_room(&self, client_id: &str, found: Option<StateId>) -> Result<(), TunerError> {
        if found.is_none() && self.knowledge.states.len() >= STATES_MAX + STATES_OF_NEW_MACHINES_MAX {
            return Err(TunerError::TooManyStates);
        }
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

    /// Notes a change of the client's state and decides for the new visit. Where that makes one client too
    /// many, another is forgotten.
    fn visit(&mut self, ask: &Ask, normalised: &[f64], state: StateId, planned: &Planned) -> Option<String> {
        let number = self.decides(ask, Some(state))?;
        let decision = self.decide(ask, number, normalised, state, planned);
        let client_id = ask.client_id.clone();
        let is_one_too_many = self.visits.of(&client_id).is_none() && self.visits.len() >= CLIENTS_MAX;
        let forgotten = is_one_too_many.then(|| self.visits.forget_oldest()).flatten();
        let since = self.trials.last().0;
        self.visits.begin(Visit { client_id, state_id: state.0, number, since, decision, account: None });
        forgotten
    }

    /// Whether the policy still wants the client to run a trial that it holds.
    pub(super) fn still_fits(&self, ask: &Ask, trial: &Trial, fixed: Option<&Prediction>) -> bool {
        let policy = &self.spec.policy;
        match fixed {
            Some(fixed) => {
                // One of an earlier space, which is read as wanted, may be of a cheaper level.
                trial.decision.fidelity.is_none()
                    && trial.mode() == fixed.decision.mode()
                    && trial.configuration == fixed.configuration
            }
            None if trial.mode() == Mode::Pinned => false,
            None if trial.decision.fidelity.is_some() && !ask.fidelities => false,
            None if trial.decision.explores() => {
                // The budget does not cover an exploring trial of an earlier session or of a time without a
                // budget, nor another run where too little is left.
                let account = self.visits.account(&trial.client_id);
                let covers =
                    |budget| account.is_some_and(|account| account.covers_again(trial.number, budget));
                // A session that explores no more runs it to its end only if it has shown that it runs it, or
                // if nothing else was known.
                let is_wanted = trial.decision.heartbeat
                    || !self.wishes(&ask.session_policy).never_explores()
                    || trial.decision.rule() == Some(Rule::NothingKnown);
                policy.operation == Operation::Tune && is_wanted && policy.regret_budget.is_none_or(covers)
            }
            None => !matches!(trial.decision.choice, Choice::Shadow { .. }),
        }
    }

    /// The trial that follows from the decision of the client's visit.
    fn by_policy(
        &mut self,
        ask: &Ask,
        number: TrialNumber,
        normalised: &[f64],
        state: StateId,
        planned: &mut Planned,
    ) -> Prediction {
        if let Some(first) = self.start_first(ask, state) {
            return first;
        }
        let decided = match self.visits.of(&ask.client_id).map(|visit| &visit.decision) {
            Some(VisitDecision::Exploit { configuration, predicted_cost, exploit, said })
                if !self.is_rechecked(ask, state) =>
            {
                let choice = Choice::Exploit(exploit.as_ref().clone());
                return Prediction {
                    configuration: configuration.clone(),
                    predicted_cost: *predicted_cost,
                    decision: Decision { said: said.clone(), ..choice.decided() },
                    insight: None,
                };
            }
            Some(VisitDecision::Explore { rule, estimate }) => (*rule, *estimate),
            _ => (ExploreRule::Dice, ExplorationEstimate::default()),
        };
        if self.spec.policy.operation == Operation::Freeze {
            let (start, ground) = (self.start_of(ask), Ground::Measured);
            let known =
                self.exploiting(planned).exploitation(start.as_ref(), normalised, Some(state), ground);
            return known.by(ExploitRule::Frozen, ExplorationEstimate::default(), BudgetStatus::default());
        }
        let mut prediction = self.explore_within_budget(ask, number, normalised, state, decided, planned);
        if let Some(level) = self.wishes(&ask.session_policy).cheaper_level(ask.fidelities, number, state)
            && let Choice::Explore(explore) = &mut prediction.decision.choice
        {
            // A cost at another level says nothing of the reference.
            explore.abort_above = None;
            prediction.decision.fidelity = Some(level);
        }
        prediction
    }

    fn hand_out(
        &mut self,
        ask: &Ask,
        number: TrialNumber,
        state: StateId,
        mut prediction: Prediction,
        now_ms: i64,
    ) -> Trial {
        prediction.decision.silent = self.visits.is_silent(ask, &self.spec.policy);
        prediction.decision.session = ask.session;
        prediction.decision.lost_leases = self.searches.lost(state, &prediction.configuration);
        let Prediction { configuration, decision, predicted_cost, .. } = prediction;
        let trial = Trial {
            indicators: ask.indicators.clone(),
            predicted_cost,
            lease_expire_ms: now_ms.saturating_add(self.spec.policy.lease_ms()),
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
    fn hand_out_again(&mut self, ask: &Ask, number: TrialNumber, now_ms: i64) -> Option<Trial> {
        if let Some(account) = self.visits.account_mut(&ask.client_id) {
            account.again(number.0);
        }
        self.renew(number, now_ms)
    }

    /// Gives an open trial a fresh lease.
    pub(super) fn renew(&mut self, number: TrialNumber, now_ms: i64) -> Option<Trial> {
        let expire_ms = now_ms.saturating_add(self.spec.policy.lease_ms());
        self.trials.renew(number, expire_ms).cloned()
    }

    /// Founds a state of a machine with these indicators as its anchor.
    pub(super) fn found(
        &mut self,
        anchor: Vec<f64>,
        fingerprint: Option<&crate::trial::Fingerprint>,
    ) -> StateId {
        self.searches.found(None);
        let state = self.knowledge.found(anchor, fingerprint);
        assert!(self.searches.record(state).is_none(), "nothing was begun");
        state
    }
}
