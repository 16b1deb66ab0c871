//! What a cost would have been without the noise that other measurements explain.
//!
//! A client may report quantities beside its costs that say something of them: the processor time of a frame, which hardly
//! knows of other programs, or the counted work of its rays, which has no noise at all (that counts predict the time of
//! tracing rays: Aila, Karras and Laine, "On quality metrics of bounding volume hierarchies", High-Performance Graphics
//! 2013). The regression of cost on them over configurations predicts a cost by itself; how far that is off, and how noisy
//! costs and predictions are, is told by configurations that were measured again. Of the measured cost and the predicted
//! one the combination of least variance is taken, with the covariance of their noises: the method of control variates
//! (Nelson, "Control variate remedies", Operations Research 38, 1990). Where the other quantities say nothing, the cost is
//! left as it was measured. What disturbs costs may not have happened yet when all this is learnt: so costs are taken to be a
//! little noisier than they were seen to be ([`UNSEEN_NOISE`]), which decides where both are as good.

use serde::{Deserialize, Serialize};

use crate::matrix::Factor;

/// Repeats, beyond the first measurement of each configuration, from which noise is judged.
const REPEATS_LEAST: usize = 5;
/// Configurations beyond the number of coefficients from which the regression is judged.
const CONFIGURATIONS_SPARE: usize = 4;
/// Coefficients are drawn to zero by so much, in variances of the quantity.
const RIDGE: f64 = 1e-3;
/// The standard deviation of the noise that costs alone may have beyond what was seen: other programs that did not run yet.
const UNSEEN_NOISE: f64 = 0.02;
/// Variances of less are rounding.
const VARIANCE_LEAST: f64 = 1e-18;

/// One trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Which configuration: any number.
    pub configuration: usize,
    /// The logarithm of its cost.
    pub log_cost: f64,
    /// Logarithms of the auxiliary measurements, in the same order in all observations.
    pub auxiliary: Vec<f64>,
}

/// The best combination of a cost with what auxiliary measurements predict of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Denoiser {
    level: f64,
    means: Vec<f64>,
    slopes: Vec<f64>,
    weight: f64,
    /// Variance of the noise of a cost as it is measured, and of the combination.
    noise_2: f64,
    combined_2: f64,
}

/// Means over the observations of one configuration.
struct Group {
    count: f64,
    log_cost: f64,
    auxiliary: Vec<f64>,
}

fn groups(observations: &[Observation]) -> Vec<(usize, Group)> {
    let mut groups: Vec<(usize, Group)> = Vec::new();
    for one in observations {
        let place = groups.iter().position(|(name, _)| *name == one.configuration).unwrap_or_else(|| {
            let group = Group { count: 0.0, log_cost: 0.0, auxiliary: vec![0.0; one.auxiliary.len()] };
            groups.push((one.configuration, group));
            groups.len() - 1
        });
        let group = &mut groups[place].1;
        group.count += 1.0;
        group.log_cost += (one.log_cost - group.log_cost) / group.count;
        for (mean, x) in group.auxiliary.iter_mut().zip(&one.auxiliary) {
            *mean += (x - *mean) / group.count;
        }
    }
    groups
}

impl Denoiser {
    /// Learns from observations, all with the same auxiliary measurements. `None` where there are too few, or too few
    /// repeats, to tell what helps.
    pub fn of(observations: &[Observation]) -> Option<Denoiser> {
        let width = observations.first()?.auxiliary.len();
        let groups = groups(observations);
        let repeats = observations.len() - groups.len();
        if width == 0 || repeats < REPEATS_LEAST || groups.len() < width + 1 + CONFIGURATIONS_SPARE {
            return None;
        }
        let total: f64 = groups.iter().map(|(_, group)| group.count).sum();
        let mean = |of: &dyn Fn(&Group) -> f64| -> f64 {
            groups.iter().map(|(_, group)| group.count * of(group)).sum::<f64>() / total
        };
        let level = mean(&|group| group.log_cost);
        let means: Vec<f64> = (0..width).map(|axis| mean(&|group| group.auxiliary[axis])).collect();
        let mut matrix = vec![0.0; width * width];
        let mut slopes = vec![0.0; width];
        for i in 0..width {
            for j in 0..=i {
                matrix[i * width + j] =
                    mean(&|group| (group.auxiliary[i] - means[i]) * (group.auxiliary[j] - means[j]));
            }
            matrix[i * width + i] = matrix[i * width + i] * (1.0 + RIDGE) + VARIANCE_LEAST;
            slopes[i] = mean(&|group| (group.auxiliary[i] - means[i]) * (group.log_cost - level));
        }
        let factor = Factor::of(&matrix, width)?;
        factor.forward(&mut slopes);
        factor.backward(&mut slopes);
        let mut denoiser = Denoiser { level, means, slopes, weight: 0.0, noise_2: 0.0, combined_2: 0.0 };
        // Noises of costs and predictions, by repeats.
        let (mut cost_2, mut predicted_2, mut both) = (0.0, 0.0, 0.0);
        for one in observations {
            let (_, group) = groups.iter().find(|(name, _)| *name == one.configuration)?;
            let cost = one.log_cost - group.log_cost;
            let predicted = denoiser.predicted(&one.auxiliary) - denoiser.predicted(&group.auxiliary);
            cost_2 += cost * cost;
            predicted_2 += predicted * predicted;
            both += cost * predicted;
        }
        let freedom = repeats as f64;
        let (cost_2, predicted_2, both) = (cost_2 / freedom, predicted_2 / freedom, both / freedom);
        // What predictions are off beyond noise.
        let misses = groups.iter().map(|(_, group)| {
            let miss = group.log_cost - denoiser.predicted(&group.auxiliary);
            miss * miss - (cost_2 + predicted_2 - 2.0 * both) / group.count
        });
        let spare = (groups.len() - width - 1) as f64;
        let off_2 = (misses.sum::<f64>() / spare).max(0.0);
        if cost_2.is_nan() || cost_2 <= VARIANCE_LEAST {
            return None;
        }
        let unseen_2 = UNSEEN_NOISE * UNSEEN_NOISE;
        let spread = (cost_2 + predicted_2 + off_2 - 2.0 * both).max(0.0);
        denoiser.weight = ((cost_2 - both + unseen_2) / (spread + unseen_2)).clamp(0.0, 1.0);
        denoiser.noise_2 = cost_2;
        let (own, other) = (1.0 - denoiser.weight, denoiser.weight);
        denoiser.combined_2 =
            own * own * cost_2 + other * other * (predicted_2 + off_2) + 2.0 * own * other * both;
        denoiser.slopes.iter().all(|slope| slope.is_finite()).then_some(denoiser)
    }

    /// What the auxiliary measurements alone predict.
    fn predicted(&self, auxiliary: &[f64]) -> f64 {
        let terms = auxiliary.iter().zip(&self.means).zip(&self.slopes);
        self.level + terms.map(|((x, mean), slope)| slope * (x - mean)).sum::<f64>()
    }

    /// The logarithm of a cost without the noise that is explained.
    pub fn denoised(&self, log_cost: f64, auxiliary: &[f64]) -> f64 {
        (1.0 - self.weight) * log_cost + self.weight * self.predicted(auxiliary)
    }

    /// How much the auxiliary measurements have a say: 0 leaves costs as they were measured, 1 takes what is predicted.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Which share of the variance of a single measurement's noise is left.
    pub fn variance_left(&self) -> f64 {
        (self.combined_2 / self.noise_2).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::statistics::simulated::normal;

    /// Trials of 40 configurations, every other one measured twice, with what the costs really are.
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
            let auxiliary = vec![auxiliary(truth, load, &mut random)];
            Observation { configuration, log_cost, auxiliary }
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
            denoiser.map_or(one.log_cost, |denoiser| denoiser.denoised(one.log_cost, &one.auxiliary))
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
            assert!(denoised < 0.8 * raw && denoiser.variance_left() < 0.8, "{denoised} of {raw}");
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
                let auxiliary = vec![own + 0.005 * normal(&mut random)];
                Observation { configuration, log_cost: own + load, auxiliary }
            };
            let quiet: Vec<Observation> = (0..30).map(|number| trial(number % 20, 0.0)).collect();
            let denoiser = Denoiser::of(&quiet).expect("there are repeats");
            let loaded = trial(7, 0.7);
            let off = denoiser.denoised(loaded.log_cost, &loaded.auxiliary) - 0.7;
            assert!(off.abs() < 0.2, "{off} off with a weight of {}", denoiser.weight());
        }
    }

    #[test]
    fn what_says_nothing_is_not_listened_to() {
        for seed in 0..10 {
            let (observations, truths) = trials(seed, |_, _, random| normal(random));
            let denoiser = Denoiser::of(&observations);
            let (denoised, raw) = errors(&observations, &truths, denoiser.as_ref());
            // Drawing everything to the mean is as good as such noise allows, and no worse than the costs themselves.
            assert!(denoised < 1.05 * raw, "{denoised} of {raw}");
        }
    }

    #[test]
    fn too_little_says_nothing() {
        let (observations, _) = trials(1, |truth, _, _| truth);
        assert_eq!(Denoiser::of(&[]), None);
        assert_eq!(Denoiser::of(&observations[..44]), None, "too little was measured again");
        let constant: Vec<Observation> = (0..40)
            .map(|place| Observation { configuration: place % 20, log_cost: 1.0, auxiliary: vec![2.0] })
            .collect();
        assert_eq!(Denoiser::of(&constant), None);
    }
}
