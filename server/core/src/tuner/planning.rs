//! The plan that a question needs, and the copies of the tuner for a [`PlanRequest`].

use std::borrow::Cow;

use crate::configuration::Configuration;
use crate::ids::{MachineId, StateId};
use crate::limits::POINTS_IN_RESERVE_MAX;
use crate::machines::Machines;
use crate::policy::Operation;
use crate::predict::contextual::FitRequest;
use crate::predict::nearest::Nearest;
use crate::predict::{Predictor, Query};
use crate::search::AnySearch;
use crate::session::SessionPolicy;
use crate::trial::Fingerprint;
use crate::tuner::exploring::{Exploiting, Standings, Transfer, Wishes, is_spent};
use crate::tuner::knowledge::States;
use crate::tuner::plan::{PlanRequest, Planned};
use crate::tuner::proposal::Ground;
use crate::tuner::{Question, Tuner, checks};

impl Tuner {
    /// The computation that a question needs to be answered quickly; `None` where it needs none. `may_plan`
    /// says whether to plan for a state's search: one plan for it at a time is enough.
    pub fn plan(&self, question: &Question<'_>, may_plan: impl Fn(StateId) -> bool) -> Option<PlanRequest> {
        let Question { ask, normalised, state: here } = question;
        let (policy, here) = (&self.spec.policy, *here);
        if policy.pinned.is_some() {
            return None;
        }
        let ahead = Planned::Ahead(Box::default());
        let exploiting = self.exploiting(&ahead);
        let wishes = exploiting.wishes(&ask.session_policy);
        let explores = wishes.foretold(ask, here, &self.clients)?;
        let (machines, machine) = machines_of(&self.knowledge.states.machines, ask.fingerprint.as_ref());
        let standings = exploiting.standings;
        let transfer = Transfer { asking: Some((&machines, machine)), ..exploiting.transfer };
        let exploiting = Exploiting { transfer, ..exploiting };
        let query = || transfer.query(normalised, here);
        let number = self.clients.trials.last().next();
        let first = || transfer.models.predictors.proposal(policy.predictor, &query(), number.0);
        let ground = Ground::of(policy, &ask.session_policy);
        let ends = |here: &StateId| wishes.is_spent(*here) && standings.is_to_be_confirmed(*here);
        let answers =
            if explores { here.filter(ends) } else { state_that_answers(transfer.states, &query(), here) };
        let start = checks::start_of(&self.spec.space, ask).filter(|_| answers == here);
        let [assessment, beside_start] = standings.assessments_to_plan(answers, start.as_ref());
        let rival_of = here.filter(|&here| !standings.is_settled(here));
        let nothing = PlanRequest::nothing(&self.spec);
        let mut request = PlanRequest { assessment, beside_start, rival_of, ..nothing };
        let tunes = policy.operation == Operation::Tune;
        // The plan may show whether there is anything to exploit.
        let is_unsure = !explores
            && ground == Ground::Predicted
            && here.is_none_or(|here| transfer.states.results(here).best().is_none());
        if !explores || !tunes || here.is_none() && policy.weigh_gain {
            request.portfolio = transfer.evidence_elsewhere(normalised, here);
            request.answer = exploiting.answer_to_plan(normalised, here, ground);
        }
        match here.filter(|_| explores || is_unsure) {
            Some(here) if tunes => {
                let affords = || self.clients.visits.affords(policy, ask, standings.default_runs(here));
                let is_own = || transfer.untried_by_machines(here).is_none() && affords();
                let search = wishes.search_to_plan(ask.fidelities, here, is_own);
                request.search = search.filter(|(state, ..)| may_plan(*state));
                // A start that the client leaves is taken back before it is answered.
                let held = self.clients.trials.of_client(&ask.client_id, here);
                let is_left = held.is_some_and(|held| self.searches.leaves_start(ask, held));
                let may_propose = is_left || transfer.is_untouched(here);
                if may_propose && !transfer.begins_with_portfolio(normalised, Some(here)) {
                    request.first = first();
                }
                let begins = request.first.is_none() && self.searches.of(here).is_none();
                if begins && transfer.warms_up_searches() && is_own() {
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
}

impl Exploiting<'_> {
    /// The computation that a prediction needs to be made quickly; `None` where it needs none.
    pub(super) fn plan(
        &self,
        normalised: &[f64],
        here: Option<StateId>,
        start: Option<&Configuration>,
    ) -> Option<PlanRequest> {
        let (standings, transfer) = (self.standings, self.transfer);
        let spec = standings.spec;
        if spec.policy.pinned.is_some() {
            return None;
        }
        let ground = Ground::of(&spec.policy, &SessionPolicy::default());
        let answers = state_that_answers(standings.states, &transfer.query(normalised, here), here);
        let [assessment, beside_start] =
            standings.assessments_to_plan(answers, start.filter(|_| answers == here));
        let request = PlanRequest {
            answer: self.answer_to_plan(normalised, here, ground),
            portfolio: transfer.evidence_elsewhere(normalised, here),
            normalised: normalised.to_vec(),
            assessment,
            beside_start,
            rival_of: here.filter(|&here| !standings.is_settled(here)),
            ..PlanRequest::nothing(spec)
        };
        (!request.is_empty()).then_some(request)
    }

    /// The fit of the predictors that answers in place of measurements, where these are not the only ground.
    fn answer_to_plan(
        &self,
        normalised: &[f64],
        here: Option<StateId>,
        ground: Ground,
    ) -> Option<FitRequest> {
        let transfer = self.transfer;
        if ground == Ground::Measured || !transfer.needs_predictor(here) {
            return None;
        }
        let measured = self.measured_answer(normalised, here);
        let query = Query { rival: Some(&measured.configuration), ..transfer.query(normalised, here) };
        transfer.models.predictors.request(transfer.spec.policy.predictor, &query)
    }
}

impl Wishes<'_> {
    /// A copy of the state's search, if its next point takes a fit and will be asked for, and the number of
    /// further points for the reserve. `is_own` says whether the search's next point is what is explored.
    fn search_to_plan(
        &self,
        fidelities: bool,
        state: StateId,
        is_own: impl Fn() -> bool,
    ) -> Option<(StateId, Box<AnySearch>, usize)> {
        let Standings { spec, states, searches, .. } = self.standings;
        let exploration = searches.of(state)?;
        let mut search = Cow::Borrowed(exploration.search.as_ref()?);
        if !spec.objective.fidelities().is_empty() {
            search.to_mut().open_levels(&self.open_levels(fidelities));
        }
        let goes_on = search.is_of(spec.policy.search)
            && !search.is_ready()
            && !is_spent(exploration, states.results(state), &spec.policy, self.room())
            && is_own();
        if !goes_on {
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
