//! The blend of all predictors: a mean of their estimates, weighted by the recent errors of each.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::limits::REWARD_COST_MIN;
use crate::policy::PredictorMethod;
use crate::predict::Estimate;
use crate::predict::prequential::{ErrorInterval, ErrorStatistics, error};
use crate::predict::registry::METHODS;

/// Number of doublings of the weight for half the error; errors below the least count as equal. The weights
/// rest on about the last twenty tests: a predictor that errs in a state is likely to err there again. On the
/// streams of `examples/predictors` powers of 6 to 10 and 12 to 30 tests do about as well; a power of 4 over
/// 400 tests left the blend up to a tenth above the best single predictor.
const WEIGHT_POWER: i32 = 8;
const ERROR_LEAST: f64 = 1e-6;

/// A predictor's estimate of a configuration.
pub(super) type MethodEstimate = (PredictorMethod, Option<Estimate>);

/// Errors of each predictor, and of the blend of them all (`Auto`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct PredictorErrors(BTreeMap<PredictorMethod, ErrorStatistics>);

impl PredictorErrors {
    /// Notes the error of each predictor, and of the blend before it, on a measured cost. The first trial of
    /// all does not count, because no predictor had an estimate.
    pub(super) fn take(&mut self, words: &[MethodEstimate], cost: f64) {
        let Some(blend) = self.blend(words) else { return };
        for (method, expected) in words.iter().copied().chain([(PredictorMethod::Auto, Some(blend))]) {
            self.0.entry(method).or_default().take(error(expected, cost));
        }
    }

    /// The recent error; infinite before the first test.
    pub(super) fn recent(&self, method: PredictorMethod) -> f64 {
        self.0.get(&method).map_or(f64::INFINITY, ErrorStatistics::recent)
    }

    /// Tests so far, 0 before the second.
    pub(super) fn tests(&self, method: PredictorMethod) -> u64 {
        self.0.get(&method).and_then(ErrorStatistics::interval).map_or(0, |interval| interval.count)
    }

    /// The predictor of the least recent error, the first listed among equals.
    pub(super) fn leader(&self) -> PredictorMethod {
        let least = METHODS.iter().min_by(|a, b| self.recent(**a).total_cmp(&self.recent(**b)));
        least.copied().unwrap_or(METHODS[0])
    }

    /// The mean errors with 95 % intervals. Empty before the second trial.
    pub(super) fn errors(&self) -> Vec<(PredictorMethod, ErrorInterval)> {
        let interval =
            |(&method, tally): (&PredictorMethod, &ErrorStatistics)| Some((method, tally.interval()?));
        self.0.iter().filter_map(interval).collect()
    }

    /// The blend of all estimates, weighted by each predictor's errors in the last tests: the mean of
    /// logarithms, since errors are ratios. Following one predictor at a time would pay for every change of
    /// the lead. Errors fade, so a predictor that was bad for long is back after a few good tests. Shared
    /// weights do this in tracking the best expert (Herbster and Warmuth, Machine Learning 32, 1998).
    pub(super) fn blend(&self, words: &[MethodEstimate]) -> Option<Estimate> {
        let said: Vec<(f64, Estimate)> =
            words.iter().filter_map(|(method, word)| Some((self.weight(*method), (*word)?))).collect();
        let total: f64 = said.iter().map(|(weight, _)| weight).sum();
        if said.is_empty() {
            return None;
        }
        assert!(total > 0.0 && total.is_finite(), "a weight of {total} altogether");
        let log = |cost: f64| libm::log(cost.max(REWARD_COST_MIN));
        let mean: f64 = said.iter().map(|(weight, word)| weight / total * log(word.cost)).sum();
        let deviation: f64 = said.iter().map(|(weight, word)| weight / total * word.deviation).sum();
        Some(Estimate::new(libm::exp(mean), deviation))
    }

    /// The weight of a predictor in the blend; all are equal before the first test.
    fn weight(&self, method: PredictorMethod) -> f64 {
        let last = self.0.get(&method).and_then(ErrorStatistics::last);
        last.map_or(1.0, |error| error.max(ERROR_LEAST).powi(-WEIGHT_POWER))
    }
}
