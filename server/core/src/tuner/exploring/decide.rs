//! The decision to explore or to exploit.

use crate::decision::{Choice, ExploitRule, ExploitSource, ExplorationEstimate, ExploreRule};
use crate::ids::StateId;
use crate::policy::Operation;
use crate::session::SessionPolicy;
use crate::trial::{Mode, Rule, Trial};
use crate::tuner::clients::{Clients, Visits};
use crate::tuner::exploring::exploiting::Exploiting;
use crate::tuner::exploring::wishes::{Course, STAY_EXPLORES, Wishes};
use crate::tuner::knowledge::Rechecks;
use crate::tuner::proposal::{Exploitation, Ground};
use crate::tuner::{Ask, Prediction, VisitDecision, checks};

impl Exploiting<'_> {
    /// The answer to every client in shadow operation: the default, or its start.
    pub(crate) fn in_shadow(&self, ask: &Ask, normalised: &[f64], state: StateId) -> Option<Prediction> {
        let spec = self.standings.spec;
        if spec.policy.operation != Operation::Shadow {
            return None;
        }
        let ground = Ground::of(&spec.policy, &SessionPolicy::default());
        let start = checks::start_of(&spec.space, ask);
        let start = start.filter(|start| self.standings.may_run_start(state, start));
        let would = self.exploitation(start.as_ref(), normalised, Some(state), ground);
        let configuration = start.unwrap_or_else(|| spec.space.default_configuration());
        let predicted_cost = self.standings.states.cost_of(state, &configuration);
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
}

impl Wishes<'_> {
    /// The number of the visit that needs a decision in a state, known or not; `None` where the last decision
    /// holds. It does not hold for a session with another policy, nor for a kept configuration that has
    /// proved infeasible or clearly worse than another here. Nor does exploring hold once epsilon is zero, or
    /// an answer that only follows from an earlier policy: the study was frozen, weighed gains or never
    /// explored. Whenever a stay has doubled its length, the dice or the expected gain decide again whether
    /// to explore, unless the policy has the dice thrown once.
    pub(crate) fn decides(&self, ask: &Ask, state: Option<StateId>, visits: &Visits) -> Option<u64> {
        let client_id = &ask.client_id;
        let Some(visit) = visits.of(client_id) else { return Some(1) };
        let Some(state) = state.filter(|state| visit.state_id == state.0) else {
            return Some(visit.number + 1);
        };
        if visits.has_other_wishes(client_id, &ask.session_policy) {
            return Some(visit.number + 1);
        }
        let (policy, results) = (self.policy(), self.standings.states.results(state));
        let stay = self.gain.history.stay(client_id, state);
        let ends = match &visit.decision {
            VisitDecision::Explore { rule, estimate } => {
                // Where nothing else is known, exploring goes on.
                let may_end = *rule == ExploreRule::Dice || results.best().is_some();
                let tried = results.tried() as u64;
                let is_weighed_again = match estimate.until {
                    Some(until) => tried >= until,
                    // A search to be confirmed may have been given a larger budget since.
                    None => *rule == ExploreRule::Dice && !self.is_spent(state),
                };
                may_end && self.never_explores() || policy.weigh_gain && is_weighed_again
            }
            VisitDecision::Exploit { configuration, exploit, .. } => {
                let doubled = stay > 1 && stay.is_power_of_two();
                let start = checks::start_of(&self.standings.spec.space, ask);
                // A search that is over may still have to be confirmed by those who stay.
                let stays = || stay as f64 * self.epsilon(Some(state)) >= STAY_EXPLORES;
                let by_dice = matches!(exploit.rule, ExploitRule::Dice | ExploitRule::RolledBack)
                    || exploit.rule == ExploitRule::Finished && stays();
                let is_thrown_again =
                    || by_dice && !policy.dice_once && self.explores(client_id, visit.number, state);
                let begins_again = exploit.rule == ExploitRule::Finished && !self.is_spent(state);
                let (rule, threw) = (exploit.rule, exploit.estimate.epsilon);
                let is_outdated = rule == ExploitRule::Frozen && policy.operation == Operation::Tune
                    || rule == ExploitRule::Gain && !policy.weigh_gain
                    || threw == Some(0.0) && !self.never_explores();
                results.fails(configuration)
                    || begins_again
                    || is_outdated
                    || self.standings.has_new_start(state, start.as_ref(), visit.since)
                    || self.is_unfounded(state, (configuration, &exploit.source), start.as_ref())
                    || policy.roll_back && self.gain.does_clearly_worse(state, configuration)
                    || doubled
                        && (exploit.rule == ExploitRule::Gain && policy.weigh_gain || is_thrown_again())
            }
        };
        ends.then_some(visit.number)
    }

    /// Whether a client that exploits a finished state is to run another known configuration now, because the
    /// cost of its own has jumped. Where exploring has a budget, or is not wanted, nothing is rechecked.
    pub(crate) fn is_rechecked(&self, client_id: &str, state: StateId, rechecks: &Rechecks) -> bool {
        let policy = self.policy();
        policy.operation == Operation::Tune
            && policy.regret_budget.is_none()
            && self.session.epsilon.unwrap_or(policy.epsilon) > 0.0
            && self.is_finished(state)
            && rechecks.wanted(client_id, state).is_some()
    }

    /// The epsilon-greedy decision for visit `number` of a client to a state (paper section 6).
    ///
    /// Where exploring is over or does not pay, the client exploits. Where no configuration is known, or only
    /// such as were stopped, it explores, or runs the best of these or the default if epsilon is zero.
    pub(crate) fn decide(
        &self,
        exploiting: &Exploiting<'_>,
        ask: &Ask,
        number: u64,
        normalised: &[f64],
        state: StateId,
    ) -> VisitDecision {
        let ground = Ground::of(self.policy(), self.session);
        let start = checks::start_of(&self.standings.spec.space, ask);
        let exploit = || exploiting.exploitation(start.as_ref(), normalised, Some(state), ground);
        let fails = |would: &Exploitation| self.standings.states.results(state).fails(&would.configuration);
        if self.policy().operation == Operation::Freeze {
            return exploit().kept(ExploitRule::Frozen, ExplorationEstimate::default());
        }
        let (would, estimate) = match self.course(&ask.client_id, number, state) {
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
        let (is_default, fails) = (would.source == ExploitSource::Default, fails(&would));
        let exploits = match self.never_explores() {
            // What was stopped here ran elsewhere at least.
            true => !is_default || !fails,
            false => !is_default && !fails,
        };
        if exploits {
            // An open confirmation waits for clients on whom the dice fall.
            let rule = if self.is_spent(state) { ExploitRule::Finished } else { ExploitRule::Dice };
            return would.kept(rule, estimate);
        }
        VisitDecision::Explore { rule: ExploreRule::NothingKnown, estimate }
    }

    /// Whether the policy still wants the client to run a trial that it holds.
    pub(crate) fn still_wants(
        &self,
        ask: &Ask,
        trial: &Trial,
        fixed: Option<&Prediction>,
        visits: &Visits,
    ) -> bool {
        let policy = self.policy();
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
                let account = visits.account(&trial.client_id);
                let covers =
                    |budget| account.is_some_and(|account| account.covers_again(trial.number, budget));
                // A session that explores no more runs it to its end only if it has shown that it runs it, or
                // if nothing else was known.
                let is_wanted = trial.decision.heartbeat
                    || !self.never_explores()
                    || trial.decision.rule() == Some(Rule::NothingKnown);
                policy.operation == Operation::Tune && is_wanted && policy.regret_budget.is_none_or(covers)
            }
            None => !matches!(trial.decision.choice, Choice::Shadow { .. }),
        }
    }

    /// Whether a question will explore, as far as is known before it is answered. `None` where the last
    /// decision holds and its answer is at hand: the client exploits, or gets the trial that it holds again.
    pub(crate) fn foretold(&self, ask: &Ask, here: Option<StateId>, clients: &Clients) -> Option<bool> {
        let (policy, visits) = (self.policy(), &clients.visits);
        if policy.operation == Operation::Shadow {
            return Some(false);
        }
        if let Some(number) = self.decides(ask, here, visits) {
            return Some(match here {
                Some(here) => self.explores(&ask.client_id, number, here),
                None => policy.weigh_gain || self.draws(&ask.client_id, number, None),
            });
        }
        let visit = visits.of(&ask.client_id);
        let exploits = visit.is_none_or(|visit| matches!(visit.decision, VisitDecision::Exploit { .. }));
        let held = here.and_then(|here| clients.trials.of_client(&ask.client_id, here));
        let leaves = |trial: &Trial| self.standings.searches.leaves_start(ask, trial);
        let holds = || held.is_some_and(|trial| !leaves(trial) && self.still_wants(ask, trial, None, visits));
        (!exploits && !holds()).then_some(true)
    }
}
