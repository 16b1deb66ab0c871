//! Statistics of the indicators over all states of a study: the real range of each, and the indicators that
//! add nothing.
//!
//! A study declares a range for each indicator before anything was measured. An indicator whose states lie
//! far outside its range would dominate every distance. So distances along an axis are divided by the range
//! that holds all but a fiftieth of the states, where that is wider than the declared one. Stored coordinates
//! do not change: states are recognised by the declared scale.
//!
//! An indicator with one value in all states is left out. So is a linear function of another indicator, which
//! would count twice. The first state that contradicts brings a redundant indicator back for good.

use serde::{Deserialize, Serialize};

/// Number of states from which on an indicator with one value in all of them is called constant.
const CONSTANT_AFTER: u64 = 8;
/// Number of states from which on an indicator may be called redundant.
const REDUNDANT_AFTER: u64 = 16;
/// The share of its variance that another indicator must explain.
const REDUNDANT: f64 = 0.999;
/// A state whose indicator lies further than this from the regression line contradicts.
const CONTRADICTION: f64 = 0.05;
/// One state of this number may lie outside the range, and always one.
const BEYOND_SHARE: u64 = 50;
/// Number of least and of greatest values that are kept of each indicator.
const EXTREMES: usize = 32;
/// Values are clamped to this for correlations, so that a single outlier does not make a line.
const REACH: (f64, f64) = (-1.0, 2.0);

/// An indicator that is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OmittedIndicator {
    /// Its index in the schema.
    pub(crate) axis: usize,
    /// The other indicator that it is a linear function of; `None` where it is constant.
    pub(crate) redundant_with: Option<usize>,
}

/// Statistics of the indicators over a study's states.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct IndicatorStatistics {
    states: u64,
    /// For each indicator, the least values rising and the greatest falling.
    least: Vec<Vec<f64>>,
    greatest: Vec<Vec<f64>>,
    mean: Vec<f64>,
    /// Sums of products of deviations, row by row up to the diagonal.
    products: Vec<f64>,
    /// Was called redundant once and turned out not to be.
    contradicted: Vec<bool>,
}

fn place(row: usize, column: usize) -> usize {
    debug_assert!(column <= row, "{row}, {column} is above the diagonal");
    row * (row + 1) / 2 + column
}

/// Keeps a value among the first by an order.
fn keep(values: &mut Vec<f64>, value: f64, before: impl Fn(f64, f64) -> bool) {
    let at = values.partition_point(|&other| !before(value, other));
    values.insert(at, value);
    values.truncate(EXTREMES);
    debug_assert!(values.windows(2).all(|pair| !before(pair[1], pair[0])), "{values:?} are in order");
}

impl IndicatorStatistics {
    /// Statistics of no state.
    pub(crate) fn new(indicators: usize) -> Self {
        IndicatorStatistics {
            states: 0,
            least: vec![Vec::new(); indicators],
            greatest: vec![Vec::new(); indicators],
            mean: vec![0.0; indicators],
            products: vec![0.0; indicators * (indicators + 1) / 2],
            contradicted: vec![false; indicators],
        }
    }

    /// The number of indicators.
    pub(crate) fn width(&self) -> usize {
        self.mean.len()
    }

    /// Takes the normalised indicators of a new state; finite.
    pub(crate) fn take(&mut self, state: &[f64]) {
        assert_eq!(state.len(), self.width(), "the indicators of the study");
        let clamped: Vec<f64> = state.iter().map(|x| x.clamp(REACH.0, REACH.1)).collect();
        for OmittedIndicator { axis, redundant_with } in self.omitted() {
            if let Some(other) = redundant_with {
                let expected =
                    self.mean[axis] + self.slope(axis, other) * (clamped[other] - self.mean[other]);
                self.contradicted[axis] |= (clamped[axis] - expected).abs() > CONTRADICTION;
            }
        }
        self.states += 1;
        let before: Vec<f64> = clamped.iter().zip(&self.mean).map(|(x, mean)| x - mean).collect();
        for (mean, off) in self.mean.iter_mut().zip(&before) {
            *mean += off / self.states as f64;
        }
        let after: Vec<f64> = clamped.iter().zip(&self.mean).map(|(x, mean)| x - mean).collect();
        for (row, before) in before.iter().enumerate() {
            let products = &mut self.products[place(row, 0)..=place(row, row)];
            products.iter_mut().zip(&after).for_each(|(product, after)| *product += before * after);
            keep(&mut self.least[row], state[row], |a, b| a < b);
            keep(&mut self.greatest[row], state[row], |a, b| a > b);
        }
    }

    fn slope(&self, axis: usize, other: usize) -> f64 {
        let square = self.products[place(other, other)];
        assert!(square > 0.0, "indicator {other} varies by {square}");
        self.products[place(axis, other)] / square
    }

    fn is_constant(&self, axis: usize) -> bool {
        self.states >= CONSTANT_AFTER && self.least[axis].first() == self.greatest[axis].first()
    }

    /// The indicators that are left out, by rising index.
    pub(crate) fn omitted(&self) -> Vec<OmittedIndicator> {
        let mut omitted: Vec<OmittedIndicator> = Vec::new();
        for axis in 0..self.width() {
            if self.is_constant(axis) {
                omitted.push(OmittedIndicator { axis, redundant_with: None });
                continue;
            }
            if self.states < REDUNDANT_AFTER || self.contradicted[axis] {
                continue;
            }
            let own = self.products[place(axis, axis)];
            let is_kept = |other: &usize| !omitted.iter().any(|omitted| omitted.axis == *other);
            let redundant_with = (0..axis).filter(is_kept).find(|&other| {
                let (product, theirs) =
                    (self.products[place(axis, other)], self.products[place(other, other)]);
                own > 0.0 && theirs > 0.0 && product * product >= REDUNDANT * own * theirs
            });
            omitted
                .extend(redundant_with.map(|other| OmittedIndicator { axis, redundant_with: Some(other) }));
        }
        omitted
    }

    /// Weights for the squares of distances: 1 within the declared range, less where states reach further, 0
    /// for omitted indicators.
    pub(crate) fn weights(&self) -> Vec<f64> {
        let rank = (self.states / BEYOND_SHARE).max(1) as usize;
        let bound =
            |values: &[f64], declared: f64| values.get(rank.min(EXTREMES - 1)).copied().unwrap_or(declared);
        let mut weights: Vec<f64> = (0..self.width())
            .map(|axis| {
                let low = bound(&self.least[axis], 0.0).min(0.0);
                let width = bound(&self.greatest[axis], 1.0).max(1.0) - low;
                1.0 / (width * width)
            })
            .collect();
        self.omitted().iter().for_each(|omitted| weights[omitted.axis] = 0.0);
        weights
    }

    /// The number of states behind the statistics.
    pub(crate) fn states(&self) -> u64 {
        self.states
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn bounds_widen_with_evidence_and_not_for_one_wild_state() {
        let mut statistics = IndicatorStatistics::new(2);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        (0..30).for_each(|_| statistics.take(&[random.random(), random.random()]));
        assert_eq!(statistics.weights(), [1.0, 1.0]);
        statistics.take(&[1e9, 0.5]);
        assert_eq!(statistics.weights(), [1.0, 1.0], "one may lie beyond");
        (0..30).for_each(|_| statistics.take(&[9.0 * random.random::<f64>(), random.random()]));
        let weights = statistics.weights();
        assert!(weights[0] < 1.0 / 49.0 && weights[0] >= 1.0 / 81.0, "{weights:?}");
        assert_eq!(weights[1], 1.0);
        (0..40).for_each(|_| statistics.take(&[-9.0 * random.random::<f64>(), 0.5]));
        assert!(statistics.weights()[0] < 1.0 / 196.0);
    }

    #[test]
    fn what_is_constant_is_left_out_until_it_is_not() {
        let mut statistics = IndicatorStatistics::new(2);
        (0..7).for_each(|step| statistics.take(&[f64::from(step) * 0.1, 0.25]));
        assert_eq!(statistics.omitted(), []);
        statistics.take(&[0.9, 0.25]);
        assert_eq!(statistics.omitted(), [OmittedIndicator { axis: 1, redundant_with: None }]);
        assert_eq!(statistics.weights(), [1.0, 0.0]);
        statistics.take(&[0.9, 0.26]);
        assert_eq!(statistics.omitted(), []);
    }

    #[test]
    fn what_follows_another_is_left_out_until_a_state_contradicts() {
        let mut statistics = IndicatorStatistics::new(3);
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut state = || {
            let (a, b): (f64, f64) = (random.random(), random.random());
            [a, b, 0.8 - 0.7 * a]
        };
        (0..40).for_each(|_| statistics.take(&state()));
        assert_eq!(statistics.omitted(), [OmittedIndicator { axis: 2, redundant_with: Some(0) }]);
        statistics.take(&[0.5, 0.5, 0.9]);
        (0..1000).for_each(|_| statistics.take(&state()));
        assert_eq!(statistics.omitted(), [], "for good");
        // Two indicators that only share one wild state are not redundant.
        let mut statistics = IndicatorStatistics::new(2);
        (0..40).for_each(|_| statistics.take(&[random.random(), random.random()]));
        statistics.take(&[1e9, 1e9]);
        assert_eq!(statistics.omitted(), []);
    }
}
