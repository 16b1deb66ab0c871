//! Planning a suggestion apart from the tuner: long computations run before the question, on copies.
//!
//! A suggestion takes microseconds but for three things. A search with a model fits it. A search that begins
//! receives the results of other states. The contextual predictor fits a process to measurements near by.
//! Many clients that share a tuner must not wait for that. So the holder of the tuner makes a [`PlanRequest`]
//! of a question (the [`DecisionStep`] that needs it), lets go of the tuner, [computes](PlanRequest::compute)
//! it, and hands the [`SuggestionPlan`] in with the question. A question with a plan never fits a model. Its
//! plan may lack a needed result, because another client changed the state or plans for its search. The
//! question then gets the search's reserve, or an answer from the tables, because a client never waits. A
//! client that is alone gets equal answers either way. Only the evidence of other states for a search that
//! begins is computed at once where no plan holds it, once for a state.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::predict::contextual::FitRequest;
use crate::predict::{Answer, FitTime};
use crate::search::{AnySearch, PlannedPoint};
use crate::study::StudySpec;
use crate::tuner::knowledge::{Assessment, AssessmentRequest, Assessments, MeasuredElsewhere, WarmStart};

/// The computation before a question can be answered quickly: copies of its inputs.
#[derive(Clone, Debug)]
pub struct PlanRequest {
    pub(super) spec: Arc<StudySpec>,
    pub(super) normalised: Vec<f64>,
    pub(super) answer: Option<FitRequest>,
    pub(super) first: Option<FitRequest>,
    /// The answers of other states, for one in which nothing was measured.
    pub(super) portfolio: Option<MeasuredElsewhere>,
    pub(super) search: Option<(StateId, Box<AnySearch>, usize)>,
    /// The evidence of other states for a search that begins; a state without an id does not exist yet.
    pub(super) evidence: Option<(Option<StateId>, MeasuredElsewhere)>,
    /// The state whose own measurements may give the answer.
    pub(super) assessment: Option<AssessmentRequest>,
    /// The same beside the client's start.
    pub(super) beside_start: Option<AssessmentRequest>,
    /// The state whose assessment gives the answer that a prediction has to beat; `None` where that answer is
    /// known.
    pub(super) rival_of: Option<StateId>,
}

/// One step towards an answer.
#[derive(Clone, Debug)]
pub enum DecisionStep<T> {
    /// This has to be computed apart before the next step.
    Need(Box<PlanRequest>),
    /// The answer.
    Done(T),
}

/// The result of a [`PlanRequest`]. The default plans nothing.
#[derive(Clone, Debug, Default)]
pub struct SuggestionPlan {
    normalised: Vec<f64>,
    /// The answer to exploit.
    answer: Option<Answer>,
    /// The answer to explore first.
    first: Option<Answer>,
    /// The best of a portfolio, to exploit.
    portfolio: Option<Configuration>,
    /// The next point of a state's search.
    point: Option<(StateId, PlannedPoint)>,
    /// The warm start of a state's search, if anything follows from other states.
    beginning: Option<(Option<StateId>, Option<WarmStart>)>,
    /// The assessment of a state.
    assessment: Option<(StateId, Arc<Assessment>)>,
    /// The same beside the client's start.
    beside_start: Option<(StateId, Arc<Assessment>)>,
    /// The state whose assessment was taken from the plan.
    assessed: Option<StateId>,
}

impl PlanRequest {
    pub(super) fn nothing(spec: &Arc<StudySpec>) -> Self {
        PlanRequest {
            spec: Arc::clone(spec),
            normalised: Vec::new(),
            answer: None,
            first: None,
            portfolio: None,
            search: None,
            evidence: None,
            assessment: None,
            beside_start: None,
            rival_of: None,
        }
    }

    /// The state whose search it plans for. One plan for it at a time is enough.
    pub fn searched_state(&self) -> Option<StateId> {
        self.search.as_ref().map(|(state, ..)| *state)
    }

    /// Computes it: up to some milliseconds.
    pub fn compute(self) -> SuggestionPlan {
        let space = &self.spec.space;
        let point = self.search.and_then(|(state, search, reserve)| Some((state, search.plan(reserve)?)));
        let portfolio = self.portfolio.and_then(|evidence| evidence.best(space));
        let beginning = self.evidence.map(|(state, evidence)| (state, evidence.beginning(space)));
        let assess = |request: AssessmentRequest| Some((request.state, Arc::new(request.compute()?)));
        let (assessment, beside_start) =
            (self.assessment.and_then(assess), self.beside_start.and_then(assess));
        // The assessment of the rival may just have been computed.
        let assessed = assessment.as_ref().filter(|(state, _)| Some(*state) == self.rival_of);
        let rival = assessed.map(|(_, assessed)| assessed.answer.clone()).or_else(|| portfolio.clone());
        let beside = |request: FitRequest| match rival {
            Some(rival) => request.beside(rival),
            None => request,
        };
        let answer = self.answer.and_then(|request| beside(request).answer(space));
        let first = self.first.and_then(|request| request.answer(space));
        let normalised = self.normalised;
        SuggestionPlan {
            normalised,
            answer,
            first,
            portfolio,
            point,
            beginning,
            assessment,
            beside_start,
            assessed: None,
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        let answers = self.answer.is_some() || self.first.is_some() || self.portfolio.is_some();
        let assesses = self.assessment.is_some() || self.beside_start.is_some();
        !answers && !assesses && self.search.is_none() && self.evidence.is_none()
    }
}

impl SuggestionPlan {
    /// The indicators that it was made for, normalised; `None` where it plans nothing.
    pub(super) fn normalised(&self) -> Option<&[f64]> {
        let answers = self.answer.is_some() || self.first.is_some() || self.portfolio.is_some();
        let assesses = self.assessment.is_some() || self.beside_start.is_some();
        let is_empty = !answers && !assesses && self.point.is_none() && self.beginning.is_none();
        (!is_empty).then_some(&self.normalised)
    }
}

/// The source of slow computations for an answer.
#[derive(Clone, Debug)]
pub(super) enum Planned {
    /// They run when they are needed.
    AtOnce,
    /// They ran before; the answer does without those that the plan lacks.
    Ahead(Box<SuggestionPlan>),
}

impl Planned {
    /// Whether models may be fitted now.
    pub(super) fn is_at_once(&self) -> bool {
        matches!(self, Planned::AtOnce)
    }

    /// The fit of the predictors that answers for these indicators.
    pub(super) fn answer(&self, normalised: &[f64]) -> FitTime<'_> {
        self.fitted(normalised, |plan| plan.answer.as_ref())
    }

    /// The fit of the predictors that proposes what to explore first for these indicators.
    pub(super) fn first(&self, normalised: &[f64]) -> FitTime<'_> {
        self.fitted(normalised, |plan| plan.first.as_ref())
    }

    fn fitted<'a>(
        &'a self,
        normalised: &[f64],
        answer: impl FnOnce(&'a SuggestionPlan) -> Option<&'a Answer>,
    ) -> FitTime<'a> {
        match self {
            Planned::AtOnce => FitTime::Now,
            Planned::Ahead(plan) => {
                FitTime::Before(answer(plan.as_ref()).filter(|_| plan.normalised == normalised))
            }
        }
    }

    /// The `best` of a portfolio for these indicators.
    pub(super) fn portfolio(
        &self,
        normalised: &[f64],
        best: impl FnOnce() -> Option<Configuration>,
    ) -> Option<Configuration> {
        match self {
            Planned::AtOnce => best(),
            Planned::Ahead(plan) => {
                plan.portfolio.as_ref().filter(|_| plan.normalised == normalised).cloned()
            }
        }
    }

    /// The warm start of the search of a state with this anchor; it `begins` now where that was not planned.
    pub(super) fn beginning(
        &mut self,
        state: StateId,
        anchor: &[f64],
        begins: impl FnOnce() -> Option<WarmStart>,
    ) -> Option<WarmStart> {
        let planned = match self {
            Planned::AtOnce => None,
            Planned::Ahead(plan) => {
                let SuggestionPlan { normalised, beginning, .. } = plan.as_mut();
                let is_of = |of: Option<StateId>| of.map_or(*normalised == anchor, |of| of == state);
                beginning.take_if(|(of, _)| is_of(*of))
            }
        };
        planned.map_or_else(begins, |(_, beginning)| beginning)
    }

    /// Keeps the planned assessments.
    pub(super) fn keep_in(&mut self, assessments: &mut Assessments) {
        let Planned::Ahead(plan) = self else { return };
        let assessed = plan.assessment.take();
        plan.assessed = assessed.as_ref().map(|(state, _)| *state);
        for (state, assessment) in [assessed, plan.beside_start.take()].into_iter().flatten() {
            assessments.keep(state, assessment);
        }
    }

    /// Whether an assessment of a state was made for this question. The state's table may have changed since.
    pub(super) fn has_assessed(&self, state: StateId) -> bool {
        matches!(self, Planned::Ahead(plan) if plan.assessed == Some(state))
    }

    /// The next point of a state's search, if it was planned.
    pub(super) fn take_point(&mut self, state: StateId) -> Option<PlannedPoint> {
        let Planned::Ahead(plan) = self else { return None };
        plan.point.take_if(|(planned, _)| *planned == state).map(|(_, point)| point)
    }
}
