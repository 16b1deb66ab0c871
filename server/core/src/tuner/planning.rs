//! The plan that a question needs, and the copies of the tuner for a [`PlanRequest`].

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::configuration::RawConfiguration;
use crate::ids::{MachineId, StateId};
use crate::limits::POINTS_IN_RESERVE_MAX;
use crate::machines::Machines;
use crate::policy::Operation;
use crate::predict::nearest::Nearest;
use crate::predict::{Predictor, Query};
use crate::search::AnySearch;
use crate::session::SessionPolicy;
use crate::trial::Fingerprint;
use crate::tuner::exploring::{Exploiting, Transfer, is_spent};
use crate::tuner::knowledge::States;
use crate::tuner::plan::{PlanRequest, Planned};
use crate::tuner::proposal::Ground;
use crate::tuner::{Ask, Question, Tuner, checks};

impl Tuner {
    /// The computation that a question needs to be answered quickly; `None` where it needs none. `may_plan`
    /// says whether to plan for a state's search: one plan for it at a time is enough.
    pub fn plan(&self, question: &Question<'_>, may_plan: impl Fn(StateId) -> bool) -> Option<PlanRequest> {
        let Question { ask, normalised, state: here } = question;
        let (policy, here) = (&self.spec.policy, *here);
        if policy.pinned.is_some() {
            return None;
        }
        let wishes = self.wishes(&ask.session_policy);
        let explores = wishes.foretold(ask, here, &self.clients)?;
        let (machines, machine) = machines_of(&self.knowledge.states.machines, ask.fingerprint.as_ref());
        let transfer = Transfer { asking: Some((&machines, machine)), ..self.transfer() };
        let query = || transfer.query(normalised, here);
        let (predictor, predictors) = (policy.predictor, &self.knowledge.models.predictors);
        let ground = Ground::of(policy, &ask.session_policy);
        let answer = || {
            if ground == Ground::Measured || !transfer.needs_predictor(here) {
                return None;
            }
            let ahead = Planned::Ahead(Box::default());
            let exploiting = Exploiting { transfer, ..self.exploiting(&ahead) };
            let measured = exploiting.measured_answer(normalised, here);
            predictors.request(predictor, &Query { rival: Some(&measured.configuration), ..query() })
        };
        let first = || predictors.proposal(predictor, &query(), self.clients.trials.last().0 + 1);
        let rival_of = here.filter(|&here| !self.standings().is_settled(here));
        let mut request = PlanRequest { rival_of, ..PlanRequest::nothing(&self.spec) };
        let ends = |here: &StateId| wishes.is_spent(*here) && self.standings().is_to_be_confirmed(*here);
        let answers = if explores {
            here.filter(ends)
        } else {
            state_that_answers(&self.knowledge.states, &query(), here)
        };
        request.assessment = answers.and_then(|state| self.standings().assessment_to_plan(state, None));
        request.beside_start = self
            .standings()
            .start_to_plan(checks::start_of(&self.spec.space, ask), answers.filter(|_| answers == here));
        let tunes = policy.operation == Operation::Tune;
        // The plan may show whether there is anything to exploit.
        let is_unsure = !explores
            && ground == Ground::Predicted
            && here.is_none_or(|here| self.knowledge.states.results(here).best().is_none());
        if !explores || !tunes || here.is_none() && policy.weigh_gain {
            request.portfolio = transfer.evidence_elsewhere(normalised, here);
            request.answer = answer();
        }
        match here.filter(|_| explores || is_unsure) {
            Some(here) if tunes => {
                request.search = self.search_to_plan(ask, here).filter(|(state, ..)| may_plan(*state));
                // A start that the client leaves is taken back before it is answered.
                let held = self.clients.trials.of_client(&ask.client_id, here);
                let is_left = held.is_some_and(|held| self.searches.leaves_start(ask, held));
                let may_propose = is_left || transfer.is_untouched(here);
                if may_propose && !transfer.begins_with_portfolio(normalised, Some(here)) {
                    request.first = first();
                }
                let begins = request.first.is_none() && self.searches.of(here).is_none();
                if begins
                    && transfer.warms_up_searches()
                    && transfer.untried_by_machines(here).is_none()
                    && self.clients.visits.affords(policy, ask, self.standings().default_runs(here))
                {
                    request.evidence = Some((Some(here), transfer.evidence(here)));
                }
            }
            None if here.is_none() && tunes && (explores || is_unsure) => {
                if !transfer.begins_with_portfolio(normalised, None) {
                    request.first = first();
                }
                if request.first.is_none() && transfer.warms_up_searches() {
                    request.evidence = Some((None, transfer.evidence_for(&query())));
                }
            }
            _ => {}
        }
        request.evidence = request.evidence.filter(|(_, evidence)| !evidence.is_empty());
        request.normalised.clone_from(normalised);
        (!request.is_empty()).then_some(request)
    }

    /// Plans a prediction, for [`Tuner::predict_step`].
    pub(super) fn plan_prediction(
        &self,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&RawConfiguration>,
    ) -> Option<PlanRequest> {
        let normalised = self.spec.indicators.normalise(indicators).ok()?;
        let here = self.knowledge.recognise_for(fingerprint, &normalised);
        if self.spec.policy.pinned.is_some() {
            return None;
        }
        let measured = self.exploiting(&Planned::Ahead(Box::default())).measured_answer(&normalised, here);
        let query = self.knowledge.states.query(&self.spec.space, &normalised, here);
        let query = Query { rival: Some(&measured.configuration), ..query };
        let predicts = Ground::of(&self.spec.policy, &SessionPolicy::default()) == Ground::Predicted;
        let asks = predicts && self.transfer().needs_predictor(here);
        let predictors = &self.knowledge.models.predictors;
        let portfolio = self.transfer().evidence_elsewhere(&normalised, here);
        let answer = asks.then(|| predictors.request(self.spec.policy.predictor, &query)).flatten();
        let answers = state_that_answers(&self.knowledge.states, &query, here);
        let assessment = answers.and_then(|state| self.standings().assessment_to_plan(state, None));
        let start = checks::start(&self.spec.space, start).ok()?;
        let beside_start = self.standings().start_to_plan(start, answers.filter(|_| answers == here));
        let rival_of = here.filter(|&here| !self.standings().is_settled(here));
        let nothing = PlanRequest::nothing(&self.spec);
        let request =
            PlanRequest { answer, portfolio, normalised, assessment, beside_start, rival_of, ..nothing };
        (!request.is_empty()).then_some(request)
    }

    /// Plans a question for the best, for [`Tuner::best_step`].
    pub(super) fn plan_best(
        &self,
        indicators: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&RawConfiguration>,
    ) -> Option<PlanRequest> {
        let state = self.knowledge.best_state(&self.spec.indicators, indicators, fingerprint).ok()??;
        let assessment = self.standings().assessment_to_plan(state, None);
        let beside_start =
            self.standings().start_to_plan(checks::start(&self.spec.space, start).ok()?, Some(state));
        let request = PlanRequest { assessment, beside_start, ..PlanRequest::nothing(&self.spec) };
        (!request.is_empty()).then_some(request)
    }

    /// A copy of the state's search, if its next point takes a fit and will be asked for, and the number of
    /// further points for the reserve.
    fn search_to_plan(&self, ask: &Ask, state: StateId) -> Option<(StateId, Box<AnySearch>, usize)> {
        let (policy, results) = (&self.spec.policy, self.knowledge.states.results(state));
        let exploration = self.searches.of(state)?;
        let room = self.wishes(&ask.session_policy).room();
        let mut search = Cow::Borrowed(exploration.search.as_ref()?);
        if !self.spec.objective.fidelities().is_empty() {
            search.to_mut().open_levels(&self.wishes(&ask.session_policy).open_levels(ask.fidelities));
        }
        let goes_on = search.is_of(policy.search)
            && !search.is_ready()
            && !is_spent(exploration, results, policy, room)
            && self.transfer().untried_by_machines(state).is_none();
        if !goes_on || !self.clients.visits.affords(policy, ask, self.standings().default_runs(state)) {
            return None;
        }
        // Where others work on the state too, some of them will ask before the next fit ends.
        let reserve = exploration.open.len().min(POINTS_IN_RESERVE_MAX);
        Some((state, Box::new(search.into_owned()), reserve))
    }
}

/// The machines by the time of a question, when one that is new is known, and the machine that asks.
fn machines_of<'a>(machines: &'a Machines, asks: Option<&Fingerprint>) -> (Cow<'a, Machines>, MachineId) {
    if let Some(machine) = machines.find(asks) {
        return (Cow::Borrowed(machines), machine);
    }
    let mut grown = machines.clone();
    let (machine, _) = grown.note_founder(asks);
    (Cow::Owned(grown), machine)
}

/// The state whose own measurements answer a question, as far as is known before it is answered: its own
/// state where anything was measured there, else the nearest.
fn state_that_answers(states: &States, query: &Query<'_>, here: Option<StateId>) -> Option<StateId> {
    let answers_itself = |state: &StateId| states.results(*state).best().is_some();
    let nearest = || {
        let answer = Nearest.predict(query)?;
        answer.neighbours.first().map(|nearest| StateId(nearest.state_id))
    };
    here.filter(answers_itself).or_else(nearest)
}
