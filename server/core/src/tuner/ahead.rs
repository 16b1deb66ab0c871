//! Thinking apart: what takes a suggestion long is done on copies, before, and without the tuner.
//!
//! A suggestion is a matter of microseconds but for three things: a search with a model fits it, one that begins is
//! told what other states know, and the contextual predictor fits a process to what was measured near by. Where many
//! clients share a tuner they must not wait for that. So whoever holds the tuner first asks for the [`Errand`] of a question, lets go of the tuner, has the errand
//! run, and then asks the question with the [`Thoughts`] that came of it. A question with thoughts never fits a
//! model: where there are none for what it turns out to need (another client changed the state meanwhile, or is
//! thinking about the same search), it is answered from the tables, because a client never waits. A client that is alone
//! gets the same answers either way. One thing is still done at once where nobody thought of it, once for a state:
//! what others tell a search that begins.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::limits::DEBTS_MAX;
use crate::policy::Operation;
use crate::predict::contextual::Request;
use crate::predict::{Answer, Debts, Query, Settled};
use crate::search::{AnySearch, Plan};
use crate::study::StudySpec;
use crate::trial::{Fingerprint, Trial};
use crate::tuner::elsewhere::{Beginning, Others};
use crate::tuner::report::is_spent;
use crate::tuner::weigh::terms;
use crate::tuner::{Ask, Change, Decision, Prediction, Tuner, TunerError, query};

/// What a question needs thought about: copies of what it rests on.
#[derive(Clone, Debug)]
pub struct Errand {
    spec: Arc<StudySpec>,
    normalised: Vec<f64>,
    answer: Option<Request>,
    first: Option<Request>,
    search: Option<(u64, Box<AnySearch>)>,
    /// What others tell the search of a state that begins; one without an id is not there yet.
    others: Option<(Option<u64>, Others)>,
}

/// What came of an [`Errand`].
#[derive(Clone, Debug, Default)]
pub struct Thoughts {
    normalised: Vec<f64>,
    /// What to exploit.
    answer: Option<Answer>,
    /// What to explore first.
    first: Option<Answer>,
    /// The next point of a state's search.
    plan: Option<(u64, Plan)>,
    /// What the search of a state begins with, if anything follows from the others.
    beginning: Option<(Option<u64>, Option<Beginning>)>,
}

impl Errand {
    /// The state whose search it thinks about. Nobody else need do that at the same time.
    pub fn searched_state(&self) -> Option<u64> {
        self.search.as_ref().map(|(state, _)| *state)
    }

    /// Runs it: up to some milliseconds.
    pub fn run(self) -> Thoughts {
        let space = &self.spec.space;
        let answer = |request: Option<Request>| request.and_then(|request| request.answer(space));
        let (answer, first) = (answer(self.answer), answer(self.first));
        let plan = self.search.and_then(|(state, search)| Some((state, search.plan()?)));
        let beginning = self.others.map(|(state, others)| (state, others.beginning(space)));
        Thoughts { normalised: self.normalised, answer, first, plan, beginning }
    }

    fn is_empty(&self) -> bool {
        self.answer.is_none() && self.first.is_none() && self.search.is_none() && self.others.is_none()
    }
}

impl Thoughts {
    pub(super) fn answer(&self, normalised: &[f64]) -> Option<&Answer> {
        self.answer.as_ref().filter(|_| self.normalised == normalised)
    }

    pub(super) fn first(&self, normalised: &[f64]) -> Option<&Answer> {
        self.first.as_ref().filter(|_| self.normalised == normalised)
    }

    pub(super) fn take_beginning(&mut self, state: u64, anchor: &[f64]) -> Option<Option<Beginning>> {
        let is_of = |of: Option<u64>| of.map_or(self.normalised == anchor, |of| of == state);
        self.beginning.take_if(|(of, _)| is_of(*of)).map(|(_, beginning)| beginning)
    }

    pub(super) fn take_plan(&mut self, state: u64) -> Option<Plan> {
        self.plan.take_if(|(planned, _)| *planned == state).map(|(_, plan)| plan)
    }
}

impl Tuner {
    /// What is to be thought about before [`Tuner::suggest_ahead`]; `None` where that is a lookup anyway.
    /// `may_plan` tells of which states' searches: where somebody else already thinks about one, that is enough.
    pub fn errand(&self, ask: &Ask, may_plan: impl Fn(u64) -> bool) -> Option<Errand> {
        let policy = &self.spec.policy;
        if policy.pinned.is_some() {
            return None;
        }
        let normalised = self.spec.indicators.normalise(&ask.indicators).ok()?;
        let here = self.recognise(&ask.client_id, ask.fingerprint.as_ref(), &normalised);
        let found = self.fleet.find(ask.fingerprint.as_ref());
        // A machine that is new is known by the time of the question.
        let grown = found.is_none().then(|| {
            let mut fleet = self.fleet.clone();
            let (machine, _) = fleet.found(ask.fingerprint.as_ref());
            (fleet, machine)
        });
        let (fleet, machine) = match &grown {
            Some((fleet, machine)) => (fleet, *machine),
            None => (&self.fleet, found.unwrap_or_default()),
        };
        let query =
            || Query { machine, ..query(&self.spec, &self.states, &self.atlas, fleet, &normalised, here) };
        let predictor = policy.predictor;
        let answer =
            || self.needs_predictor(here).then(|| self.predictors.request(predictor, &query())).flatten();
        let first = || self.predictors.proposal(predictor, &query(), self.last_trial + 1);
        let mut errand = Errand {
            spec: Arc::clone(&self.spec),
            normalised: Vec::new(),
            answer: None,
            first: None,
            search: None,
            others: None,
        };
        let explores = match self.decides(&ask.client_id, here) {
            _ if policy.operation == Operation::Shadow => false,
            Some(number) => {
                here.is_none_or(|here| !self.is_finished(here)) && self.draws(&ask.client_id, number, here)
            }
            None => {
                let visit = self.visits.get(&ask.client_id);
                if visit.is_none_or(|visit| visit.decision != Decision::Explore) || self.holds(ask, here) {
                    return None;
                }
                true
            }
        };
        match here {
            Some(here) if explores && policy.operation == Operation::Tune => {
                errand.search = self.search_to_plan(ask, here).filter(|(state, _)| may_plan(*state));
                if self.is_untouched(here) {
                    errand.first = first();
                }
                let begins = errand.first.is_none() && self.work[here].exploration.is_none();
                if begins && self.hears_others() && self.transfer(here).is_none() && self.affords(ask, here) {
                    errand.others = Some((Some(self.states[here].id), self.told_by_others(here)));
                }
                if policy.weigh_gain && self.not_worth(here, &self.prospect(&ask.client_id, here)).is_some() {
                    errand.answer = answer();
                }
            }
            None if explores && policy.operation == Operation::Tune => {
                errand.first = first();
                if errand.first.is_none() && self.hears_others() {
                    errand.others = Some((None, self.told_of(&query())));
                }
                // Whether exploring pays is weighed once the state is known.
                errand.answer = policy.weigh_gain.then(answer).flatten();
            }
            _ => errand.answer = answer(),
        }
        errand.others = errand.others.filter(|(_, others)| !others.is_empty());
        errand.normalised.clone_from(&normalised);
        (!errand.is_empty()).then_some(errand)
    }

    /// The same for [`Tuner::predict_ahead`].
    pub fn prediction_errand(
        &self,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
    ) -> Option<Errand> {
        let normalised = self.spec.indicators.normalise(indicators).ok()?;
        let here = self.recognise_for(fingerprint, &normalised);
        if self.spec.policy.pinned.is_some() || !self.needs_predictor(here) {
            return None;
        }
        let query = query(&self.spec, &self.states, &self.atlas, &self.fleet, &normalised, here);
        let answer = Some(self.predictors.request(self.spec.policy.predictor, &query)?);
        let spec = Arc::clone(&self.spec);
        Some(Errand { spec, answer, first: None, search: None, others: None, normalised })
    }

    /// [`Tuner::suggest`] in microseconds, with what was thought of before.
    pub fn suggest_ahead(
        &mut self,
        ask: &Ask,
        thoughts: Thoughts,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        self.thoughts = Some(thoughts);
        let suggested = self.suggest(ask, now_ms);
        self.thoughts = None;
        suggested
    }

    /// [`Tuner::predict`] in microseconds, with what was thought of before.
    pub fn predict_ahead(
        &mut self,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
        thoughts: Thoughts,
    ) -> Result<Prediction, TunerError> {
        self.thoughts = Some(thoughts);
        let predicted = self.predict(indicators, fingerprint);
        self.thoughts = None;
        predicted
    }

    /// From now on reports leave to others what takes the models long: see [`Tuner::debts`].
    pub fn defer(&mut self) {
        self.defers = true;
    }

    /// What reports have left to be settled; `None` where there is nothing. What is not settled in time is settled
    /// by a later report.
    pub fn debts(&self) -> Option<Debts> {
        self.predictors.debts()
    }

    /// Whether reports have left anything to be settled.
    pub fn owes(&self) -> bool {
        self.predictors.owed() > 0
    }

    /// Takes over what was settled, unless somebody was faster.
    pub fn hand_in(&mut self, settled: Settled) {
        self.predictors.hand_in(settled);
    }

    /// Settles here and now what nobody else is to do.
    pub(super) fn settle_debts(&mut self) {
        if !self.defers || self.predictors.owed() > DEBTS_MAX {
            self.predictors.settle_all(&self.spec.space);
        }
    }

    /// Whether the client holds a trial of the state that it will get again.
    fn holds(&self, ask: &Ask, here: Option<usize>) -> bool {
        let held = self.held.get(&ask.client_id).zip(here);
        let number = held.and_then(|(held, here)| held.get(&self.states[here].id));
        number.is_some_and(|&number| self.still_fits(number, None))
    }

    /// A copy of the state's search, if its next point has to be thought about and will be asked for.
    fn search_to_plan(&self, ask: &Ask, state: usize) -> Option<(u64, Box<AnySearch>)> {
        let (policy, knowledge) = (&self.spec.policy, &self.states[state].knowledge);
        let exploration = self.work[state].exploration.as_ref()?;
        let search = exploration.search.as_ref()?;
        let goes_on = search.method() == policy.search
            && !search.is_ready()
            && !is_spent(exploration, knowledge, policy)
            && self.transfer(state).is_none();
        if !goes_on || !self.affords(ask, state) {
            return None;
        }
        let mut copy = exploration.clone();
        let held = self.held_axes(&mut copy, state);
        let mut search = copy.search?;
        search.hold(&held);
        Some((self.states[state].id, Box::new(search)))
    }

    /// Whether the client's budget, if it has one, allows for exploring.
    fn affords(&self, ask: &Ask, state: usize) -> bool {
        let account = self.visits.get(&ask.client_id).and_then(|visit| visit.account.as_ref());
        let Some((budget, account)) = self.spec.policy.regret_budget.zip(account) else {
            return true;
        };
        account.leave(terms(&self.spec.policy, budget), ask.can_abort, self.default_runs(state)).is_ok()
    }

    /// Whether nothing was begun in a state.
    pub(super) fn is_untouched(&self, state: usize) -> bool {
        let work = &self.work[state];
        work.exploration.is_none() && work.running.is_empty() && self.states[state].knowledge.tried() == 0
    }

    /// Whether exploiting asks a predictor, not only the tables of the state.
    fn needs_predictor(&self, here: Option<usize>) -> bool {
        let known = |here: usize| {
            self.is_finished(here) && self.states[here].knowledge.best().is_some()
                || self.best_by_others(here).is_some()
        };
        here.is_none_or(|here| !known(here))
    }
}
