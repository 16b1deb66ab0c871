//! The second half of a client's frame, and the other ends of a trial.

use std::collections::BTreeMap;

use crate::ids::{StateId, TrialNumber};
use crate::objective::Objective;
use crate::trial::{Outcome, Trial, TrialState};
use crate::tuner::{Change, Tuner, TunerError};

impl Tuner {
    /// Takes a completed trial out of the open ones, learns it, and passes its result to its search.
    pub(super) fn take(&mut self, completed: &Trial) -> Change {
        let (state, number) = (StateId(completed.state_id), TrialNumber(completed.number));
        let (before, tried) = (self.searches.changes(state), self.knowledge.states.results(state).tried());
        self.clients.end(number);
        let is_few = self.searches.few().count().is_some();
        let learnt = self.knowledge.complete(&self.spec, is_few, completed);
        if learnt.has_changed {
            self.searches.begin_again(state);
            self.knowledge.states.forget_search(state);
        }
        if learnt.has_jumped
            && let Some(exploration) = self.searches.change(state)
        {
            // The search learnt costs that are no longer believed. Another search begins with the rest of the
            // table.
            exploration.end();
        }
        if !matches!(completed.outcome, Some(Outcome::Failed { .. })) {
            self.searches.forgive(state, &completed.configuration);
        }
        self.racing().stand_beside_start(completed, tried);
        let mut change = Change { trials: vec![completed.clone()], ..Change::default() };
        change.visits.extend(self.clients.visits.settle(&self.spec, completed));
        match completed.decision.fidelity {
            Some(_) => {
                let pace = self.knowledge.speeds.pace_of(&self.spec.policy, &completed.client_id);
                self.racing().tell_cheaper(completed, pace);
            }
            None => self.racing().tell_in_full(completed, &learnt),
        }
        if self.searches.changes(state) != before {
            change.states.push(self.standings().row(state));
        }
        change
    }
}

/// A trial with its result, which the caller has checked.
pub(super) fn completed(
    objective: &Objective,
    trial: &Trial,
    measurements: BTreeMap<String, f64>,
    outcome: Outcome,
    completion: u64,
    now_ms: i64,
) -> Result<Trial, TunerError> {
    // A limit holds for full trials, and so does a cost.
    let is_full = trial.decision.fidelity.is_none();
    let beyond = match outcome {
        Outcome::Ok if is_full => objective.beyond(&measurements)?,
        _ => None,
    };
    let outcome = beyond.map_or(outcome, Outcome::infeasible);
    let cost = match &outcome {
        Outcome::Ok => Some(objective.cost(&measurements)?),
        Outcome::Aborted { lower_bound } => Some(*lower_bound + 0.0),
        Outcome::Infeasible { .. } | Outcome::Failed { .. } => None,
    };
    Ok(Trial {
        late: trial.state == TrialState::Expired || now_ms > trial.lease_expire_ms,
        state: TrialState::Completed,
        measurements,
        cost: cost.filter(|_| is_full),
        outcome: Some(outcome),
        complete_ms: Some(now_ms),
        completion: Some(completion),
        ..trial.clone()
    })
}
