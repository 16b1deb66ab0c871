//! Problems whose optimum moves with the context.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::{STATE_TOLERANCE_DEFAULT, StudySpec};
use treewright_core::tuner::Tuner;
use treewright_core::value::Value;
use treewright_lab::simulated::{share, study};

/// Contexts on which the best fixed configuration is found.
const CONTEXTS: usize = 4000;
/// Regret of the best fixed configuration, by the choice of unit.
const FIXED: f64 = 0.6;

/// A function with four parameters and two indicators.
pub(crate) struct Problem {
    pub(crate) name: &'static str,
    /// Where the optimum of each parameter lies in a context.
    optimum: fn(&[f64; 2]) -> [f64; 4],
    /// The cost above the least, of the ways from the optimum.
    rise: fn(&[f64; 4]) -> f64,
    /// The least cost in a context.
    least: fn(&[f64; 2]) -> f64,
    integers: bool,
    /// A regret of one in units of cost.
    unit: f64,
}

fn wave(&[u, v]: &[f64; 2]) -> [f64; 4] {
    let sine = |x: f64| 0.5 + 0.4 * (std::f64::consts::PI * x).sin();
    [sine(u - 0.5), sine(2.0 * v - 0.5), sine(u + v), sine(u - v)]
}

fn slope(&[u, v]: &[f64; 2]) -> [f64; 4] {
    [0.1 + 0.8 * u, 0.9 - 0.8 * v, 0.1 + 0.4 * (u + v), 0.5 + 0.4 * (u - v)]
}

/// Round a circle, at a steady pace.
fn turn(&[u, v]: &[f64; 2]) -> [f64; 4] {
    let angle = std::f64::consts::PI * (u + 0.5 * v);
    [0.5 + 0.35 * angle.cos(), 0.5 + 0.35 * angle.sin(), 0.2 + 0.6 * u * v, 0.5 - 0.3 * (u - v).powi(2)]
}

fn bowl(ways: &[f64; 4]) -> f64 {
    4.0 * ways.iter().map(|way| way * way).sum::<f64>()
}

fn uneven(&[a, b, c, d]: &[f64; 4]) -> f64 {
    8.0 * a * a + 4.0 * b * b + 2.0 * c * c + d * d
}

fn cone(ways: &[f64; 4]) -> f64 {
    2.0 * ways.iter().map(|way| way * way).sum::<f64>().sqrt()
}

/// A kink along each axis.
fn roof(ways: &[f64; 4]) -> f64 {
    ways.iter().map(|way| way.abs()).sum()
}

/// Factors that multiply, two of them with a kink.
fn factors(&[a, b, c, d]: &[f64; 4]) -> f64 {
    (1.0 + 3.0 * a * a) * (1.0 + b.abs()) * (1.0 + 3.0 * c * c) * (1.0 + 0.5 * d.abs()) - 1.0
}

/// A valley across the axes, ten times as steep as it is long.
fn ridge(&[a, b, c, d]: &[f64; 4]) -> f64 {
    10.0 * ((a - b).powi(2) + (c + d).powi(2)) + (a + b).powi(2) + (c - d).powi(2)
}

/// Waves on a bowl: valleys a half apart.
fn waves(ways: &[f64; 4]) -> f64 {
    let wave = |way: &f64| 3.0 * way * way + 0.15 * (1.0 - (4.0 * std::f64::consts::PI * way).cos());
    ways.iter().map(wave).sum()
}

/// Steep near the optimum and level far away.
fn funnel(ways: &[f64; 4]) -> f64 {
    2.0 * (1.0 - (-6.0 * ways.iter().map(|way| way * way).sum::<f64>()).exp())
}

/// A cost that rises over two magnitudes.
fn exponential(ways: &[f64; 4]) -> f64 {
    (3.0 * ways.iter().map(|way| way * way).sum::<f64>()).exp() - 1.0
}

fn one(_: &[f64; 2]) -> f64 {
    1.0
}

/// A level that differs by a factor of five over the contexts.
fn hill(&[u, v]: &[f64; 2]) -> f64 {
    (1.6 * u * v).exp()
}

/// All problems.
pub(crate) fn all() -> Vec<Problem> {
    let problem = |name, optimum, rise, least, integers| {
        let mut problem = Problem { name, optimum, rise, least, integers, unit: 1.0 };
        problem.scale();
        problem
    };
    vec![
        problem("wave, bowl", wave as fn(&_) -> _, bowl as fn(&_) -> _, one as fn(&_) -> _, false),
        problem("slope, bowl", slope, bowl, one, false),
        problem("wave, uneven, level", wave, uneven, hill, false),
        problem("wave, cone", wave, cone, one, false),
        problem("slope, uneven, integers", slope, uneven, hill, true),
        problem("wave, roof", wave, roof, one, false),
        problem("slope, roof, level", slope, roof, hill, false),
        problem("wave, factors, level", wave, factors, hill, false),
        problem("slope, ridge", slope, ridge, one, false),
        problem("wave, ridge", wave, ridge, one, false),
        problem("slope, waves", slope, waves, one, false),
        problem("wave, funnel", wave, funnel, one, false),
        problem("wave, exponential, level", wave, exponential, hill, false),
        problem("turn, bowl", turn, bowl, one, false),
        problem("turn, cone, level", turn, cone, hill, false),
    ]
}

impl Problem {
    /// The noiseless cost of a point of the unit cube.
    pub(crate) fn cost(&self, context: &[f64; 2], point: &[f64]) -> f64 {
        let optimum = (self.optimum)(context);
        let ways: [f64; 4] = std::array::from_fn(|axis| point[axis] - optimum[axis]);
        (self.least)(context) * (1.0 + (self.rise)(&ways))
    }

    /// The regret of a cost.
    pub(crate) fn regret(&self, cost: f64, context: &[f64; 2]) -> f64 {
        (cost - (self.least)(context)) / self.unit
    }

    /// Finds the best fixed configuration by pattern search, and takes its mean regret for [`FIXED`].
    fn scale(&mut self) {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let contexts: Vec<[f64; 2]> = (0..CONTEXTS).map(|_| [random.random(), random.random()]).collect();
        let regret = |point: &[f64]| {
            contexts.iter().map(|context| self.regret(self.cost(context, point), context)).sum::<f64>()
                / CONTEXTS as f64
        };
        let (mut best, mut step) = (vec![0.5; 4], 0.25);
        let mut least = regret(&best);
        while step > 0.004 {
            let before = least;
            for axis in 0..4 {
                for way in [-step, step] {
                    let mut other = best.clone();
                    other[axis] = (other[axis] + way).clamp(0.0, 1.0);
                    let found = regret(&other);
                    if found < least {
                        (best, least) = (other, found);
                    }
                }
            }
            if least == before {
                step /= 2.0;
            }
        }
        self.unit = least / FIXED;
    }

    fn name_of(axis: usize) -> String {
        format!("p{axis}")
    }

    /// The point of a configuration.
    pub(crate) fn point(&self, configuration: &Configuration) -> Vec<f64> {
        let coordinate = |axis: usize| match configuration.get(&Self::name_of(axis)) {
            Some(Value::Float(x)) => *x,
            Some(Value::Integer(level)) => *level as f64 / 16.0,
            _ => 0.5,
        };
        (0..4).map(coordinate).collect()
    }

    /// The tuner of a study of the problem.
    pub(crate) fn tuner(&self, policy: Policy, seed: u64) -> Tuner {
        let level = Domain::Integer { min: 0, max: 16, scale: Scale::Linear };
        let of = |axis: usize| match self.integers {
            true => Parameter::new(Self::name_of(axis), level.clone(), Value::Integer(8)),
            false => share(Self::name_of(axis)),
        };
        let space = Space::new((0..4).map(of).collect(), vec![]).expect("a valid space");
        let study = study(space, ["u", "v"].map(str::to_owned).into_iter(), policy, seed);
        let spec = StudySpec { state_tolerance: STATE_TOLERANCE_DEFAULT, ..study };
        Tuner::new(Arc::new(spec)).expect("a valid study")
    }
}
