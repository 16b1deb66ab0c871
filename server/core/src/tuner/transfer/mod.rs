//! Transfer: all that a decision takes from other states and other machines comes through here.
//!
//! - The predictors' best configuration, which carry knowledge from state to state: [`Transfer::answer`] to exploit,
//!   and [`Transfer::first`] to explore where nothing was measured yet.
//! - What other machines found best that met the same input ([`other_machines`]): [`Transfer::best_by_machines`] to exploit,
//!   [`Transfer::untried_by_machines`] to explore.
//! - What a search that begins is told of the nearest states ([`warm_start`]).
//!
//! Which of them is asked in which case is decided by the callers, in `decide` and `explore`. What measurements say of
//! all of these is learnt in `report`, and nowhere else.

mod other_machines;
mod warm_start;

use crate::ids::StateId;
use crate::policy::PredictorMethod;
use crate::predict::{Answer, Query};
use crate::study::StudySpec;
use crate::tuner::models::Models;
use crate::tuner::plan::Planned;
use crate::tuner::searches::Searches;
use crate::tuner::states::States;
use crate::tuner::trials::OpenTrials;

pub(super) use other_machines::compare;
pub(super) use warm_start::{MeasuredElsewhere, WarmStart};

/// What there is to ask.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transfer<'a> {
    pub(super) spec: &'a StudySpec,
    pub(super) states: &'a States,
    pub(super) searches: &'a Searches,
    pub(super) trials: &'a OpenTrials,
    pub(super) models: &'a Models,
}

impl<'a> Transfer<'a> {
    fn query(&self, normalised: &'a [f64], here: Option<StateId>) -> Query<'a> {
        self.states.query(&self.spec.space, normalised, here)
    }

    /// What the policy's predictor would exploit for these indicators, and which one said so; `None` where nothing is
    /// known of any state.
    pub(super) fn answer(
        &self,
        normalised: &'a [f64],
        here: Option<StateId>,
        planned: &Planned,
    ) -> Option<(Answer, PredictorMethod)> {
        let (method, query) = (self.spec.policy.predictor, self.query(normalised, here));
        let predictors = self.models.predictors();
        match planned.of_predictors(normalised) {
            None => predictors.predict(method, &query),
            Some(planned) => predictors.predict_ahead(method, &query, planned.answer),
        }
    }

    /// What to run first in a state where nothing was measured yet, if the predictor can say from elsewhere where much
    /// may be gained. Trial `number` makes answers differ from one to the next.
    pub(super) fn first(
        &self,
        state: StateId,
        number: u64,
        normalised: &'a [f64],
        planned: &Planned,
    ) -> Option<(Answer, PredictorMethod)> {
        if !self.is_untouched(state) {
            return None;
        }
        let (method, query) = (self.spec.policy.predictor, self.query(normalised, Some(state)));
        let predictors = self.models.predictors();
        match planned.of_predictors(normalised) {
            None => predictors.propose(method, &query, number),
            Some(planned) => predictors.propose_ahead(method, &query, number, planned.first),
        }
    }

    /// Whether nothing was begun in a state.
    pub(super) fn is_untouched(&self, state: StateId) -> bool {
        self.searches.of(state).is_none()
            && !self.trials.runs_anything(state)
            && self.states.results(state).tried() == 0
    }

    /// Whether exploiting asks a predictor, not only the tables of the state.
    pub(super) fn needs_predictor(&self, here: Option<StateId>) -> bool {
        let is_known = |here: StateId| {
            let results = self.states.results(here);
            let is_finished = results.tried() >= self.spec.policy.trials_per_state as usize;
            is_finished && results.best().is_some() || self.best_by_machines(here).is_some()
        };
        here.is_none_or(|here| !is_known(here))
    }
}
