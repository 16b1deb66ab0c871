//! Exploring within means: what a client that explores gets where the policy limits what exploring may cost.
//!
//! [`budget`](super::budget) keeps the account; here it is asked before, and what it says decides the answer.

use crate::ids::{StateId, TrialNumber};
use crate::trial::{Explanation, Mode, Rule};
use crate::tuner::budget::{Denied, Leave, Terms};
use crate::tuner::decide::plain_reason;
use crate::tuner::plan::Planned;
use crate::tuner::{Ask, Prediction, Tuner};

impl Tuner {
    /// The search's next point where the budget allows it, told to stop at the policy's cap.
    pub(super) fn explore_within_means(
        &mut self,
        ask: &Ask,
        number: TrialNumber,
        normalised: &[f64],
        state: StateId,
        planned: &mut Planned,
    ) -> Prediction {
        let policy = &self.spec.policy;
        let weighed = self.visits.of(&ask.client_id).map(|visit| visit.weighed.clone()).unwrap_or_default();
        let (Some(terms), Some(account)) = (Terms::of(policy), self.visits.account(&ask.client_id)) else {
            let cap = policy.abort_above;
            let reference = self.states.knowledge(state).best().map(|best| best.mean_cost);
            let mut prediction = self.explore(state, number, normalised, planned);
            let explanation = &mut prediction.reason.explanation;
            let held = std::mem::take(&mut explanation.held);
            *explanation = Explanation { held, ..weighed };
            if prediction.mode == Mode::Explore
                && let (Some(factor), Some(reference)) = (cap, reference)
            {
                explanation.reference_cost = Some(reference);
                explanation.abort_above = Some(factor * reference).filter(|cost| cost.is_finite());
            }
            return prediction;
        };
        match account.leave(terms, ask.can_abort, self.default_runs(state)) {
            Ok(leave) => {
                let prediction = self.explore(state, number, normalised, planned);
                self.with_leave(leave, weighed, ask, number, prediction)
            }
            Err(denied) => {
                let left = account.left(terms.budget);
                match self.baseline(denied, state) {
                    Some(prediction) => wait_for_budget(denied, left, weighed, prediction),
                    // The only way on is to explore.
                    None => self.explore(state, number, normalised, planned),
                }
            }
        }
    }

    /// An answer with enough set aside for the worst, if it explores.
    fn with_leave(
        &mut self,
        leave: Leave,
        weighed: Explanation,
        ask: &Ask,
        number: TrialNumber,
        mut prediction: Prediction,
    ) -> Prediction {
        let held = std::mem::take(&mut prediction.reason.explanation.held);
        let mut explanation = Explanation {
            held,
            budget_left: Some(leave.left),
            reference_cost: Some(leave.reference),
            ..weighed
        };
        if prediction.mode == Mode::Explore {
            explanation.set_aside = Some(leave.set_aside);
            explanation.abort_above = Some(leave.abort_above);
            if let Some(account) = self.visits.account_mut(&ask.client_id) {
                account.set_aside(number.0, leave.set_aside);
            }
        }
        prediction.reason.explanation = explanation;
        prediction
    }

    /// What is run while the budget does not allow exploring: the default once in each stay, so that what exploring
    /// costs can be told, then the best that was measured there. `None` where there is neither.
    fn baseline(&self, denied: Denied, state: StateId) -> Option<Prediction> {
        if matches!(denied, Denied::NoReference) && self.default_runs(state) {
            let summary =
                "The baseline must be measured before anything is explored within a budget.".to_owned();
            return Some(Prediction {
                configuration: self.spec.space.default_configuration(),
                mode: Mode::Default,
                predicted_cost: self.states.default_cost(state),
                reason: plain_reason("default", summary),
                insight: None,
            });
        }
        let mut known = self.best_known(state)?;
        known.reason.summary.push_str(" Exploring has to wait for its budget.");
        Some(known)
    }
}

fn wait_for_budget(
    denied: Denied,
    left: f64,
    weighed: Explanation,
    mut prediction: Prediction,
) -> Prediction {
    let (set_aside, reference_cost) = match denied {
        Denied::NoReference => (None, None),
        Denied::TooLittle(leave) => (Some(leave.set_aside), Some(leave.reference)),
    };
    prediction.reason.explanation = Explanation {
        rule: Some(Rule::Budget),
        budget_left: Some(left),
        set_aside,
        reference_cost,
        ..weighed
    };
    prediction
}
