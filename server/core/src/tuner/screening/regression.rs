//! Bayesian linear regression from sums, and the common part of several regressions.
//!
//! Each state has effects of its own, drawn around those of all states: `w_s ~ N(m, diag(t))`. Mean `m` and
//! spread `t` are found by expectation and maximisation (Dempster, Laird and Rubin 1977) in the form of a
//! hierarchical linear model (Gelman et al., "Bayesian Data Analysis", chapter 15). A parameter with alike
//! effects everywhere is thereby known in a new state before any measurement there.

use serde::{Deserialize, Serialize};

/// Sums over the trials of a state: all that a regression needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Sums {
    /// The lower triangle of the features' products, row by row.
    products: Vec<f64>,
    /// Features times target.
    targets: Vec<f64>,
    square: f64,
    pub(super) count: f64,
}

impl Sums {
    pub(super) fn new(width: usize) -> Self {
        Sums {
            products: vec![0.0; width * (width + 1) / 2],
            targets: vec![0.0; width],
            square: 0.0,
            count: 0.0,
        }
    }

    /// Whether these are sums over `width` features.
    pub(super) fn fits(&self, width: usize) -> bool {
        self.products.len() == width * (width + 1) / 2 && self.targets.len() == width
    }

    pub(super) fn learn(&mut self, features: &[f64], target: f64) {
        assert_eq!(features.len(), self.targets.len(), "a trial of other features");
        let mut place = 0;
        for (row, a) in features.iter().enumerate() {
            for b in &features[..=row] {
                self.products[place] += a * b;
                place += 1;
            }
            self.targets[row] += a * target;
        }
        assert_eq!(place, self.products.len(), "all products were added to");
        self.square += target * target;
        self.count += 1.0;
    }
}

/// The effects of one state: their mean, and the inverse of the factor of their precision.
#[derive(Clone, Debug)]
pub(super) struct Effects {
    pub(super) mean: Vec<f64>,
    /// Lower triangle of L⁻¹, where the precision is L Lᵀ; row by row.
    inverse: Vec<f64>,
}

impl Effects {
    /// The posterior variance of a combination of effects.
    pub(super) fn variance(&self, combination: &[f64]) -> f64 {
        let rows = combination.len();
        assert_eq!(rows, self.mean.len(), "a combination of all effects");
        (0..rows)
            .map(|row| dot(&self.inverse[start(row)..=start(row) + row], &combination[..=row]).powi(2))
            .sum()
    }

    /// The posterior variances of the effects themselves.
    fn variances(&self) -> Vec<f64> {
        let width = self.mean.len();
        let mut variances = vec![0.0; width];
        for row in 0..width {
            for (column, variance) in variances[..=row].iter_mut().enumerate() {
                *variance += self.inverse[start(row) + column].powi(2);
            }
        }
        variances
    }
}

/// The common part of the effects of all states.
#[derive(Clone, Debug)]
pub(super) struct Common {
    mean: Vec<f64>,
    /// Variance of each effect from state to state.
    spread: Vec<f64>,
    /// Variance that the effects do not explain.
    pub(super) noise: f64,
}

/// The effects that are expected before anything is known: of a size of 20 % of the cost.
const EFFECT_PRIOR: f64 = 0.2;
/// Other states say nothing of the constant of a state.
const CONSTANT_PRIOR: f64 = 1.0;
/// Weight of the spread's prior, in states.
const SPREAD_PRIOR_STATES: f64 = 0.1;
/// The least residual that is assumed: timers are not better.
const NOISE_LEAST: f64 = 1e-4;
const STEPS: usize = 8;

impl Common {
    /// The prior, before any trial.
    fn prior(width: usize) -> Self {
        let mut spread = vec![EFFECT_PRIOR * EFFECT_PRIOR; width];
        spread[0] = CONSTANT_PRIOR;
        Common { mean: vec![0.0; width], spread, noise: 0.01 }
    }

    /// Learns from all states.
    pub(super) fn learn<'a>(states: impl Iterator<Item = &'a Sums> + Clone, width: usize) -> Option<Self> {
        let mut common = Common::prior(width);
        let count = states.clone().count() as f64;
        for _ in 0..STEPS {
            let effects: Vec<(&Sums, Effects)> =
                states.clone().map(|sums| Some((sums, common.effects(sums)?))).collect::<Option<_>>()?;
            let mut next = Common::prior(width);
            for feature in 1..width {
                let sum: f64 = effects.iter().map(|(_, effects)| effects.mean[feature]).sum();
                // Drawn towards no effect, as if by one more state.
                next.mean[feature] = sum / (count + SPREAD_PRIOR_STATES);
            }
            let mut spread: Vec<f64> = next.spread.iter().map(|prior| SPREAD_PRIOR_STATES * prior).collect();
            let (mut residual, mut trials) = (0.01 * 4.0, 4.0);
            for (sums, effects) in &effects {
                let variances = effects.variances();
                for feature in 1..width {
                    spread[feature] +=
                        (effects.mean[feature] - next.mean[feature]).powi(2) + variances[feature];
                }
                residual += sums.residual(effects);
                trials += sums.count;
            }
            for (feature, spread) in spread.iter().enumerate().skip(1) {
                next.spread[feature] = spread / (count + SPREAD_PRIOR_STATES);
            }
            assert!(trials >= 4.0, "{trials} trials");
            next.noise = (residual / trials).max(NOISE_LEAST);
            common = next;
        }
        Some(common)
    }

    /// The effects in one state. `None` where rounding has made the sums useless.
    pub(super) fn effects(&self, sums: &Sums) -> Option<Effects> {
        let width = self.mean.len();
        assert!(sums.fits(width), "sums over {width} features");
        let mut factor: Vec<f64> = sums.products.iter().map(|product| product / self.noise).collect();
        let mut right: Vec<f64> = sums.targets.iter().map(|target| target / self.noise).collect();
        for feature in 0..width {
            factor[start(feature) + feature] += 1.0 / self.spread[feature];
            right[feature] += self.mean[feature] / self.spread[feature];
        }
        factorise(&mut factor, width)?;
        let inverse = invert(&factor, width);
        // The mean is L⁻ᵀ L⁻¹ right.
        let half: Vec<f64> =
            (0..width).map(|row| dot(&inverse[start(row)..=start(row) + row], &right[..=row])).collect();
        let mut mean = vec![0.0; width];
        for row in 0..width {
            for (column, mean) in mean[..=row].iter_mut().enumerate() {
                *mean += inverse[start(row) + column] * half[row];
            }
        }
        mean.iter().all(|mean| mean.is_finite()).then_some(Effects { mean, inverse })
    }
}

impl Sums {
    /// The expected sum of squares that the effects leave.
    fn residual(&self, effects: &Effects) -> f64 {
        let mean = &effects.mean;
        let mut fitted = 0.0;
        let mut place = 0;
        for (row, a) in mean.iter().enumerate() {
            for (column, b) in mean[..=row].iter().enumerate() {
                fitted += self.products[place] * a * b * if row == column { 1.0 } else { 2.0 };
                place += 1;
            }
        }
        (self.square - 2.0 * dot(mean, &self.targets) + fitted).max(0.0)
    }
}

/// Where a row of a lower triangle begins.
fn start(row: usize) -> usize {
    row * (row + 1) / 2
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    debug_assert_eq!(a.len(), b.len(), "vectors of one length");
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Cholesky's factor, in place.
fn factorise(matrix: &mut [f64], width: usize) -> Option<()> {
    assert_eq!(matrix.len(), start(width), "a triangle of {width} rows");
    for row in 0..width {
        for column in 0..=row {
            let (i, j) = (start(row), start(column));
            let sum = matrix[i + column] - dot(&matrix[i..i + column], &matrix[j..j + column]);
            matrix[i + column] = if row == column {
                if !(sum.is_finite() && sum > 0.0) {
                    return None;
                }
                sum.sqrt()
            } else {
                sum / matrix[j + column]
            };
        }
    }
    Some(())
}

/// The inverse of a lower triangle.
fn invert(factor: &[f64], width: usize) -> Vec<f64> {
    assert!((0..width).all(|row| factor[start(row) + row] > 0.0), "the diagonal of a factor is positive");
    let mut inverse = vec![0.0; factor.len()];
    for column in 0..width {
        inverse[start(column) + column] = 1.0 / factor[start(column) + column];
        for row in column + 1..width {
            let sum: f64 = (column..row).map(|k| factor[start(row) + k] * inverse[start(k) + column]).sum();
            inverse[start(row) + column] = -sum / factor[start(row) + row];
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_those_of_the_normal_equations() {
        let mut sums = Sums::new(3);
        for index in 0..200 {
            let (a, b) = (f64::from(index % 7) / 3.0 - 1.0, f64::from(index % 11) / 5.0 - 1.0);
            sums.learn(&[1.0, a, b], 0.5 - 0.3 * a + 0.05 * b);
        }
        let common = Common { noise: 1e-6, ..Common::prior(3) };
        let effects = common.effects(&sums).expect("positive");
        for (mean, expected) in effects.mean.iter().zip([0.5, -0.3, 0.05]) {
            assert!((mean - expected).abs() < 1e-4, "{mean} {expected}");
        }
        assert!(effects.variance(&[0.0, 1.0, 0.0]) < 1e-7);
        assert!((sums.residual(&effects)).abs() < 1e-4);
        // Of other effects it is the plain sum of squares.
        let other = Effects { mean: vec![0.2, 0.7, -0.4], inverse: effects.inverse };
        let left = |index: u32| {
            let (a, b) = (f64::from(index % 7) / 3.0 - 1.0, f64::from(index % 11) / 5.0 - 1.0);
            (0.5 - 0.3 * a + 0.05 * b - (0.2 + 0.7 * a - 0.4 * b)).powi(2)
        };
        let expected: f64 = (0..200).map(left).sum();
        assert!((sums.residual(&other) - expected).abs() < 1e-9 * expected, "{expected}");
    }

    #[test]
    fn what_is_alike_everywhere_is_known_in_a_new_state() {
        let states: Vec<Sums> = (0..12)
            .map(|state| {
                let mut sums = Sums::new(3);
                let own = if state % 2 == 0 { 0.4 } else { -0.4 };
                for index in 0..60 {
                    let (a, b) = (f64::from(index % 7) / 3.0 - 1.0, f64::from(index % 11) / 5.0 - 1.0);
                    let noise = 0.02 * (f64::from((index * 37 + state * 11) % 13) / 6.0 - 1.0);
                    sums.learn(&[1.0, a, b], own * a + noise);
                }
                sums
            })
            .collect();
        let common = Common::learn(states.iter(), 3).expect("well behaved");
        let fresh = common.effects(&Sums::new(3)).expect("the prior");
        let deviation = |feature: &[f64]| fresh.variance(feature).sqrt();
        assert!(deviation(&[0.0, 1.0, 0.0]) > 0.3, "differs from state to state");
        assert!(deviation(&[0.0, 0.0, 1.0]) < 0.1, "matters nowhere: {}", deviation(&[0.0, 0.0, 1.0]));
        assert!(common.noise < 0.002, "{}", common.noise);
    }
}
