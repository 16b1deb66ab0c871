//! The lasting speed of a state's machine, relative to the state's first measurement.
//!
//! The table of a state has costs at the speed of its first measurement, when other programs may have run.
//! Costs for people are those at the machine's fastest lasting speed. This is the estimate where
//! configurations ran too seldom for that of `quiet`.

use serde::{Deserialize, Serialize};

/// The number of latest factors of speed that are kept, the least number that is judged, and the share of
/// them that may be fast by chance.
const KEPT_MAX: usize = 64;
const KEPT_LEAST: usize = 8;
const LASTS: f64 = 0.15;
/// The least difference of a lasting speed, as a logarithm and in deviations of a measurement.
const CHANGE: f64 = 0.1;
const NOISE: f64 = 1.5;

/// The speeds of a state's machine. Plain data, exact through serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Logarithms of the factors that the latest costs were divided by.
    latest: Vec<f64>,
    /// The logarithm of the lowest factor that lasted: the middle of its estimates.
    lowest: f64,
}

impl Pace {
    /// Notes the factor of the machine's speed by which a trial's cost is divided. `noise` is the standard
    /// deviation of the logarithm of one measurement, which may be mistaken for speed.
    pub fn note(&mut self, factor: f64, noise: f64) {
        if factor == 1.0 && self.latest.is_empty() {
            return;
        }
        if self.latest.len() == KEPT_MAX {
            self.latest.remove(0);
        }
        self.latest.push(libm::log(factor));
        if self.latest.len() >= KEPT_LEAST {
            let mut sorted = self.latest.clone();
            sorted.sort_by(f64::total_cmp);
            let fast = sorted[(LASTS * sorted.len() as f64) as usize];
            let reach = (NOISE * noise).max(CHANGE);
            if fast < -reach {
                // Of the estimates of one speed the middle one, since the fastest are so by chance.
                let around = if fast < self.lowest - reach { fast } else { self.lowest };
                let near = sorted.partition_point(|pace| *pace <= around + reach);
                let middle = sorted[near / 2];
                if middle < self.lowest || 2 * near > sorted.len() {
                    self.lowest = middle.min(0.0);
                }
            }
        }
    }

    /// The costs of the table were multiplied by a factor.
    pub fn shift(&mut self, factor: f64) {
        let shift = libm::log(factor);
        self.latest.iter_mut().for_each(|pace| *pace -= shift);
        self.lowest = (self.lowest - shift).min(0.0);
    }

    /// The factor that converts the costs of the table to those of the machine at its fastest; at most 1.
    pub fn factor(&self) -> f64 {
        assert!(self.lowest <= 0.0, "a lowest speed of {}", self.lowest);
        libm::exp(self.lowest)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    #[test]
    fn the_noise_of_estimates_makes_no_machine_faster() {
        for noise in [0.02, 0.05, 0.07] {
            let mut off = 0.0;
            for seed in 0..40 {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                let mut pace = Pace::default();
                let mut run = |pace: &mut Pace, count: usize, factor: f64| {
                    let noisy = |random: &mut ChaCha8Rng| factor * libm::exp(noise * normal(random));
                    (0..count).for_each(|_| pace.note(noisy(&mut random), noise));
                };
                (0..20).for_each(|_| pace.note(1.0, noise));
                // Other programs end, and begin again.
                run(&mut pace, 60, 0.7);
                let quiet = pace.factor();
                run(&mut pace, 100, 1.0);
                assert!(pace.factor() <= (1.0 + noise) * quiet, "{} after {quiet}", pace.factor());
                off += libm::log(quiet / 0.7) / 40.0;
            }
            assert!(off.abs() < 0.6 * noise, "reported costs are off by {off} at a noise of {noise}");
        }
    }

    #[test]
    fn the_fastest_speed_that_lasted_is_kept() {
        let mut pace = Pace::default();
        (0..20).for_each(|_| pace.note(1.0, 0.03));
        assert_eq!(pace.factor(), 1.0);
        // Faster for a moment by chance, then for a while.
        pace.note(0.5, 0.03);
        (0..20).for_each(|_| pace.note(1.0, 0.03));
        assert_eq!(pace.factor(), 1.0);
        (0..20).for_each(|_| pace.note(0.7, 0.03));
        assert!((pace.factor() - 0.7).abs() < 1e-12);
        (0..100).for_each(|_| pace.note(1.4, 0.03));
        assert!((pace.factor() - 0.7).abs() < 1e-12, "it was that fast");
        pace.shift(0.7);
        assert!((pace.factor() - 1.0).abs() < 1e-12);
    }
}
