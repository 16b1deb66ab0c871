//! Radial basis functions over indicators and parameters (paper section 6.2).
//!
//! The paper calls its features Gaussians and prints `exp(-omega |x - c|)`, the norm without a square. The
//! two differ. The printed form has a cusp at its centre and a long tail, so that in the paper's 28
//! dimensions a typical feature is 0.1. A Gaussian of that width is smooth and a tenth of that. The model
//! follows the formula, with `omega = 1`. Centres come from a Latin hypercube. There are 3.5 times as many
//! features as parameters and indicators.

mod candidates;
mod greedy_gq;

use serde::{Deserialize, Serialize};

use crate::matrix::distance_2;
use crate::predict::draw_in;
use crate::randomness::{Purpose, stream};
use crate::search::latin_hypercube::design;
pub use greedy_gq::Rbf;

/// The widths of all features.
const OMEGA: f64 = 1.0;

/// `ceil(3.5 (parameters + indicators))`, in whole numbers. Indicators that are left out count, so that a
/// model keeps its size.
pub fn feature_count(parameters: usize, indicators: usize) -> usize {
    (7 * (parameters + indicators)).div_ceil(2)
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Basis {
    /// The state's part and the action's part of each centre.
    centres: Vec<(Vec<f64>, Vec<f64>)>,
    /// The places of indicators that are left out.
    omitted: Vec<usize>,
}

impl Basis {
    fn new(parameters: usize, indicators: usize, seed: u64, omitted: &[usize]) -> Self {
        let mut random = stream(seed, Purpose::Centres, 0, 0);
        let centres = design(feature_count(parameters, indicators), indicators + parameters, &mut random);
        let halves = centres.into_iter().map(|mut state| {
            let action = state.split_off(indicators);
            (state, action)
        });
        assert!(omitted.iter().all(|&axis| axis < indicators), "{omitted:?} of {indicators} indicators");
        Basis { centres: halves.collect(), omitted: omitted.to_vec() }
    }

    fn len(&self) -> usize {
        self.centres.len()
    }

    /// The state's part of the squared distance to each centre. Indicators far out of their range are drawn
    /// in, so that features there do not vanish altogether.
    fn state_2(&self, state: &[f64]) -> Vec<f64> {
        let state: Vec<f64> = state.iter().map(|&x| draw_in(x)).collect();
        let distance_2 = |(centre, _): &(Vec<f64>, Vec<f64>)| {
            let terms = state.iter().zip(centre).enumerate().filter(|(axis, _)| !self.omitted.contains(axis));
            terms.map(|(_, (a, b))| (a - b) * (a - b)).sum::<f64>()
        };
        self.centres.iter().map(distance_2).collect()
    }

    /// The action's part of the squared distance to each centre.
    fn action_2(&self, point: &[f64]) -> Vec<f64> {
        self.centres.iter().map(|(_, centre)| distance_2(point, centre)).collect()
    }

    /// The features at the sums of squared distances.
    fn features(&self, state_2: &[f64], action_2: &[f64], phi: &mut Vec<f64>) {
        let count = self.len();
        assert!(state_2.len() == count && action_2.len() == count, "{count} centres");
        phi.clear();
        phi.extend(state_2.iter().zip(action_2).map(|(state, action)| state + action));
        phi.iter_mut().for_each(|x| *x = exp_minus(OMEGA * x.sqrt()));
    }
}

/// `exp(-x)` for `x >= 0`, to 1e-13 of its value; `x` counts as at most 700. It has no branches, so that the
/// compiler computes several at once: features take most of a model's time.
fn exp_minus(x: f64) -> f64 {
    use std::f64::consts::{LN_2, LOG2_E};
    /// Adding this leaves an integer in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    /// `ln 2` less a short number whose multiples are exact.
    const LN_2_HIGH: f64 = 0.693_145_751_953_125;
    const LN_2_LOW: f64 = LN_2 - LN_2_HIGH;
    let x = if x < 700.0 { x } else { 700.0 };
    let shifted = ROUND - x * LOG2_E;
    let k = shifted - ROUND;
    let r = (-x - k * LN_2_HIGH) - k * LN_2_LOW;
    // Taylor's series; |r| is at most 0.35.
    let mut sum = 1.0 / 479_001_600.0;
    for inverse in [
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        sum = sum * r + inverse;
    }
    // The low bits of `shifted` are k + 2^51, whose upper part the shift throws away.
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    sum * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_feature_count_is_the_papers() {
        assert_eq!(feature_count(11, 17), 98);
        assert_eq!(feature_count(1, 0), 4);
    }

    #[test]
    fn the_quick_exponential_is_the_exponential() {
        for step in 0..70_000 {
            let x = f64::from(step) * 0.01;
            let (quick, right) = (exp_minus(x), (-x).exp());
            assert!((quick - right).abs() <= 1e-13 * right, "{x}: {quick} against {right}");
        }
        assert_eq!(exp_minus(0.0), 1.0);
        assert!(exp_minus(f64::MAX) > 0.0);
    }
}
