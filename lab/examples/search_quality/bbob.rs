//! Continuous functions after Hansen, Finck, Ros and Auger, "Real-parameter black-box optimization
//! benchmarking 2009: noiseless functions definitions" (INRIA RR-6829), with their numbers. The offsets of
//! the values are left out: what is given is the gap to the optimum.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::value::Value;

use crate::problem::{Kind, Problem, normal};

/// The functions that are carried out.
pub(crate) const FUNCTIONS: [u32; 15] = [1, 2, 3, 6, 7, 8, 9, 10, 12, 13, 14, 15, 16, 17, 21];

type Matrix = Vec<Vec<f64>>;

/// One function in one dimension with one random optimum and rotation.
struct Function {
    number: u32,
    optimum: Vec<f64>,
    r: Matrix,
    q: Matrix,
    peaks: Vec<(Vec<f64>, Vec<f64>, f64)>,
}

fn rotation(dimension: usize, random: &mut impl Rng) -> Matrix {
    let mut rows: Matrix = (0..dimension).map(|_| (0..dimension).map(|_| normal(random)).collect()).collect();
    for i in 0..dimension {
        for j in 0..i {
            let along: f64 = (0..dimension).map(|k| rows[i][k] * rows[j][k]).sum();
            let other = rows[j].clone();
            rows[i].iter_mut().zip(other).for_each(|(x, other)| *x -= along * other);
        }
        let length = rows[i].iter().map(|x| x * x).sum::<f64>().sqrt();
        rows[i].iter_mut().for_each(|x| *x /= length);
    }
    rows
}

fn times(matrix: &Matrix, x: &[f64]) -> Vec<f64> {
    matrix.iter().map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
}

fn oscillate(x: f64) -> f64 {
    if x == 0.0 {
        return 0.0;
    }
    let (log, c1, c2) = (x.abs().ln(), if x > 0.0 { 10.0 } else { 5.5 }, if x > 0.0 { 7.9 } else { 3.1 });
    x.signum() * (log + 0.049 * ((c1 * log).sin() + (c2 * log).sin())).exp()
}

fn asymmetric(x: &mut [f64], beta: f64) {
    let last = (x.len() - 1).max(1) as f64;
    for (i, x) in x.iter_mut().enumerate() {
        if *x > 0.0 {
            *x = x.powf(1.0 + beta * i as f64 / last * x.sqrt());
        }
    }
}

fn stretch(x: &mut [f64], alpha: f64) {
    let last = (x.len() - 1).max(1) as f64;
    x.iter_mut().enumerate().for_each(|(i, x)| *x *= alpha.powf(0.5 * i as f64 / last));
}

fn outside(x: &[f64]) -> f64 {
    x.iter().map(|x| (x.abs() - 5.0).max(0.0).powi(2)).sum()
}

fn ellipsoid(z: &[f64], condition: f64) -> f64 {
    let last = (z.len() - 1).max(1) as f64;
    z.iter().enumerate().map(|(i, z)| condition.powf(i as f64 / last) * z * z).sum()
}

fn rastrigin(z: &[f64]) -> f64 {
    let cosines: f64 = z.iter().map(|z| (2.0 * std::f64::consts::PI * z).cos()).sum();
    10.0 * (z.len() as f64 - cosines) + z.iter().map(|z| z * z).sum::<f64>()
}

fn rosenbrock(z: &[f64]) -> f64 {
    z.windows(2).map(|z| 100.0 * (z[0] * z[0] - z[1]).powi(2) + (z[0] - 1.0).powi(2)).sum()
}

impl Function {
    fn new(number: u32, dimension: usize, seed: u64) -> Self {
        let random = &mut ChaCha8Rng::seed_from_u64(seed * 1000 + u64::from(number) * 31 + dimension as u64);
        let reach = if number == 8 { 3.0 } else { 4.0 };
        let mut optimum: Vec<f64> =
            (0..dimension).map(|_| reach * (2.0 * random.random::<f64>() - 1.0)).collect();
        let (r, q) = (rotation(dimension, random), rotation(dimension, random));
        let mut peaks = Vec::new();
        if number == 21 {
            let mut conditions: Vec<f64> =
                (0..100).map(|i| 1000f64.powf(2.0 * f64::from(i) / 99.0)).collect();
            for i in 0..101 {
                let alpha = match i {
                    0 => 1000.0,
                    _ => conditions.swap_remove(random.random_range(0..conditions.len())),
                };
                let mut scale = vec![1.0; dimension];
                stretch(&mut scale, alpha);
                for k in (1..dimension).rev() {
                    scale.swap(k, random.random_range(0..=k));
                }
                let divisor = alpha.powf(0.25);
                scale.iter_mut().for_each(|s| *s /= divisor);
                let reach = if i == 0 { 3.92 } else { 4.9 };
                let at: Vec<f64> =
                    (0..dimension).map(|_| reach * (2.0 * random.random::<f64>() - 1.0)).collect();
                let height = if i == 0 { 10.0 } else { 1.1 + 8.0 * f64::from(i - 1) / 99.0 };
                peaks.push((at, scale, height));
            }
            optimum.clone_from(&peaks[0].0);
        }
        Function { number, optimum, r, q, peaks }
    }

    fn gap(&self, x: &[f64]) -> f64 {
        let d = x.len();
        let root = (d as f64).sqrt();
        let shifted: Vec<f64> = x.iter().zip(&self.optimum).map(|(x, o)| x - o).collect();
        match self.number {
            1 => shifted.iter().map(|z| z * z).sum(),
            2 => ellipsoid(&shifted.iter().map(|&z| oscillate(z)).collect::<Vec<_>>(), 1e6),
            3 => {
                let mut z: Vec<f64> = shifted.iter().map(|&z| oscillate(z)).collect();
                asymmetric(&mut z, 0.2);
                stretch(&mut z, 10.0);
                rastrigin(&z)
            }
            6 => {
                let mut z = times(&self.r, &shifted);
                stretch(&mut z, 10.0);
                let z = times(&self.q, &z);
                let sum: f64 = z
                    .iter()
                    .zip(&self.optimum)
                    .map(|(z, o)| if z * o > 0.0 { (100.0 * z).powi(2) } else { z * z })
                    .sum();
                oscillate(sum).powf(0.9)
            }
            7 => {
                let mut z = times(&self.r, &shifted);
                stretch(&mut z, 10.0);
                let first = z[0].abs() / 1e4;
                let step =
                    |z: &f64| if z.abs() > 0.5 { (0.5 + z).floor() } else { (0.5 + 10.0 * z).floor() / 10.0 };
                let z = times(&self.q, &z.iter().map(step).collect::<Vec<_>>());
                0.1 * first.max(ellipsoid(&z, 100.0)) + outside(x)
            }
            8 => {
                let scale = (root / 8.0).max(1.0);
                rosenbrock(&shifted.iter().map(|z| scale * z + 1.0).collect::<Vec<_>>())
            }
            9 => {
                let scale = (root / 8.0).max(1.0);
                rosenbrock(&times(&self.r, &shifted).iter().map(|z| scale * z + 1.0).collect::<Vec<_>>())
            }
            10 => ellipsoid(&times(&self.r, &shifted).into_iter().map(oscillate).collect::<Vec<_>>(), 1e6),
            12 => {
                let mut z = times(&self.r, &shifted);
                asymmetric(&mut z, 0.5);
                let z = times(&self.r, &z);
                z[0] * z[0] + 1e6 * z[1..].iter().map(|z| z * z).sum::<f64>()
            }
            13 => {
                let mut z = times(&self.r, &shifted);
                stretch(&mut z, 10.0);
                let z = times(&self.q, &z);
                z[0] * z[0] + 100.0 * z[1..].iter().map(|z| z * z).sum::<f64>().sqrt()
            }
            14 => {
                let z = times(&self.r, &shifted);
                let last = (d - 1).max(1) as f64;
                let sum: f64 =
                    z.iter().enumerate().map(|(i, z)| z.abs().powf(2.0 + 4.0 * i as f64 / last)).sum();
                sum.sqrt()
            }
            15 => {
                let mut z: Vec<f64> = times(&self.r, &shifted).into_iter().map(oscillate).collect();
                asymmetric(&mut z, 0.2);
                z = times(&self.q, &z);
                stretch(&mut z, 10.0);
                rastrigin(&times(&self.r, &z))
            }
            16 => {
                let z: Vec<f64> = times(&self.r, &shifted).into_iter().map(oscillate).collect();
                let mut z = times(&self.q, &z);
                stretch(&mut z, 0.01);
                let z = times(&self.r, &z);
                let wave = |x: f64| -> f64 {
                    (0..12)
                        .map(|k| {
                            0.5f64.powi(k) * (2.0 * std::f64::consts::PI * 3f64.powi(k) * (x + 0.5)).cos()
                        })
                        .sum()
                };
                let (f0, sum) = (wave(0.0), z.iter().map(|&z| wave(z)).sum::<f64>());
                10.0 * (sum / d as f64 - f0).max(0.0).powi(3) + 10.0 / d as f64 * outside(x)
            }
            17 => {
                let mut z = times(&self.r, &shifted);
                asymmetric(&mut z, 0.5);
                let mut z = times(&self.q, &z);
                stretch(&mut z, 10.0);
                let term = |z: &[f64]| {
                    let s = (z[0] * z[0] + z[1] * z[1]).sqrt();
                    s.sqrt() + s.sqrt() * (50.0 * s.powf(0.2)).sin().powi(2)
                };
                (z.windows(2).map(term).sum::<f64>() / (d - 1) as f64).powi(2) + 10.0 * outside(x)
            }
            21 => {
                let peak = |(at, scale, height): &(Vec<f64>, Vec<f64>, f64)| {
                    let z = times(&self.r, &x.iter().zip(at).map(|(x, a)| x - a).collect::<Vec<_>>());
                    let squares: f64 = z.iter().zip(scale).map(|(z, s)| s * z * z).sum();
                    height * (-squares / (2.0 * d as f64)).exp()
                };
                let highest = self.peaks.iter().map(peak).fold(0.0, f64::max);
                oscillate(10.0 - highest).max(0.0).powi(2) + outside(x)
            }
            _ => unreachable!("the list of functions names only these"),
        }
    }
}

/// A function over the cube from -5 to 5, with the default at a random place; `noise` multiplies the gap, and
/// `offset` is added to what is measured.
pub(crate) fn problem(number: u32, dimension: usize, seed: u64, noise: f64, offset: f64) -> Problem {
    let function = Function::new(number, dimension, seed);
    let random = &mut ChaCha8Rng::seed_from_u64(seed * 77 + 5);
    let parameters = (0..dimension).map(|i| Parameter {
        name: format!("x{i}"),
        domain: Domain::Float { min: -5.0, max: 5.0, scale: Scale::Linear },
        default: Value::Float(10.0 * random.random::<f64>() - 5.0),
        active_if: None,
    });
    let space = Space::new(parameters.collect(), Vec::new()).expect("a valid space");
    let truth = move |configuration: &Configuration| {
        let x = (0..dimension).map(|i| configuration.get(&format!("x{i}")).and_then(Value::as_number));
        Some(function.gap(&x.map(|x| x.unwrap_or(0.0)).collect::<Vec<f64>>()))
    };
    Problem {
        name: format!("f{number}-{dimension}d"),
        kind: Kind::Gap,
        space,
        truth: Box::new(truth),
        noise,
        offset,
        optimum: 0.0,
    }
}
