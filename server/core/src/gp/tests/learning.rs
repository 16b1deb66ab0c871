//! Learning lengths and noise.

use super::super::kernel::FeatureKind;
use super::super::likelihood::{Profile, gradient};
use super::super::{Covariances, Hyperparameters, Process, Sample, Schedule};
use super::*;
use crate::matrix::Factor;

fn log_density(sample: &Sample, values: &[f64], hyper: &Hyperparameters) -> f64 {
    let factor = Factor::of(&sample.correlations(hyper).0, sample.len()).expect("positive definite");
    Profile::of(&factor, values, &PRIOR).log_density
}

#[test]
fn the_gradient_of_the_likelihood_agrees_with_finite_differences() {
    let all = &KINDS[..];
    for (seed, has_trend, kinds, parts) in
        [(1, false, all, 0), (2, true, all, 0), (3, true, &KINDS[..4], 0), (4, true, all, 3)]
    {
        let points = with_parts(points(kinds, 18, seed), parts, seed + 20);
        let counts: Vec<f64> = (0..18).map(|p| 1.0 + f64::from(p % 4)).collect();
        let values: Vec<f64> = points.iter().map(|x| (4.0 * x[0]).cos() + x[1] * x[3]).collect();
        let sample = Sample::new(kinds.to_vec(), &slices(&points), counts);
        for sample in [sample.clone().prepared(), sample] {
            let hyper = uneven(kinds, has_trend);
            let (matrix, slopes) = sample.correlations(&hyper);
            let factor = Factor::of(&matrix, 18).expect("positive definite");
            let Profile { variance, whitened: mut alpha, .. } = Profile::of(&factor, &values, &PRIOR);
            factor.backward(&mut alpha);
            let gradient = gradient(&sample, &hyper, &slopes, &factor.inverse(), &alpha, variance);
            let count = hyper.clone().log_mut().len();
            for (index, own) in gradient.iter().enumerate().take(count) {
                let moved = |by: f64| {
                    let mut hyper = hyper.clone();
                    hyper.log_mut()[index] += by;
                    log_density(&sample, &values, &hyper)
                };
                let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                assert!((own - slope).abs() < 1e-5 * (1.0 + slope.abs()), "{index}: {own} and {slope}");
            }
        }
    }
}

/// Values that follow the first feature closely, the second hardly, and noise.
fn lopsided(count: usize, noise: f64) -> (Vec<Vec<f64>>, Vec<f64>) {
    let random = &mut random(9);
    let points: Vec<Vec<f64>> = (0..count).map(|_| vec![random.random(), random.random()]).collect();
    let value = |x: &Vec<f64>| (9.0 * x[0]).sin() + 0.1 * x[1] + noise * standard_normal(random);
    let values = points.iter().map(value).collect();
    (points, values)
}

#[test]
fn features_that_matter_get_short_lengths_and_noise_is_found() {
    let kinds = vec![FeatureKind::Ordered; 2];
    let noise_of = |noise: f64| {
        let (points, values) = lopsided(60, noise);
        let mut hyper = Hyperparameters::new(&kinds, &PRIOR);
        let sample = Sample::new(kinds.clone(), &slices(&points), vec![1.0; 60]).prepared();
        let before = log_density(&sample, &values, &hyper);
        let schedule = Schedule { steps: 40, ahead: false };
        let learnt = Process::learn(sample, &[(values, 0.0)], &mut hyper, &PRIOR, schedule);
        let (process, _) = learnt.expect("positive definite");
        assert!(process.log_likelihood > before + 1.0, "{} {before}", process.log_likelihood);
        assert!(process.weights[0] > 4.0 * process.weights[1], "{:?}", process.weights);
        process.noise.sqrt()
    };
    let (quiet, loud) = (noise_of(0.01), noise_of(0.3));
    assert!(quiet < 0.1 && (0.15..0.6).contains(&loud), "{quiet} {loud}");
}

#[test]
fn a_step_ahead_is_the_first_step_of_the_next_fit() {
    let kinds = vec![FeatureKind::Ordered; 2];
    let (points, values) = lopsided(20, 0.1);
    let sample = || Sample::new(kinds.clone(), &slices(&points), vec![1.0; 20]);
    let views = [(values, 0.0)];
    let mut at_once = Hyperparameters::new(&kinds, &PRIOR);
    Process::learn(sample(), &views, &mut at_once, &PRIOR, Schedule { steps: 6, ahead: false });
    let mut apart = Hyperparameters::new(&kinds, &PRIOR);
    for _ in 0..3 {
        Process::learn(sample(), &views, &mut apart, &PRIOR, Schedule { steps: 1, ahead: true });
    }
    assert_eq!(apart, at_once);
}

#[test]
fn the_likeliest_view_is_taken() {
    let kinds = vec![FeatureKind::Ordered; 2];
    let (points, values) = lopsided(30, 0.01);
    // These values in disorder have nothing to do with the points.
    let shuffled: Vec<f64> = (0..30).map(|index| values[(index * 7 + 3) % 30]).collect();
    for (views, likeliest) in [([&shuffled, &values], 1), ([&values, &shuffled], 0)] {
        let views = views.map(|values| (values.clone(), 0.0));
        let sample = Sample::new(kinds.clone(), &slices(&points), vec![1.0; 30]);
        let mut hyper = Hyperparameters::new(&kinds, &PRIOR);
        let schedule = Schedule { steps: 3, ahead: false };
        let learnt = Process::learn(sample, &views, &mut hyper, &PRIOR, schedule);
        assert_eq!(learnt.expect("positive definite").1, likeliest);
    }
}

#[test]
fn hyperparameters_stay_within_their_ranges_and_are_stored_exactly() {
    let kinds = vec![FeatureKind::Ordered; 2];
    let mut hyper = Hyperparameters::with_trend(&kinds, &PRIOR);
    for sign in [1.0, -1.0] {
        for _ in 0..100 {
            hyper.ascend(&kinds, &[sign * 1e9; 4], &PRIOR);
        }
        let within = |value: f64, range: [f64; 2]| value >= 0.999 * range[0] && value <= 1.001 * range[1];
        assert!(hyper.weights(2).iter().all(|&weight| within(weight, PRIOR.weight_range)), "{hyper:?}");
        assert!(within(hyper.noise(2), PRIOR.noise_range), "{hyper:?}");
    }
    let text = serde_json::to_string(&hyper).expect("plain data");
    assert_eq!(serde_json::from_str::<Hyperparameters>(&text).expect("own output"), hyper);
    // The stored form since the first searches with a model.
    let stored = r#"{"log":[0.5,-1.25,-3.0],"steps":[0.3,0.36,0.01],"signs":[1,0,-1]}"#;
    let read: Hyperparameters = serde_json::from_str(stored).expect("a stored row");
    assert_eq!(serde_json::to_string(&read).expect("plain data"), stored);
}

#[test]
fn the_prior_is_where_it_says() {
    let prior = Prior { length_spread: 0.7, ..PRIOR };
    let hyper = Hyperparameters::new(&KINDS, &prior);
    let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
    let weights = hyper.weights(5);
    // Lengths of half the root of five; a linear feature has a variance of one.
    assert!(weights[..4].iter().all(|&weight| close(weight, 1.0 / (0.25 * 5.0))), "{weights:?}");
    assert!(close(weights[4], 1.0) && close(hyper.noise(5), 0.05) && hyper.trend(5) == 0.0);
    assert!(close(Hyperparameters::with_trend(&KINDS, &prior).trend(5), 1.0));
    // Displaced by a half, a hyperparameter is drawn back by a slope of half the inverse variance of its
    // logarithm.
    for (index, spread) in [(0, 2.0 * 0.7), (4, 2.0), (5, 1.5), (6, 2.0)] {
        for displaced in [0.5, -0.5] {
            for stronger in [0.99, 1.01] {
                let mut hyper = Hyperparameters::with_trend(&KINDS, &prior);
                hyper.log_mut()[index] += displaced;
                let before = hyper.log_mut()[index];
                let mut gradient = [0.0; 7];
                gradient[index] = stronger * displaced / (spread * spread);
                hyper.ascend(&KINDS, &gradient, &prior);
                let moved = hyper.log_mut()[index] - before;
                let is_away = moved * displaced > 0.0;
                assert_eq!(is_away, stronger > 1.0, "{index} {displaced} {stronger}: {moved}");
            }
        }
    }
}

#[test]
fn the_jacobian_of_a_view_counts_like_its_likelihood() {
    let kinds = vec![FeatureKind::Ordered; 2];
    let (points, values) = lopsided(20, 0.1);
    let fit = |jacobians: [f64; 2]| {
        let sample = Sample::new(kinds.clone(), &slices(&points), vec![1.0; 20]);
        let mut hyper = Hyperparameters::new(&kinds, &PRIOR);
        let views = jacobians.map(|jacobian| (values.clone(), jacobian));
        Process::learn(sample, &views, &mut hyper, &PRIOR, Schedule::default()).expect("positive definite")
    };
    let ((first, a), (second, b), (none, _)) = (fit([2.5, 0.0]), fit([0.0, 2.5]), fit([0.0, 0.0]));
    assert_eq!((a, b), (0, 1));
    assert_eq!(first.log_likelihood, second.log_likelihood);
    assert!((first.log_likelihood - none.log_likelihood - 2.5).abs() < 1e-9);
}

/// Two ordered features, and one of two categories by turns.
fn of_two_categories(count: usize) -> Vec<Vec<f64>> {
    let mut points = points(&KINDS[..3], count, 6);
    points.iter_mut().enumerate().for_each(|(index, point)| point[2] = (index % 2) as f64);
    points
}

#[test]
fn a_measurement_moves_the_mean_by_as_much_as_it_lowers_the_variance() {
    let (kinds, hyper) = (&KINDS[..3], uneven(&KINDS[..3], false));
    let (mut points, mut counts) = (of_two_categories(12), vec![1.0; 12]);
    let (one, other, count) = (vec![0.4, 0.6, 0.0], vec![0.4, 0.6, 1.0], 0.5);
    // The variance without noise, and the variance before any measurement.
    let fit = |points: &[Vec<f64>], counts: &[f64]| {
        let values = points.iter().map(|x| x[0] - x[1] * x[2]).collect();
        let sample = Sample::new(kinds.to_vec(), &slices(points), counts.to_vec());
        let process = Process::fit(sample, values, &hyper, &PRIOR).expect("positive definite");
        let mut covariances = Covariances::default();
        process.covariances(&process.context(&[]), &one, &mut covariances);
        let most = process.deviation_max(&covariances).powi(2);
        (process.deviation(&mut covariances).powi(2) / most, most, process)
    };
    let (before, most, process) = fit(&points, &counts);
    let moved = process.moved_by(&one, &other, count);
    points.push(other.clone());
    counts.push(count);
    let (after, ..) = fit(&points, &counts);
    assert!(moved > 0.0 && (before - after - moved * moved / most).abs() < 1e-9, "{before} {after} {moved}");
}

#[test]
fn a_shift_of_some_values_is_found() {
    let (kinds, hyper) = (&KINDS[..3], uneven(&KINDS[..3], false));
    let points = of_two_categories(12);
    let is_one = |index: usize| points[index][2] == 1.0;
    let shift = |by: f64| {
        let of = |index: usize| points[index][0] + if is_one(index) { by } else { 0.0 };
        let sample = Sample::new(kinds.to_vec(), &slices(&points), vec![1.0; 12]);
        let process = Process::fit(sample, (0..12).map(of).collect(), &hyper, &PRIOR);
        process.expect("positive definite").shift_of(is_one)
    };
    assert!((shift(0.7) - shift(0.0) - 0.7).abs() < 1e-9, "{} {}", shift(0.7), shift(0.0));
    let sample = Sample::new(kinds.to_vec(), &slices(&points), vec![1.0; 12]);
    let process = Process::fit(sample, vec![1.0; 12], &hyper, &PRIOR).expect("positive definite");
    assert_eq!([process.shift_of(|_| true), process.shift_of(|_| false)], [0.0; 2], "nothing to compare");
}
