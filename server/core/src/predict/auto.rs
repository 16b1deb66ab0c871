//! All predictors of a study, and the choice among them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::REWARD_COST_MIN;
use crate::policy::PredictorMethod;
use crate::predict::prequential::{Interval, Tally, error};
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
/// Half the error is worth so many doublings of the weight; errors below the least are all the same. The weights go by
/// the last twenty tests or so: who errs in a state is likely to err there again. On the streams of
/// `examples/predictors` powers of 6 to 10 and 12 to 30 tests do about as well; a power of 4 over 400 tests left the
/// blend up to a tenth above the best single predictor.
const WEIGHT_POWER: i32 = 8;
const ERROR_LEAST: f64 = 1e-6;
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
    /// Errors of each predictor, and of the choice among them.
    tallies: BTreeMap<PredictorMethod, Tally>,
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
            tallies: BTreeMap::new(),
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

    /// Notes how far each would have been off a measured cost. To be called before the trial is learnt, and
    /// before the table of its state holds it.
    pub fn test(&mut self, query: &Query<'_>, configuration: &Configuration, cost: f64) {
        if !self.chooses {
            return;
        }
        self.trials += 1;
        if self.trials > TESTS_EAGER && !self.trials.is_multiple_of(TESTS_SHARE) {
            return;
        }
        let words = PredictorMethod::SINGLE.map(|method| (method, self.expect(method, query, configuration)));
        // The first trial of all is nobody's fault.
        if words.iter().all(|(_, expected)| expected.is_none()) {
            return;
        }
        let blend = self.blend(&words);
        for (method, expected) in words.into_iter().chain([(PredictorMethod::Auto, blend)]) {
            self.tallies.entry(method).or_default().take(error(expected, cost));
        }
    }

    /// Teaches all.
    pub fn learn(&mut self, lesson: &Lesson<'_>) {
        self.learn_features(lesson);
        if let Some(model) = &mut self.contextual {
            model.learn(lesson);
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
        let recent = |method: &PredictorMethod| self.recent(*method);
        let methods = PredictorMethod::SINGLE;
        methods.into_iter().min_by(|a, b| recent(a).total_cmp(&recent(b))).unwrap_or(methods[0])
    }

    fn recent(&self, method: PredictorMethod) -> f64 {
        self.tallies.get(&method).map_or(f64::INFINITY, Tally::recent)
    }

    /// Who answers and proposes for a method.
    fn speaker(&self, method: PredictorMethod) -> PredictorMethod {
        if method != PredictorMethod::Auto {
            return method;
        }
        let (contextual, leader) = (PredictorMethod::Contextual, self.leader());
        let tests =
            self.tallies.get(&contextual).and_then(Tally::interval).map_or(0, |interval| interval.count);
        let trusted = tests < TESTS_MIN
            || self.recent(contextual) <= (TRUSTED * self.recent(leader)).max(TRUSTED_ERROR);
        if trusted { contextual } else { leader }
    }

    /// The mean errors of every predictor and of the choice among them (`Auto`), with 95 % intervals. Empty
    /// before the second trial, and where nothing is to be chosen.
    pub fn errors(&self) -> Vec<(PredictorMethod, Interval)> {
        let interval = |(&method, tally): (&PredictorMethod, &Tally)| Some((method, tally.interval()?));
        self.tallies.iter().filter_map(interval).collect()
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
        self.blend(&PredictorMethod::SINGLE.map(|method| (method, estimate(method))))
    }

    /// The word of all, weighted by how little each erred in the last tests: the mean of logarithms, since errors
    /// are ratios. To follow one at a time would pay for every change of the lead; and since weights rest on errors
    /// that fade, whoever was bad for long is back after a few good tests, which is what sharing weights does for
    /// those who track the best expert (Herbster and Warmuth, Machine Learning 32, 1998).
    fn blend(&self, words: &[(PredictorMethod, Option<Estimate>)]) -> Option<Estimate> {
        let said: Vec<(f64, Estimate)> =
            words.iter().filter_map(|(method, word)| Some((self.weight(*method), (*word)?))).collect();
        let total: f64 = said.iter().map(|(weight, _)| weight).sum();
        if said.is_empty() {
            return None;
        }
        let log = |cost: f64| libm::log(cost.max(REWARD_COST_MIN));
        let mean: f64 = said.iter().map(|(weight, word)| weight / total * log(word.cost)).sum();
        let deviation: f64 = said.iter().map(|(weight, word)| weight / total * word.deviation).sum();
        Some(Estimate::new(libm::exp(mean), deviation))
    }

    /// The weight of a predictor in the blend: all the same before the first test.
    fn weight(&self, method: PredictorMethod) -> f64 {
        let last = self.tallies.get(&method).and_then(Tally::last);
        last.map_or(1.0, |error| error.max(ERROR_LEAST).powi(-WEIGHT_POWER))
    }

    /// The answer to exploit, and whose it is: the method's own, else (a model can be without a clue) that of
    /// the nearest neighbour.
    pub fn predict(&self, method: PredictorMethod, query: &Query<'_>) -> Option<(Answer, PredictorMethod)> {
        [self.speaker(method), PredictorMethod::NearestNeighbour].into_iter().find_map(|method| {
            let answer = self.single(method)?.predict(query)?;
            let expected = on_machine(method, query, answer.expected);
            Some((Answer { expected, ..answer }, method))
        })
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
