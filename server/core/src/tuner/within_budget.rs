//! Exploring within a budget: the next configuration of a client that explores where the policy limits its
//! regret.
//!
//! [`budget`](super::budget) keeps the account. It is asked here before a client explores.

use crate::decision::{
    BudgetStatus, Choice, ExploitRule, ExploitSource, ExplorationEstimate, Explore, ExploreRule,
    ExploredPoint,
};
use crate::ids::{StateId, TrialNumber};
use crate::policy::ABORT_ABOVE_STOPPABLE;
use crate::results::{Record, ResultTable};
use crate::robust::is_torn;
use crate::tuner::budget::{Denied, Terms};
use crate::tuner::explore::Explored;
use crate::tuner::exploring::Exploiting;
use crate::tuner::knowledge::GainEvidence;
use crate::tuner::plan::Planned;
use crate::tuner::proposal::Exploitation;
use crate::tuner::{Ask, Prediction, Tuner, checks};

/// Why a client explores, and the estimate of that decision.
pub(super) type ExploreBasis = (ExploreRule, ExplorationEstimate);

impl Tuner {
    /// The search's next point where the budget allows it, to be stopped at the policy's cap.
    pub(super) fn explore_within_budget(
        &mut self,
        ask: &Ask,
        number: TrialNumber,
        normalised: &[f64],
        state: StateId,
        decided: ExploreBasis,
        planned: &mut Planned,
    ) -> Prediction {
        let room = self.exploiting(planned).wishes(&ask.session_policy).room();
        let policy = &self.spec.policy;
        let (Some(terms), Some(account)) = (Terms::of(policy), self.clients.visits.account(&ask.client_id))
        else {
            let own = ask.session_policy.abort_above.or(policy.abort_above);
            let factor = own.or(ask.can_abort.then_some(ABORT_ABOVE_STOPPABLE));
            let pace = self.knowledge.speeds.pace_of(policy, &ask.client_id);
            let reference = reference(self.knowledge.states.results(state));
            let cap = factor.zip(reference.map(|cost| (cost * pace).min(f64::MAX)));
            let explored = self.explore((ask, room), state, number, normalised, planned);
            let (mut budget, mut abort_above) = (BudgetStatus::default(), None);
            if let (true, Some((factor, reference))) = (explored.explores(), cap) {
                budget.reference_cost = Some(reference);
                abort_above = Some(factor * reference).filter(|cost| cost.is_finite());
            }
            return answer(explored, decided, budget, abort_above);
        };
        match account.leave(terms, ask.can_abort, self.standings().default_runs(state)) {
            Ok(leave) => {
                assert!(leave.left >= leave.set_aside, "{} covers {}", leave.left, leave.set_aside);
                let explored = self.explore((ask, room), state, number, normalised, planned);
                let explores = explored.explores();
                let is_charged =
                    explores || runs_dear_incumbent(self.knowledge.gain(&self.spec.policy), &explored, state);
                // Enough for the worst.
                if is_charged && let Some(account) = self.clients.visits.account_mut(&ask.client_id) {
                    account.set_aside(number.0, leave.set_aside);
                }
                let budget = BudgetStatus {
                    budget_left: Some(leave.left),
                    set_aside: is_charged.then_some(leave.set_aside),
                    reference_cost: Some(leave.reference),
                };
                answer(explored, decided, budget, explores.then_some(leave.abort_above))
            }
            Err(denied) => {
                let budget_left = Some(account.left(terms.budget));
                let (set_aside, reference_cost) = match denied {
                    Denied::NoReference => (None, None),
                    Denied::TooLittle(leave) => (Some(leave.set_aside), Some(leave.reference)),
                };
                match self.exploiting(planned).baseline(ask, denied, state) {
                    Some(baseline) => {
                        let budget = BudgetStatus { budget_left, set_aside, reference_cost };
                        baseline.by(ExploitRule::Budget, decided.1, budget)
                    }
                    // The only way on is to explore.
                    None => {
                        let explored = self.explore((ask, room), state, number, normalised, planned);
                        answer(
                            explored,
                            (ExploreRule::NothingKnown, decided.1),
                            BudgetStatus::default(),
                            None,
                        )
                    }
                }
            }
        }
    }
}

impl Exploiting<'_> {
    /// The configuration to run while the budget does not allow exploring: the default, or the client's
    /// start, once in each stay, as a reference for the cost of exploring, then the best measured there.
    /// `None` where there is neither.
    fn baseline(&self, ask: &Ask, denied: Denied, state: StateId) -> Option<Exploitation> {
        let (space, standings) = (&self.standings.spec.space, self.standings);
        let start = checks::start_of(space, ask).filter(|start| standings.may_run_start(state, start));
        if matches!(denied, Denied::NoReference) && (start.is_some() || standings.default_runs(state)) {
            let configuration = start.unwrap_or_else(|| space.default_configuration());
            return Some(Exploitation {
                predicted_cost: standings.states.cost_of(state, &configuration),
                configuration,
                source: ExploitSource::Default,
                rolled_back: false,
            });
        }
        Some(self.beside_start(self.best_known(state, None)?, start.as_ref(), Some(state)))
    }
}

/// Whether an incumbent is measured again that does clearly worse than the best measured configuration.
/// Its cost above the reference then counts as that of exploring.
fn runs_dear_incumbent(gain: GainEvidence<'_>, explored: &Explored, state: StateId) -> bool {
    match explored {
        Explored::Candidate(candidate) => {
            matches!(candidate.point, ExploredPoint::Incumbent { is_default: false, .. })
                && gain.does_clearly_worse(state, &candidate.configuration)
        }
        Explored::Nothing { .. } => false,
    }
}

/// The cost beside which exploring trials are too dear. It is the best known, unless that is a single
/// measurement so far below the next that it was perhaps read wrongly. By that every trial would be stopped
/// at once, and the one that measures it again, too.
fn reference(results: &ResultTable) -> Option<f64> {
    let mut ranked = results.ranked();
    let (best, next) = (ranked.next()?, ranked.next());
    let is_mistaken = |next: &&Record| best.measurements == 1 && is_torn(best.mean_cost, next.mean_cost);
    Some(next.filter(is_mistaken).unwrap_or(best).mean_cost)
}

fn answer(
    explored: Explored,
    (rule, estimate): ExploreBasis,
    budget: BudgetStatus,
    abort_above: Option<f64>,
) -> Prediction {
    match explored {
        Explored::Candidate(candidate) => {
            let explore = Explore { point: candidate.point, rule, estimate, budget, abort_above };
            Prediction {
                configuration: candidate.configuration,
                predicted_cost: candidate.predicted_cost,
                decision: Choice::Explore(explore).decided(),
                insight: None,
            }
        }
        Explored::Nothing { instead, rule } => instead.by(rule, estimate, budget),
    }
}
