//! What estimates promise, on landscapes whose truth is known.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::statistics::simulated::normal;

const NOISE: f64 = 0.07;

fn distance_2(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// What a search leaves behind that falls for luck: a quarter at random, then steps from the lowest mean.
fn searched(
    truth: impl Fn(&[f64]) -> f64,
    dimension: usize,
    trials: usize,
    seed: u64,
) -> Vec<ConfigurationSample> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut all: Vec<(Vec<f64>, Vec<f64>)> = vec![(vec![0.7; dimension], Vec::new())];
    for trial in 0..trials {
        let measured = all.iter().enumerate().filter(|(_, one)| !one.1.is_empty());
        let best =
            measured.min_by(|a, b| mean(&a.1.1).total_cmp(&mean(&b.1.1))).map_or(0, |(place, _)| place);
        if trial > 0 && trial < trials / 4 {
            all.push(((0..dimension).map(|_| random.random()).collect(), Vec::new()));
        } else if trial > 0 && trial % 10 > 0 {
            let step = 0.3 * (1.0 - trial as f64 / trials as f64) + 0.03;
            let from = all[best].0.clone();
            let moved = from.into_iter().map(|x| {
                if random.random::<bool>() { x } else { (x + step * normal(&mut random)).clamp(0.0, 1.0) }
            });
            all.push((moved.collect(), Vec::new()));
        }
        let place = if trial > 0 && trial % 10 == 0 { best } else { all.len() - 1 };
        let log_cost = truth(&all[place].0) + NOISE * normal(&mut random);
        all[place].1.push(log_cost);
    }
    let sample = |(features, log_costs): (Vec<f64>, Vec<f64>)| {
        let mean = mean(&log_costs);
        let scatter = log_costs.iter().map(|x| (x - mean) * (x - mean)).sum();
        ConfigurationSample { features, mean, count: log_costs.len() as f64, scatter }
    };
    all.into_iter().map(sample).collect()
}

/// Over 20 searches: the gain that is told, the true one, the one that the lowest mean tells, and how often the
/// interval held.
fn told(truth: impl Fn(&[f64]) -> f64, dimension: usize, trials: usize) -> (f64, f64, f64, usize) {
    let (mut sums, mut held) = ([0.0; 3], 0);
    for seed in 0..20 {
        let samples = searched(&truth, dimension, trials, seed);
        let posterior = CostPosterior::of(&samples, distance_2).expect("there are samples");
        let means = posterior.means();
        let best = (0..means.len()).min_by(|&a, &b| means[a].total_cmp(&means[b])).expect("there are some");
        let Comparison { gain, gain_low, gain_high, .. } = posterior.compare(best, 0);
        let log_ratio = truth(&samples[0].features) - truth(&samples[best].features);
        let true_gain = 1.0 - (-log_ratio).exp();
        let lowest = samples.iter().map(|sample| sample.mean).fold(f64::INFINITY, f64::min);
        let lucky = 1.0 - (lowest - samples[0].mean).exp();
        for (sum, x) in sums.iter_mut().zip([gain, true_gain, lucky]) {
            *sum += x / 20.0;
        }
        held += usize::from(gain_low <= true_gain && true_gain <= gain_high);
    }
    (sums[0], sums[1], sums[2], held)
}

#[test]
fn nothing_is_told_to_be_gained_where_everything_costs_the_same() {
    for dimension in [6, 28] {
        let (told, _, lucky, held) = told(|_| 1.0, dimension, 40);
        assert!(told <= 0.015 && held >= 19, "{dimension}: told {told}, interval held {held} times");
        assert!(lucky > 0.08, "the lowest of many would tell {lucky}");
    }
}

#[test]
fn what_a_bowl_gains_is_told_as_it_is() {
    let bowl = |x: &[f64]| x.iter().map(|x| (x - 0.3) * (x - 0.3)).sum::<f64>();
    for dimension in [2, 6] {
        let (told, truth, lucky, held) = told(bowl, dimension, 40);
        assert!((told - truth).abs() <= 0.015, "{dimension}: told {told}, is {truth}");
        assert!(held >= 18, "{dimension}: the interval held {held} times");
        assert!(lucky - truth > 0.02, "the lowest of many would tell {lucky} instead of {truth}");
    }
}

#[test]
fn repeats_outweigh_a_lucky_measurement() {
    let sample = |x: f64, mean: f64, count: f64| ConfigurationSample {
        features: vec![x],
        mean,
        count,
        scatter: (count - 1.0) * 0.05 * 0.05,
    };
    let samples =
        [sample(0.0, 1.0, 10.0), sample(0.5, 0.8, 10.0), sample(1.0, 0.75, 1.0), sample(0.2, 1.0, 6.0)];
    let posterior = CostPosterior::of(&samples, distance_2).expect("there are samples");
    let comparison = posterior.compare(1, 0);
    assert!(comparison.probability_better > 0.99 && comparison.gain_low > 0.1, "{comparison:?}");
    assert!((0.04..0.06).contains(&posterior.noise()), "{}", posterior.noise());
    assert!(posterior.compare(2, 1).probability_better < 0.95);
}

#[test]
fn what_is_rough_is_not_taken_for_noise() {
    const NOISE: f64 = 0.03;
    for seed in 0..4 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // Close to each other, each with a cost of its own; the first ran six times, the others once.
        let truths: Vec<f64> =
            (0..40).map(|i| if i == 0 { 0.0 } else { 0.3 * normal(&mut random) }).collect();
        let mut sample = |truth: &f64, runs: usize| {
            let features = vec![0.5 + 0.04 * random.random::<f64>(), 0.5 + 0.04 * random.random::<f64>()];
            let logs: Vec<f64> = (0..runs).map(|_| truth + NOISE * normal(&mut random)).collect();
            let mean = mean(&logs);
            let scatter = logs.iter().map(|x| (x - mean) * (x - mean)).sum();
            ConfigurationSample { features, mean, count: runs as f64, scatter }
        };
        let samples: Vec<ConfigurationSample> =
            truths.iter().enumerate().map(|(i, truth)| sample(truth, if i == 0 { 6 } else { 1 })).collect();
        let posterior = CostPosterior::of(&samples, distance_2).expect("there are samples");
        let means = posterior.means();
        let least = (1..40).min_by(|&a, &b| samples[a].mean.total_cmp(&samples[b].mean)).expect("some");
        assert!((means[least] - truths[least]).abs() < 0.15, "{} for {}", means[least], truths[least]);
        assert!(posterior.compare(least, 0).probability_better > 0.95);
        assert!(posterior.noise() < 0.12, "{}", posterior.noise());
    }
}

#[test]
fn the_unit_of_costs_and_the_order_of_samples_do_not_matter() {
    let samples = searched(|x| x[0], 3, 20, 1);
    let posterior = CostPosterior::of(&samples, distance_2).expect("there are samples");
    let shifted: Vec<ConfigurationSample> = samples
        .iter()
        .rev()
        .map(|sample| ConfigurationSample { mean: sample.mean + 9.0, ..sample.clone() })
        .collect();
    let other = CostPosterior::of(&shifted, distance_2).expect("there are samples");
    let last = samples.len() - 1;
    for place in 0..=last {
        let (a, b) = (posterior.compare(place, 0), other.compare(last - place, last));
        assert!((a.gain - b.gain).abs() < 1e-6 && (a.gain_low - b.gain_low).abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn few_and_equal_samples_are_fine() {
    assert!(CostPosterior::of(&[], distance_2).is_none());
    let one = ConfigurationSample { features: vec![0.1], mean: 2.0, count: 1.0, scatter: 0.0 };
    let posterior = CostPosterior::of(std::slice::from_ref(&one), distance_2).expect("there is a sample");
    assert_eq!(posterior.compare(0, 0).gain, 0.0);
    assert!((posterior.means()[0] - 2.0).abs() < 1e-12);
    let posterior = CostPosterior::of(&vec![one; 12], distance_2).expect("there are samples");
    let comparison = posterior.compare(3, 5);
    assert!(comparison.gain.abs() < 1e-9 && comparison.gain_low <= 0.0 && comparison.gain_high >= 0.0);
}
