//! Transfer: all that a decision takes from other states and other machines comes through here.
//!
//! - The predictors' best configuration, which carry knowledge from state to state: [`Transfer::answer`] to exploit,
//!   and [`Transfer::first`] to explore where nothing was measured yet.
//! - What other machines found best that met the same input ([`other_machines`]): [`Transfer::best_by_machines`] to exploit,
//!   [`Transfer::untried_by_machines`] to explore.
//! - What a search that begins is told of the nearest states (`evidence`, computed in `warm_start`).
//!
//! Which of them is asked in which case is decided by the callers, in `decide` and `explore`. What measurements say of
//! all of these is learnt in `report`, and nowhere else.

mod evidence;
mod other_machines;

use crate::configuration::Configuration;
use crate::decision::ExploitSource;
use crate::ids::StateId;
use crate::policy::PredictorMethod;
use crate::predict::state_index::IndexEntry;
use crate::predict::{Answer, Query};
use crate::results::SEARCHED_LEAST;
use crate::study::StudySpec;
use crate::tuner::models::Models;
use crate::tuner::plan::Planned;
use crate::tuner::searches::Searches;
use crate::tuner::states::{States, at};
use crate::tuner::trials::OpenTrials;
use crate::tuner::warm_start::MeasuredElsewhere;

pub(super) use other_machines::compare;

/// So many of the nearest states say whether those near by were searched.
const NEAR: usize = 8;

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
        if !self.is_untouched(state) || self.begins_with_portfolio(normalised, Some(state)) {
            return None;
        }
        let (method, query) = (self.spec.policy.predictor, self.query(normalised, Some(state)));
        let predictors = self.models.predictors();
        match planned.of_predictors(normalised) {
            None => predictors.propose(method, &query, number),
            Some(planned) => predictors.propose_ahead(method, &query, number, planned.first),
        }
    }

    /// Whether the search of a state begins with what did best in others: where the states near by were searched. Where
    /// inputs are met once, nothing was, and a predictor proposes what to run.
    pub(super) fn begins_with_portfolio(&self, normalised: &'a [f64], here: Option<StateId>) -> bool {
        if !self.warms_up_searches() {
            return false;
        }
        let near = self
            .query(normalised, here)
            .nearest(NEAR, false, |other| Some(other.id) != here && other.results.best().is_some());
        let was_searched = |near: &&IndexEntry| {
            let state = &self.states[at(near.name as usize)];
            state.explored && state.results.tried() >= SEARCHED_LEAST
        };
        2 * near.iter().filter(was_searched).count() > near.len()
    }

    /// Whether the best of a portfolio is what is exploited: the policy leaves the choice of the predictor to us, nothing is
    /// known of the state, and those near by were searched.
    pub(super) fn exploits_portfolio(&self, normalised: &'a [f64], here: Option<StateId>) -> bool {
        self.spec.policy.predictor == PredictorMethod::Auto
            && here.is_none_or(|here| self.states.results(here).tried() == 0)
            && self.begins_with_portfolio(normalised, here)
    }

    /// What a portfolio is made from that [is exploited](Transfer::exploits_portfolio), to be computed apart.
    pub(super) fn portfolio_evidence(
        &self,
        normalised: &'a [f64],
        here: Option<StateId>,
    ) -> Option<MeasuredElsewhere> {
        let exploits = self.exploits_portfolio(normalised, here);
        exploits.then(|| self.evidence_for(&self.query(normalised, here)))
    }

    /// The best of the portfolio, where that is what is exploited.
    pub(super) fn best_of_portfolio(
        &self,
        normalised: &'a [f64],
        here: Option<StateId>,
        planned: &Planned,
    ) -> Option<(Configuration, ExploitSource)> {
        if !self.exploits_portfolio(normalised, here) {
            return None;
        }
        let query = self.query(normalised, here);
        let evidence = self.evidence_for(&query);
        let best = match planned.of_portfolio(normalised) {
            None => evidence.best(&self.spec.space),
            Some(best) => best.cloned(),
        };
        let states = evidence.states() as u64;
        Some((best?, ExploitSource::Portfolio { states, neighbours: self.neighbours_of(&query) }))
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
            let policy = &self.spec.policy;
            let is_finished =
                self.searches.are_spent(here, results, policy, policy.trials_per_state as usize);
            is_finished && results.best().is_some() || self.best_by_machines(here).is_some()
        };
        here.is_none_or(|here| !is_known(here))
    }
}
