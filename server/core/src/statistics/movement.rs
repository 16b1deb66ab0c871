//! Costs without the part that small movements within a state explain.
//!
//! Indicators that differ by less than the study's tolerance are one state, but a camera that moves a little
//! sees a little more or less. In the model, the logarithm of a cost is that of its configuration at the
//! state's anchor, plus a linear function of the indicators' distances from the anchor, plus noise.
//! Configurations count as random effects. So single measurements count as well, and repeats count most,
//! because the configuration's own cost cancels (Laird and Ware, "Random-effects models for longitudinal
//! data", Biometrics 38, 1982). The slopes have a normal prior around zero. Its width is averaged over,
//! weighed by the likelihood of the measurements (MacKay, "Bayesian interpolation", Neural Computation 4,
//! 1992): where movement does not matter, slopes stay at zero.

use serde::{Deserialize, Serialize};

use crate::matrix::Factor;
use crate::robust::{NOISE_LEAST, NOISE_PRIOR, deviation, median, reach_of};
use crate::statistics::auxiliary::{Observation, Row, by_configuration};

/// Least number of measurements for an estimate of slopes.
const MEASUREMENTS_LEAST: usize = 8;
/// Standard deviations of the effect of all movements together on the logarithm of a cost, beside no effect.
const EFFECTS: [f64; 3] = [0.02, 0.06, 0.18];
/// The least standard deviation between configurations.
const BETWEEN_LEAST: f64 = 0.02;
/// Least number of repeats for an estimate of noise.
const REPEATS_LEAST: usize = 4;
/// Rounds in which noise and slopes are estimated in turn.
const ROUNDS: usize = 3;
/// Smaller movements, as shares of an indicator's range, are rounding errors.
const MOVEMENT_LEAST: f64 = 1e-12;
/// The largest correction of the logarithm of a cost.
const CORRECTION_MAX: f64 = std::f64::consts::LN_2;

/// The effect of movements within a state on its costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Movement {
    /// By indicator.
    slopes: Vec<f64>,
}

impl Movement {
    /// Learns from measurements, beside each the distance of every indicator from the state's anchor, as a
    /// share of its range. `None` where there are too few or nothing moves.
    pub fn of(measurements: &[Observation]) -> Option<Movement> {
        let width = measurements.first()?.beside.len();
        assert!(measurements.iter().all(|one| one.beside.len() == width), "{width} indicators");
        let spread = |axis: usize| {
            let values = || measurements.iter().map(|one| one.beside[axis]);
            let mean = values().sum::<f64>() / measurements.len() as f64;
            (values().map(|x| (x - mean) * (x - mean)).sum::<f64>() / measurements.len() as f64).sqrt()
        };
        let axes: Vec<(usize, f64)> = (0..width)
            .map(|axis| (axis, spread(axis)))
            .filter(|(_, spread)| *spread > MOVEMENT_LEAST)
            .collect();
        if axes.is_empty() || measurements.len() < MEASUREMENTS_LEAST {
            return None;
        }
        let mut logs: Vec<f64> = measurements.iter().map(|one| one.log_cost).collect();
        let middle = median(&mut logs);
        let reach = reach_of(deviation(&logs, middle));
        let centred = |one: &Observation| Observation {
            configuration: one.configuration,
            log_cost: (one.log_cost - middle).clamp(-reach, reach),
            beside: axes.iter().map(|(axis, spread)| one.beside[*axis] / spread).collect(),
        };
        let centred: Vec<Observation> = measurements.iter().map(centred).collect();
        let mut found = vec![0.0; axes.len()];
        for _ in 0..ROUNDS {
            found = slopes(&centred, &found)?;
        }
        let mut slopes = vec![0.0; width];
        for ((axis, spread), slope) in axes.iter().zip(&found) {
            slopes[*axis] = slope / spread;
        }
        slopes.iter().all(|slope| slope.is_finite()).then_some(Movement { slopes })
    }

    /// The part of the logarithm of a cost that the movement explains.
    pub fn explained(&self, offset: &[f64]) -> f64 {
        // Indicators that are too far from the anchor come without an offset.
        assert!(offset.is_empty() || offset.len() == self.slopes.len(), "{} indicators", offset.len());
        let sum: f64 = self.slopes.iter().zip(offset).map(|(slope, x)| slope * x).sum();
        sum.clamp(-CORRECTION_MAX, CORRECTION_MAX)
    }
}

/// One round: the noise that is left by the slopes so far, and the slopes by that noise.
fn slopes(measurements: &[Observation], before: &[f64]) -> Option<Vec<f64>> {
    let dot = |x: &[f64]| x.iter().zip(before).map(|(x, slope)| x * slope).sum::<f64>();
    let all = by_configuration(measurements);
    let groups = all.len();
    let freedom = measurements.len() - groups;
    let within = |one: &Observation| {
        let of = &all[&one.configuration];
        let left = one.log_cost - dot(&one.beside) - (of.log_cost - dot(&of.beside));
        left * left
    };
    let noise_2 = match freedom >= REPEATS_LEAST {
        true => measurements.iter().map(within).sum::<f64>() / freedom as f64,
        false => NOISE_PRIOR * NOISE_PRIOR,
    };
    let noise_2 = noise_2.max(NOISE_LEAST * NOISE_LEAST);
    let mean = all.values().map(|of| of.log_cost - dot(&of.beside)).sum::<f64>();
    let mean = mean / groups as f64;
    let between = |of: &Row| {
        let left = of.log_cost - dot(&of.beside) - mean;
        left * left - noise_2 / of.count
    };
    let between_2 = all.values().map(between).sum::<f64>() / groups as f64;
    let between_2 = between_2.max(BETWEEN_LEAST * BETWEEN_LEAST);
    // Each measurement less a part of its configuration's mean, which makes the errors of all independent.
    let width = before.len() + 1;
    let (mut matrix, mut right) = (vec![0.0; width * width], vec![0.0; width]);
    for one in measurements {
        let of = &all[&one.configuration];
        let part = 1.0 - (noise_2 / (noise_2 + of.count * between_2)).sqrt();
        let cost = one.log_cost - part * of.log_cost;
        let mut row = vec![1.0 - part];
        row.extend(one.beside.iter().zip(&of.beside).map(|(x, mean)| x - part * mean));
        for i in 0..width {
            (0..=i).for_each(|j| matrix[i * width + j] += row[i] * row[j]);
            right[i] += row[i] * cost;
        }
    }
    matrix.iter_mut().chain(&mut right).for_each(|entry| *entry /= noise_2);
    averaged(&matrix, &right)
}

/// The slopes by the normal equations over the noise, the level first, averaged over the widths of the prior,
/// weighed by likelihood.
fn averaged(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    let width = right.len();
    assert_eq!(matrix.len(), width * width, "equations for every slope");
    let axes = width - 1;
    // The level alone is as likely as each of the widths.
    let none = 0.5 * right[0] * right[0] / matrix[0] - 0.5 * libm::log(matrix[0]);
    let mut models = vec![(none, vec![0.0; axes])];
    for effect in EFFECTS {
        let precision = axes as f64 / (effect * effect);
        let mut matrix = matrix.to_vec();
        (1..width).for_each(|axis| matrix[axis * width + axis] += precision);
        let factor = Factor::of(&matrix, width)?;
        let mut found = right.to_vec();
        factor.forward(&mut found);
        let explained = 0.5 * found.iter().map(|x| x * x).sum::<f64>();
        let prior = 0.5 * axes as f64 * libm::log(precision);
        let evidence = explained - factor.half_log_determinant() + prior;
        factor.backward(&mut found);
        models.push((evidence, found[1..].to_vec()));
    }
    let most = models.iter().map(|(evidence, _)| *evidence).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = models.iter().map(|(evidence, _)| libm::exp(evidence - most)).sum();
    let mut slopes = vec![0.0; axes];
    for (evidence, found) in &models {
        let weight = libm::exp(evidence - most) / total;
        slopes.iter_mut().zip(found).for_each(|(slope, found)| *slope += weight * found);
    }
    Some(slopes)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    /// A search of 60 trials, the first configuration every sixth time, while three of four indicators move.
    fn search(seed: u64, slope: f64) -> (Vec<Observation>, Vec<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let truths: Vec<f64> = (0..60).map(|_| 2.0 + 0.1 * normal(&mut random)).collect();
        let one = |trial: usize| {
            let configuration = if trial.is_multiple_of(6) { 0 } else { trial };
            let mut beside: Vec<f64> = (0..3).map(|_| 0.01 * (2.0 * random.random::<f64>() - 1.0)).collect();
            beside.push(0.0);
            let moved = slope * (beside[0] - 0.5 * beside[1]);
            let log_cost = truths[configuration] + moved + 0.02 * normal(&mut random);
            Observation { configuration, log_cost, beside }
        };
        ((0..60).map(one).collect(), truths)
    }

    /// Root of the mean square error of the costs of a search, corrected and as they were measured.
    fn errors(measurements: &[Observation], truths: &[f64], movement: &Movement) -> (f64, f64) {
        let error = |cost: &dyn Fn(&Observation) -> f64| {
            let squares = measurements.iter().map(|one| (cost(one) - truths[one.configuration]).powi(2));
            (squares.sum::<f64>() / measurements.len() as f64).sqrt()
        };
        let corrected = |one: &Observation| one.log_cost - movement.explained(&one.beside);
        (error(&corrected), error(&|one| one.log_cost))
    }

    /// Sums of such errors over searches in which a camera moves costs by `percent` at the ends.
    fn summed_errors(percent: f64) -> (f64, f64) {
        (0..20).fold((0.0, 0.0), |(corrected, raw), seed| {
            let (measurements, truths) = search(seed, percent);
            let movement = Movement::of(&measurements).expect("enough");
            let (with, without) = errors(&measurements, &truths, &movement);
            (corrected + with, raw + without)
        })
    }

    #[test]
    fn what_a_moving_camera_adds_is_taken_off() {
        let (corrected, raw) = summed_errors(12.0);
        assert!(corrected < 0.55 * raw, "{corrected} of {raw}");
    }

    #[test]
    fn movement_that_costs_nothing_changes_little() {
        let (corrected, raw) = summed_errors(0.0);
        assert!(corrected < 1.1 * raw, "{corrected} of {raw}");
    }

    #[test]
    fn where_nothing_moves_or_little_was_measured_nothing_is_learnt() {
        let (mut measurements, _) = search(1, 12.0);
        assert_eq!(Movement::of(&measurements[..7]), None);
        assert_eq!(Movement::of(&[]), None);
        measurements.iter_mut().for_each(|one| one.beside.fill(0.001));
        assert_eq!(Movement::of(&measurements), None);
    }

    #[test]
    fn one_absurd_cost_does_not_bend_the_slopes() {
        let (mut measurements, truths) = search(3, 12.0);
        measurements[17].log_cost = 700.0;
        let movement = Movement::of(&measurements).expect("enough");
        measurements[17].log_cost = truths[17];
        let (with, without) = errors(&measurements, &truths, &movement);
        assert!(with < 2.0 * without, "{with} of {without}");
    }
}
