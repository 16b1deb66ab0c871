//! The errors of predictors: each is asked about every trial before it learns the trial.
//!
//! Dawid, "Statistical theory: the prequential approach", JRSS A 147, 1984; Gama, Sebastião and Rodrigues,
//! "On evaluating stream learning algorithms", Machine Learning 90, 2013. The error of a prediction is the
//! logarithm of the ratio of expected and measured cost, without its sign: 0.1 is ten percent off. It does
//! not change with the unit of the cost.

use serde::{Deserialize, Serialize};

use crate::limits::REWARD_COST_MIN;
use crate::predict::Estimate;
use crate::sum::Sum;

/// The largest error that counts: a thousandfold.
pub const ERROR_MAX: f64 = 6.907_755_278_982_137;
/// The factor by which an older error's weight falls with each new one, in the recent mean.
const FADE: f64 = 1.0 - 1.0 / 400.0;

/// The error of one prediction; [`ERROR_MAX`] where there was none.
pub fn error(expected: Option<Estimate>, cost: f64) -> f64 {
    let log = |cost: f64| libm::log(cost.max(REWARD_COST_MIN));
    expected.map_or(ERROR_MAX, |expected| (log(expected.cost) - log(cost)).abs().min(ERROR_MAX))
}

/// The errors of one predictor so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorStatistics {
    count: u64,
    sum: Sum,
    squares: Sum,
    recent: Fading,
}

/// A mean in which older values fade.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Fading {
    sum: f64,
    weight: f64,
}

/// A mean error and its 95 % interval, by the normal approximation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorInterval {
    /// Predictions tested.
    pub count: u64,
    /// Mean error.
    pub mean: f64,
    /// Lower end, at least 0.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl ErrorStatistics {
    /// Counts one more error.
    pub fn take(&mut self, error: f64) {
        assert!((0.0..=ERROR_MAX).contains(&error), "an error of {error}");
        self.count += 1;
        self.sum.add(error);
        self.squares.add(error * error);
        let Fading { sum, weight } = &mut self.recent;
        (*sum, *weight) = (FADE * *sum + error, FADE * *weight + 1.0);
    }

    /// The recent mean error, on which the choice rests. Infinite before the first.
    pub fn recent(&self) -> f64 {
        let Fading { sum, weight } = self.recent;
        if weight > 0.0 { sum / weight } else { f64::INFINITY }
    }

    /// The mean error of all trials; `None` before the first.
    pub fn interval(&self) -> Option<ErrorInterval> {
        if self.count == 0 {
            return None;
        }
        let n = self.count as f64;
        let mean = self.sum.value() / n;
        let variance = if self.count > 1 {
            ((self.squares.value() / n - mean * mean) * n / (n - 1.0)).max(0.0)
        } else {
            ERROR_MAX * ERROR_MAX
        };
        let reach = 1.96 * (variance / n).sqrt();
        let (low, high) = ((mean - reach).max(0.0), mean + reach);
        assert!(low <= mean && mean <= high, "{mean} lies between {low} and {high}");
        Some(ErrorInterval { count: self.count, mean, low, high })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_and_bounded() {
        let expected = Some(Estimate::new(2.0, 0.0));
        assert_eq!(error(expected, 2.0), 0.0);
        assert!((error(expected, 1.0) - std::f64::consts::LN_2).abs() < 1e-15);
        assert!((error(expected, 4.0) - std::f64::consts::LN_2).abs() < 1e-15);
        assert_eq!(error(expected, 0.0), ERROR_MAX);
        assert_eq!(error(None, 1.0), ERROR_MAX);
    }

    #[test]
    fn recent_errors_outweigh_the_old() {
        let mut tally = ErrorStatistics::default();
        assert_eq!(tally.recent(), f64::INFINITY);
        (0..4000).for_each(|_| tally.take(1.0));
        (0..400).for_each(|_| tally.take(0.0));
        assert!((tally.recent() - FADE.powi(400)).abs() < 1e-4, "{}", tally.recent());
    }

    #[test]
    fn the_interval_narrows_around_the_mean() {
        let mut tally = ErrorStatistics::default();
        assert_eq!(tally.interval(), None);
        (0..400).for_each(|index| tally.take(if index % 2 == 0 { 0.1 } else { 0.3 }));
        let ErrorInterval { count, mean, low, high } = tally.interval().expect("tested");
        assert_eq!(count, 400);
        assert!((mean - 0.2).abs() < 1e-12);
        assert!((high - mean - 0.0098).abs() < 1e-4 && (mean - low - 0.0098).abs() < 1e-4);
    }
}
