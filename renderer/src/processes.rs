//! The differences from one process to the next.
//!
//! The layout of memory makes a structure some per cent faster or slower as long as a process lives. Here
//! ratios are of rounds of two processes, with a variance between them, as in a random-effects model
//! (DerSimonian and Laird, 1986). All contenders of a table tell that variance together, and a pair that
//! differs by more than they do counts by itself.

use serde::Serialize;

use crate::statistics::{Ratio, Summary};

/// Standard deviation of a normal distribution over its median absolute deviation.
const MAD_TO_DEVIATION: f64 = 1.4826;
/// Half the width of an interval of 95 % in standard deviations.
const HALF_WIDTH: f64 = 1.96;

/// Rounds in two processes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Processes {
    /// How many ran in this process and in the second one. Lists of rounds have them in this order.
    pub rounds: [usize; 2],
    /// Deviation of a ratio of contenders from process to process, beyond the noise of rounds, as a share.
    pub spread: f64,
}

impl Processes {
    /// Of the costs of all contenders, in ms.
    pub fn of(costs: &[&[f64]], rounds: [usize; 2]) -> Self {
        let of_round = |round: usize| -> Vec<f64> {
            costs.iter().filter_map(|costs| costs.get(round)).map(|cost| cost.ln()).collect()
        };
        let typical: Vec<f64> =
            (0..rounds[0] + rounds[1]).map(|round| Summary::of(&of_round(round)).median).collect();
        let shift = |costs: &&[f64]| {
            let logs: Vec<f64> =
                costs.iter().zip(&typical).map(|(cost, typical)| cost.ln() - typical).collect();
            Shift::of(&logs, rounds[0])
        };
        let shifts: Vec<Shift> = costs.iter().filter_map(shift).collect();
        let median =
            |of: &dyn Fn(&Shift) -> f64| Summary::of(&shifts.iter().map(of).collect::<Vec<_>>()).median;
        let middle = median(&|shift| shift.by);
        let deviation = MAD_TO_DEVIATION * median(&|shift| (shift.by - middle).abs());
        // Shifts and ratios are of two, so both have twice the variance of one contender in one process.
        let count = shifts.len() as f64;
        let variance = deviation.powi(2) * count / (count - 1.0).max(1.0) - median(&|shift| shift.noise);
        Self { rounds, spread: variance.max(0.0).sqrt() }
    }

    /// The ratio of pairs as [`Ratio::of`], its interval widened by the difference of processes.
    pub fn ratio(&self, numerators: &[f64], denominators: &[f64]) -> Ratio {
        let ratio = Ratio::of(numerators, denominators);
        let logs: Vec<f64> = numerators.iter().zip(denominators).map(|(a, b)| (a / b).ln()).collect();
        let own = Shift::of(&logs, self.rounds[0]).map_or(0.0, Shift::variance);
        let wider = HALF_WIDTH * (own.max(self.spread.powi(2)) / 2.0).sqrt();
        let factor = |within: f64| within.ln().hypot(wider).exp();
        let interval = ratio.interval.map(|[low, high]| {
            [ratio.median / factor(ratio.median / low), ratio.median * factor(high / ratio.median)]
        });
        Ratio { interval, ..ratio }
    }
}

/// How far the median of some logarithms moves from the first process to the second.
#[derive(Clone, Copy, Debug)]
struct Shift {
    by: f64,
    /// The part of its variance that comes from the rounds within each process.
    noise: f64,
}

impl Shift {
    /// Of the logarithms of all rounds, of which the first process ran `first`.
    fn of(logs: &[f64], first: usize) -> Option<Self> {
        let (one, other) = logs.split_at_checked(first)?;
        let [one, other] = [one, other].map(Summary::of);
        // The variance of a median (McGill, Tukey and Larsen, Variations of box plots, 1978).
        let noise =
            |of: Summary| (1.25 * (of.upper_quartile - of.lower_quartile) / 1.35).powi(2) / of.count as f64;
        (one.count > 0 && other.count > 0)
            .then(|| Self { by: other.median - one.median, noise: noise(one) + noise(other) })
    }

    /// The variance between processes: what noise does not explain.
    fn variance(self) -> f64 {
        ((self.by.powi(2) - self.noise) / 2.0).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUNDS: usize = 11;
    const WORLDS: u32 = 400;

    /// Normally distributed numbers, equal every time.
    struct Normal(u64);

    impl Normal {
        fn next(&mut self, deviation: f64) -> f64 {
            let mut uniform = || {
                self.0 =
                    self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 11) as f64 / (1_u64 << 53) as f64
            };
            deviation * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0)
        }
    }

    /// Costs of contenders that are equal in the mean of many processes.
    fn costs(random: &mut Normal, between: f64, within: f64) -> Vec<Vec<f64>> {
        let mut contender = || -> Vec<f64> {
            let mut costs = Vec::new();
            for _ in 0..2 {
                let of_process = random.next(between);
                costs.extend((0..ROUNDS).map(|_| (of_process + random.next(within)).exp()));
            }
            costs
        };
        (0..10).map(|_| contender()).collect()
    }

    /// How often an interval of one process's kind, and of two, holds the truth; and the mean spread.
    fn held(between: f64, within: f64) -> (f64, f64, f64) {
        let (mut alone, mut both, mut spread) = (0, 0, 0.0);
        let mut random = Normal(1);
        for _ in 0..WORLDS {
            let costs = costs(&mut random, between, within);
            let all: Vec<&[f64]> = costs.iter().map(Vec::as_slice).collect();
            let processes = Processes::of(&all, [ROUNDS, ROUNDS]);
            let holds = |ratio: Ratio| ratio.interval.is_some_and(|[low, high]| (low..=high).contains(&1.0));
            alone += u32::from(holds(Ratio::of(&costs[0], &costs[1])));
            both += u32::from(holds(processes.ratio(&costs[0], &costs[1])));
            spread += processes.spread;
        }
        let share = |count: u32| f64::from(count) / f64::from(WORLDS);
        (share(alone), share(both), spread / f64::from(WORLDS))
    }

    #[test]
    fn intervals_hold_the_difference_between_processes() {
        let (alone, both, spread) = held(0.01, 0.014);
        assert!(alone < 0.85, "{alone}");
        assert!(both > 0.92, "{both}");
        assert!((0.01..0.016).contains(&spread), "0.014 less noise: {spread}");
        let (alone, both, spread) = held(0.0, 0.014);
        assert!(alone > 0.93 && both > alone && spread < 0.004, "{alone} {both} {spread}");
    }

    #[test]
    fn one_contender_that_differs_widens_its_own_interval_alone() {
        let mut all = costs(&mut Normal(2), 0.0, 0.01);
        let odd = all.pop().expect("there are ten");
        let odd: Vec<f64> =
            odd.iter().enumerate().map(|(at, cost)| if at < ROUNDS { *cost } else { 1.5 * cost }).collect();
        all.push(odd);
        let slices: Vec<&[f64]> = all.iter().map(Vec::as_slice).collect();
        let processes = Processes::of(&slices, [ROUNDS, ROUNDS]);
        assert!(processes.spread < 0.01, "{processes:?}");
        let factor = |ratio: Ratio| ratio.interval.map_or(0.0, |[low, high]| high / low);
        assert!(factor(processes.ratio(&all[0], &all[1])) < 1.04);
        assert!(factor(processes.ratio(&all[0], &all[9])) > 1.5);
    }

    #[test]
    fn what_does_not_differ_is_no_wider() {
        let (slow, fast) = ([3.0; 8], [2.0; 8]);
        let processes = Processes::of(&[&slow, &fast], [4, 4]);
        assert_eq!(processes, Processes { rounds: [4, 4], spread: 0.0 });
        let ratio = processes.ratio(&slow, &fast);
        assert_eq!((ratio.median, ratio.interval, ratio.count), (1.5, Some([1.5, 1.5]), 8));
        assert_eq!(processes.ratio(&slow[..5], &fast[..5]).interval, None, "five pairs show nothing");
        assert_eq!(Processes::of(&[], [4, 4]).spread, 0.0);
        assert_eq!(Processes::of(&[&slow], [4, 4]).spread, 0.0);
    }
}
