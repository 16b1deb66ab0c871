//! The present speed of a client's machine.
//!
//! Clocks rise and fall, and other programs come and go: all costs of a client are multiplied by one factor
//! that changes over time. Its logarithm is modelled as a random walk and followed by a scalar Kalman filter
//! (Kalman, "A new approach to linear filtering and prediction problems", Journal of Basic Engineering 82,
//! 1960). Repeated measurements of the incumbent, whose cost is known, drive it; every other measurement is
//! divided by the factor of its time. A step far outside the walk's range is a jump: the filter then forgets
//! its estimate and takes the new value (a gate on the normalised innovation: Bar-Shalom, Li and Kirubarajan,
//! "Estimation with applications to tracking and navigation", 2001, section 5.4).

use serde::{Deserialize, Serialize};

/// Standard deviation of one step of the walk, from one trial to the next, in deviations of a measurement;
/// smaller changes cannot be seen.
const STEP: f64 = 0.25;
/// The filter's deviation after a jump, and at the beginning of a session.
const JUMP: f64 = 0.5;
/// Innovations of more standard deviations are jumps.
const GATE: f64 = 4.0;
/// Deviations of each measurement that a cumulative sum forgives, and its height above which costs have
/// shifted. Where frames scatter by 2 %, a shift of 10 % is about four deviations.
const FORGIVEN: f64 = 1.5;
const SHIFTED: f64 = 1.5;
/// The largest magnitude of the logarithm of a factor, so that factors and their inverses are finite.
const LOG_FACTOR_MAX: f64 = 700.0;

/// A client's speed, relative to its first measurement. Opaque, exact through serde.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Logarithm of the factor on all costs, and its variance.
    log_factor: f64,
    variance: f64,
    /// The last innovation went over the gate: the next one decides whether it was a jump or a wild
    /// measurement.
    suspects: Option<f64>,
    pub(crate) jumps: u64,
}

impl Speed {
    /// A trial has passed. `noise` is the standard deviation of the logarithm of one measurement.
    pub fn step(&mut self, noise: f64) {
        let step = STEP * noise;
        self.variance = (self.variance + step * step).min(JUMP * JUMP);
    }

    /// The distance of a measurement from the one that is expected at present, in standard deviations: what
    /// [`hold`](Speed::hold) is about to take.
    pub fn deviations(&self, cost: f64, expected: f64, noise: f64) -> f64 {
        (seen(cost, expected) - self.log_factor) / self.spread(noise).max(f64::MIN_POSITIVE)
    }

    /// The standard deviation of a measurement beside what is expected.
    fn spread(&self, noise: f64) -> f64 {
        (self.variance + noise * noise).sqrt()
    }

    /// Takes a measurement of a configuration whose cost is known to be `expected` at the factor 1. Both
    /// costs are above 0. One measurement far off counts as an accident; a second one like it counts as a
    /// jump.
    pub fn hold(&mut self, cost: f64, expected: f64, noise: f64) {
        let seen = seen(cost, expected);
        let innovation = seen - self.log_factor;
        if innovation.abs() > GATE * self.spread(noise) {
            let agrees = self.suspects.is_some_and(|before| (seen - before).abs() <= GATE * noise);
            if !agrees {
                self.suspects = Some(seen);
                return;
            }
            self.variance = JUMP * JUMP;
            self.jumps += 1;
        }
        self.suspects = None;
        let gain = self.variance / (self.variance + noise * noise).max(f64::MIN_POSITIVE);
        assert!((0.0..=1.0).contains(&gain), "a gain of {gain}");
        self.log_factor = (self.log_factor + gain * innovation).clamp(-LOG_FACTOR_MAX, LOG_FACTOR_MAX);
        self.variance *= 1.0 - gain;
    }

    /// The factor on all costs at the moment.
    pub fn factor(&self) -> f64 {
        libm::exp(self.log_factor)
    }

    /// Whether the last measurement was far off, so that the next one decides between an accident and a jump.
    pub fn is_suspicious(&self) -> bool {
        self.suspects.is_some()
    }
}

/// The logarithm of a cost over the expected one.
fn seen(cost: f64, expected: f64) -> f64 {
    libm::log(cost.max(f64::MIN_POSITIVE)) - libm::log(expected.max(f64::MIN_POSITIVE))
}

/// Whether known costs have shifted by less than a jump: a cumulative sum to either side (Page, "Continuous
/// inspection schemes", Biometrika 41, 1954). It sees a lasting shift soonest for its rate of false alarms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShiftSums {
    rise: f64,
    fall: f64,
}

impl ShiftSums {
    /// Takes the distance of a measurement from the expected one, in standard deviations. Whether costs have
    /// shifted. A wild measurement counts as the least jump.
    pub fn take(&mut self, deviations: f64) -> bool {
        let off = deviations.clamp(-GATE, GATE);
        self.rise = (self.rise + off - FORGIVEN).max(0.0);
        self.fall = (self.fall - off - FORGIVEN).max(0.0);
        assert!(self.rise >= 0.0 && self.fall >= 0.0, "sums of {self:?}");
        self.rise.max(self.fall) > SHIFTED
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    /// Runs 80 trials of challengers of cost 8 on a machine with that factor, and the incumbent of cost 10
    /// whenever the speed is uncertain. Returns the mean errors of the corrected and the raw logarithms, and
    /// the number of runs of the incumbent.
    fn run(factor: impl Fn(usize) -> f64, noise: f64) -> (f64, f64, usize) {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut speed = Speed::default();
        let (mut corrected, mut raw, mut trials, mut held) = (0.0, 0.0, 0, 0);
        for time in 0..80 {
            speed.step(noise);
            let measured =
                |cost: f64, random: &mut ChaCha8Rng| cost * factor(time) * (noise * normal(random)).exp();
            if speed.is_suspicious() || speed.variance.sqrt() > noise {
                speed.hold(measured(10.0, &mut random), 10.0, noise);
                held += 1;
            } else {
                let cost = measured(8.0, &mut random);
                corrected += (cost / speed.factor() / 8.0).ln().abs();
                raw += (cost / 8.0).ln().abs();
                trials += 1;
            }
        }
        (corrected / f64::from(trials), raw / f64::from(trials), held)
    }

    #[test]
    fn load_that_comes_and_goes_is_taken_out() {
        let load = |time: usize| if (time / 16) % 2 == 1 { 1.6 } else { 1.0 };
        let (corrected, raw, held) = run(load, 0.03);
        assert!(corrected < 0.6 * raw, "{corrected} of {raw}");
        assert!(held < 30, "{held} of 80 trials held the speed");
    }

    #[test]
    fn a_slow_change_of_the_clock_is_followed() {
        let (corrected, raw, _) = run(|time| (0.006 * time as f64).exp(), 0.03);
        assert!(corrected < 0.5 * raw, "{corrected} of {raw}");
    }

    #[test]
    fn a_quiet_machine_loses_little_by_it() {
        let (corrected, raw, held) = run(|_| 1.0, 0.05);
        assert!(corrected < 1.3 * raw, "{corrected} of {raw}");
        assert!(held <= 12, "{held} of 80 trials held the speed");
    }

    #[test]
    fn one_wild_measurement_is_no_jump_and_two_are() {
        let mut speed = Speed::default();
        speed.hold(30.0, 10.0, 0.03);
        assert_eq!((speed.factor(), speed.jumps, speed.is_suspicious()), (1.0, 0, true));
        speed.hold(10.1, 10.0, 0.03);
        assert!(!speed.is_suspicious() && speed.factor() < 1.05);
        speed.hold(30.0, 10.0, 0.03);
        speed.hold(30.5, 10.0, 0.03);
        assert_eq!(speed.jumps, 1);
        assert!((speed.factor() - 3.05).abs() < 0.05);
    }

    /// Frames until costs that shift by `shift` deviations are noticed; all of `frames` where they are not.
    fn noticed_after(shift: f64, frames: usize, seed: u64) -> usize {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut sums = ShiftSums::default();
        (1..=frames).find(|_| sums.take(shift + normal(&mut random))).unwrap_or(frames)
    }

    #[test]
    fn a_shift_of_four_deviations_is_noticed_within_three_frames_and_calm_lasts_for_hundreds() {
        for side in [-1.0, 1.0] {
            let soon = (0..100).filter(|&seed| noticed_after(4.0 * side, 100, seed) <= 3).count();
            assert!(soon >= 98, "{soon} of 100");
        }
        let calm: usize = (0..40).map(|seed| noticed_after(0.0, 1000, seed)).sum();
        assert!(calm >= 40 * 150, "{calm} calm frames in 40 runs");
    }

    #[test]
    fn extremes_stay_finite() {
        let mut speed = Speed::default();
        for cost in [0.0, 0.0, f64::MAX, f64::MAX, 5e-324, 1.0] {
            assert!(!speed.deviations(cost, 1.0, 0.0).is_nan());
            speed.hold(cost, 1.0, 0.0);
            assert!(speed.factor().is_finite());
        }
        for (cost, expected) in [(f64::MAX, f64::MIN_POSITIVE), (f64::MIN_POSITIVE, f64::MAX)] {
            (0..4).for_each(|_| speed.hold(cost, expected, 0.01));
            assert!(speed.factor().is_normal() && (1.0 / speed.factor()).is_normal(), "{speed:?}");
        }
    }
}
