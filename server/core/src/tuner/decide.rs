//! Explore or exploit, and what is exploited.

use std::collections::BTreeMap;

use rand::RngExt;

use crate::knowledge::{KnownState, Record};
use crate::policy::PredictorMethod;
use crate::predict::{Answer, Nearest, Predictor, Query};
use crate::randomness::{Purpose, stream, text_number};
use crate::trial::{Mode, Neighbour, Reason};
use crate::tuner::{Decision, Prediction, Tuner, TunerError};

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
        let query =
            Query { state: normalised, here: here.map(|state| &self.states[state]), known: &self.states };
        let method = self.spec.policy.predictor;
        let answer = match method {
            PredictorMethod::NearestNeighbour => None,
            PredictorMethod::RbfGreedyGq => self.model.predict(&query),
        };
        if let Some(answer) = answer {
            let count = answer.neighbours.len();
            let summary = format!(
                "The model learnt from all trials expects the most of it; the {count} nearest known states are listed."
            );
            return exploit(answer, method, summary);
        }
        if let Some(answer) = Nearest.predict(&query) {
            let nearest = answer.neighbours.first();
            let summary = nearest.map(|Neighbour { state_id, distance, .. }| {
                format!("Best known configuration of state {state_id}, the nearest known one, at distance {distance:.4}.")
            });
            return exploit(answer, PredictorMethod::NearestNeighbour, summary.unwrap_or_default());
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

fn exploit(answer: Answer, method: PredictorMethod, summary: String) -> Prediction {
    let Answer { configuration, predicted_cost, neighbours } = answer;
    let reason = Reason { neighbours, ..plain_reason(method.name(), summary) };
    Prediction { configuration, mode: Mode::Exploit, predicted_cost, reason }
}

pub(super) fn plain_reason(source: &str, summary: String) -> Reason {
    Reason { summary, source: source.to_owned(), step: String::new(), neighbours: Vec::new() }
}
