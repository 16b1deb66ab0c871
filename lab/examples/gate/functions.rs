//! Continuous functions by which black-box optimisers are judged, after COCO's bbob (Hansen, Finck, Ros and
//! Auger, "Real-parameter black-box optimization benchmarking 2009: noiseless functions definitions", 2009).
//!
//! As run times do, a tenth of a random point's cost always remains, and 10 % of noise lies on the whole.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::{configuration::Configuration, space::Space, value::Value};
use treewright_lab::simulated::{normal, share};

use crate::problem::Problem;

/// Dimensions, one a seed in turn.
const DIMENSIONS: [usize; 3] = [2, 5, 10];
const NOISE: f64 = 0.1;
/// Random points whose median is the scale of a function, and the share of it that always remains.
const POINTS: usize = 101;
const REMAINS: f64 = 0.1;

/// A function of a point whose optimum is at 0, where it is 0.
type Function = fn(&[f64]) -> f64;

const FUNCTIONS: [Function; 7] = [sphere, ellipsoid, discus, rastrigin, rosenbrock, sharp_ridge, powers];

fn sphere(z: &[f64]) -> f64 {
    z.iter().map(|z| z * z).sum()
}

/// 0 for the first axis to 1 for the last.
fn place(axis: usize, z: &[f64]) -> f64 {
    axis as f64 / (z.len() - 1) as f64
}

fn ellipsoid(z: &[f64]) -> f64 {
    z.iter().enumerate().map(|(axis, one)| 1e6_f64.powf(place(axis, z)) * one * one).sum()
}

fn discus(z: &[f64]) -> f64 {
    1e6 * z[0] * z[0] + sphere(&z[1..])
}

fn rastrigin(z: &[f64]) -> f64 {
    let waves: f64 = z.iter().map(|z| 1.0 - (2.0 * std::f64::consts::PI * z).cos()).sum();
    10.0 * waves + sphere(z)
}

fn rosenbrock(z: &[f64]) -> f64 {
    let pair = |pair: &[f64]| {
        let (one, next) = (pair[0] + 1.0, pair[1] + 1.0);
        100.0 * (one * one - next).powi(2) + (one - 1.0).powi(2)
    };
    z.windows(2).map(pair).sum()
}

fn sharp_ridge(z: &[f64]) -> f64 {
    z[0] * z[0] + 100.0 * sphere(&z[1..]).sqrt()
}

fn powers(z: &[f64]) -> f64 {
    let sum: f64 = z.iter().enumerate().map(|(axis, one)| one.abs().powf(2.0 + 4.0 * place(axis, z))).sum();
    sum.sqrt()
}

/// Orthogonal unit vectors of random directions.
fn rotation(dimension: usize, random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for _ in 0..dimension {
        let mut row: Vec<f64> = (0..dimension).map(|_| normal(random)).collect();
        for other in &rows {
            let along: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
            row.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
        }
        let length = sphere(&row).sqrt();
        row.iter_mut().for_each(|a| *a /= length);
        rows.push(row);
    }
    rows
}

fn problem(function: Function, seed: u64) -> Problem {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let dimension = DIMENSIONS[seed as usize % DIMENSIONS.len()];
    // From -5 to 5 on each axis, and the optimum not at the edge.
    let optimum: Vec<f64> = (0..dimension).map(|_| 8.0 * random.random::<f64>() - 4.0).collect();
    let rows = rotation(dimension, &mut random);
    let value = move |x: &[f64]| {
        let off: Vec<f64> = x.iter().zip(&optimum).map(|(x, best)| 10.0 * x - 5.0 - best).collect();
        let z = rows.iter().map(|row| row.iter().zip(&off).map(|(a, b)| a * b).sum::<f64>());
        function(&z.collect::<Vec<f64>>())
    };
    let mut anywhere: Vec<f64> =
        (0..POINTS).map(|_| value(&(0..dimension).map(|_| random.random()).collect::<Vec<f64>>())).collect();
    anywhere.sort_by(f64::total_cmp);
    let remains = REMAINS * anywhere[POINTS / 2];
    let truth = move |configuration: &Configuration| {
        let number = |axis: usize| configuration.get(&format!("x{axis}")).and_then(Value::as_number);
        let x: Option<Vec<f64>> = (0..dimension).map(number).collect();
        Some(remains + value(&x?))
    };
    let space = Space::new((0..dimension).map(|axis| share(format!("x{axis}"))).collect(), Vec::new());
    Problem { space: space.expect("a space"), truth: Box::new(truth), noise: NOISE, optimum: remains }
}

pub(crate) fn problems(seed: u64) -> Vec<Problem> {
    FUNCTIONS.iter().map(|function| problem(*function, seed)).collect()
}
