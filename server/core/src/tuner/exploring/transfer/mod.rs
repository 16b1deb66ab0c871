//! Transfer: the only way by which results of other states and machines reach a decision.
//!
//! - The answer of other states, for one that is new: [`Transfer::best_elsewhere`].
//! - The predictors' best configuration, which carry knowledge from state to state: [`Transfer::answer`] to
//!   exploit where that is worth its risk, and [`Transfer::first`] to explore where nothing was measured
//!   yet.
//! - The best configuration of other machines that met this input ([`other_machines`]):
//!   [`Transfer::best_by_machines`] to exploit, [`Transfer::untried_by_machines`] to explore.
//! - The evidence of the nearest states for a search that begins (`evidence`, computed in `warm_start`).
//!
//! The callers choose among them, in `decide` and `explore`. All of these learn only in `report`.

mod evidence;
mod other_machines;

use std::collections::BTreeSet;

use crate::configuration::Configuration;
use crate::decision::ExploitSource;
use crate::gp::Posterior;
use crate::gp::acquisition::is_worth;
use crate::ids::{MachineId, StateId};
use crate::machines::Machines;
use crate::policy::PredictorMethod;
use crate::predict::state_index::{Among, IndexEntry};
use crate::predict::{Answer, Nearest, Predictor as _, Query, RUNS_LEAST, WORTH, runs_after};
use crate::results::SEARCHED_LEAST;
use crate::study::StudySpec;
use crate::tuner::clients::OpenTrials;
use crate::tuner::exploring::searches::Searches;
use crate::tuner::knowledge::{MeasuredElsewhere, Models, States, at};
use crate::tuner::plan::Planned;

pub(crate) use other_machines::compare;

/// Number of nearest states that say whether those near by were searched.
const NEAR: usize = 8;
/// Number of nearest states that say whether anything fails.
const RUNS_STATES: usize = 48;

/// The inputs of a transfer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Transfer<'a> {
    pub(crate) spec: &'a StudySpec,
    pub(crate) states: &'a States,
    pub(crate) searches: &'a Searches,
    pub(crate) trials: &'a OpenTrials,
    pub(crate) models: &'a Models,
    /// The machine that asks, and all machines with it, where its state is not there yet; the study's first
    /// one without.
    pub(crate) asking: Option<(&'a Machines, MachineId)>,
}

impl<'a> Transfer<'a> {
    pub(crate) fn query(&self, normalised: &'a [f64], here: Option<StateId>) -> Query<'a> {
        let query = self.states.query(&self.spec.space, normalised, here);
        match self.asking.filter(|_| here.is_none()) {
            Some((machines, machine)) => Query { machines, machine, ..query },
            None => query,
        }
    }

    /// The configuration that the policy's predictor would exploit for these indicators in place of a
    /// measured rival, and the predictor that names it. The configuration was not measured in this state, can
    /// almost surely be run there, and is worth its risk.
    pub(crate) fn answer(
        &self,
        normalised: &'a [f64],
        here: Option<StateId>,
        planned: &Planned,
        rival: &'a Configuration,
    ) -> Option<(Answer, PredictorMethod)> {
        let method = self.spec.policy.predictor;
        let query = Query { rival: Some(rival), ..self.query(normalised, here) };
        let answer = self.models.predictors.predict_fitted(method, &query, planned.answer(normalised));
        answer.filter(|(answer, method)| {
            let configuration = &answer.configuration;
            configuration != rival && !query.excludes(configuration) && self.is_sound(&query, answer, *method)
        })
    }

    /// Whether an answer can almost surely be run and is worth its risk. A contextual model ensures both
    /// itself.
    fn is_sound(&self, query: &Query<'_>, answer: &Answer, method: PredictorMethod) -> bool {
        if method == PredictorMethod::Contextual {
            return true;
        }
        let known = query.rival.and_then(|rival| self.models.predictors.estimate(method, query, rival));
        let Some(known) = known else { return false };
        let change = Posterior {
            mean: answer.expected.cost - known.cost,
            deviation: answer.expected.deviation.max(f64::MIN_POSITIVE),
        };
        let near = query.nearest_tried(RUNS_STATES, RUNS_STATES);
        let near = near.iter().take(RUNS_STATES);
        let tables = near.map(|near| &self.states[at(near.name as usize)].results);
        let records = || tables.clone().flat_map(|results| results.records());
        let mut ran: BTreeSet<&Configuration> = BTreeSet::new();
        is_worth(change, WORTH)
            && records().all(|record| !record.fails())
            // A few of many thousand suffice.
            && records().any(|record| {
                ran.insert(&record.configuration);
                runs_after(ran.len()) >= RUNS_LEAST
            })
    }

    /// The first configuration to run in a state without measurements, if the predictor expects much gain
    /// from other states' measurements. Trial `number` makes answers differ from one to the next.
    pub(crate) fn first(
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
        self.models.predictors.propose(method, &query, number, planned.first(normalised))
    }

    /// Whether the search of a state begins with the best configurations of others: where the states near by
    /// were searched. Where every input is met only once, none was searched, and a predictor proposes
    /// instead.
    pub(crate) fn begins_with_portfolio(&self, normalised: &'a [f64], here: Option<StateId>) -> bool {
        if !self.warms_up_searches() {
            return false;
        }
        let near = self.query(normalised, here).nearest(NEAR, Among::Ran, |other| Some(other.id) != here);
        let was_searched = |near: &&IndexEntry| {
            let state = &self.states[at(near.name as usize)];
            state.explored && state.results.tried() >= SEARCHED_LEAST
        };
        let searched = near.iter().filter(was_searched).count();
        assert!(searched <= near.len() && near.len() <= NEAR, "{searched} of {}", near.len());
        2 * searched > near.len()
    }

    /// The results that [`best_elsewhere`](Transfer::best_elsewhere) answers from, to be computed apart.
    pub(crate) fn evidence_elsewhere(
        &self,
        normalised: &'a [f64],
        here: Option<StateId>,
    ) -> Option<MeasuredElsewhere> {
        let is_known = here.is_some_and(|here| self.states.results(here).best().is_some());
        let evidence = (!is_known).then(|| self.answers_elsewhere(&self.query(normalised, here)))?;
        (!evidence.is_empty()).then_some(evidence)
    }

    /// The incumbent or confirmed winner of other states that serves them best, for a state without a
    /// measured configuration that can be run.
    pub(crate) fn best_elsewhere(
        &self,
        normalised: &'a [f64],
        here: Option<StateId>,
        planned: &Planned,
    ) -> Option<(Configuration, ExploitSource)> {
        let evidence = self.evidence_elsewhere(normalised, here)?;
        let best = planned.portfolio(normalised, || evidence.best(&self.spec.space));
        // The default is an answer only where the states near by were searched and found nothing better.
        let is_found = |best: &Configuration| {
            best != self.spec.space.default_ref() || self.begins_with_portfolio(normalised, here)
        };
        let (best, states) = (best.filter(is_found)?, evidence.states.len() as u64);
        let neighbours = self.neighbours_of(&self.query(normalised, here));
        Some((best, ExploitSource::Portfolio { states, neighbours }))
    }

    /// Whether nothing was begun in a state.
    pub(crate) fn is_untouched(&self, state: StateId) -> bool {
        self.searches.of(state).is_none()
            && !self.trials.runs_anything(state)
            && self.states.results(state).tried() == 0
    }

    /// Whether exploiting asks a predictor, not only the tables of the state.
    pub(crate) fn needs_predictor(&self, here: Option<StateId>) -> bool {
        let is_known = |here: StateId| {
            let results = self.states.results(here);
            let policy = &self.spec.policy;
            let is_finished =
                self.searches.are_spent(here, results, policy, policy.trials_per_state as usize);
            is_finished && results.best().is_some() || self.best_by_machines(here).is_some()
        };
        here.is_none_or(|here| !is_known(here))
    }

    /// The nearest neighbour's answer, among configurations that are not known to fail.
    pub(crate) fn nearest(&self, normalised: &'a [f64], here: Option<StateId>) -> Option<Answer> {
        Nearest.predict(&self.query(normalised, here))
    }
}
