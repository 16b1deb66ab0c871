//! Where to measure next: expected improvement, and the climb to its maximum.

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::process::{Belief, Process};
use crate::search::layout::Layout;

/// A configuration that was measured.
pub(super) struct Known {
    /// Canonical coordinates.
    pub(super) x: Vec<f64>,
    /// What the model makes of its cost.
    pub(super) believed: f64,
}

/// The value of measuring a point.
pub(super) struct Acquisition<'a> {
    pub(super) layout: &'a Layout,
    /// `None` while there are not two costs to learn from.
    pub(super) cost: Option<&'a Process>,
    /// Predicts 1 for points that cannot be run; `None` while every point could.
    pub(super) failure: Option<&'a Process>,
    pub(super) dimension: usize,
    /// Deviations of cost count as so many times what the model says.
    pub(super) doubt: f64,
}

/// A point on the way up.
#[derive(Clone)]
struct Climber {
    x: Vec<f64>,
    value: f64,
}

/// Random points to begin with: anywhere, and near the best.
const ANYWHERE: usize = 40;
const NEAR: usize = 40;
/// How many points climb, and how many changes they try between them.
const CLIMBERS: usize = 4;
const CHANGES: usize = 240;
/// Steps along a continuous axis shrink from this to that over the climb.
const STEP_FIRST: f64 = 0.15;
const STEP_LAST: f64 = 0.01;
/// The probability that a point can be run is never taken for less than this.
const FEASIBLE_MIN: f64 = 1e-3;

/// A point drawn from the whole cube.
pub(super) fn anywhere(dimension: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    (0..dimension).map(|_| random.random()).collect()
}

impl Acquisition<'_> {
    /// The logarithm of the expected improvement on `best` times the probability that the point can be run;
    /// minus infinity where it cannot exceed `floor`.
    fn value(&self, x: &[f64], active: &[bool], best: f64, floor: f64) -> f64 {
        let features = self.layout.features(x, active);
        let Some(cost) = self.cost else {
            return self.feasible(&features).ln();
        };
        let nearness = cost.nearness(&features);
        let mean = cost.mean(&nearness);
        let improvement = |deviation: f64| log_improvement((best - mean) / deviation) + deviation.ln();
        // Nothing unknown could make more of it than this; most points end here.
        if improvement(self.doubt * cost.deviation_max(&nearness)) <= floor {
            return f64::NEG_INFINITY;
        }
        let improvement = improvement(self.doubt * cost.deviation(&nearness));
        if improvement <= floor { f64::NEG_INFINITY } else { improvement + self.feasible(&features).ln() }
    }

    /// The probability that a point can be run.
    pub(super) fn feasible(&self, features: &[f64]) -> f64 {
        self.failure.map_or(1.0, |failure| {
            let belief = failure.at(features);
            let spread = (belief.deviation * belief.deviation + failure.noise()).sqrt();
            normal((0.5 - belief.mean) / spread).max(FEASIBLE_MIN)
        })
    }

    /// The best point to measure that is not `taken`.
    pub(super) fn best(
        &self,
        known: &[Known],
        random: &mut ChaCha8Rng,
        taken: impl Fn(&[f64]) -> bool,
    ) -> Option<Vec<f64>> {
        let mut order: Vec<&Known> = known.iter().collect();
        order.sort_by(|a, b| a.believed.total_cmp(&b.believed));
        let best = order.first().map_or(0.0, |known| known.believed);
        let best = if best.is_finite() { best } else { 0.0 };
        let dimension = self.dimension;
        let mut climbers: Vec<Climber> = Vec::new();
        let enter = |mut x: Vec<f64>, floor: f64| {
            self.layout.hold(&mut x);
            let active = self.layout.canonical(&mut x);
            let value = self.value(&x, &active, best, floor);
            Climber { x, value }
        };
        let none = f64::NEG_INFINITY;
        for _ in 0..ANYWHERE {
            climbers.push(enter(anywhere(dimension, random), none));
        }
        for index in 0..if order.is_empty() { 0 } else { NEAR } {
            let centre = &order[index % order.len().min(CLIMBERS)].x;
            let radius = 0.3 * 0.5f64.powi((index / 8) as i32);
            let mut x = centre.clone();
            let always = random.random_range(0..dimension);
            for (axis, x) in x.iter_mut().enumerate() {
                if axis == always || random.random::<f64>() < 0.4 {
                    *x = self.layout.moved(axis, *x, radius, random);
                }
            }
            climbers.push(enter(x, none));
        }
        climbers.retain(|climber| !taken(&climber.x));
        climbers.sort_by(|a, b| b.value.total_cmp(&a.value));
        climbers.truncate(CLIMBERS);
        // The best of the known start too: their neighbours are the likeliest improvements.
        let mut axes: Vec<usize> = (0..dimension).collect();
        let mut champion: Option<Climber> = None;
        let starts = climbers.into_iter().chain(
            order.iter().take(2).map(|known| Climber { x: known.x.clone(), value: f64::NEG_INFINITY }),
        );
        let starts: Vec<Climber> = starts.collect();
        let share = CHANGES / starts.len().max(1);
        for mut climber in starts {
            let mut tried = 0;
            while tried < share {
                axes.shuffle(random);
                for &axis in &axes {
                    let progress = tried as f64 / share as f64;
                    let radius = STEP_FIRST * (STEP_LAST / STEP_FIRST).powf(progress);
                    let mut x = climber.x.clone();
                    x[axis] = self.layout.moved(axis, x[axis], radius, random);
                    tried += 1;
                    let changed = enter(x, climber.value);
                    if changed.value > climber.value && !taken(&changed.x) {
                        climber = changed;
                    }
                    if tried >= share {
                        break;
                    }
                }
            }
            if climber.value > f64::NEG_INFINITY
                && champion.as_ref().is_none_or(|other| climber.value > other.value)
            {
                champion = Some(climber);
            }
        }
        champion.map(|climber| climber.x)
    }
}

/// `ln(phi(z) + z Phi(z))`, the logarithm of the expected improvement of a standard normal over `-z`.
pub(super) fn log_improvement(z: f64) -> f64 {
    let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
    if z > -5.0 {
        return (density + z * normal(z)).ln();
    }
    // The first terms of the asymptotic expansion: phi(z) / z^2 (1 - 3 / z^2 + 15 / z^4).
    let inverse = 1.0 / (z * z);
    -0.5 * z * z - 0.5 * (2.0 * std::f64::consts::PI).ln()
        + (inverse * (1.0 - 3.0 * inverse + 15.0 * inverse * inverse)).ln()
}

/// The mean of what is believed of a value, measured with `noise` (a variance), above a bound.
pub(super) fn mean_above(bound: f64, belief: Belief, noise: f64) -> f64 {
    let deviation = (belief.deviation * belief.deviation + noise).sqrt();
    let z = (bound - belief.mean) / deviation;
    // The hazard of the normal, which approaches a straight line from above.
    let hazard = if z > 5.0 {
        z + 1.0 / z
    } else {
        (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt() / normal(-z)
    };
    let mean = belief.mean + deviation * hazard;
    if mean.is_finite() { mean.max(bound) } else { bound }
}

/// A standard normal number.
pub(super) fn standard_normal(random: &mut ChaCha8Rng) -> f64 {
    let (a, b) = (1.0 - random.random::<f64>(), random.random::<f64>());
    libm::sqrt(-2.0 * libm::log(a)) * libm::cos(2.0 * std::f64::consts::PI * b)
}

/// The distribution function of the standard normal.
fn normal(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_above_a_bound_is_that_of_a_truncated_normal() {
        let belief = Belief { mean: 1.0, deviation: 3.0 };
        // Half a normal: the root of two over pi times its deviation above the bound, here 5.
        let half = mean_above(1.0, belief, 16.0);
        assert!((half - 1.0 - 5.0 * (2.0 / std::f64::consts::PI).sqrt()).abs() < 1e-12, "{half}");
        assert!((mean_above(-1e6, belief, 16.0) - 1.0).abs() < 1e-9, "a bound far below says nothing");
        let far = mean_above(1e6, belief, 16.0);
        assert!((1e6..1e6 + 1.0).contains(&far), "a bound far above is all there is: {far}");
        let (below, above) = (mean_above(25.99, belief, 16.0), mean_above(26.01, belief, 16.0));
        assert!(below < above && above - below < 0.2, "{below} {above}");
    }
}
