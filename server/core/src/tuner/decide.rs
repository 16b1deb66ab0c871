//! The decision to explore or to exploit.

use crate::decision::{Choice, ExploitRule, ExploitSource, ExplorationEstimate, ExploreRule};
use crate::ids::StateId;
use crate::policy::Operation;
use crate::session::SessionPolicy;
use crate::tuner::plan::Planned;
use crate::tuner::proposal::Exploitation;
use crate::tuner::session::{Course, STAY_EXPLORES};
use crate::tuner::{Ask, Prediction, Tuner, VisitDecision, checks};

impl Tuner {
    /// The answer to every client in shadow operation: the default, or its start.
    pub(super) fn in_shadow(
        &self,
        ask: &Ask,
        normalised: &[f64],
        state: StateId,
        planned: &Planned,
    ) -> Option<Prediction> {
        if self.spec.policy.operation != Operation::Shadow {
            return None;
        }
        let ground = self.wishes(&SessionPolicy::default()).ground();
        let start = checks::start_of(&self.spec.space, ask)
            .filter(|start| self.standings().may_run_start(state, start));
        let would = self.exploiting(planned).exploitation(start.as_ref(), normalised, Some(state), ground);
        let configuration = start.unwrap_or_else(|| self.spec.space.default_configuration());
        let predicted_cost = self.knowledge.states.cost_of(state, &configuration);
        let costs = would.predicted_cost.zip(predicted_cost);
        let expected_gain =
            costs.map(|(cost, default)| (default - cost) / default).filter(|gain| gain.is_finite());
        let instead_of = would.configuration.to_raw();
        Some(Prediction {
            configuration,
            predicted_cost,
            decision: Choice::Shadow { instead_of, expected_gain }.decided(),
            insight: None,
        })
    }

    /// The number of the visit that needs a decision in a state, known or not; `None` where the last decision
    /// holds. It does not hold for a session with another policy, nor for a kept configuration that has
    /// proved infeasible or clearly worse than another here. Nor does exploring hold once epsilon is zero, or
    /// an answer that only follows from an earlier policy: the study was frozen, weighed gains or never
    /// explored. Whenever a stay has doubled its length, the dice or the expected gain decide again whether
    /// to explore, unless the policy has the dice thrown once.
    pub(super) fn decides(&self, ask: &Ask, state: Option<StateId>) -> Option<u64> {
        let client_id = &ask.client_id;
        let Some(visit) = self.clients.visits.of(client_id) else { return Some(1) };
        let Some(state) = state.filter(|state| visit.state_id == state.0) else {
            return Some(visit.number + 1);
        };
        if self.clients.visits.has_other_wishes(client_id, &ask.session_policy) {
            return Some(visit.number + 1);
        }
        let (policy, stay) = (&self.spec.policy, self.knowledge.history.stay(client_id, state));
        let wishes = self.wishes(&ask.session_policy);
        let ends = match &visit.decision {
            VisitDecision::Explore { rule, estimate } => {
                let results = self.knowledge.states.results(state);
                // Where nothing else is known, exploring goes on.
                let may_end = *rule == ExploreRule::Dice || results.best().is_some();
                let tried = results.tried() as u64;
                let is_weighed_again = match estimate.until {
                    Some(until) => tried >= until,
                    // A search to be confirmed may have been given a larger budget since.
                    None => *rule == ExploreRule::Dice && !wishes.is_spent(state),
                };
                may_end && wishes.never_explores() || policy.weigh_gain && is_weighed_again
            }
            VisitDecision::Exploit { configuration, exploit, .. } => {
                let (doubled, start) =
                    (stay > 1 && stay.is_power_of_two(), checks::start_of(&self.spec.space, ask));
                // A search that is over may still have to be confirmed by those who stay.
                let stays = || stay as f64 * wishes.epsilon(Some(state)) >= STAY_EXPLORES;
                let by_dice = matches!(exploit.rule, ExploitRule::Dice | ExploitRule::RolledBack)
                    || exploit.rule == ExploitRule::Finished && stays();
                let is_thrown_again =
                    || by_dice && !policy.dice_once && wishes.explores(client_id, visit.number, state);
                let begins_again = exploit.rule == ExploitRule::Finished && !wishes.is_spent(state);
                let (rule, threw) = (exploit.rule, exploit.estimate.epsilon);
                let is_outdated = rule == ExploitRule::Frozen && policy.operation == Operation::Tune
                    || rule == ExploitRule::Gain && !policy.weigh_gain
                    || threw == Some(0.0) && !wishes.never_explores();
                self.knowledge.states.results(state).fails(configuration)
                    || begins_again
                    || is_outdated
                    || self.standings().has_new_start(state, start.as_ref(), visit.since)
                    || wishes.is_unfounded(state, (configuration, &exploit.source), start.as_ref())
                    || policy.roll_back
                        && self.knowledge.gain(&self.spec.policy).does_clearly_worse(state, configuration)
                    || doubled
                        && (exploit.rule == ExploitRule::Gain && policy.weigh_gain || is_thrown_again())
            }
        };
        ends.then_some(visit.number)
    }

    /// Whether a client that exploits a finished state is to run another known configuration now, because the
    /// cost of its own has jumped. Where exploring has a budget, or is not wanted, nothing is rechecked.
    pub(super) fn is_rechecked(&self, ask: &Ask, state: StateId) -> bool {
        let policy = &self.spec.policy;
        policy.operation == Operation::Tune
            && policy.regret_budget.is_none()
            && ask.session_policy.epsilon.unwrap_or(policy.epsilon) > 0.0
            && self.wishes(&ask.session_policy).is_finished(state)
            && self.knowledge.rechecks.wanted(&ask.client_id, state).is_some()
    }

    /// The epsilon-greedy decision for visit `number` of a client to a state (paper section 6).
    ///
    /// Where exploring is over or does not pay, the client exploits. Where no configuration is known, it
    /// explores, or runs the default if epsilon is zero.
    pub(super) fn decide(
        &self,
        ask: &Ask,
        number: u64,
        normalised: &[f64],
        state: StateId,
        planned: &Planned,
    ) -> VisitDecision {
        let wishes = self.wishes(&ask.session_policy);
        let (ground, start) = (wishes.ground(), checks::start_of(&self.spec.space, ask));
        let exploiting = self.exploiting(planned);
        let exploit = || exploiting.exploitation(start.as_ref(), normalised, Some(state), ground);
        let fails = |would: &Exploitation| self.knowledge.states.results(state).fails(&would.configuration);
        if self.spec.policy.operation == Operation::Freeze {
            return exploit().kept(ExploitRule::Frozen, ExplorationEstimate::default());
        }
        let (would, estimate) = match wishes.course(&ask.client_id, number, state) {
            Course::Explore(estimate) => return VisitDecision::Explore { rule: ExploreRule::Dice, estimate },
            Course::Finished => return exploit().kept(ExploitRule::Finished, ExplorationEstimate::default()),
            Course::Weighed(estimate) => {
                let would = exploit();
                if !fails(&would) {
                    return would.kept(ExploitRule::Gain, estimate);
                }
                return VisitDecision::Explore { rule: ExploreRule::NothingKnown, estimate };
            }
            Course::Drawn(estimate) => (exploit(), estimate),
        };
        if would.source != ExploitSource::Default || wishes.never_explores() && !fails(&would) {
            // An open confirmation waits for clients on whom the dice fall.
            let rule = if wishes.is_spent(state) { ExploitRule::Finished } else { ExploitRule::Dice };
            return would.kept(rule, estimate);
        }
        VisitDecision::Explore { rule: ExploreRule::NothingKnown, estimate }
    }
}
