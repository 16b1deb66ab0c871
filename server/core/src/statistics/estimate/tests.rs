//! The promises of estimates, on landscapes whose truth is known.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::matrix::distance_2;
use crate::randomness::standard_normal as normal;

const NOISE: f64 = 0.07;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn mean_of(sample: &ConfigurationSample) -> f64 {
    moments_of(&sample.measurements).0
}

/// Measurements without a time.
fn unordered(log_costs: &[f64]) -> Vec<Measurement> {
    log_costs.iter().map(|&log_cost| Measurement { log_cost, moment: None, weight: 1.0 }).collect()
}

/// The samples of a search that falls for luck: a quarter at random, then steps from the lowest mean.
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
    let sample = |(features, log_costs): (Vec<f64>, Vec<f64>)| ConfigurationSample {
        features,
        measurements: unordered(&log_costs),
        weight: 1.0,
    };
    all.into_iter().map(sample).collect()
}

/// Over 20 searches: the estimated gain, the true one, that of the lowest mean, and the share of intervals
/// that held.
fn averages(truth: impl Fn(&[f64]) -> f64, dimension: usize, trials: usize) -> (f64, f64, f64, usize) {
    let (mut sums, mut held) = ([0.0; 3], 0);
    for seed in 0..20 {
        let samples = searched(&truth, dimension, trials, seed);
        let posterior = CostPosterior::of(&samples, distance_2).expect("there are samples");
        let means = posterior.means();
        let best = (0..means.len()).min_by(|&a, &b| means[a].total_cmp(&means[b])).expect("there are some");
        let Comparison { gain, gain_low, gain_high, .. } = posterior.compare(best, 0);
        let log_ratio = truth(&samples[0].features) - truth(&samples[best].features);
        let true_gain = 1.0 - (-log_ratio).exp();
        let lowest = samples.iter().map(mean_of).fold(f64::INFINITY, f64::min);
        let lucky = 1.0 - (lowest - mean_of(&samples[0])).exp();
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
        let (estimated, _, lucky, held) = averages(|_| 1.0, dimension, 40);
        assert!(estimated <= 0.015 && held >= 19, "{dimension}: {estimated}, interval held {held} times");
        assert!(lucky > 0.08, "the lowest of many would tell {lucky}");
    }
}

#[test]
fn what_a_bowl_gains_is_told_as_it_is() {
    let bowl = |x: &[f64]| x.iter().map(|x| (x - 0.3) * (x - 0.3)).sum::<f64>();
    for dimension in [2, 6] {
        let (estimated, truth, lucky, held) = averages(bowl, dimension, 40);
        assert!((estimated - truth).abs() <= 0.015, "{dimension}: estimated {estimated}, is {truth}");
        assert!(held >= 18, "{dimension}: the interval held {held} times");
        assert!(lucky - truth > 0.02, "the lowest of many would tell {lucky} instead of {truth}");
    }
}

#[test]
fn repeats_outweigh_a_lucky_measurement() {
    let sample = |x: f64, mean: f64, runs: usize| {
        let off = |run: usize| if runs == 1 { 0.0 } else { 0.05 * (1.0 - 2.0 * (run % 2) as f64) };
        let log_costs: Vec<f64> = (0..runs).map(|run| mean + off(run)).collect();
        ConfigurationSample { features: vec![x], measurements: unordered(&log_costs), weight: 1.0 }
    };
    let samples = [sample(0.0, 1.0, 10), sample(0.5, 0.8, 10), sample(1.0, 0.75, 1), sample(0.2, 1.0, 6)];
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
            ConfigurationSample { features, measurements: unordered(&logs), weight: 1.0 }
        };
        let samples: Vec<ConfigurationSample> =
            truths.iter().enumerate().map(|(i, truth)| sample(truth, if i == 0 { 6 } else { 1 })).collect();
        let posterior = CostPosterior::of(&samples, distance_2).expect("there are samples");
        let means = posterior.means();
        let least =
            (1..40).min_by(|&a, &b| mean_of(&samples[a]).total_cmp(&mean_of(&samples[b]))).expect("some");
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
        .map(|sample| {
            let higher = |one: &Measurement| Measurement { log_cost: one.log_cost + 9.0, ..*one };
            ConfigurationSample {
                measurements: sample.measurements.iter().map(higher).collect(),
                ..sample.clone()
            }
        })
        .collect();
    let other = CostPosterior::of(&shifted, distance_2).expect("there are samples");
    let last = samples.len() - 1;
    for place in 0..=last {
        let (a, b) = (posterior.compare(place, 0), other.compare(last - place, last));
        assert!((a.gain - b.gain).abs() < 1e-6 && (a.gain_low - b.gain_low).abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn a_poor_measurement_counts_for_less_than_a_good_one() {
    // Half a logarithm below the others, as six measurements say.
    let mean = |weight: f64| {
        let sample = |place: usize| {
            let (log_cost, count, weight) = match place {
                3 => (-0.5, 6, weight),
                _ => (0.02 * (place % 3) as f64, 1, 1.0),
            };
            let measurements = vec![Measurement { log_cost, moment: None, weight }; count];
            ConfigurationSample { features: vec![place as f64 / 8.0], measurements, weight: 1.0 }
        };
        let samples: Vec<ConfigurationSample> = (0..8).map(sample).collect();
        CostPosterior::of(&samples, distance_2).expect("there are samples").means()[3]
    };
    let (good, poor) = (mean(1.0), mean(0.001));
    assert!(good < -0.3 && poor > -0.1, "{good} by good ones, {poor} by poor ones");
    // Of two measurements of one configuration the better one has more say.
    let of = |(weight, log_cost): (f64, f64)| Measurement { log_cost, moment: None, weight };
    let measurements = [(1.0, 2.0), (0.25, 7.0)].map(of).to_vec();
    let two = ConfigurationSample { features: vec![0.0], measurements, weight: 1.0 };
    assert_eq!((mean_of(&two), two.scatter()), (3.0, 5.0));
}

#[test]
fn few_and_equal_samples_are_fine() {
    assert!(CostPosterior::of(&[], distance_2).is_none());
    let one = ConfigurationSample { features: vec![0.1], measurements: unordered(&[2.0]), weight: 1.0 };
    let posterior = CostPosterior::of(std::slice::from_ref(&one), distance_2).expect("there is a sample");
    assert_eq!(posterior.compare(0, 0).gain, 0.0);
    assert!((posterior.means()[0] - 2.0).abs() < 1e-12);
    let posterior = CostPosterior::of(&vec![one; 12], distance_2).expect("there are samples");
    let comparison = posterior.compare(3, 5);
    assert!(comparison.gain.abs() < 1e-9 && comparison.gain_low <= 0.0 && comparison.gain_high >= 0.0);
}

/// On a machine whose speed wanders (deviation 0.13, 20 trials) with little noise from trial to trial (0.04):
/// the first configuration, and others whose logarithms are lower by `gain`. Each entry of `plan` is the next
/// configuration to run.
fn wandering(plan: &[usize], gain: f64, seed: u64) -> Vec<ConfigurationSample> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let keep: f64 = (-1.0_f64 / 20.0).exp();
    let mut speed = 0.13 * normal(&mut random);
    let places = plan.iter().max().map_or(0, |last| last + 1);
    let mut measured: Vec<Vec<Measurement>> = vec![Vec::new(); places];
    for (time, &place) in plan.iter().enumerate() {
        let log_cost = speed + 0.04 * normal(&mut random) - if place == 0 { 0.0 } else { gain };
        let moment = Some(Moment { client: 1, time: time as u64 });
        measured[place].push(Measurement { log_cost, moment, weight: 1.0 });
        speed = keep * speed + 0.13 * (1.0 - keep * keep).sqrt() * normal(&mut random);
    }
    let sample = |(place, measurements)| {
        let features = vec![place as f64 / places as f64, 0.5];
        ConfigurationSample { features, measurements, weight: 1.0 }
    };
    measured.into_iter().enumerate().map(sample).collect()
}

#[test]
fn a_fast_minute_proves_nothing() {
    // The first one ran all the time, the others each in one stretch: of those some had a fast one.
    let plan: Vec<usize> = (0..64).map(|time| if time % 8 < 2 { 0 } else { 1 + time / 8 }).collect();
    let timeless = |mut samples: Vec<ConfigurationSample>| {
        let all = samples.iter_mut().flat_map(|sample| &mut sample.measurements);
        all.for_each(|one| one.moment = None);
        samples
    };
    let proven = |samples: &[ConfigurationSample]| {
        let posterior = CostPosterior::of(samples, distance_2).expect("there are samples");
        (1..samples.len()).filter(|&one| posterior.compare(one, 0).probability_better > 0.95).count()
    };
    let (mut with, mut without) = (0, 0);
    for seed in 0..20 {
        let samples = wandering(&plan, 0.0, seed);
        with += proven(&samples);
        without += proven(&timeless(samples));
    }
    assert!(with <= 6 && without >= 20, "{with} of 160 with times, {without} without");
}

#[test]
fn what_runs_in_turn_is_told_apart_on_a_machine_that_wanders() {
    let plan: Vec<usize> = (0..40).map(|time| if time % 2 == 0 { 0 } else { 1 + (time / 2) % 2 }).collect();
    let (mut found, mut drifts, mut noise) = (0, 0.0, 0.0);
    for seed in 0..20 {
        let posterior =
            CostPosterior::of(&wandering(&plan, 0.08, seed), distance_2).expect("there are samples");
        found += usize::from(posterior.compare(1, 0).probability_better > 0.95);
        let drifting = posterior.models.iter().filter(|model| model.drifts);
        drifts += drifting.map(|model| model.weight).sum::<f64>() / 20.0;
        noise += posterior.noise() / 20.0;
    }
    assert!(found >= 15 && drifts > 0.8 && noise < 0.06, "{found} of 20, {drifts}, {noise}");
}

#[test]
fn many_measurements_are_bundled() {
    let plan: Vec<usize> = (0..CELLS_MAX * 3).map(|time| time % 100).collect();
    let posterior = CostPosterior::of(&wandering(&plan, 0.3, 1), distance_2).expect("there are samples");
    assert!(posterior.models.iter().all(|model| model.cells.len() == 100 && !model.drifts));
    assert!(posterior.compare(1, 0).gain > 0.0);
}

#[test]
fn a_steady_machine_needs_one_cell_for_each_configuration() {
    let plan: Vec<usize> = (0..40).map(|time| (time * 7 % 11) * (time % 3) % 9).collect();
    let mut samples = wandering(&plan, 0.2, 4);
    samples[2].weight = 0.3;
    let n = samples.len();
    let distances: Vec<f64> =
        (0..n * n).map(|pair| distance_2(&samples[pair / n].features, &samples[pair % n].features)).collect();
    let apart = cells(&samples);
    let merged = Grid::merged(&samples, &apart, &distances).fit(&FAMILIES, None, 1.0);
    let apart = Grid::new(apart, n, &distances).fit(&FAMILIES, None, 1.0);
    assert!(apart[0].1.cells.len() > n + 5 && merged[0].1.cells.len() == n);
    for ((a, one), (b, other)) in apart.iter().zip(&merged) {
        assert!((a - b).abs() < 1e-6 * a.abs().max(1.0), "{a} {b}");
        let means = one.means.iter().zip(&other.means);
        assert!(means.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
        assert!((one.noise_2 / other.noise_2 - 1.0).abs() < 1e-6);
    }
}

#[test]
fn what_is_to_be_gained_less_what_is_to_be_lost_is_the_gain() {
    for seed in 0..6 {
        let depth = f64::from(u32::from(seed % 2 == 0));
        let bowl = |x: &[f64]| depth * x.iter().map(|x| (x - 0.4) * (x - 0.4)).sum::<f64>();
        let samples = searched(bowl, 3, 30, seed);
        let posterior = CostPosterior::of(&samples, distance_2).expect("samples");
        for one in 1..samples.len() {
            let there = posterior.compare(one, 0);
            let back = posterior.compare(0, one);
            let mean = -(1.0 - there.gain).ln();
            let difference = there.expected_gain - there.expected_loss;
            // The distribution function of Student's distribution is off by up to 0.002.
            assert!((difference - mean).abs() < 0.01 * (mean.abs() + 0.1), "{difference} {mean}");
            assert!((there.expected_gain - back.expected_loss).abs() < 1e-9);
            assert!(there.expected_gain >= 0.0 && there.expected_loss >= 0.0);
        }
    }
}

#[test]
fn a_landscape_that_may_be_flat_is_no_reason_to_stay() {
    // Two configurations, one of which ran 6 % faster, in little noise: both may be equal.
    let sample = |features: f64, log_costs: &[f64]| ConfigurationSample {
        features: vec![features],
        measurements: unordered(log_costs),
        weight: 1.0,
    };
    let slow = sample(0.2, &[0.0, 0.03, -0.02, 0.01]);
    let compare = |fast: &[f64]| {
        let posterior = CostPosterior::of(&[slow.clone(), sample(0.8, fast)], distance_2).expect("samples");
        posterior.compare(1, 0)
    };
    let fast = compare(&[-0.06, -0.08]);
    assert!(fast.probability_better < 0.95 && fast.is_worth(20.0), "{fast:?}");
    let lucky = compare(&[-0.03]);
    assert!(!lucky.is_worth(20.0), "{lucky:?}");
    let same = compare(&[0.01, 0.0]);
    assert!(!same.is_worth(1.5), "{same:?}");
}
