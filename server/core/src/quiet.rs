//! The costs of a state's configurations on a quiet machine.
//!
//! Other programs come and go, and multiply all costs of a client. The logarithm of a cost is therefore the
//! configuration's own, plus the machine's level at that time, plus noise. Medians fit these two in turn
//! (median polish: Tukey, "Exploratory data analysis", 1977), the level over a few trials that followed one
//! another. Costs for people are those at the lowest level that lasted: a mode of the levels, to which the
//! mean shifts from the lowest ones (Fukunaga and Hostetler, "The estimation of the gradient of a density
//! function", IEEE Transactions on Information Theory 21, 1975). One wild measurement moves none of them.
//!
//! The filter of `statistics::drift` decides at each trial, and mistakes load for noise that begins just when
//! configurations run a second time. Here all measurements are looked at together.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::robust::{Moment, median};

/// The number of latest measurements that are kept, and the least number of a configuration.
const KEPT_MAX: usize = 128;
const MEASUREMENTS_LEAST: usize = 4;
/// Measurements on either side that have the level of one.
const NEIGHBOURS: usize = 3;
/// How often costs and levels are fitted in turn, and how often the mean is shifted.
const TURNS: usize = 10;
const SHIFTS: usize = 20;
/// The share of the levels, and their least number, that may be lower by chance.
const CHANCE: f64 = 0.05;
const CHANCE_LEAST: usize = 3;
/// Levels within this distance of a mode belong to it, as logarithms.
const ALIKE: f64 = 0.08;
/// The least distance of the levels of a machine that is not steady.
const MOVES: f64 = 0.1;

/// A measurement of a configuration, which a hash names.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct TimedCost {
    configuration: u64,
    moment: Moment,
    log_cost: f64,
}

/// The latest measurements of configurations that had run before. Plain data, exact through serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct QuietCosts {
    latest: Vec<TimedCost>,
}

impl QuietCosts {
    /// Notes a measured cost, whatever the machine's speed was. A cost of zero has no logarithm.
    pub fn note(&mut self, configuration: u64, moment: Moment, cost: f64) {
        if cost <= 0.0 {
            return;
        }
        if self.latest.len() == KEPT_MAX {
            self.latest.remove(0);
        }
        self.latest.push(TimedCost { configuration, moment, log_cost: libm::log(cost) });
        assert!(self.latest.len() <= KEPT_MAX, "{} measurements are kept", self.latest.len());
    }

    /// The cost of a configuration at the lowest level that lasted. `None` where it was measured too seldom,
    /// and where the machine was steady: the mean of the measurements is as good then.
    pub fn cost(&self, configuration: u64) -> Option<f64> {
        let is_own = |one: &&TimedCost| one.configuration == configuration;
        if self.latest.iter().filter(is_own).count() < MEASUREMENTS_LEAST {
            return None;
        }
        let (costs, mut levels) = self.fit();
        levels.sort_by(f64::total_cmp);
        let (lowest, highest) = (levels.first()?, levels.last()?);
        if highest - lowest < MOVES {
            return None;
        }
        let cost = libm::exp(costs.get(&configuration)? + lasting(&levels));
        Some(cost).filter(|cost| cost.is_finite() && *cost > 0.0)
    }

    /// The logarithm of the cost of each configuration, and the level of each measurement.
    fn fit(&self) -> (BTreeMap<u64, f64>, Vec<f64>) {
        let (mut clients, mut configurations) =
            (BTreeMap::<u64, Vec<usize>>::new(), BTreeMap::<u64, Vec<usize>>::new());
        for (place, one) in self.latest.iter().enumerate() {
            clients.entry(one.moment.client).or_default().push(place);
            configurations.entry(one.configuration).or_default().push(place);
        }
        let costs_beside = |levels: &[f64]| -> BTreeMap<u64, f64> {
            let cost = |places: &Vec<usize>| {
                let mut own: Vec<f64> =
                    places.iter().map(|&place| self.latest[place].log_cost - levels[place]).collect();
                median(&mut own)
            };
            configurations.iter().map(|(configuration, places)| (*configuration, cost(places))).collect()
        };
        let mut levels = vec![0.0; self.latest.len()];
        for _ in 0..TURNS {
            let costs = costs_beside(&levels);
            for places in clients.values() {
                let residual = |place: &usize| {
                    let one = &self.latest[*place];
                    one.log_cost - costs[&one.configuration]
                };
                let residuals: Vec<f64> = places.iter().map(residual).collect();
                for (at, &place) in places.iter().enumerate() {
                    let near = at.saturating_sub(NEIGHBOURS)..(at + NEIGHBOURS + 1).min(residuals.len());
                    levels[place] = median(&mut residuals[near].to_vec());
                }
            }
        }
        (costs_beside(&levels), levels)
    }
}

/// The lowest level that lasted, of at least one in ascending order.
fn lasting(levels: &[f64]) -> f64 {
    let chance = ((CHANCE * levels.len() as f64) as usize).max(CHANCE_LEAST);
    let mut level = levels[chance.min(levels.len() - 1)];
    for _ in 0..SHIFTS {
        let near = levels.iter().filter(|other| (**other - level).abs() <= ALIKE);
        let (sum, count) = near.fold((0.0, 0.0), |(sum, count), other| (sum + other, count + 1.0));
        if count > 0.0 {
            level = sum / count;
        }
    }
    level
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    /// Rounds of four configurations of costs 10 to 13, on a machine with a level for each trial.
    fn rounds(count: u64, noise: f64, seed: u64, level: impl Fn(u64) -> f64) -> QuietCosts {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut costs = QuietCosts::default();
        for time in 0..4 * count {
            let log = level(time) + noise * normal(&mut random);
            let moment = Moment { client: 1, time };
            costs.note(time % 4, moment, (10.0 + (time % 4) as f64) * libm::exp(log));
        }
        costs
    }

    #[test]
    fn a_steady_machine_leaves_costs_to_their_means() {
        let costs = rounds(20, 0.01, 1, |_| 0.0);
        assert_eq!((costs.cost(0), costs.cost(9)), (None, None));
        assert_eq!(rounds(3, 0.01, 1, |time| time as f64).cost(0), None, "it ran three times");
    }

    #[test]
    fn load_is_taken_out_whether_it_comes_or_was_there_from_the_start() {
        for noise in [0.02, 0.04, 0.07] {
            let mut off = Vec::new();
            for seed in 0..40 {
                let mut random = ChaCha8Rng::seed_from_u64(seed + 1000);
                let slow = random.random_range(0.2..0.6);
                // Loaded at first or not, and quiet for at least a fifth of the time.
                let (begin, quiet) = (random.random_range(0..60), random.random_range(16..60));
                let is_quiet = |time: u64| (begin..begin + quiet).contains(&time);
                let costs = rounds(20, noise, seed, |time| if is_quiet(time) { 0.0 } else { slow });
                let own = costs.cost(2).expect("it is not steady");
                off.push((own / 12.0 - 1.0).abs());
            }
            let near = off.iter().filter(|off| **off <= 0.05).count();
            assert!(near >= 34, "{near} of 40 are near at a noise of {noise}: {off:?}");
        }
    }

    #[test]
    fn one_wild_measurement_moves_nothing() {
        let level = |time: u64| if time < 40 { 0.4 } else { 0.0 };
        let known = rounds(20, 0.02, 3, level).cost(1).expect("it is not steady");
        assert!((known / 11.0 - 1.0).abs() < 0.03, "{known}");
        for wild in [1e-300, 1e-6, 1.7e15, f64::MAX] {
            for place in [0, 5, 41, 79] {
                let mut costs = rounds(20, 0.02, 3, level);
                costs.latest[place].log_cost = libm::log(wild);
                let own = costs.cost(1).expect("it is not steady");
                assert!((own / known - 1.0).abs() < 0.03, "{own} for {known} beside {wild} at {place}");
            }
        }
    }

    #[test]
    fn clients_have_levels_of_their_own() {
        let mut costs = QuietCosts::default();
        for time in 0..80 {
            // They take turns with each configuration, and the second is always slow.
            let client = (time / 2) % 2;
            let log = if client == 1 { 0.5 } else { 0.0 };
            costs.note(time % 2, Moment { client, time }, 10.0 * libm::exp(log));
        }
        let own = costs.cost(0).expect("they differ");
        assert!((own / 10.0 - 1.0).abs() < 0.01, "{own}");
    }

    #[test]
    fn extremes_stay_finite_and_few_are_kept() {
        let mut costs = QuietCosts::default();
        for time in 0..400 {
            let cost = [f64::MAX, f64::MIN_POSITIVE, 0.0, 1.0][(time as usize / 7) % 4];
            costs.note(time % 3, Moment { client: time % 2, time }, cost);
            assert!(costs.cost(time % 3).is_none_or(|cost| cost.is_finite() && cost > 0.0));
        }
        assert_eq!(costs.latest.len(), KEPT_MAX);
        let text = serde_json::to_string(&costs).expect("plain data");
        assert_eq!(serde_json::from_str::<QuietCosts>(&text).expect("own text"), costs);
    }
}
