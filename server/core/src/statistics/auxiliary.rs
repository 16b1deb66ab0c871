//! Costs without the noise that other measurements explain.
//!
//! A client may report quantities beside its costs that depend on them. One is the processor time of a frame,
//! which other programs hardly change. Another is the counted work of its rays, which has no noise at all (on
//! counts that predict the time of tracing rays: Aila, Karras and Laine, "On quality metrics of bounding
//! volume hierarchies", High-Performance Graphics 2013). The regression of cost on them over configurations
//! predicts a cost by itself. Its error, and the noise of costs and predictions, are estimated from
//! configurations that were measured again. The result is the combination of the measured and the predicted
//! cost of least variance, with the covariance of their noises. This is the method of control variates
//! (Nelson, "Control variate remedies", Operations Research 38, 1990). Where the other quantities say
//! nothing, the cost stays as measured.
//!
//! Other programs come and go in spells that last for many trials. Configurations measured in one spell only
//! would seem badly predicted, and where a search meets better ones later, the regression takes a spell for
//! their merit. So it also runs over the differences of consecutive trials, which cancel a spell
//! (differencing against serial correlation: Hamilton, "Time Series Analysis", 1994, chapter 8). A
//! prediction's error is also taken against the nearer of a trial's two neighbours. A spell that begins or
//! ends is far from one of them, a badly predicted configuration from both.
//!
//! A disturbance may not have happened yet when the regression is learnt. So the assumed noise of costs is a
//! little larger than the measured one (`UNSEEN_NOISE`), which favours the prediction where both are equally
//! good.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::matrix::Factor;
use crate::robust::median;

/// Least number of repeats, beyond each configuration's first measurement, before noise is judged.
const REPEATS_LEAST: usize = 5;
/// Least number of configurations, beyond the number of coefficients, before the regression is judged.
const CONFIGURATIONS_SPARE: usize = 4;
/// Strength with which coefficients are drawn to zero, in variances of the quantity.
const RIDGE: f64 = 1e-3;
/// The standard deviation of a further noise of costs alone, from other programs that did not run yet.
const UNSEEN_NOISE: f64 = 0.03;
/// Standard deviations of a difference beyond which a spell begins or ends there.
const SPELL_BEGINS: f64 = 3.0;
/// The median of the absolute value of a normal variable of unit variance.
const MEDIAN_OF_NORMAL: f64 = 0.6745;
/// The mean square difference between a normal variable of unit variance and the nearer of two others: 2 −
/// 2√3/π.
const NEARER_OF_TWO: f64 = 0.8973;
/// Smaller variances are rounding errors.
const VARIANCE_LEAST: f64 = 1e-18;

/// One trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The number of its configuration.
    pub configuration: usize,
    /// The logarithm of its cost.
    pub log_cost: f64,
    /// Possible explanations of a part of it, in one order in all observations: logarithms of auxiliary
    /// measurements, or movements of indicators.
    pub beside: Vec<f64>,
}

/// The best combination of a measured cost and its prediction by auxiliary measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Denoiser {
    level: f64,
    means: Vec<f64>,
    slopes: Vec<f64>,
    /// 0 leaves costs as they were measured, 1 takes the predicted ones.
    pub(crate) weight: f64,
}

/// Means over `count` observations of one configuration, or differences that weigh as much.
#[derive(Default)]
pub(super) struct Row {
    pub(super) count: f64,
    pub(super) log_cost: f64,
    pub(super) beside: Vec<f64>,
}

pub(super) fn by_configuration(observations: &[Observation]) -> BTreeMap<usize, Row> {
    let mut means: BTreeMap<usize, Row> = BTreeMap::new();
    for one in observations {
        let of = means.entry(one.configuration).or_default();
        of.beside.resize(one.beside.len(), 0.0);
        of.count += 1.0;
        of.log_cost += (one.log_cost - of.log_cost) / of.count;
        for (mean, x) in of.beside.iter_mut().zip(&one.beside) {
            *mean += (x - *mean) / of.count;
        }
    }
    means
}

/// The least-squares slopes through the origin, and the mean square of the residuals.
fn least_squares(rows: &[Row], width: usize) -> Option<(Vec<f64>, f64)> {
    let total: f64 = rows.iter().map(|row| row.count).sum();
    let mean =
        |of: &dyn Fn(&Row) -> f64| -> f64 { rows.iter().map(|row| row.count * of(row)).sum::<f64>() / total };
    assert!(rows.iter().all(|row| row.beside.len() == width && row.count > 0.0), "{width} in a row");
    let mut matrix = vec![0.0; width * width];
    let mut slopes = vec![0.0; width];
    for i in 0..width {
        for j in 0..=i {
            matrix[i * width + j] = mean(&|row| row.beside[i] * row.beside[j]);
        }
        matrix[i * width + i] = matrix[i * width + i] * (1.0 + RIDGE) + VARIANCE_LEAST;
        slopes[i] = mean(&|row| row.beside[i] * row.log_cost);
    }
    let factor = Factor::of(&matrix, width)?;
    factor.forward(&mut slopes);
    factor.backward(&mut slopes);
    let residual_2 = mean(&|row| row.left(&slopes) * row.left(&slopes));
    Some((slopes, residual_2))
}

impl Row {
    fn left(&self, slopes: &[f64]) -> f64 {
        self.log_cost - self.beside.iter().zip(slopes).map(|(x, slope)| slope * x).sum::<f64>()
    }
}

/// The slopes by the differences of consecutive trials, without those between spells, and the residual
/// variance of a trial, spells included. `None` where there are too few.
fn slopes_in_time(observations: &[Observation], width: usize) -> Option<(Vec<f64>, f64)> {
    let pairs = observations.iter().zip(&observations[1..]);
    let pairs = pairs.filter(|(one, next)| one.configuration != next.configuration);
    let mut rows: Vec<Row> = pairs
        .map(|(one, next)| Row {
            count: 1.0,
            log_cost: next.log_cost - one.log_cost,
            beside: next.beside.iter().zip(&one.beside).map(|(next, one)| next - one).collect(),
        })
        .collect();
    if rows.len() < width + CONFIGURATIONS_SPARE {
        return None;
    }
    let (slopes, residual_2) = least_squares(&rows, width)?;
    let mut left: Vec<f64> = rows.iter().map(|row| row.left(&slopes).abs()).collect();
    let limit = SPELL_BEGINS * median(&mut left) / MEDIAN_OF_NORMAL;
    rows.retain(|row| row.left(&slopes).abs() <= limit);
    let (slopes, _) = least_squares(&rows, width)?;
    Some((slopes, 0.5 * residual_2))
}

impl Denoiser {
    /// Learns from observations in the order in which they were made. All have one set of auxiliary
    /// measurements. `None` where there are too few observations or repeats.
    pub fn of(observations: &[Observation]) -> Option<Denoiser> {
        let width = observations.first()?.beside.len();
        assert!(observations.iter().all(|one| one.beside.len() == width), "{width} measurements beside");
        let groups = by_configuration(observations);
        let repeats = observations.len() - groups.len();
        if width == 0 || repeats < REPEATS_LEAST || groups.len() < width + 1 + CONFIGURATIONS_SPARE {
            return None;
        }
        let total: f64 = groups.values().map(|group| group.count).sum();
        let mean = |of: &dyn Fn(&Row) -> f64| -> f64 {
            groups.values().map(|group| group.count * of(group)).sum::<f64>() / total
        };
        let level = mean(&|group| group.log_cost);
        let means: Vec<f64> = (0..width).map(|axis| mean(&|group| group.beside[axis])).collect();
        let apart = groups.values().map(|group| Row {
            count: group.count,
            log_cost: group.log_cost - level,
            beside: group.beside.iter().zip(&means).map(|(x, mean)| x - mean).collect(),
        });
        let (over_configurations, residual_2) = least_squares(&apart.collect::<Vec<_>>(), width)?;
        let slopes = match slopes_in_time(observations, width) {
            Some((in_time, in_time_2)) if in_time_2 < residual_2 => in_time,
            _ => over_configurations,
        };
        let mut denoiser = Denoiser { level, means, slopes, weight: 0.0 };
        // Noises of costs and predictions, by repeats.
        let (mut cost_2, mut predicted_2, mut both) = (0.0, 0.0, 0.0);
        for one in observations {
            let group = &groups[&one.configuration];
            let cost = one.log_cost - group.log_cost;
            let predicted = denoiser.predicted(&one.beside) - denoiser.predicted(&group.beside);
            cost_2 += cost * cost;
            predicted_2 += predicted * predicted;
            both += cost * predicted;
        }
        let freedom = repeats as f64;
        let (cost_2, predicted_2, both) = (cost_2 / freedom, predicted_2 / freedom, both / freedom);
        // Errors of predictions beyond noise.
        let misses = groups.values().map(|group| {
            let miss = group.log_cost - denoiser.predicted(&group.beside);
            miss * miss - (cost_2 + predicted_2 - 2.0 * both) / group.count
        });
        let spare = (groups.len() - width - 1) as f64;
        let off_2 = (misses.sum::<f64>() / spare).max(0.0).min(denoiser.off_in_time_2(observations));
        if cost_2.is_nan() || cost_2 <= VARIANCE_LEAST {
            return None;
        }
        let unseen_2 = UNSEEN_NOISE * UNSEEN_NOISE;
        let spread = (cost_2 + predicted_2 + off_2 - 2.0 * both).max(0.0);
        denoiser.weight = ((cost_2 - both + unseen_2) / (spread + unseen_2)).clamp(0.0, 1.0);
        denoiser.slopes.iter().all(|slope| slope.is_finite()).then_some(denoiser)
    }

    /// An upper bound of the predictions' error variance, noise included, that spells do not raise: from each
    /// trial and the nearer of its neighbours in time. Infinite without such trials.
    fn off_in_time_2(&self, observations: &[Observation]) -> f64 {
        let off = |one: &Observation| one.log_cost - self.predicted(&one.beside);
        let (mut sum, mut count) = (0.0, 0.0);
        for three in observations.windows(3) {
            let [before, one, after] = three else { continue };
            // Trials of one configuration share their error.
            if before.configuration != one.configuration && after.configuration != one.configuration {
                let nearer = (off(one) - off(before)).abs().min((off(one) - off(after)).abs());
                (sum, count) = (sum + nearer * nearer, count + 1.0);
            }
        }
        if count >= CONFIGURATIONS_SPARE as f64 { sum / count / NEARER_OF_TWO } else { f64::INFINITY }
    }

    /// The prediction of the auxiliary measurements alone.
    fn predicted(&self, auxiliary: &[f64]) -> f64 {
        assert_eq!(auxiliary.len(), self.slopes.len(), "as many measurements as were learnt from");
        let terms = auxiliary.iter().zip(&self.means).zip(&self.slopes);
        self.level + terms.map(|((x, mean), slope)| slope * (x - mean)).sum::<f64>()
    }

    /// The logarithm of a cost without the explained noise.
    pub fn denoised(&self, log_cost: f64, auxiliary: &[f64]) -> f64 {
        (1.0 - self.weight) * log_cost + self.weight * self.predicted(auxiliary)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    /// Trials of 40 configurations, every other one measured twice, and their true costs.
    fn trials(
        seed: u64,
        auxiliary: impl Fn(f64, f64, &mut ChaCha8Rng) -> f64,
    ) -> (Vec<Observation>, Vec<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let truths: Vec<f64> = (0..40).map(|_| 2.0 + 0.2 * normal(&mut random)).collect();
        let places = (0..40).chain((0..40).step_by(2));
        let observations = places.map(|configuration| {
            let truth = truths[configuration];
            // None, one or two busy processes beside it: factors 1, 1.6 and 2.2 on wall time.
            let load = [0.0, 0.48, 0.77][random.random_range(0..3)];
            let log_cost = truth + load + 0.03 * normal(&mut random);
            let beside = vec![auxiliary(truth, load, &mut random)];
            Observation { configuration, log_cost, beside }
        });
        (observations.collect(), truths)
    }

    /// Root of the mean square error of costs, denoised and raw, apart from a common level.
    fn errors(observations: &[Observation], truths: &[f64], denoiser: Option<&Denoiser>) -> (f64, f64) {
        let error = |cost: &dyn Fn(&Observation) -> f64| {
            let off: Vec<f64> =
                observations.iter().map(|one| cost(one) - truths[one.configuration]).collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            (off.iter().map(|off| (off - mean) * (off - mean)).sum::<f64>() / off.len() as f64).sqrt()
        };
        let denoised = |one: &Observation| {
            denoiser.map_or(one.log_cost, |denoiser| denoiser.denoised(one.log_cost, &one.beside))
        };
        (error(&denoised), error(&|one| one.log_cost))
    }

    #[test]
    fn processor_time_takes_the_load_of_others_out() {
        let (mut denoised_sum, mut raw_sum) = (0.0, 0.0);
        for seed in 0..10 {
            let cpu =
                |truth: f64, load: f64, random: &mut ChaCha8Rng| truth + 0.08 * load + 0.03 * normal(random);
            let (observations, truths) = trials(seed, cpu);
            let denoiser = Denoiser::of(&observations).expect("there are repeats");
            let (denoised, raw) = errors(&observations, &truths, Some(&denoiser));
            assert!(denoised < 0.8 * raw, "{denoised} of {raw}");
            denoised_sum += denoised;
            raw_sum += raw;
        }
        assert!(denoised_sum < 0.5 * raw_sum, "{denoised_sum} of {raw_sum}");
    }

    #[test]
    fn what_was_learnt_on_a_quiet_machine_holds_when_others_come() {
        for seed in 0..10 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            // One part of the noise both share, as clocks do; another one only other programs bring.
            let mut trial = |configuration: usize, load: f64| {
                let own = 0.1 * configuration as f64 + 0.03 * normal(&mut random);
                let beside = vec![own + 0.005 * normal(&mut random)];
                Observation { configuration, log_cost: own + load, beside }
            };
            let quiet: Vec<Observation> = (0..30).map(|number| trial(number % 20, 0.0)).collect();
            let denoiser = Denoiser::of(&quiet).expect("there are repeats");
            let loaded = trial(7, 0.7);
            let off = denoiser.denoised(loaded.log_cost, &loaded.beside) - 0.7;
            assert!(off.abs() < 0.2, "{off} off with a weight of {}", denoiser.weight);
        }
    }

    /// A search of 120 trials that finds better and better, the first configuration every eighth time, on a
    /// machine that is slower for whole spells. Returns the true costs by configuration, too.
    fn search_in_spells(seed: u64, unlike: impl Fn(usize) -> f64) -> (Vec<Observation>, Vec<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let truths: Vec<f64> = (0..120_i32)
            .map(|trial| {
                2.0 + 0.4 * normal(&mut random).abs() * 0.97_f64.powi(trial) - 0.003 * f64::from(trial)
            })
            .collect();
        let (mut load, mut latest) = (0.0, 0);
        let mut observations = Vec::new();
        for trial in 0..120 {
            if random.random_range(0.0..1.0) < 0.05 {
                load = [0.0, 0.4, 0.69][random.random_range(0..3)];
            }
            let configuration = match trial % 8 {
                0 => 0,
                3 => latest,
                _ => trial,
            };
            latest = configuration;
            let own = truths[configuration] + 0.03 * normal(&mut random);
            let beside = vec![own + 0.02 * normal(&mut random) - unlike(configuration)];
            observations.push(Observation { configuration, log_cost: own + load, beside });
        }
        (observations, truths)
    }

    #[test]
    fn spells_of_load_are_nobodys_merit() {
        let (mut denoised_sum, mut raw_sum) = (0.0, 0.0);
        for seed in 0..20 {
            let (observations, truths) = search_in_spells(seed, |_| 0.0);
            let denoiser = Denoiser::of(&observations).expect("there are repeats");
            let (denoised, raw) = errors(&observations, &truths, Some(&denoiser));
            denoised_sum += denoised;
            raw_sum += raw;
        }
        assert!(denoised_sum < 0.3 * raw_sum, "{denoised_sum} of {raw_sum}");
    }

    #[test]
    fn what_predicts_some_configurations_badly_is_not_believed_of_them() {
        let mut sum = 0.0;
        for seed in 0..20 {
            // A search that ends among configurations which do half the work at equal cost, as those that
            // leave a thread idle do by processor time.
            let halved = |configuration: usize| if configuration > 60 { 0.69 } else { 0.0 };
            let (observations, truths) = search_in_spells(seed, halved);
            let denoiser = Denoiser::of(&observations).expect("there are repeats");
            // Their mean error, beside the others'.
            let off = |is_halved: bool| {
                let those = observations.iter().filter(|one| (one.configuration > 60) == is_halved);
                let off: Vec<f64> = those
                    .map(|one| denoiser.denoised(one.log_cost, &one.beside) - truths[one.configuration])
                    .collect();
                off.iter().sum::<f64>() / off.len() as f64
            };
            let bias = off(true) - off(false);
            sum += bias / 20.0;
        }
        assert!(sum.abs() < 0.2, "{sum}");
    }

    #[test]
    fn what_says_nothing_is_not_listened_to() {
        for seed in 0..10 {
            let (observations, truths) = trials(seed, |_, _, random| normal(random));
            let denoiser = Denoiser::of(&observations);
            let (denoised, raw) = errors(&observations, &truths, denoiser.as_ref());
            // Drawing everything to the mean is as good as such noise allows, and no worse than the costs
            // themselves.
            assert!(denoised < 1.05 * raw, "{denoised} of {raw}");
        }
    }

    #[test]
    fn too_little_says_nothing() {
        let (observations, _) = trials(1, |truth, _, _| truth);
        assert_eq!(Denoiser::of(&[]), None);
        assert_eq!(Denoiser::of(&observations[..44]), None, "too little was measured again");
        let constant: Vec<Observation> = (0..40)
            .map(|place| Observation { configuration: place % 20, log_cost: 1.0, beside: vec![2.0] })
            .collect();
        assert_eq!(Denoiser::of(&constant), None);
    }
}
