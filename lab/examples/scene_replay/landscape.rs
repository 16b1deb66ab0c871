//! What configurations cost in a recorded scene, measured or not: a Gaussian process over everything that ran
//! there.

use std::collections::BTreeMap;

use treewright_core::configuration::Configuration;
use treewright_core::space::{Domain, Space};
use treewright_core::value::Value;

/// Lengths among which the likelihood chooses, in distances between features.
const LENGTHS: [f64; 4] = [1.0, 2.0, 4.0, 8.0];
/// Standard deviations of the logarithms of costs among which it chooses.
const SPREADS: [f64; 4] = [0.05, 0.1, 0.2, 0.4];
/// The noise of the logarithm of one recorded frame.
const NOISE: f64 = 0.06;

/// What was recorded of one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Recorded {
    pub(crate) configuration: Configuration,
    /// The logarithm of its cost.
    pub(crate) log_cost: f64,
    /// How many frames that is the mean of.
    pub(crate) frames: f64,
}

/// The costs of a scene.
pub(crate) struct Landscape {
    space: Space,
    known: Vec<Vec<f64>>,
    weights: Vec<f64>,
    level: f64,
    length: f64,
    spread: f64,
}

impl Landscape {
    pub(crate) fn of(space: &Space, recorded: &[Recorded]) -> Self {
        let known: Vec<Vec<f64>> = recorded.iter().map(|one| features(space, &one.configuration)).collect();
        let level = recorded.iter().map(|one| one.log_cost).sum::<f64>() / recorded.len() as f64;
        let residuals: Vec<f64> = recorded.iter().map(|one| one.log_cost - level).collect();
        let fit = |length: f64, spread: f64| {
            let n = known.len();
            let mut matrix = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..n {
                    matrix[i * n + j] = covariance(&known[i], &known[j], length, spread);
                }
                matrix[i * n + i] += NOISE * NOISE / recorded[i].frames;
            }
            let (weights, half_log_determinant) = solve(matrix, &residuals);
            let misfit: f64 = weights.iter().zip(&residuals).map(|(weight, y)| weight * y).sum();
            (-0.5 * misfit - half_log_determinant, weights, length, spread)
        };
        let all = LENGTHS.iter().flat_map(|&length| SPREADS.iter().map(move |&spread| (length, spread)));
        let (_, weights, length, spread) = all
            .map(|(length, spread)| fit(length, spread))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .expect("there are lengths");
        Self { space: space.clone(), known, weights, level, length, spread }
    }

    /// The cost of a configuration, in units of the recording.
    pub(crate) fn cost(&self, configuration: &Configuration) -> f64 {
        let at = features(&self.space, configuration);
        let all = self.known.iter().zip(&self.weights);
        let sum: f64 =
            all.map(|(known, weight)| weight * covariance(&at, known, self.length, self.spread)).sum();
        (self.level + sum).exp()
    }
}

/// One number for each number, one for each value of a category, 0 where a parameter means nothing.
fn features(space: &Space, configuration: &Configuration) -> Vec<f64> {
    let place: BTreeMap<&str, f64> = space
        .parameters()
        .iter()
        .map(|parameter| parameter.name.as_str())
        .zip(space.encode(configuration))
        .collect();
    let mut all = Vec::new();
    for parameter in space.parameters() {
        let value = configuration.get(&parameter.name);
        match &parameter.domain {
            Domain::Categorical { values } => {
                let share = std::f64::consts::FRAC_1_SQRT_2;
                all.extend(values.iter().map(|one| if Some(one) == value { share } else { 0.0 }));
            }
            Domain::Boolean => all.push(match value {
                Some(Value::Boolean(true)) => 0.5,
                Some(_) => -0.5,
                None => 0.0,
            }),
            _ => all.push(if value.is_some() { place[parameter.name.as_str()] - 0.5 } else { 0.0 }),
        }
    }
    all
}

/// Matérn with smoothness 5/2.
fn covariance(a: &[f64], b: &[f64], length: f64, spread: f64) -> f64 {
    let distance_2: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    let r = (5.0 * distance_2).sqrt() / length;
    spread * spread * (1.0 + r + r * r / 3.0) * (-r).exp()
}

/// Solves by Cholesky's factor; half the logarithm of the determinant beside it.
fn solve(mut matrix: Vec<f64>, right: &[f64]) -> (Vec<f64>, f64) {
    let n = right.len();
    let mut x = right.to_vec();
    let mut half_log_determinant = 0.0;
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let rest = matrix[i * n + j] - sum;
            matrix[i * n + j] = if i == j { rest.max(1e-12).sqrt() } else { rest / matrix[j * n + j] };
        }
        half_log_determinant += matrix[i * n + i].ln();
        let sum: f64 = (0..i).map(|k| matrix[i * n + k] * x[k]).sum();
        x[i] = (x[i] - sum) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| matrix[k * n + i] * x[k]).sum();
        x[i] = (x[i] - sum) / matrix[i * n + i];
    }
    (x, half_log_determinant)
}
