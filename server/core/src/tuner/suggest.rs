//! The first half of a client's frame: its next configuration.

use crate::decision::{BudgetStatus, Choice, Decision, ExploitRule, ExplorationEstimate, ExploreRule};
use crate::ids::{StateId, TrialNumber};
use crate::policy::Operation;
use crate::trial::{Trial, TrialState};
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
        self.knowledge.check_room(found)?;
        self.clients.check_room(&ask.client_id, found)?;
        // From here on nothing fails.
        let state = found.unwrap_or_else(|| {
            self.searches.found(None);
            self.knowledge.found(normalised.clone(), ask.fingerprint.as_ref())
        });
        let changes_before = self.searches.changes(state);
        let mut change = self.lose_to_restart(ask, state, now_ms).unwrap_or_default();
        let visit_before = self.clients.visits.of(&ask.client_id).cloned();
        let fixed = wanted.or_else(|| self.exploiting(&planned).in_shadow(ask, &normalised, state));
        if fixed.is_none() {
            let exploiting = self.exploiting(&planned);
            let wishes = exploiting.wishes(&ask.session_policy);
            if let Some(number) = wishes.decides(ask, Some(state), &self.clients.visits) {
                let decision = wishes.decide(&exploiting, ask, number, &normalised, state);
                change.forgotten.extend(self.clients.visit(&ask.client_id, state, number, decision));
            }
            self.clients.visits.keep_account(ask, &self.spec.policy, state, self.clients.trials.last());
        }
        let held = self.clients.trials.of_client(&ask.client_id, state);
        let wishes = self.exploiting(&planned).wishes(&ask.session_policy);
        let visits = &self.clients.visits;
        let is_wanted = |trial| wishes.still_wants(ask, trial, fixed.as_ref(), visits);
        let held = held.map(|trial| (TrialNumber(trial.number), is_wanted(trial)));
        let trial = match held {
            Some((number, true)) => {
                self.clients.hand_out_again(&ask.client_id, number, &self.spec.policy, now_ms)
            }
            stale => {
                if let Some((number, _)) = stale {
                    let ended = self.clients.end(number);
                    let abandoned = ended.map(|trial| self.racing().take_back(trial, TrialState::Abandoned));
                    change.trials.extend(abandoned);
                }
                let number = self.clients.trials.last().next();
                let mut prediction = match fixed {
                    Some(fixed) => fixed,
                    None => self.by_policy(ask, number, &normalised, state, &mut planned),
                };
                prediction.decision.lost_leases = self.searches.lost_before(state, &prediction.configuration);
                Some(self.clients.hand_out(ask, number, state, prediction, &self.spec.policy, now_ms))
            }
        };
        change.trials.push(trial.expect("a held trial is open"));
        if let Some(visit) = self.clients.visits.of(&ask.client_id)
            && visit_before.as_ref() != Some(visit)
        {
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

    /// The trial that follows from the decision of the client's visit.
    fn by_policy(
        &mut self,
        ask: &Ask,
        number: TrialNumber,
        normalised: &[f64],
        state: StateId,
        planned: &mut Planned,
    ) -> Prediction {
        let wishes = self.exploiting(planned).wishes(&ask.session_policy);
        if let Some(first) = wishes.start_first(ask, state, &self.clients) {
            return first;
        }
        let decided = match self.clients.visits.of(&ask.client_id).map(|visit| &visit.decision) {
            Some(VisitDecision::Exploit { configuration, predicted_cost, exploit, said })
                if !wishes.is_rechecked(&ask.client_id, state, &self.knowledge.rechecks) =>
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
        let wishes = self.exploiting(planned).wishes(&ask.session_policy);
        if let Some(level) = wishes.cheaper_level(ask.fidelities, number, state)
            && let Choice::Explore(explore) = &mut prediction.decision.choice
        {
            // A cost at another level says nothing of the reference.
            explore.abort_above = None;
            prediction.decision.fidelity = Some(level);
        }
        prediction
    }
}
