//! The decision to explore or to exploit.

use rand::RngExt;

use crate::configuration::Configuration;
use crate::decision::{Choice, ExploitRule, ExploitSource, ExplorationEstimate, ExploreRule};
use crate::fnv;
use crate::ids::StateId;
use crate::policy::{Operation, PredictorMethod};
use crate::randomness::{Purpose, stream};
use crate::session::SessionPolicy;
use crate::tuner::plan::Planned;
use crate::tuner::proposal::Exploitation;
use crate::tuner::{Ask, Prediction, Prospect, Tuner, VisitDecision};

/// A client that stays for this number of frames divided by epsilon explores without a draw, unless the
/// policy draws only once.
const STAY_EXPLORES: f64 = 3.0;
/// The length of the stay changes these bits of the number by which a visit's dice are thrown.
const THROWS_SHIFT: u32 = 32;

/// The grounds that an answer may rest on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ground {
    /// Measurements alone: no client gets a configuration that was never run.
    Measured,
    /// A prediction as well, where it is worth its risk.
    Predicted,
}

/// The course of a visit, as far as it follows without the exploited configuration.
enum Course {
    /// It explores.
    Explore(ExplorationEstimate),
    /// It exploits: the search is over.
    Finished,
    /// It exploits a configuration that is not known to fail: exploring does not pay.
    Weighed(ExplorationEstimate),
    /// It exploits what is known: so the dice fell.
    Drawn(ExplorationEstimate),
}

impl Tuner {
    /// The pinned configuration, if the policy has one.
    pub(super) fn pinned(&self) -> Option<Prediction> {
        let configuration = self.spec.policy.pinned.clone()?;
        let decision = Choice::Pinned.decided();
        Some(Prediction { configuration, predicted_cost: None, decision, insight: None })
    }

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
        let start = self.usable_start(ask, state);
        let would = self.exploiting(planned).exploitation(start.as_ref(), normalised, Some(state), ground);
        let configuration = start.unwrap_or_else(|| self.spec.space.default_configuration());
        let predicted_cost = self.states.cost_of(state, &configuration);
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
        let Some(visit) = self.visits.of(client_id) else { return Some(1) };
        let Some(state) = state.filter(|state| visit.state_id == state.0) else {
            return Some(visit.number + 1);
        };
        if self.visits.has_other_wishes(client_id, &ask.session_policy) {
            return Some(visit.number + 1);
        }
        let (policy, stay) = (&self.spec.policy, self.history.stay(client_id, state));
        let ends = match &visit.decision {
            VisitDecision::Explore { rule, estimate } => {
                let results = self.states.results(state);
                // Where nothing else is known, exploring goes on.
                let may_end = *rule == ExploreRule::Dice || results.best().is_some();
                let tried = results.tried() as u64;
                let is_weighed_again = match estimate.until {
                    Some(until) => tried >= until,
                    // A search to be confirmed may have been given a larger budget since.
                    None => *rule == ExploreRule::Dice && !self.wishes(&ask.session_policy).is_spent(state),
                };
                may_end && self.never_explores(&ask.session_policy) || policy.weigh_gain && is_weighed_again
            }
            VisitDecision::Exploit { configuration, exploit, .. } => {
                let doubled = stay > 1 && stay.is_power_of_two();
                let epsilon = || self.wishes(&ask.session_policy).epsilon(Some(state));
                // A search that is over may still have to be confirmed by those who stay.
                let stays = || stay as f64 * epsilon() >= STAY_EXPLORES;
                let by_dice = matches!(exploit.rule, ExploitRule::Dice | ExploitRule::RolledBack)
                    || exploit.rule == ExploitRule::Finished && stays();
                let is_thrown_again =
                    || by_dice && !policy.dice_once && self.explores(ask, visit.number, state);
                let begins_again = exploit.rule == ExploitRule::Finished
                    && !self.wishes(&ask.session_policy).is_spent(state);
                let (rule, threw) = (exploit.rule, exploit.estimate.epsilon);
                let is_outdated = rule == ExploitRule::Frozen && policy.operation == Operation::Tune
                    || rule == ExploitRule::Gain && !policy.weigh_gain
                    || threw == Some(0.0) && !self.never_explores(&ask.session_policy);
                self.states.results(state).fails(configuration)
                    || begins_again
                    || is_outdated
                    || self.has_new_start(ask, state, visit.since)
                    || self.is_unfounded(ask, state, configuration, &exploit.source)
                    || policy.roll_back && self.gain().does_clearly_worse(state, configuration)
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
            && self.rechecks.wanted(&ask.client_id, state).is_some()
    }

    /// Whether a kept configuration was never run in a state while only measurements count: something else
    /// ran there, or nothing but a model names it.
    fn is_unfounded(
        &self,
        ask: &Ask,
        state: StateId,
        configuration: &Configuration,
        source: &ExploitSource,
    ) -> bool {
        let results = self.states.results(state);
        // The nearest neighbour names what ran in another state.
        let nearest = PredictorMethod::NearestNeighbour;
        let is_modelled = matches!(source, ExploitSource::Predictor(by) if by.predictor != nearest);
        self.wishes(&ask.session_policy).ground() == Ground::Measured
            && (results.best().is_some() || is_modelled)
            && results.ran(configuration).is_none()
            && self.start_of(ask).as_ref() != Some(configuration)
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
        let session = &ask.session_policy;
        let (ground, start) = (self.wishes(session).ground(), self.start_of(ask));
        let exploiting = self.exploiting(planned);
        let exploit = || exploiting.exploitation(start.as_ref(), normalised, Some(state), ground);
        let fails = |would: &Exploitation| self.states.results(state).fails(&would.configuration);
        if self.spec.policy.operation == Operation::Freeze {
            return exploit().kept(ExploitRule::Frozen, ExplorationEstimate::default());
        }
        let (would, estimate) = match self.course(ask, number, state) {
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
        if would.source != ExploitSource::Default || self.never_explores(session) && !fails(&would) {
            // An open confirmation waits for clients on whom the dice fall.
            let rule =
                if self.wishes(session).is_spent(state) { ExploitRule::Finished } else { ExploitRule::Dice };
            return would.kept(rule, estimate);
        }
        VisitDecision::Explore { rule: ExploreRule::NothingKnown, estimate }
    }

    /// The course of visit `number` of a client to a state, in a study that is not frozen.
    fn course(&self, ask: &Ask, number: u64, state: StateId) -> Course {
        let (policy, session) = (&self.spec.policy, &ask.session_policy);
        if self.wishes(session).is_finished(state) {
            return Course::Finished;
        }
        let mut estimate = ExplorationEstimate {
            epsilon: Some(self.wishes(session).epsilon(Some(state))),
            ..ExplorationEstimate::default()
        };
        if !(policy.weigh_gain && session.epsilon.unwrap_or(policy.epsilon) > 0.0) {
            let draws = self.draws(ask, number, Some(state));
            return if draws { Course::Explore(estimate) } else { Course::Drawn(estimate) };
        }
        let Prospect { gain, frames, exploring_cost, trials } =
            self.gain().prospect(&ask.client_id, state, self.wishes(session).room());
        estimate.expected_gain = Some(gain);
        estimate.expected_frames = Some(frames);
        estimate.exploring_cost = Some(exploring_cost);
        // A search that its budget ended is still to be confirmed.
        if trials == 0 && !self.wishes(session).is_spent(state) {
            return Course::Weighed(estimate);
        }
        let until = (self.states.results(state).tried() + trials) as u64;
        estimate.until = (trials > 0).then_some(until);
        Course::Explore(estimate)
    }

    /// Whether a client explores a state for which the decision of visit `number` is to be taken, as far as
    /// that is known before the exploited configuration is.
    pub(super) fn explores(&self, ask: &Ask, number: u64, state: StateId) -> bool {
        matches!(self.course(ask, number, state), Course::Explore(_))
    }

    /// Whether the dice of visit `number` of a client to a state, known or not, fall on exploring.
    pub(super) fn draws(&self, ask: &Ask, number: u64, state: Option<StateId>) -> bool {
        if self.wishes(&ask.session_policy).explores_to_the_end() {
            return true;
        }
        let epsilon = self.wishes(&ask.session_policy).epsilon(state);
        let long = state.filter(|_| !self.spec.policy.dice_once);
        let stay = long.map_or(0, |state| self.history.stay(&ask.client_id, state));
        if stay as f64 * epsilon >= STAY_EXPLORES {
            return true;
        }
        // A long stay throws them again, see `decides`.
        let throw = if stay > 1 { number ^ (stay << THROWS_SHIFT) } else { number };
        let client = fnv::hash(ask.client_id.bytes());
        let draw: f64 = stream(self.spec.seed, Purpose::Decision, client, throw).random();
        draw < epsilon
    }
}
