//! Main effects: the cheap values of each parameter in other states of a study, as a start for the search of
//! a new one.
//!
//! Scenes differ, but the causes of a good configuration are mostly common to them. Before a search begins in
//! a new state, the logarithms of the costs that were measured in other states are fitted by a sum. It has
//! one level for each state, and one effect for each active parameter. This is an analysis of variance by
//! main effects (Box, Hunter and Hunter, "Statistics for Experimenters", 1978). Effects are shrunk towards
//! zero by ridge regression (Hoerl and Kennard, Technometrics 12, 1970). Hundreds of noisy measurements come
//! down to a few numbers for each parameter, so that effects of a few percent stand out from noise.
//!
//! The sum need not hold for the new state. The Gaussian process of the new state gets it as one more
//! feature, on which costs may depend linearly (`FeatureKind::Linear` of the kernel), and learns the
//! coefficient from measurements there. Where the other states mislead, the coefficient goes to zero. The
//! effects are parts of that feature with coefficients of their own, so that the others may be right about
//! one parameter and wrong about another. This is a linear model with a prior on its coefficients, solved in
//! closed form with the process (Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006,
//! section 2.7). Vizier treats earlier studies in this spirit, by a stack of processes (Golovin et al.,
//! "Google Vizier: a service for black-box optimization", KDD 2017, section 3.3).

use serde::{Deserialize, Serialize};

use crate::search::layout::Layout;

/// Number of equidistant knots of the piecewise linear effect of an axis with many values.
const KNOTS: usize = 6;
/// An axis of fewer values than this has one effect for each value.
const CELLS_MAX: u32 = 8;
/// The ridge penalty: an effect is shrunk as if this number of further measurements had shown zero.
const RIDGE: f64 = 3.0;
/// Sweeps of coordinate descent over all effects.
const SWEEPS: usize = 12;
/// A standard deviation of the sums below this is rounding error, and nothing is learnt.
const DEVIATION_MIN: f64 = 1e-9;
/// Steps per standard deviation to which effects are rounded. Costs in another unit then give effects equal
/// to the bit, although their logarithms round differently.
const STEPS_PER_DEVIATION: f64 = (1u64 << 20) as f64;
/// Most rounds over all parameters in [`MainEffects::descend`].
const ROUNDS_MAX: usize = 16;

/// A measurement of another state, from which effects are learnt.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceMeasurement {
    /// The number of its state, from 0.
    pub state: usize,
    /// Its point.
    pub x: Vec<f64>,
    /// The logarithm of its cost.
    pub log_cost: f64,
}

/// The effects of all parameters. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MainEffects {
    /// For each axis, at its knots or for its values by rank. In standard deviations of the measurements'
    /// sums.
    effects: Vec<Vec<f64>>,
    /// The mean sum over the measurements.
    mean: f64,
}

/// The two effects of an axis around a coordinate: the index of the first, and the weight of the second.
fn interpolation(layout: &Layout, axis: usize, x: f64) -> (usize, f64) {
    match layout.cells(axis) {
        0 | CELLS_MAX.. => {
            let at = layout.by_size(axis, x).clamp(0.0, 1.0) * (KNOTS - 1) as f64;
            let first = (at as usize).min(KNOTS - 2);
            (first, at - first as f64)
        }
        cells => {
            let rank = layout.rank(axis, x);
            assert!(rank < cells, "rank {rank} of {cells}");
            (rank as usize, 0.0)
        }
    }
}

/// The number of effects of an axis.
fn count(layout: &Layout, axis: usize) -> usize {
    match layout.cells(axis) {
        0 | CELLS_MAX.. => KNOTS,
        cells => cells as usize,
    }
}

impl MainEffects {
    /// Fits the effects. `None` where nothing can be learnt: fewer than two measurements, or no difference
    /// between them.
    pub fn fit(layout: &Layout, measured: &[SourceMeasurement]) -> Option<MainEffects> {
        let dimension = layout.dimension();
        let states = measured.iter().map(|one| one.state + 1).max()?;
        let mut from = vec![states];
        for axis in 0..dimension {
            from.push(from[axis] + count(layout, axis));
        }
        // For each effect, the measurements that contain it, and its weight in each.
        let mut columns: Vec<Vec<(usize, f64)>> = vec![Vec::new(); from[dimension]];
        for (row, one) in measured.iter().enumerate() {
            columns[one.state].push((row, 1.0));
            let mut x = one.x.clone();
            let active = layout.canonical(&mut x);
            for axis in (0..dimension).filter(|&axis| active[axis]) {
                let (first, share) = interpolation(layout, axis, x[axis]);
                let mut enter = |place: usize, share: f64| {
                    if share > 0.0 {
                        columns[from[axis] + place].push((row, share));
                    }
                };
                enter(first, 1.0 - share);
                enter(first + 1, share);
            }
        }
        let mut levels = vec![(0.0, 0.0); states];
        for one in measured {
            let (sum, count) = &mut levels[one.state];
            (*sum, *count) = (*sum + one.log_cost, *count + 1.0);
        }
        let level = |state: usize| levels[state].0 / levels[state].1;
        // Residuals. The levels among the effects correct the means of the states, which are subtracted here.
        let mut residuals: Vec<f64> = measured.iter().map(|one| one.log_cost - level(one.state)).collect();
        let mut effects = vec![0.0; columns.len()];
        for _ in 0..SWEEPS {
            for (index, (effect, column)) in effects.iter_mut().zip(&columns).enumerate() {
                let ridge = if index < states { 1e-6 } else { RIDGE };
                let (mut product, mut squares) = (0.0, ridge);
                for &(row, share) in column {
                    product += share * (residuals[row] + share * *effect);
                    squares += share * share;
                }
                let now = product / squares;
                column.iter().for_each(|&(row, share)| residuals[row] -= share * (now - *effect));
                *effect = now;
            }
        }
        let effects = (0..dimension).map(|axis| effects[from[axis]..from[axis + 1]].to_vec()).collect();
        let mut fitted = MainEffects { effects, mean: 0.0 };
        let sum_of = |one: &SourceMeasurement| {
            let mut x = one.x.clone();
            let active = layout.canonical(&mut x);
            fitted.sum(layout, &x, &active)
        };
        let sums: Vec<f64> = measured.iter().map(sum_of).collect();
        let mean = sums.iter().sum::<f64>() / sums.len() as f64;
        let deviation = (sums.iter().map(|sum| (sum - mean).powi(2)).sum::<f64>() / sums.len() as f64).sqrt();
        if !(deviation > DEVIATION_MIN && deviation.is_finite()) {
            return None;
        }
        let rounded = |value: f64| (value / deviation * STEPS_PER_DEVIATION).round() / STEPS_PER_DEVIATION;
        fitted.effects.iter_mut().flatten().for_each(|effect| *effect = rounded(*effect));
        fitted.mean = rounded(mean);
        Some(fitted)
    }

    /// The effect of each parameter at a canonical point; 0 where it is inactive.
    pub(super) fn parts<'a>(
        &'a self,
        layout: &'a Layout,
        x: &'a [f64],
        active: &'a [bool],
    ) -> impl Iterator<Item = f64> + 'a {
        self.effects.iter().enumerate().map(move |(axis, effects)| {
            if !active[axis] {
                return 0.0;
            }
            let (first, share) = interpolation(layout, axis, x[axis]);
            let next = if share > 0.0 { share * (effects[first + 1] - effects[first]) } else { 0.0 };
            effects[first] + next
        })
    }

    fn sum(&self, layout: &Layout, x: &[f64], active: &[bool]) -> f64 {
        self.parts(layout, x, active).sum()
    }

    /// The predicted cost of a canonical point, standardised: 0 is the mean over the measurements, 1 is one
    /// standard deviation more (in the logarithm).
    pub(super) fn at(&self, layout: &Layout, x: &[f64], active: &[bool]) -> f64 {
        self.sum(layout, x, active) - self.mean
    }

    /// The point of least predicted cost by coordinate descent from a point: one parameter after the other,
    /// until no other value of any is cheaper. From a configuration with a good measurement it stays near
    /// measurements, where the sum is most reliable.
    pub(crate) fn descend(&self, layout: &Layout, from: &[f64]) -> Vec<f64> {
        let enter = |mut x: Vec<f64>| {
            let active = layout.canonical(&mut x);
            (self.at(layout, &x, &active), x)
        };
        let mut best = enter(from.to_vec());
        for _ in 0..ROUNDS_MAX {
            let before = best.0;
            for axis in 0..self.effects.len() {
                for place in 0..self.effects[axis].len() {
                    let mut x = best.1.clone();
                    x[axis] = match layout.cells(axis) {
                        0 | CELLS_MAX.. => place as f64 / (KNOTS - 1) as f64,
                        _ => layout.at_rank(axis, place as u32),
                    };
                    let other = enter(x);
                    if other.0 < best.0 {
                        best = other;
                    }
                }
            }
            if best.0 >= before {
                break;
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::space::Space;

    /// A back end, a depth that only one of them has, a width and a float.
    fn layout() -> Layout {
        let space = Space::builder().categorical("backend", ["a", "b", "c"]).default("a");
        let space = space.integer("depth", 1..=40).default(8).active_if("backend", ["b"]);
        let space = space.categorical("width", [2, 4, 8]).default(2).float("cost", 0.0..=1.0).default(0.5);
        Layout::of(&space.build().expect("a valid space"))
    }

    /// The logarithm of a cost that is a product of factors: best with the second back end, a middling depth,
    /// the widest nodes and a low cost.
    fn log_cost(layout: &Layout, x: &[f64]) -> f64 {
        let mut x = x.to_vec();
        let active = layout.canonical(&mut x);
        let backend = [0.3, 0.0, 0.5][layout.rank(0, x[0]) as usize];
        let depth = if active[1] { (x[1] - 0.6).abs() } else { 0.0 };
        backend + depth - 0.1 * f64::from(layout.rank(2, x[2])) + 0.4 * x[3]
    }

    fn measured(layout: &Layout, count: usize, noise: f64, level: f64) -> Vec<SourceMeasurement> {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let one = |place: usize| {
            let x: Vec<f64> = (0..layout.dimension()).map(|_| random.random()).collect();
            let state = place % 3;
            let level = level + 2.0 * state as f64;
            let log_cost = level + log_cost(layout, &x) + noise * (2.0 * random.random::<f64>() - 1.0);
            SourceMeasurement { state, x, log_cost }
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn many_noisy_measurements_add_up_to_the_best_of_every_parameter() {
        let layout = layout();
        let effects =
            MainEffects::fit(&layout, &measured(&layout, 300, 0.2, 0.0)).expect("something follows");
        let best = effects.descend(&layout, &[0.5, 0.5, 0.1, 0.9]);
        assert_eq!((layout.rank(0, best[0]), layout.rank(2, best[2])), (1, 2), "{best:?}");
        assert!((0.35..0.85).contains(&best[1]) && best[3] < 0.25, "{best:?}");
        let at = |x: &[f64]| {
            let mut x = x.to_vec();
            let active = layout.canonical(&mut x);
            effects.at(&layout, &x, &active)
        };
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let points: Vec<Vec<f64>> = (0..200).map(|_| (0..4).map(|_| random.random()).collect()).collect();
        let in_order = points.windows(2).filter(|pair| {
            let truth = log_cost(&layout, &pair[0]) < log_cost(&layout, &pair[1]);
            (at(&pair[0]) < at(&pair[1])) == truth
        });
        let in_order = in_order.count();
        assert!(in_order > 170, "{in_order} of 199");
    }

    #[test]
    fn what_a_whole_state_costs_says_nothing() {
        let layout = layout();
        let effects = |level: f64| MainEffects::fit(&layout, &measured(&layout, 60, 0.1, level));
        assert_eq!(effects(0.0), effects(300.0));
    }

    #[test]
    fn nothing_follows_from_nothing_or_equal_costs() {
        let layout = layout();
        assert_eq!(MainEffects::fit(&layout, &[]), None);
        assert_eq!(MainEffects::fit(&layout, &measured(&layout, 1, 0.0, 0.0)), None);
        let mut equal = measured(&layout, 40, 0.1, 0.0);
        equal.iter_mut().for_each(|one| one.log_cost = 0.1 + one.state as f64);
        assert_eq!(MainEffects::fit(&layout, &equal), None);
    }
}
