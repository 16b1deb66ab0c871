//! Explore or exploit, and what is exploited.

use std::collections::BTreeMap;

use rand::RngExt;

use crate::knowledge::{KnownState, Record};
use crate::policy::PredictorMethod;
use crate::predict::Answer;
use crate::randomness::{Purpose, stream, text_number};
use crate::trial::{Mode, Neighbour, Reason};
use crate::tuner::{Decision, Prediction, Tuner, TunerError, query};

impl Tuner {
    /// What would be exploited for these indicators. Changes nothing.
    pub fn predict(&self, indicators: &BTreeMap<String, f64>) -> Result<Prediction, TunerError> {
        let state = self.spec.indicators.normalise(indicators)?;
        if let Some(pinned) = self.pinned() {
            return Ok(pinned);
        }
        Ok(self.exploitation(&state, self.recognise(None, &state)))
    }

    /// The pinned configuration, if the policy has one.
    pub(super) fn pinned(&self) -> Option<Prediction> {
        let configuration = self.spec.policy.pinned.clone()?;
        let reason = plain_reason("pinned", "The policy pins this configuration.".into());
        Some(Prediction { configuration, mode: Mode::Pinned, predicted_cost: None, reason })
    }

    /// The epsilon-greedy decision for visit `number` of a client to a state (paper section 6).
    ///
    /// Where exploring is over there is only exploiting; where nothing is known to exploit there is only
    /// exploring, unless epsilon is zero, which leaves the default configuration.
    pub(super) fn decide(&self, client_id: &str, number: u64, normalised: &[f64], state: usize) -> Decision {
        let seed = self.spec.seed;
        let draw: f64 = stream(seed, Purpose::Decision, text_number(client_id), number).random();
        let finished = self.is_finished(state);
        if !finished && draw < self.spec.policy.epsilon {
            return Decision::Explore;
        }
        let exploitation = self.exploitation(normalised, Some(state));
        let knows_nothing = exploitation.mode == Mode::Default;
        let default_fails = self.states[state].knowledge.is_infeasible(&exploitation.configuration);
        if !finished && knows_nothing && (self.spec.policy.epsilon > 0.0 || default_fails) {
            return Decision::Explore;
        }
        let Prediction { configuration, mode, predicted_cost, reason } = exploitation;
        Decision::Exploit { configuration, mode, predicted_cost, reason }
    }

    /// Whether the state's search has spent its budget.
    pub(super) fn is_finished(&self, state: usize) -> bool {
        self.states[state].knowledge.tried() >= self.spec.policy.trials_per_state as usize
    }

    /// The answer without a search: the best of the state itself once it is explored to the end, else what
    /// the policy's predictor says, else (the radial basis model can be without a clue) what the nearest
    /// neighbour says, else the default configuration.
    pub(super) fn exploitation(&self, normalised: &[f64], here: Option<usize>) -> Prediction {
        if let Some(state) = here.filter(|&state| self.is_finished(state))
            && let Some(prediction) = self.best_known(state)
        {
            return prediction;
        }
        let query = query(&self.spec, &self.states, &self.atlas, normalised, here);
        if let Some((answer, method)) = self.predictors.predict(self.spec.policy.predictor, &query) {
            return exploit(answer, method);
        }
        Prediction {
            configuration: self.spec.space.default_configuration(),
            mode: Mode::Default,
            predicted_cost: here.and_then(|state| self.default_cost(state)),
            reason: plain_reason("default", "Nothing better is known yet.".into()),
        }
    }

    /// The best measured configuration of a state.
    pub(super) fn best_known(&self, state: usize) -> Option<Prediction> {
        let KnownState { id, knowledge, .. } = &self.states[state];
        let Record { configuration, mean_cost, measurements, .. } = knowledge.best()?;
        let summary = format!(
            "Best of {} configurations tried in this state; its cost is the mean of {measurements} measurements.",
            knowledge.tried()
        );
        let mut reason = plain_reason("best_known", summary);
        reason.neighbours = vec![Neighbour { state_id: *id, distance: 0.0, best_cost: *mean_cost }];
        Some(Prediction {
            configuration: configuration.clone(),
            mode: Mode::Exploit,
            predicted_cost: Some(*mean_cost),
            reason,
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
    Prediction { configuration, mode: Mode::Exploit, predicted_cost: Some(expected.cost), reason }
}

pub(super) fn plain_reason(source: &str, summary: String) -> Reason {
    Reason { summary, source: source.to_owned(), step: String::new(), neighbours: Vec::new() }
}
