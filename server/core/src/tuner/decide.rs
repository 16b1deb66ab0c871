//! Explore or exploit, and what is exploited.

use rand::RngExt;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::knowledge::{KnownState, Record};
use crate::policy::{Operation, PredictorMethod};
use crate::predict::Answer;
use crate::randomness::{Purpose, stream, text_number};
use crate::search::Verdict;
use crate::trial::{Explanation, Mode, Neighbour, Reason, Rule};
use crate::tuner::plan::Planned;
use crate::tuner::{Decision, Prediction, Tuner};

impl Tuner {
    /// The pinned configuration, if the policy has one.
    pub(super) fn pinned(&self) -> Option<Prediction> {
        let configuration = self.spec.policy.pinned.clone()?;
        let summary = "The policy pins this configuration.".into();
        let explanation = Explanation::of(Rule::Pinned);
        let reason = Reason { explanation, ..plain_reason("pinned", summary) };
        Some(Prediction { configuration, mode: Mode::Pinned, predicted_cost: None, reason, insight: None })
    }

    /// What every client gets while the study only looks on.
    pub(super) fn in_shadow(
        &self,
        normalised: &[f64],
        state: StateId,
        planned: &Planned,
    ) -> Option<Prediction> {
        if self.spec.policy.operation != Operation::Shadow {
            return None;
        }
        let would = self.exploitation(normalised, Some(state), planned);
        let default_cost = self.states.default_cost(state);
        let explanation = Explanation {
            instead_of: Some(would.configuration.to_raw()),
            expected_gain: would
                .predicted_cost
                .zip(default_cost)
                .and_then(|(cost, default)| Some((default - cost) / default).filter(|gain| gain.is_finite())),
            ..Explanation::of(Rule::Shadow)
        };
        let summary = "The study answers the default and learns silently.".into();
        Some(Prediction {
            configuration: self.spec.space.default_configuration(),
            mode: Mode::Default,
            predicted_cost: default_cost,
            reason: Reason { explanation, ..plain_reason("shadow", summary) },
            insight: None,
        })
    }

    /// The number of the visit that a decision is to be taken for in a state, known or not; `None` where the last
    /// one holds. A kept configuration that proved infeasible or clearly worse than another here meanwhile is decided
    /// anew, and so is whether exploring pays whenever a stay has doubled its length.
    pub(super) fn decides(&self, client_id: &str, state: Option<StateId>) -> Option<u64> {
        let Some(visit) = self.visits.of(client_id) else {
            return Some(1);
        };
        let Some(state) = state.filter(|state| visit.state_id == state.0) else {
            return Some(visit.number + 1);
        };
        let Decision::Exploit { configuration, reason, .. } = &visit.decision else {
            return None;
        };
        let policy = &self.spec.policy;
        let is_weighed_again = || {
            let stay = self.history.stay(client_id, state);
            let weighed = reason.explanation.rule == Some(Rule::Gain);
            weighed && policy.weigh_gain && stay > 1 && stay.is_power_of_two()
        };
        let ends = self.states.knowledge(state).is_infeasible(configuration)
            || policy.roll_back && self.gain().does_clearly_worse(state, configuration)
            || is_weighed_again();
        ends.then_some(visit.number)
    }

    /// The epsilon-greedy decision for visit `number` of a client to a state (paper section 6).
    ///
    /// Where exploring is over, or does not pay, there is only exploiting; where nothing is known to exploit
    /// there is only exploring, unless epsilon is zero, which leaves the default configuration. Tells what was
    /// weighed as well.
    pub(super) fn decide(
        &self,
        client_id: &str,
        number: u64,
        normalised: &[f64],
        state: StateId,
        planned: &Planned,
    ) -> (Decision, Explanation) {
        let (policy, gain) = (&self.spec.policy, self.gain());
        let epsilon = gain.epsilon(state);
        let weigh = |rule| Explanation { epsilon: Some(epsilon), ..Explanation::of(rule) };
        let mut weighed = match (policy.operation == Operation::Freeze, self.is_finished(state)) {
            (true, _) => Explanation::of(Rule::Frozen),
            (false, true) => Explanation::of(Rule::Finished),
            (false, false) if self.draws(client_id, number, Some(state)) => weigh(Rule::Explore),
            (false, false) => weigh(Rule::Exploit),
        };
        let fails = |configuration: &Configuration| self.states.knowledge(state).is_infeasible(configuration);
        let exploit = || self.exploitation(normalised, Some(state), planned);
        let mut exploitation = None;
        if weighed.rule == Some(Rule::Exploit) {
            let would = &*exploitation.insert(exploit());
            let knows_nothing = would.mode == Mode::Default;
            if knows_nothing && (policy.epsilon > 0.0 || fails(&would.configuration)) {
                weighed.rule = Some(Rule::NothingKnown);
            }
        }
        if matches!(weighed.rule, Some(Rule::Explore | Rule::NothingKnown)) {
            if policy.weigh_gain {
                let prospect = gain.prospect(client_id, state);
                weighed.expected_gain = Some(prospect.gain);
                weighed.expected_frames = Some(prospect.frames);
                weighed.exploring_cost = Some(prospect.exploring_cost);
                if gain.not_worth(state, &prospect).is_some() {
                    let would = &*exploitation.get_or_insert_with(exploit);
                    if !fails(&would.configuration) {
                        weighed.rule = Some(Rule::Gain);
                    }
                }
            }
            if weighed.rule != Some(Rule::Gain) {
                return (Decision::Explore, weighed);
            }
        }
        let exploitation = exploitation.unwrap_or_else(exploit);
        let Prediction { configuration, mode, predicted_cost, mut reason, .. } = exploitation;
        // What was rolled back says so itself.
        if reason.explanation.rule.is_none() {
            reason.explanation = weighed;
        }
        let reason = Box::new(reason);
        (Decision::Exploit { configuration, mode, predicted_cost, reason }, Explanation::default())
    }

    /// Whether the dice of visit `number` of a client to a state, known or not, fall on exploring.
    pub(super) fn draws(&self, client_id: &str, number: u64, state: Option<StateId>) -> bool {
        let draw: f64 = stream(self.spec.seed, Purpose::Decision, text_number(client_id), number).random();
        draw < state.map_or(self.spec.policy.epsilon, |state| self.gain().epsilon(state))
    }

    /// Whether the state's search has spent its budget.
    pub(super) fn is_finished(&self, state: StateId) -> bool {
        self.states.knowledge(state).tried() >= self.spec.policy.trials_per_state as usize
    }

    /// Whether the default can be run in a state, as far as is known.
    pub(super) fn default_runs(&self, state: StateId) -> bool {
        let settled = self.states.knowledge(state).settled(self.spec.space.default_ref(), 1);
        settled != Some(Verdict::Infeasible)
    }

    /// The answer without a search: the best of the state itself once it is explored to the end, else what other
    /// machines know of it as long as that counts for more, else what the policy's predictor says, else (the radial
    /// basis model can be without a clue) what the nearest neighbour says, else the default configuration.
    ///
    /// What is known to do clearly worse here than another measured configuration gives way to that one.
    pub(super) fn exploitation(
        &self,
        normalised: &[f64],
        here: Option<StateId>,
        planned: &Planned,
    ) -> Prediction {
        let answer = self.predicted(normalised, here, planned);
        if self.spec.policy.roll_back
            && let Some(state) = here
            && self.gain().does_clearly_worse(state, &answer.configuration)
            && let Some(mut best) = self.best_known(state)
        {
            best.reason.summary.push_str(" What was predicted did clearly worse here.");
            best.reason.explanation = Explanation::of(Rule::RolledBack);
            return best;
        }
        answer
    }

    fn predicted(&self, normalised: &[f64], here: Option<StateId>, planned: &Planned) -> Prediction {
        if let Some(state) = here.filter(|&state| self.is_finished(state))
            && let Some(prediction) = self.best_known(state)
        {
            return prediction;
        }
        let transfer = self.transfer();
        if let Some(prediction) = here.and_then(|state| transfer.best_by_machines(state)) {
            return prediction;
        }
        if let Some((answer, method)) = transfer.answer(normalised, here, planned) {
            return exploit(answer, method);
        }
        Prediction {
            configuration: self.spec.space.default_configuration(),
            mode: Mode::Default,
            predicted_cost: here.and_then(|state| self.states.default_cost(state)),
            reason: plain_reason("default", "Nothing better is known yet.".into()),
            insight: None,
        }
    }

    /// The best measured configuration of a state.
    pub(super) fn best_known(&self, state: StateId) -> Option<Prediction> {
        let KnownState { id, knowledge, .. } = &self.states[state];
        let Record { configuration, mean_cost, measurements, .. } = knowledge.best()?;
        let summary = format!(
            "Best of {} configurations tried in this state; its cost rests on {measurements} measurements.",
            knowledge.tried()
        );
        let mut reason = plain_reason("best_known", summary);
        reason.neighbours = vec![Neighbour { state_id: *id, distance: 0.0, best_cost: *mean_cost }];
        Some(Prediction {
            configuration: configuration.clone(),
            mode: Mode::Exploit,
            predicted_cost: Some(*mean_cost),
            reason,
            insight: None,
        })
    }
}

fn exploit(answer: Answer, method: PredictorMethod) -> Prediction {
    let Answer { configuration, expected, neighbours } = answer;
    let nearest = neighbours.first();
    let summary = match (method, nearest) {
        (PredictorMethod::NearestNeighbour, Some(Neighbour { state_id, distance, .. })) => format!(
            "Best known configuration of state {state_id}, the nearest known one, at distance {distance:.4}."
        ),
        _ => format!(
            "The model learnt from all trials expects the most of it: {:.4} ± {:.4}; the {} nearest known states are \
             listed.",
            expected.cost,
            expected.deviation,
            neighbours.len()
        ),
    };
    let reason = Reason { neighbours, ..plain_reason(method.name(), summary) };
    let predicted_cost = Some(expected.cost);
    Prediction { configuration, mode: Mode::Exploit, predicted_cost, reason, insight: None }
}

pub(super) fn plain_reason(source: &str, summary: String) -> Reason {
    Reason { summary, source: source.to_owned(), ..Reason::default() }
}
