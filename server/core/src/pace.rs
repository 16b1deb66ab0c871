//! The speed of a state's machine that lasted for a while, relative to the state's first measurement.
//!
//! The table of a state has costs at the speed of its first measurement, when other programs may have run.
//! People see the costs of the machine at its fastest lasting speed.

use serde::{Deserialize, Serialize};

/// Most factors of speed that are kept, the latest ones; the least number that is judged; and the share of
/// them that was faster by chance.
const KEPT_MAX: usize = 64;
const KEPT_LEAST: usize = 8;
const LASTS: f64 = 0.15;
/// Speeds that differ by less, or by fewer deviations of a measurement, are the same.
const CHANGE: f64 = 0.1;
const NOISE: f64 = 1.5;

/// The speeds of a state's machine. Plain data, exact through serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Logarithms of the factors that the latest costs were divided by.
    latest: Vec<f64>,
    /// The lowest that lasted.
    lowest: f64,
}

impl Pace {
    /// Notes how fast the client's machine was in a trial: the factor that its cost is divided by. `noise` is
    /// the standard deviation of the logarithm of one measurement: noise is taken for speed now and then.
    pub fn note(&mut self, factor: f64, noise: f64) {
        if factor == 1.0 && self.latest.is_empty() {
            return;
        }
        if self.latest.len() == KEPT_MAX {
            self.latest.remove(0);
        }
        self.latest.push(libm::log(factor));
        assert!(self.latest.len() <= KEPT_MAX, "{} speeds are kept", self.latest.len());
        if self.latest.len() >= KEPT_LEAST {
            let mut sorted = self.latest.clone();
            sorted.sort_by(f64::total_cmp);
            let fast = sorted[(LASTS * sorted.len() as f64) as usize];
            let lasts = fast < -(NOISE * noise).max(CHANGE);
            self.lowest = if lasts { self.lowest.min(fast) } else { self.lowest };
        }
    }

    /// The costs of the table were multiplied by a factor.
    pub fn shift(&mut self, factor: f64) {
        let shift = libm::log(factor);
        self.latest.iter_mut().for_each(|pace| *pace -= shift);
        self.lowest = (self.lowest - shift).min(0.0);
    }

    /// By which factor the costs of the table are to be multiplied to be those of the machine at its fastest;
    /// at most 1.
    pub fn factor(&self) -> f64 {
        assert!(self.lowest <= 0.0, "a lowest speed of {}", self.lowest);
        libm::exp(self.lowest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
