//! The first half of a client's frame: its next configuration.

use crate::decision::{BudgetStatus, Choice, Decision, ExploitRule, ExplorationEstimate, ExploreRule};
use crate::ids::{StateId, TrialNumber};
use crate::limits::{STATES_MAX, STATES_OF_NEW_MACHINES_MAX};
use crate::policy::Operation;
use crate::trial::{Mode, Rule, Trial, TrialState};
use crate::tuner::plan::Planned;
use crate::tuner::proposal::Ground;
use crate::tuner::{Ask, Change, Prediction, Question, Tuner, TunerError, VisitDecision, checks};

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
        if found.is_none() && self.knowledge.states.len() >= STATES_MAX + STATES_OF_NEW_MACHINES_MAX {
            return Err(TunerError::TooManyStates);
        }
        self.clients.check_room(&ask.client_id, found)?;
        // From here on nothing fails.
        let state = found.unwrap_or_else(|| {
            self.searches.found(None);
            self.knowledge.found(normalised.clone(), ask.fingerprint.as_ref())
        });
        let mut change = Change::default();
        let changes_before = self.searches.changes(state);
        if let Some(lost) = self.lose_to_restart(ask, state, now_ms) {
            change.trials.extend(lost.trials);
            change.visits.extend(lost.visits);
        }
        let visit_before = self.clients.visits.of(&ask.client_id).cloned();
        let fixed = wanted.or_else(|| self.in_shadow(ask, &normalised, state, &planned));
        if fixed.is_none() {
            if let Some(number) = self.decides(ask, Some(state)) {
                let decision = self.decide(ask, number, &normalised, state, &planned);
                change.forgotten.extend(self.clients.visit(&ask.client_id, state, number, decision));
            }
            self.clients.visits.keep_account(ask, &self.spec.policy, state, self.clients.trials.last());
        }
        let held = self.clients.trials.of_client(&ask.client_id, state);
        let held = held.map(|trial| (TrialNumber(trial.number), self.still_fits(ask, trial, fixed.as_ref())));
        let trial = match held {
            Some((number, true)) => {
                self.clients.hand_out_again(&ask.client_id, number, &self.spec.policy, now_ms)
            }
            stale => {
                if let Some((number, _)) = stale {
                    change.trials.extend(self.take_back(number, TrialState::Abandoned));
                }
                let number = self.clients.trials.last().next();
                let mut prediction = match fixed {
                    Some(fixed) => fixed,
                    None => self.by_policy(ask, number, &normalised, state, &mut planned),
                };
                prediction.decision.lost_leases = self.searches.lost(state, &prediction.configuration);
                Some(self.clients.hand_out(ask, number, state, prediction, &self.spec.policy, now_ms))
            }
        };
        change.trials.push(trial.expect("a held trial is open"));
        let visit = self.clients.visits.of(&ask.client_id);
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
                let account = self.clients.visits.account(&trial.client_id);
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
        let decided = match self.clients.visits.of(&ask.client_id).map(|visit| &visit.decision) {
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
            let (start, ground) = (checks::start_of(&self.spec.space, ask), Ground::Measured);
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
}
