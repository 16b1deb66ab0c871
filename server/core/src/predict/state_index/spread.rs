//! What the states that were met tell of the indicators: how far each really reaches, and which say nothing.
//!
//! A study declares a range for each indicator before anybody has measured it. Where states lie further out, that
//! indicator alone would rule every distance. So bounds widen as states come: distances along an axis are divided by
//! the range that all but a fiftieth of the states keep to, where that is wider than the declared one. Nothing that is
//! stored changes: states keep their coordinates, and are recognised by the declared scale as before.
//!
//! An indicator that has one value in all states is left out, and so is one that follows another in a straight line:
//! what it says would count twice. The first state that says otherwise brings it back for good.

use serde::{Deserialize, Serialize};

/// So many states must agree before an indicator is called constant.
const CONSTANT_AFTER: u64 = 8;
/// Before one is called redundant.
const REDUNDANT_AFTER: u64 = 16;
/// The share of its variance that another must explain.
const REDUNDANT: f64 = 0.999;
/// A state whose indicator lies further than this from where the other puts it is a contradiction.
const CONTRADICTION: f64 = 0.05;
/// One state in so many may lie beyond the bounds, and always one.
const BEYOND_SHARE: u64 = 50;
/// How many of the least and greatest values are kept of each indicator.
const EXTREMES: usize = 32;
/// Values count for correlations as if they lay no further out than this: one wild state is no line.
const REACH: (f64, f64) = (-1.0, 2.0);

/// An indicator that is left out, by its place in the schema.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mute {
    pub(crate) axis: usize,
    /// Which other indicator says the same; `None` where it is constant.
    pub(crate) says: Option<usize>,
}

/// The evidence of a study's states.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Spread {
    states: u64,
    /// Of each indicator: the least values rising, the greatest falling.
    least: Vec<Vec<f64>>,
    greatest: Vec<Vec<f64>>,
    mean: Vec<f64>,
    /// Sums of products of deviations, row by row up to the diagonal.
    products: Vec<f64>,
    /// Was called redundant once and turned out not to be.
    contradicted: Vec<bool>,
}

fn place(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

/// Keeps a value among the first by an order.
fn keep(values: &mut Vec<f64>, value: f64, before: impl Fn(f64, f64) -> bool) {
    let at = values.partition_point(|&other| !before(value, other));
    values.insert(at, value);
    values.truncate(EXTREMES);
}

impl Spread {
    /// Nothing was met yet.
    pub(crate) fn new(indicators: usize) -> Self {
        Spread {
            states: 0,
            least: vec![Vec::new(); indicators],
            greatest: vec![Vec::new(); indicators],
            mean: vec![0.0; indicators],
            products: vec![0.0; indicators * (indicators + 1) / 2],
            contradicted: vec![false; indicators],
        }
    }

    /// How many indicators there are.
    pub(crate) fn width(&self) -> usize {
        self.mean.len()
    }

    /// Takes the normalised indicators of a new state; finite.
    pub(crate) fn take(&mut self, state: &[f64]) {
        let held: Vec<f64> = state.iter().map(|x| x.clamp(REACH.0, REACH.1)).collect();
        for Mute { axis, says } in self.mute() {
            if let Some(other) = says {
                let expected = self.mean[axis] + self.slope(axis, other) * (held[other] - self.mean[other]);
                self.contradicted[axis] |= (held[axis] - expected).abs() > CONTRADICTION;
            }
        }
        self.states += 1;
        let before: Vec<f64> = held.iter().zip(&self.mean).map(|(x, mean)| x - mean).collect();
        for (mean, off) in self.mean.iter_mut().zip(&before) {
            *mean += off / self.states as f64;
        }
        let after: Vec<f64> = held.iter().zip(&self.mean).map(|(x, mean)| x - mean).collect();
        for (row, before) in before.iter().enumerate() {
            let products = &mut self.products[place(row, 0)..=place(row, row)];
            products.iter_mut().zip(&after).for_each(|(product, after)| *product += before * after);
            keep(&mut self.least[row], state[row], |a, b| a < b);
            keep(&mut self.greatest[row], state[row], |a, b| a > b);
        }
    }

    fn slope(&self, axis: usize, other: usize) -> f64 {
        self.products[place(axis, other)] / self.products[place(other, other)]
    }

    fn is_constant(&self, axis: usize) -> bool {
        self.states >= CONSTANT_AFTER && self.least[axis].first() == self.greatest[axis].first()
    }

    /// What is left out, by rising place.
    pub(crate) fn mute(&self) -> Vec<Mute> {
        let mut mute: Vec<Mute> = Vec::new();
        for axis in 0..self.width() {
            if self.is_constant(axis) {
                mute.push(Mute { axis, says: None });
                continue;
            }
            if self.states < REDUNDANT_AFTER || self.contradicted[axis] {
                continue;
            }
            let own = self.products[place(axis, axis)];
            let speaks = |other: &usize| !mute.iter().any(|mute| mute.axis == *other);
            let says = (0..axis).filter(speaks).find(|&other| {
                let (product, theirs) =
                    (self.products[place(axis, other)], self.products[place(other, other)]);
                own > 0.0 && theirs > 0.0 && product * product >= REDUNDANT * own * theirs
            });
            mute.extend(says.map(|other| Mute { axis, says: Some(other) }));
        }
        mute
    }

    /// Weights for the squares of distances: 1 within the declared range, less where states reach further, 0 for
    /// what is left out.
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
        self.mute().iter().for_each(|mute| weights[mute.axis] = 0.0);
        weights
    }

    /// How many states it rests on.
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
        let mut spread = Spread::new(2);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        (0..30).for_each(|_| spread.take(&[random.random(), random.random()]));
        assert_eq!(spread.weights(), [1.0, 1.0]);
        spread.take(&[1e9, 0.5]);
        assert_eq!(spread.weights(), [1.0, 1.0], "one may lie beyond");
        (0..30).for_each(|_| spread.take(&[9.0 * random.random::<f64>(), random.random()]));
        let weights = spread.weights();
        assert!(weights[0] < 1.0 / 49.0 && weights[0] >= 1.0 / 81.0, "{weights:?}");
        assert_eq!(weights[1], 1.0);
        (0..40).for_each(|_| spread.take(&[-9.0 * random.random::<f64>(), 0.5]));
        assert!(spread.weights()[0] < 1.0 / 196.0);
    }

    #[test]
    fn what_is_constant_is_left_out_until_it_is_not() {
        let mut spread = Spread::new(2);
        (0..7).for_each(|step| spread.take(&[f64::from(step) * 0.1, 0.25]));
        assert_eq!(spread.mute(), []);
        spread.take(&[0.9, 0.25]);
        assert_eq!(spread.mute(), [Mute { axis: 1, says: None }]);
        assert_eq!(spread.weights(), [1.0, 0.0]);
        spread.take(&[0.9, 0.26]);
        assert_eq!(spread.mute(), []);
    }

    #[test]
    fn what_follows_another_is_left_out_until_a_state_contradicts() {
        let mut spread = Spread::new(3);
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut state = || {
            let (a, b): (f64, f64) = (random.random(), random.random());
            [a, b, 0.8 - 0.7 * a]
        };
        (0..40).for_each(|_| spread.take(&state()));
        assert_eq!(spread.mute(), [Mute { axis: 2, says: Some(0) }]);
        spread.take(&[0.5, 0.5, 0.9]);
        (0..1000).for_each(|_| spread.take(&state()));
        assert_eq!(spread.mute(), [], "for good");
        // Two that have nothing in common but one wild state are not one.
        let mut spread = Spread::new(2);
        (0..40).for_each(|_| spread.take(&[random.random(), random.random()]));
        spread.take(&[1e9, 1e9]);
        assert_eq!(spread.mute(), []);
    }
}
