//! Posterior and likelihood against dense linear algebra on features in Euclidean coordinates.

use nalgebra::{DMatrix, DVector};

use super::super::kernel::{FeatureKind, INACTIVE};
use super::super::{Covariances, Hyperparameters, Process, Sample};
use super::*;
use crate::matrix::Factor;

/// Coordinates whose plain Euclidean distances are those of the kernel: an ordered feature lies along one
/// axis, its inactive point beside the middle of it; categories are one-hot.
fn coordinates(kinds: &[FeatureKind], weights: &[f64], point: &[f64]) -> DVector<f64> {
    let mut all = Vec::new();
    for ((kind, weight), &x) in kinds.iter().zip(weights).zip(point) {
        let root = weight.sqrt();
        match kind {
            FeatureKind::Ordered if x == INACTIVE => all.extend([0.0, 0.5 * root]),
            FeatureKind::Ordered => all.extend([(x - 0.5) * root, 0.0]),
            FeatureKind::Categorical => {
                let of = |level: f64| if x == level { root / 2.0f64.sqrt() } else { 0.0 };
                all.extend([INACTIVE, 0.0, 1.0, 2.0].map(of));
            }
            FeatureKind::Linear => {}
        }
    }
    DVector::from_vec(all)
}

/// The covariance of two points as a share of the variance, noise left out.
fn covariance(kinds: &[FeatureKind], hyper: &Hyperparameters, a: &[f64], b: &[f64]) -> f64 {
    let weights = hyper.weights(kinds.len());
    let distance = (coordinates(kinds, &weights, a) - coordinates(kinds, &weights, b)).norm();
    let scaled = 5.0f64.sqrt() * distance;
    let mut sum = (1.0 + scaled + 5.0 / 3.0 * distance * distance) * (-scaled).exp();
    let mut within = 1.0;
    for ((kind, weight), (&a, &b)) in kinds.iter().zip(&weights).zip(a.iter().zip(b)) {
        match kind {
            FeatureKind::Linear => sum += weight * a * b,
            FeatureKind::Ordered if a != INACTIVE && b != INACTIVE => {
                within += weight * (a - 0.5) * (b - 0.5);
            }
            _ => {}
        }
    }
    // The coefficient of a part deviates from that of the linear feature as far as that from zero.
    let linear = kinds.iter().position(|kind| *kind == FeatureKind::Linear);
    for (a, b) in a[kinds.len()..].iter().zip(&b[kinds.len()..]) {
        sum += linear.map_or(0.0, |linear| weights[linear]) * a * b;
    }
    sum + hyper.trend(kinds.len()) * within * within
}

/// The covariances of measurements.
fn matrix(
    kinds: &[FeatureKind],
    hyper: &Hyperparameters,
    points: &[Vec<f64>],
    counts: &[f64],
) -> DMatrix<f64> {
    DMatrix::from_fn(points.len(), points.len(), |p, q| {
        let noise = if p == q { hyper.noise(kinds.len()) / counts[p] } else { 0.0 };
        covariance(kinds, hyper, &points[p], &points[q]) + noise
    })
}

#[test]
fn mean_variance_and_likelihood_are_those_of_a_dense_reference() {
    let all = &KINDS[..];
    for (seed, has_trend, kinds, parts) in
        [(1, false, all, 0), (2, true, all, 3), (3, false, &KINDS[..2], 0), (4, false, all, 5)]
    {
        let points = with_parts(points(kinds, 25, seed), parts, seed + 20);
        let counts: Vec<f64> = (0..25).map(|p| 1.0 + f64::from(p % 3)).collect();
        let values: Vec<f64> = points.iter().map(|x| (3.0 * x[0]).sin() + x[1]).collect();
        let hyper = uneven(kinds, has_trend);
        let sample = Sample::new(kinds.to_vec(), &slices(&points), counts.clone());
        for sample in [sample.clone().prepared(), sample] {
            let process = Process::fit(sample, values.clone(), &hyper, &PRIOR).expect("positive definite");

            let dense = matrix(kinds, &hyper, &points, &counts);
            let inverse = dense.clone().try_inverse().expect("regular");
            let (ones, y) = (DVector::repeat(25, 1.0), DVector::from_vec(values.clone()));
            let mean = (ones.transpose() * &inverse * &y)[0] / (ones.transpose() * &inverse * &ones)[0];
            let left = y.add_scalar(-mean);
            let variance = ((left.transpose() * &inverse * &left)[0] + PRIOR.squares) / 26.0;
            let likelihood = -13.0 * variance.ln() - 0.5 * dense.determinant().ln();
            assert!((process.log_likelihood - likelihood).abs() < 1e-8 * likelihood.abs());
            assert!((process.noise - hyper.noise(kinds.len()) * variance).abs() < 1e-10);

            for at in with_parts(super::points(kinds, 20, seed + 10), parts, seed + 30) {
                let towards =
                    DVector::from_iterator(25, points.iter().map(|p| covariance(kinds, &hyper, &at, p)));
                let expected = mean + (towards.transpose() * &inverse * &left)[0];
                let known = (towards.transpose() * &inverse * &towards)[0];
                let deviation = (variance * (covariance(kinds, &hyper, &at, &at) - known)).sqrt();
                let belief = process.predict(&at);
                assert!((belief.mean - expected).abs() < 1e-8, "{belief:?}, {expected}");
                assert!((belief.deviation - deviation).abs() < 1e-7, "{belief:?}, {deviation}");
                // The posterior does not change with the first features given as context.
                let split = process.at(&process.context(&at[..1]), &at[1..]);
                assert!((split.mean - expected).abs() < 1e-8 && (split.deviation - deviation).abs() < 1e-7);
            }
        }
    }
}

#[test]
fn the_parts_of_a_linear_feature_hold_or_not_one_by_one() {
    let random = &mut random(31);
    let parts: Vec<[f64; 2]> = (0..10).map(|_| [standard_normal(random), standard_normal(random)]).collect();
    let values: Vec<f64> = parts.iter().map(|parts| parts[0]).collect();
    let kinds = [FeatureKind::Linear];
    let slopes = |has_parts: bool| {
        let point = |[a, b]: [f64; 2]| if has_parts { vec![a + b, a, b] } else { vec![a + b] };
        let points: Vec<Vec<f64>> = parts.iter().map(|parts| point(*parts)).collect();
        let sample = Sample::new(kinds.to_vec(), &slices(&points), vec![1.0; 10]);
        let hyper = Hyperparameters::new(&kinds, &PRIOR);
        let process = Process::fit(sample, values.clone(), &hyper, &PRIOR).expect("positive definite");
        let at = |parts: [f64; 2]| process.predict(&point(parts)).mean;
        [[1.0, 0.0], [0.0, 1.0]].map(|parts| at(parts) - at([0.0, 0.0]))
    };
    let ([held, wrong], [one, other]) = (slopes(true), slopes(false));
    assert!(held > 0.8 && wrong.abs() < 0.2, "{held} {wrong}");
    assert!(one == other && other > 0.1, "a single coefficient cannot tell them apart: {one} {other}");
}

/// The matrix that a factor stands for.
fn product(factor: &Factor, size: usize) -> DMatrix<f64> {
    // Row i of L times the unit vectors gives its entries.
    let unit = |j: usize| (0..size).map(|k| f64::from(u8::from(k == j))).collect::<Vec<_>>();
    let lower = DMatrix::from_fn(size, size, |i, j| factor.times_row(i, &unit(j)));
    &lower * lower.transpose()
}

#[test]
fn the_diagonal_is_raised_where_it_must_be_and_then_by_as_little_as_rounding() {
    let kinds = &KINDS[..2];
    let regular = matrix(kinds, &uneven(kinds, false), &points(kinds, 20, 6), &[1.0; 20]);
    let factor = Factor::of(regular.as_slice(), 20).expect("positive definite");
    assert!((product(&factor, 20) - &regular).amax() < 1e-13, "a regular matrix is left as it is");

    // Points that coincide, without noise; and nearly so.
    let singular = DMatrix::repeat(20, 20, 3.0);
    let smooth = DMatrix::from_fn(30, 30, |i, j| (-1e-4 * (i as f64 - j as f64).powi(2)).exp());
    for matrix in [singular, smooth] {
        let size = matrix.nrows();
        let factor = Factor::of(matrix.as_slice(), size).expect("raised until it has a factor");
        let raised = product(&factor, size) - &matrix;
        assert!(raised.amax() < 1e-8 * matrix.amax(), "{}", raised.amax());
        assert!(factor.half_log_determinant().is_finite());
    }
    assert!(Factor::of(&[f64::NAN], 1).is_none());
}

#[test]
fn intervals_cover_what_is_drawn_from_the_prior() {
    let kinds = &KINDS[..2];
    let mut hyper = Hyperparameters::new(kinds, &PRIOR);
    hyper.log_mut()[2] = 0.05f64.ln();
    let (draws, count, random) = (600, 40, &mut random(7));
    let (mut means, mut measurements) = (0, 0);
    for draw in 0..draws {
        let points = points(kinds, count + 1, 100 + draw);
        // The last point is asked and never measured; values are as large as they like, around any level.
        let prior = DMatrix::from_fn(count + 1, count + 1, |p, q| {
            covariance(kinds, &hyper, &points[p], &points[q]) + if p == q { 1e-10 } else { 0.0 }
        });
        let lower = prior.cholesky().expect("positive definite").l();
        let truth = lower * DVector::from_fn(count + 1, |_, _| standard_normal(random));
        let (level, scale) = (100.0, 7.0);
        let mut measure = |p: usize| level + scale * (truth[p] + 0.05f64.sqrt() * standard_normal(random));
        let values: Vec<f64> = (0..count).map(&mut measure).collect();
        let again = measure(count);
        let sample = Sample::new(kinds.to_vec(), &slices(&points[..count]), vec![1.0; count]);
        let process = Process::fit(sample, values, &hyper, &PRIOR).expect("positive definite");
        let belief = process.predict(&points[count]);
        let covers = |value: f64, variance: f64| (value - belief.mean).abs() < 1.96 * variance.sqrt();
        let variance = belief.deviation * belief.deviation;
        means += u64::from(covers(level + scale * truth[count], variance));
        measurements += u64::from(covers(again, variance + process.noise));
    }
    for covered in [means, measurements] {
        let share = covered as f64 / draws as f64;
        assert!((0.92..0.98).contains(&share), "95 % intervals cover {share}");
    }
}

#[test]
fn nothing_is_fitted_to_nothing_or_to_values_whose_squares_are_not_finite() {
    let kinds = &KINDS[..2];
    let hyper = Hyperparameters::new(kinds, &PRIOR);
    let sample = |points: &[Vec<f64>]| Sample::new(kinds.to_vec(), &slices(points), vec![1.0; points.len()]);
    assert!(Process::fit(sample(&[]), Vec::new(), &hyper, &PRIOR).is_none());
    let two = points(kinds, 2, 8);
    for values in [[1.0, f64::NAN], [1e200, -1e200]] {
        assert!(Process::fit(sample(&two), values.to_vec(), &hyper, &PRIOR).is_none(), "{values:?}");
    }
    assert!(Process::fit(sample(&two), vec![1.0, 1.0], &hyper, &PRIOR).is_some(), "equal values are fine");
}

#[test]
fn far_from_all_points_the_deviation_is_the_greatest() {
    let kinds = vec![FeatureKind::Ordered; 2];
    let points = points(&kinds, 12, 21);
    let values: Vec<f64> = points.iter().map(|x| 3.0 * x[0] - x[1]).collect();
    let sample = Sample::new(kinds.clone(), &slices(&points), vec![1.0; 12]);
    let process =
        Process::fit(sample, values, &Hyperparameters::new(&kinds, &PRIOR), &PRIOR).expect("it fits");
    let of = |x: &[f64]| {
        let mut covariances = Covariances::default();
        process.covariances(&process.context(&[]), x, &mut covariances);
        (process.deviation_max(&covariances), process.deviation(&mut covariances))
    };
    let ((most, far), (most_here, here)) = (of(&[1e3, -1e3]), of(&points[0]));
    assert!((most / far - 1.0).abs() < 1e-9 && most == most_here && here < 0.5 * most, "{most} {far} {here}");
}
