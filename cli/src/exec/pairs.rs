//! The gain of one configuration over another from interleaved pairs of measurements: the median ratio of the
//! pairs, and an interval from order statistics. The interval holds for any noise (Conover, "Practical
//! Nonparametric Statistics", 3.2: the sign test turned round).

use serde::Serialize;

/// The confidence that the interval has at least, where there are pairs enough for it.
const CONFIDENCE: f64 = 0.95;

/// A gain, estimated from pairs. Shares: 0.2 is 20 % less than the default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Gain {
    pub(crate) pairs: usize,
    /// 1 − median of winner / default.
    pub(crate) gain: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
    /// With which probability the interval holds the true median.
    pub(crate) confidence: f64,
    /// The median of the winner's costs in these pairs.
    pub(crate) cost: f64,
    /// The median of the default's.
    pub(crate) default_cost: f64,
}

impl Gain {
    /// Of pairs `(default, winner)` of costs above 0; `None` without any.
    pub(crate) fn of(pairs: &[(f64, f64)]) -> Option<Self> {
        let usable = || pairs.iter().filter(|(default, winner)| *default > 0.0 && winner.is_finite());
        let ratios = sorted(usable().map(|(default, winner)| winner / default));
        if ratios.is_empty() {
            return None;
        }
        let count = ratios.len();
        let (cut, confidence) = cut(count);
        Some(Self {
            pairs: count,
            gain: 1.0 - median(&ratios),
            low: 1.0 - ratios[count - 1 - cut],
            high: 1.0 - ratios[cut],
            confidence,
            cost: median(&sorted(usable().map(|(_, winner)| *winner))),
            default_cost: median(&sorted(usable().map(|(default, _)| *default))),
        })
    }

    /// Whether the interval says which is better.
    pub(crate) fn is_certain(&self) -> bool {
        self.confidence >= CONFIDENCE && (self.low > 0.0 || self.high < 0.0)
    }
}

fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

/// Of sorted numbers, at least one.
fn median(sorted: &[f64]) -> f64 {
    (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]) / 2.0
}

/// The number of sorted ratios that the interval leaves out at each end, and its confidence.
fn cut(count: usize) -> (usize, f64) {
    let confidence = |cut: usize| 1.0 - 2.0 * (0..=cut).map(|heads| binomial(count, heads)).sum::<f64>();
    let best = (0..count.div_ceil(2)).take_while(|&cut| confidence(cut) >= CONFIDENCE).last().unwrap_or(0);
    (best, confidence(best).max(0.0))
}

/// The probability of `heads` heads in `throws` throws of a fair coin.
fn binomial(throws: usize, heads: usize) -> f64 {
    let half = |product: f64, step: usize| product * (throws - step) as f64 / (step + 1) as f64;
    (0..heads).fold(1.0, half) * 0.5_f64.powi(i32::try_from(throws).unwrap_or(i32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_the_sign_test() {
        // Table of Conover, A3: with 10 pairs the second and the ninth, 97.9 %.
        assert_eq!(cut(10).0, 1);
        assert!((cut(10).1 - 0.978_515_625).abs() < 1e-12);
        assert_eq!(cut(6).0, 0);
        assert!((cut(6).1 - 0.968_75).abs() < 1e-12);
        assert!(cut(5).1 < CONFIDENCE, "five pairs are too few");
    }

    #[test]
    fn a_gain_is_the_median_of_pairs() {
        let pairs: Vec<_> = (0..11).map(|index| (10.0, 7.5 + 0.1 * f64::from(index))).collect();
        let gain = Gain::of(&pairs).expect("pairs");
        assert!((gain.gain - 0.2).abs() < 1e-12 && gain.low < 0.2 && gain.high > 0.2);
        assert_eq!((gain.default_cost, gain.cost), (10.0, 8.0));
        assert!(gain.is_certain());
        let even = Gain::of(&[(1.0, 0.9), (1.0, 1.1), (1.0, 0.95), (1.0, 1.05), (1.0, 0.8), (1.0, 1.2)]);
        assert!(!even.expect("pairs").is_certain());
        assert_eq!(Gain::of(&[]), None);
        assert_eq!(Gain::of(&[(0.0, 1.0)]), None);
    }
}
