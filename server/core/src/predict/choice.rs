//! All predictors of a study, and the choice among them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::machines::FIRST;
use crate::policy::PredictorMethod;
use crate::predict::contextual::FitRequest;
use crate::predict::deferred::{ComputedUpdates, DeferredUpdate, DeferredUpdates};
use crate::predict::errors::PredictorErrors;
use crate::predict::prequential::ErrorInterval;
use crate::predict::registry::{AnyPredictor, METHODS, learns};
use crate::predict::{Answer, Contextual, Estimate, Lesson, Nearest, Predictor, PredictorSetup, Query};
use crate::space::Space;

/// Every trial is a test until this number of tests.
const TESTS_EAGER: u64 = 256;
/// From then on one trial of this number is a test, so that a report stays cheap.
const TESTS_SHARE: u64 = 16;

/// The fit of the predictor whose answers take one.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FitTime<'a> {
    /// It is made when it is needed.
    Now,
    /// It was made before. It gave this answer, or none.
    Before(Option<&'a Answer>),
}

impl FitTime<'_> {
    /// The answer of a predictor, which is `asked` where its answers take no fit.
    fn answer(self, speaker: PredictorMethod, asked: impl FnOnce() -> Option<Answer>) -> Option<Answer> {
        match self {
            FitTime::Before(answer) if speaker == PredictorMethod::Contextual => answer.cloned(),
            FitTime::Now | FitTime::Before(_) => asked(),
        }
    }
}

/// The predictors that a study's policy needs: its own, or for [`PredictorMethod::Auto`] all of them, each
/// trained on every trial, with the errors of their tests. Those that learn nothing are always among them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Predictors {
    /// In the order of the registry.
    singles: Vec<AnyPredictor>,
    /// Whether there is a choice to be made, for which all are tested.
    chooses: bool,
    trials: u64,
    tallies: PredictorErrors,
    /// Updates yet to be computed, oldest first. All [are](Predictors::apply_all) computed before a
    /// checkpoint is stored.
    #[serde(skip)]
    deferred: Vec<Arc<DeferredUpdate>>,
}

impl Predictors {
    /// The untaught models that `method` needs; centres and choices are drawn from the study's seed.
    /// `omitted` are the places of indicators that features leave out.
    pub fn new(
        method: PredictorMethod,
        space: &Space,
        indicators: usize,
        seed: u64,
        omitted: &[usize],
    ) -> Self {
        let chooses = method == PredictorMethod::Auto;
        let setup = PredictorSetup { space, indicators, seed, omitted };
        let needed = |single: &PredictorMethod| chooses || method == *single || !learns(*single);
        let singles = METHODS.iter().copied().filter(needed);
        let singles: Vec<AnyPredictor> =
            singles.filter_map(|single| AnyPredictor::new(single, setup)).collect();
        assert!(!singles.is_empty(), "those that learn nothing are always there");
        Predictors { singles, chooses, trials: 0, tallies: PredictorErrors::default(), deferred: Vec::new() }
    }

    /// Whether `method` has to be taught at all.
    pub fn are_needed(method: PredictorMethod) -> bool {
        learns(method)
    }

    /// Completes predictors that were read from a checkpoint. `false` when a configuration does not fit the
    /// space.
    pub(crate) fn settle(&mut self, space: &Space) -> bool {
        self.singles.iter_mut().all(|predictor| predictor.settle(space))
    }

    /// The predictor whose answers take a fit, and whose learning is deferred.
    fn contextual(&self) -> Option<&Contextual> {
        self.singles.iter().find_map(|predictor| match predictor {
            AnyPredictor::Contextual(contextual) => Some(contextual),
            _ => None,
        })
    }

    /// Notes the inputs of each predictor's error on a measured cost; the error itself is computed later. To
    /// be called before the trial is learnt, and before the table of its state holds it.
    pub fn test(&mut self, query: &Query<'_>, configuration: &Configuration, cost: f64) {
        if !self.chooses {
            return;
        }
        self.trials += 1;
        if self.trials > TESTS_EAGER && !self.trials.is_multiple_of(TESTS_SHARE) {
            return;
        }
        let word = |&method: &PredictorMethod| match method {
            PredictorMethod::Contextual => (method, None),
            _ => (method, self.estimate(method, query, configuration)),
        };
        let words = METHODS.iter().map(word).collect();
        let local_data = self.contextual().map(|model| model.local_data(query));
        let configuration = configuration.clone();
        self.deferred.push(Arc::new(DeferredUpdate::Test { words, local_data, configuration, cost }));
    }

    /// Teaches all. Long updates are deferred.
    pub fn learn(&mut self, lesson: &Lesson<'_>) {
        for predictor in &mut self.singles {
            match predictor {
                AnyPredictor::Contextual(contextual) => {
                    let update = contextual.note(lesson);
                    self.deferred.extend(update.map(DeferredUpdate::Hyperparameters).map(Arc::new));
                }
                other => other.learn(lesson),
            }
        }
    }

    /// The number of deferred updates.
    pub fn deferred_count(&self) -> usize {
        self.deferred.len()
    }

    /// The deferred updates, to be computed apart; `None` where there are none.
    pub fn deferred(&self) -> Option<DeferredUpdates> {
        let hyper = || self.contextual().map(|model| model.hyper.clone());
        let updates = || DeferredUpdates {
            updates: self.deferred.clone(),
            hyper: hyper(),
            tallies: self.tallies.clone(),
        };
        (!self.deferred.is_empty()).then(updates)
    }

    /// Takes over updates that were computed apart, unless another caller was faster.
    pub fn apply(&mut self, computed: ComputedUpdates) {
        let DeferredUpdates { updates, hyper, tallies } = computed.0;
        let pairs = self.deferred.iter().zip(&updates);
        let same = pairs.filter(|(own, computed)| Arc::ptr_eq(own, computed)).count();
        if same < updates.len() {
            return;
        }
        self.deferred.drain(..same);
        self.tallies = tallies;
        for single in &mut self.singles {
            if let (AnyPredictor::Contextual(model), Some(hyper)) = (single, &hyper) {
                model.hyper = hyper.clone();
            }
        }
    }

    /// Computes and applies all of them.
    pub fn apply_all(&mut self, space: &Space) {
        if let Some(updates) = self.deferred() {
            self.apply(updates.compute(space));
        }
    }

    /// Replaces the models of features by those of `fresh`, which leave out other indicators.
    pub(crate) fn begin_features(&mut self, fresh: Predictors) {
        assert_eq!(self.singles.len(), fresh.singles.len(), "predictors of one policy");
        for (own, fresh) in self.singles.iter_mut().zip(fresh.singles) {
            assert_eq!(own.method(), fresh.method(), "in the order of the registry");
            if own.has_features() {
                *own = fresh;
            }
        }
    }

    pub(crate) fn learn_features(&mut self, lesson: &Lesson<'_>) {
        let featured = self.singles.iter_mut().filter(|predictor| predictor.has_features());
        featured.for_each(|predictor| predictor.learn(lesson));
    }

    pub(crate) fn have_features(&self) -> bool {
        self.singles.iter().any(|predictor| predictor.has_features())
    }

    /// The predictor of a method; `None` for the choice among them, and for one that is not needed.
    fn single(&self, method: PredictorMethod) -> Option<&dyn Predictor> {
        self.singles.iter().find(|predictor| predictor.method() == method).map(|predictor| &**predictor)
    }

    /// The estimate of one configuration, on the asking machine.
    pub fn estimate(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        configuration: &Configuration,
    ) -> Option<Estimate> {
        let method = self.speaker(method);
        // Models learn costs as they are on the first machine.
        let expected = self.single(method)?.estimate(query, configuration)?;
        Some(self.on_machine(method, query, expected))
    }

    /// The predictor that answers and proposes for a method.
    fn speaker(&self, method: PredictorMethod) -> PredictorMethod {
        if method == PredictorMethod::Auto { self.tallies.speaker() } else { method }
    }

    /// The mean errors of every predictor and of those that answered (`Auto`), with 95 % intervals. Empty
    /// before the second trial, and where there is no choice.
    pub fn errors(&self) -> Vec<(PredictorMethod, ErrorInterval)> {
        self.tallies.errors()
    }

    /// The answer to exploit, and its predictor: the method's own, else (a model may have no answer) the
    /// nearest neighbour.
    pub fn predict(&self, method: PredictorMethod, query: &Query<'_>) -> Option<(Answer, PredictorMethod)> {
        self.predict_fitted(method, query, FitTime::Now)
    }

    /// [`Predictors::predict`] with the fit of a [request](Predictors::request).
    pub(crate) fn predict_fitted(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        fitted: FitTime<'_>,
    ) -> Option<(Answer, PredictorMethod)> {
        let speaker = self.speaker(method);
        let asked = || self.single(speaker).and_then(|predictor| predictor.predict(query));
        let (answer, method) = match fitted.answer(speaker, asked) {
            Some(answer) => (answer, speaker),
            // A predictor that cannot judge its risk must not replace one that found the risk too high.
            None if speaker == PredictorMethod::Contextual && query.rival.is_some() => return None,
            None => (Nearest.predict(query)?, PredictorMethod::NearestNeighbour),
        };
        let expected = self.on_machine(method, query, answer.expected);
        Some((Answer { expected, ..answer }, method))
    }

    /// The first point to explore in a state without measurements, and its predictor. `None` when the method
    /// proposes nothing, or its model is not to be trusted yet.
    pub(crate) fn propose(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        number: u64,
        fitted: FitTime<'_>,
    ) -> Option<(Answer, PredictorMethod)> {
        let proposer = self.speaker(method);
        let asked = || self.single(proposer)?.propose(query, number);
        fitted.answer(proposer, asked).map(|answer| (answer, proposer))
    }

    /// The fit that makes [`Predictors::predict`] a matter of microseconds; `None` if none is needed.
    pub(crate) fn request(&self, method: PredictorMethod, query: &Query<'_>) -> Option<FitRequest> {
        self.thinker(method).map(|model| model.request(query))
    }

    /// The fit that makes [`Predictors::propose`] a matter of microseconds; `None` if none is needed.
    pub(crate) fn proposal(
        &self,
        method: PredictorMethod,
        query: &Query<'_>,
        number: u64,
    ) -> Option<FitRequest> {
        self.thinker(method).map(|model| model.proposal(query, number))
    }

    /// The model whose answers take a fit, if it is the one that answers.
    fn thinker(&self, method: PredictorMethod) -> Option<&Contextual> {
        self.contextual().filter(|_| self.speaker(method) == PredictorMethod::Contextual)
    }

    /// A predictor's estimate on the asking machine.
    fn on_machine(&self, method: PredictorMethod, query: &Query<'_>, expected: Estimate) -> Estimate {
        let translates = self.single(method).is_some_and(|predictor| predictor.has_features());
        if !translates {
            return expected;
        }
        let factor = query.machines.factor(FIRST, query.machine);
        Estimate::new(factor * expected.cost, factor * expected.deviation)
    }
}
