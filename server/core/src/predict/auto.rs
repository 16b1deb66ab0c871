//! All predictors of a study, and the choice among them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::policy::PredictorMethod;
use crate::predict::blend::Tallies;
use crate::predict::contextual::Request;
use crate::predict::deferred::{ComputedUpdates, DeferredUpdate, DeferredUpdates};
use crate::predict::prequential::Interval;
use crate::predict::{
    Answer, Contextual, Estimate, LeastSquares, Lesson, Nearest, Predictor, Query, Rbf, Shape, Weighted,
};
use crate::space::Space;

/// Every trial is a test until there were so many; from then on one in
const TESTS_EAGER: u64 = 256;
/// so many is, so that a report stays cheap.
const TESTS_SHARE: u64 = 16;
/// The contextual model answers and proposes unless it errs by more than this times the least error, and by more
/// than this altogether: it alone knows of configurations that nobody tried. By error alone the choice would
/// confirm itself: who always repeats one configuration predicts its cost well.
const TRUSTED: f64 = 3.0;
const TRUSTED_ERROR: f64 = 0.25;
/// Fewer tests than this do not tell predictors apart.
const TESTS_MIN: u64 = 8;

/// The models that a study's policy needs: those of its predictor, which for [`PredictorMethod::Auto`] are all,
/// each trained on every trial, and what they were tested to be worth. The neighbours need none: they answer from
/// the tables of the states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Predictors {
    printed: Option<Rbf>,
    gaussian: Option<Rbf>,
    least_squares: Option<LeastSquares>,
    contextual: Option<Contextual>,
    /// Whether there is a choice to be made, for which all are tested.
    chooses: bool,
    trials: u64,
    tallies: Tallies,
    /// What is yet to be computed, oldest first. It all [is](Predictors::apply_all) before a checkpoint is stored.
    #[serde(skip)]
    deferred: Vec<Arc<DeferredUpdate>>,
}

impl Predictors {
    /// What `method` needs, having seen nothing yet; centres and choices are drawn from the study's seed.
    /// `mute` are the places of indicators that features leave out.
    pub fn new(method: PredictorMethod, space: &Space, indicators: usize, seed: u64, mute: &[usize]) -> Self {
        let dimension = space.dimension();
        let chooses = method == PredictorMethod::Auto;
        let needs = |single| chooses || method == single;
        let rbf = |shape| Rbf::new(shape, dimension, indicators, seed, mute);
        Predictors {
            printed: needs(PredictorMethod::RbfGreedyGq).then(|| rbf(Shape::Printed)),
            gaussian: needs(PredictorMethod::GaussianGreedyGq).then(|| rbf(Shape::Gaussian)),
            least_squares: needs(PredictorMethod::LeastSquares)
                .then(|| LeastSquares::new(dimension, indicators, seed, mute)),
            contextual: needs(PredictorMethod::Contextual).then(|| Contextual::new(space, indicators, seed)),
            chooses,
            trials: 0,
            tallies: Tallies::default(),
            deferred: Vec::new(),
        }
    }

    /// Whether trials are tests.
    pub fn are_tested(&self) -> bool {
        self.chooses
    }

    /// Whether `method` needs a model at all.
    pub fn are_needed(method: PredictorMethod) -> bool {
        !matches!(method, PredictorMethod::NearestNeighbour | PredictorMethod::WeightedNeighbours)
    }

    /// Makes what was read from a checkpoint whole. `false` when a configuration does not fit the space.
    pub(crate) fn settle(&mut self, space: &Space) -> bool {
        let Predictors { printed, gaussian, least_squares, contextual, .. } = self;
        if let Some(contextual) = contextual {
            contextual.settle(space);
        }
        [printed, gaussian].into_iter().flatten().all(|model| model.settle(space))
            && least_squares.as_mut().is_none_or(|model| model.settle(space))
    }

    /// Notes what is needed to tell how far each would have been off a measured cost; the telling is
    /// deferred. To be called before the trial is learnt, and before the table of its state holds it.
    pub fn test(&mut self, query: &Query<'_>, configuration: &Configuration, cost: f64) {
        if !self.chooses {
            return;
        }
        self.trials += 1;
        if self.trials > TESTS_EAGER && !self.trials.is_multiple_of(TESTS_SHARE) {
            return;
        }
        let words = Box::new(PredictorMethod::SINGLE.map(|method| match method {
            PredictorMethod::Contextual => (method, None),
            _ => (method, self.expect(method, query, configuration)),
        }));
        let question = self.contextual.as_ref().map(|model| model.question(query));
        let configuration = configuration.clone();
        self.deferred.push(Arc::new(DeferredUpdate::Test { words, question, configuration, cost }));
    }

    /// Teaches all. What takes long is deferred.
    pub fn learn(&mut self, lesson: &Lesson<'_>) {
        self.learn_features(lesson);
        let exercise = self.contextual.as_mut().and_then(|model| model.note(lesson));
        self.deferred.extend(exercise.map(DeferredUpdate::Exercise).map(Arc::new));
    }

    /// How many updates are deferred.
    pub fn deferred_count(&self) -> usize {
        self.deferred.len()
    }

    /// The deferred updates, to be computed apart; `None` where there are none.
    pub fn deferred(&self) -> Option<DeferredUpdates> {
        let hyper = || self.contextual.as_ref().map(|model| model.hyper().clone());
        let updates = || DeferredUpdates {
            updates: self.deferred.clone(),
            hyper: hyper(),
            tallies: self.tallies.clone(),
        };
        (!self.deferred.is_empty()).then(updates)
    }

    /// Takes over updates that were computed apart, unless somebody was faster.
    pub fn apply(&mut self, computed: ComputedUpdates) {
        let DeferredUpdates { updates, hyper, tallies } = computed.0;
        let pairs = self.deferred.iter().zip(&updates);
        let same = pairs.filter(|(own, computed)| Arc::ptr_eq(own, computed)).count();
        if same < updates.len() {
            return;
        }
        self.deferred.drain(..same);
        self.tallies = tallies;
        if let (Some(model), Some(hyper)) = (&mut self.contextual, hyper) {
            model.set_hyper(hyper);
        }
    }

    /// Computes and applies all of them.
    pub fn apply_all(&mut self, space: &Space) {
        if let Some(updates) = self.deferred() {
            self.apply(updates.compute(space));
        }
    }

    /// Begins the models of features anew, with those of `fresh`, which leave out other indicators.
    pub(crate) fn begin_features(&mut self, fresh: Predictors) {
        self.printed = fresh.printed;
        self.gaussian = fresh.gaussian;
        self.least_squares = fresh.least_squares;
    }

    /// Teaches the models of features alone.
    pub(crate) fn learn_features(&mut self, lesson: &Lesson<'_>) {
        let Predictors { printed, gaussian, least_squares, .. } = self;
        [printed, gaussian].into_iter().flatten().for_each(|model| model.learn(lesson));
        if let Some(model) = least_squares {
            model.learn(lesson);
        }
    }

    /// Whether there are models of features.
    pub(crate) fn have_features(&self) -> bool {
        self.printed.is_some() || self.gaussian.is_some() || self.least_squares.is_some()
    }

    /// The predictor of a method; `None` for the choice among them, and for a model that is not needed.
    fn single(&self, method: PredictorMethod) -> Option<&dyn Predictor> {
        match method {
            PredictorMethod::Auto => None,
            PredictorMethod::NearestNeighbour => Some(&Nearest),
            PredictorMethod::WeightedNeighbours => Some(&Weighted),
            PredictorMethod::RbfGreedyGq => self.printed.as_ref().map(|model| model as _),
            PredictorMethod::GaussianGreedyGq => self.gaussian.as_ref().map(|model| model as _),
            PredictorMethod::LeastSquares => self.least_squares.as_ref().map(|model| model as _),
            PredictorMethod::Contextual => self.contextual.as_ref().map(|model| model as _),
        }
    }

    /// What a single predictor expects. Models learn costs as they are on the first machine.
    fn expect(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        configuration: &Configuration,
    ) -> Option<Estimate> {
        let expected = self.single(method)?.estimate(query, configuration)?;
        Some(on_machine(method, query, expected))
    }

    /// The one that erred least of late, the first listed among equals.
    pub fn leader(&self) -> PredictorMethod {
        self.tallies.leader()
    }

    /// Who answers and proposes for a method.
    fn speaker(&self, method: PredictorMethod) -> PredictorMethod {
        if method != PredictorMethod::Auto {
            return method;
        }
        let (contextual, leader) = (PredictorMethod::Contextual, self.leader());
        let recent = |method| self.tallies.recent(method);
        let trusted = self.tallies.tests(contextual) < TESTS_MIN
            || recent(contextual) <= (TRUSTED * recent(leader)).max(TRUSTED_ERROR);
        if trusted { contextual } else { leader }
    }

    /// The mean errors of every predictor and of the choice among them (`Auto`), with 95 % intervals. Empty
    /// before the second trial, and where nothing is to be chosen.
    pub fn errors(&self) -> Vec<(PredictorMethod, Interval)> {
        self.tallies.errors()
    }

    /// What is expected of one configuration.
    pub fn estimate(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        configuration: &Configuration,
    ) -> Option<Estimate> {
        let estimate = |method| self.expect(method, query, configuration);
        if method != PredictorMethod::Auto {
            return estimate(method);
        }
        self.tallies.blend(&PredictorMethod::SINGLE.map(|method| (method, estimate(method))))
    }

    /// The answer to exploit, and whose it is: the method's own, else (a model can be without a clue) that of
    /// the nearest neighbour.
    pub fn predict(&self, method: PredictorMethod, query: &Query<'_>) -> Option<(Answer, PredictorMethod)> {
        let speaker = self.speaker(method);
        let own = self.single(speaker).and_then(|predictor| predictor.predict(query));
        self.or_nearest(speaker, own, query)
    }

    /// The same where what takes long was [requested](Predictors::request) and answered before.
    pub(crate) fn predict_ahead(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        answer: Option<&Answer>,
    ) -> Option<(Answer, PredictorMethod)> {
        match self.speaker(method) {
            PredictorMethod::Contextual => {
                self.or_nearest(PredictorMethod::Contextual, answer.cloned(), query)
            }
            _ => self.predict(method, query),
        }
    }

    fn or_nearest(
        &self,
        speaker: PredictorMethod,
        own: Option<Answer>,
        query: &Query<'_>,
    ) -> Option<(Answer, PredictorMethod)> {
        let (answer, method) = match own {
            Some(answer) => (answer, speaker),
            None => (Nearest.predict(query)?, PredictorMethod::NearestNeighbour),
        };
        let expected = on_machine(method, query, answer.expected);
        Some((Answer { expected, ..answer }, method))
    }

    /// What to explore first in a state where nothing was measured, and who says so; `None` when the method
    /// has no say in that, or the model that has is not to be trusted yet.
    pub fn propose(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        number: u64,
    ) -> Option<(Answer, PredictorMethod)> {
        let proposer = self.speaker(method);
        self.single(proposer)?.propose(query, number).map(|answer| (answer, proposer))
    }

    /// The same where what takes long was requested and answered before.
    pub(crate) fn propose_ahead(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        number: u64,
        answer: Option<&Answer>,
    ) -> Option<(Answer, PredictorMethod)> {
        match self.speaker(method) {
            PredictorMethod::Contextual => Some((answer?.clone(), PredictorMethod::Contextual)),
            _ => self.propose(method, query, number),
        }
    }

    /// What has to be answered before [`Predictors::predict`] is a matter of microseconds; `None` if it is already.
    pub(crate) fn request(&self, method: PredictorMethod, query: &Query<'_>) -> Option<Request> {
        self.thinker(method).map(|model| model.request(query))
    }

    /// The same for [`Predictors::propose`].
    pub(crate) fn proposal(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        number: u64,
    ) -> Option<Request> {
        self.thinker(method).map(|model| model.proposal(query, number))
    }

    /// The model whose answers take a fit, if it is the one that answers.
    fn thinker(&self, method: PredictorMethod) -> Option<&Contextual> {
        self.contextual.as_ref().filter(|_| self.speaker(method) == PredictorMethod::Contextual)
    }
}

/// What a predictor said, on the asking machine. Those that look at tables have translated already.
fn on_machine(method: PredictorMethod, query: &Query<'_>, expected: Estimate) -> Estimate {
    let learns_costs = matches!(
        method,
        PredictorMethod::RbfGreedyGq | PredictorMethod::GaussianGreedyGq | PredictorMethod::LeastSquares
    );
    if !learns_costs || query.machine == 0 {
        return expected;
    }
    let factor = query.fleet.factor(0, query.machine);
    Estimate::new(factor * expected.cost, factor * expected.deviation)
}
