//! The errors of all predictors of a study, and which of them answers for `auto`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::policy::PredictorMethod;
use crate::predict::Estimate;
use crate::predict::prequential::{ErrorInterval, ErrorStatistics, error};
use crate::predict::registry::METHODS;

/// The contextual model answers and proposes unless its error is above this multiple of the least error, and
/// above this value: it alone knows untried configurations. By error alone the choice would confirm itself: a
/// predictor that always repeats one configuration predicts its cost well.
const TRUSTED: f64 = 3.0;
const TRUSTED_ERROR: f64 = 0.25;
/// Fewer tests than this do not separate predictors.
const TESTS_MIN: u64 = 8;

pub(super) type MethodEstimate = (PredictorMethod, Option<Estimate>);

/// Errors of each predictor, and of the one that answered for `auto` at the time of each test (`Auto`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct PredictorErrors(BTreeMap<PredictorMethod, ErrorStatistics>);

impl PredictorErrors {
    /// Notes the error of each predictor on a measured cost, and that of the answering one as that of `auto`.
    /// The first trial of all does not count, because no predictor had an estimate.
    pub(super) fn take(&mut self, words: &[MethodEstimate], cost: f64) {
        let word =
            |method: PredictorMethod| words.iter().find(|word| word.0 == method).and_then(|word| word.1);
        if words.iter().all(|(_, word)| word.is_none()) {
            return;
        }
        // As in an answer, the nearest neighbour stands in for a predictor that knows nothing.
        let answering = word(self.speaker()).or_else(|| word(PredictorMethod::NearestNeighbour));
        for (method, expected) in words.iter().copied().chain([(PredictorMethod::Auto, answering)]) {
            self.0.entry(method).or_default().take(error(expected, cost));
        }
    }

    /// The predictor that answers and proposes for `auto`.
    pub(super) fn speaker(&self) -> PredictorMethod {
        let (contextual, leader) = (PredictorMethod::Contextual, self.leader());
        let trusted = self.tests(contextual) < TESTS_MIN
            || self.recent(contextual) <= (TRUSTED * self.recent(leader)).max(TRUSTED_ERROR);
        if trusted { contextual } else { leader }
    }

    /// The recent error; infinite before the first test.
    fn recent(&self, method: PredictorMethod) -> f64 {
        self.0.get(&method).map_or(f64::INFINITY, ErrorStatistics::recent)
    }

    /// Tests so far, 0 before the second.
    fn tests(&self, method: PredictorMethod) -> u64 {
        self.0.get(&method).and_then(ErrorStatistics::interval).map_or(0, |interval| interval.count)
    }

    /// The predictor of the least recent error, the first listed among equals.
    fn leader(&self) -> PredictorMethod {
        let least = METHODS.iter().min_by(|a, b| self.recent(**a).total_cmp(&self.recent(**b)));
        least.copied().unwrap_or(METHODS[0])
    }

    /// The mean errors with 95 % intervals. Empty before the second trial.
    pub(super) fn errors(&self) -> Vec<(PredictorMethod, ErrorInterval)> {
        let interval =
            |(&method, tally): (&PredictorMethod, &ErrorStatistics)| Some((method, tally.interval()?));
        self.0.iter().filter_map(interval).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests in which the contextual model expects `factor` times the cost, and the nearest neighbour the
    /// cost.
    fn tested(errors: &mut PredictorErrors, count: usize, factor: f64) {
        let word = |method: PredictorMethod| match method {
            PredictorMethod::Contextual => (method, Some(Estimate::new(factor, 0.0))),
            PredictorMethod::NearestNeighbour => (method, Some(Estimate::new(1.0, 0.0))),
            _ => (method, None),
        };
        let words: Vec<MethodEstimate> = METHODS.iter().copied().map(word).collect();
        (0..count).for_each(|_| errors.take(&words, 1.0));
    }

    fn mean(errors: &PredictorErrors, method: PredictorMethod) -> f64 {
        let all = errors.errors();
        all.iter().find(|(one, _)| *one == method).map_or(f64::NAN, |(_, interval)| interval.mean)
    }

    #[test]
    fn the_error_of_auto_is_that_of_the_predictor_that_answers() {
        let (auto, contextual) = (PredictorMethod::Auto, PredictorMethod::Contextual);
        let mut small = PredictorErrors::default();
        tested(&mut small, 40, 1.2);
        assert_eq!(small.speaker(), contextual);
        assert_eq!(mean(&small, auto), mean(&small, contextual));
        let mut large = PredictorErrors::default();
        tested(&mut large, 40, 2.0);
        assert_eq!(large.speaker(), PredictorMethod::NearestNeighbour);
        let [own, of_auto] = [contextual, auto].map(|method| mean(&large, method));
        // The contextual model answered until it was known to be wrong.
        assert!((of_auto - own * TESTS_MIN as f64 / 40.0).abs() < 1e-12, "{of_auto} and {own}");
    }

    #[test]
    fn the_nearest_neighbour_stands_in_for_a_model_that_knows_nothing() {
        let mut errors = PredictorErrors::default();
        let nearest = (PredictorMethod::NearestNeighbour, Some(Estimate::new(1.0, 0.0)));
        errors.take(&[(PredictorMethod::Contextual, None), (nearest.0, None)], 1.0);
        assert!(errors.errors().is_empty(), "nobody had an estimate");
        errors.take(&[(PredictorMethod::Contextual, None), nearest], 1.0);
        assert_eq!(mean(&errors, PredictorMethod::Auto), 0.0);
    }
}
