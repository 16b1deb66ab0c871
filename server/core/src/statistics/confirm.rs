//! A race of paired measurements, which decides whether a challenger is better than the incumbent.
//!
//! In every round each contender that still stands is measured once, so that a disturbance of the machine
//! affects all of them. The comparison takes logarithms of ratios of costs within a round. The evidence for
//! "the challenger is better by more than m" is an e-value. If the statement is wrong, it ever exceeds 1/α
//! with a probability of at most α. So the race may look after each round and stop as soon as the evidence
//! suffices (Ramdas, Grünwald, Vovk and Shafer, "Game-theoretic statistics and safe anytime-valid inference",
//! Statistical Science 38, 2023). The e-value is the mean of self-normalised supermartingales
//! `exp(λS - λ²V/2)`, mixed over λ in closed form (Robbins, "Statistical methods related to the law of the
//! iterated logarithm", Annals of Mathematical Statistics 41, 1970), with two choices of V:
//! - the sum of the squares, which only needs that a ratio and its inverse are equally likely at equal costs
//!   (de la Peña, "A general class of exponential inequalities for martingales and ratios", Annals of
//!   Probability 27, 1999),
//! - where the noise of a measurement is known, a third of that sum and two thirds of the expected one, which
//!   only needs that the noise is no larger (Delyon, "Exponential inequalities for sums of weakly dependent
//!   variables", Electronic Journal of Probability 14, 2009). It proves large differences after few rounds.
//!
//! All values of m that are not refuted make a confidence interval that is valid at every time. No challenger
//! replaces the incumbent without evidence: where none is proven better, the verdict says so.
//!
//! On a noisy machine a useful gain takes many rounds to prove ([`rounds_needed`]). All contenders run in the
//! first few of them. After those the best one goes on alone against the incumbent, if it is ahead, as in
//! successive halving (Karnin, Koren and Somekh, "Almost optimal exploration in multi-armed bandits", ICML
//! 2013).

use serde::{Deserialize, Serialize};

use crate::robust;
use crate::statistics::distribution::normal_cdf;

/// The probability that a contender is dropped wrongly, and that an interval does not hold.
pub const ERROR_MAX: f64 = 0.05;
/// The probability that any verdict "is better" of a race is wrong.
pub const PROVEN_ERROR_MAX: f64 = 0.01;
/// A gain of less is not worth another round.
pub const GAIN_LEAST: f64 = 0.01;
/// A further gain over a challenger that is proven better is not worth another round below this share of that
/// challenger's gain.
const GAIN_LEAST_SHARE: f64 = 0.1;
/// Deviations from the typical pair beyond which one counts as if it were no further away.
const WILD: f64 = 6.0;
/// Number of equal costs of each contender after which costs count as exact.
const EXACT_AFTER: usize = 3;
/// Most rounds in which all contenders run.
pub const ROUNDS_OF_ALL: usize = 10;
/// The gain that the rounds are to prove.
const GAIN_SOUGHT: f64 = 0.02;
/// That gain in deviations of the mean of the rounds: more than a proof needs, so that chance seldom hides
/// it.
const GAIN_SOUGHT_DEVIATIONS: f64 = 2.5;
/// Scales of V at which evidence is sought: variances of logarithms of ratios, from a quiet clock to a busy
/// machine.
const SCALES: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];
/// Largest magnitude of a logarithm of a ratio at the end of an interval.
const LOG_RATIO_MAX: f64 = 20.0;
/// Halvings when the end of an interval is sought.
const HALVINGS: usize = 50;

/// Paired comparisons of a challenger with the incumbent: logarithms of the incumbent's cost over the
/// challenger's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pairs {
    log_ratios: Vec<f64>,
    /// Variance of a logarithm of a ratio, where the noise is known.
    variance: Option<f64>,
}

impl Pairs {
    /// No pairs yet. `noise` is the standard deviation of the logarithm of one measurement, if it is known;
    /// if it is too small, proofs do not hold.
    pub fn new(noise: Option<f64>) -> Self {
        Pairs { log_ratios: Vec::new(), variance: noise.map(|noise| 2.0 * noise * noise) }
    }

    /// Takes the logarithm of the incumbent's cost over the challenger's.
    pub fn push(&mut self, log_ratio: f64) {
        self.log_ratios.push(log_ratio.clamp(-LOG_RATIO_MAX, LOG_RATIO_MAX));
    }

    /// The e-value of "the logarithm of the ratio is more than `m`"; with `sign` -1 of "less".
    fn evidence(&self, m: f64, sign: f64) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for log_ratio in &self.log_ratios {
            let x = sign * (log_ratio - m);
            sum += x;
            squares += x * x;
        }
        let mixed =
            |v: f64| SCALES.iter().map(|scale| one_sided(sum, v, *scale)).sum::<f64>() / SCALES.len() as f64;
        let evidence = match self.variance {
            None => mixed(squares),
            Some(variance) => {
                let expected = variance * self.log_ratios.len() as f64;
                0.5 * mixed(squares) + 0.5 * mixed((squares + 2.0 * expected) / 3.0)
            }
        };
        assert!(evidence >= 0.0, "an e-value of {evidence}");
        evidence
    }

    /// The evidence that the challenger costs less than the incumbent.
    pub fn evidence_better(&self) -> f64 {
        self.evidence(0.0, 1.0)
    }

    /// The interval of the logarithm of the ratio of the incumbent's cost over the challenger's, at any time
    /// with a probability of at least 1 - `error`. Infinite ends mean that nothing is known.
    pub fn interval(&self, error: f64) -> (f64, f64) {
        assert!(error > 0.0 && error < 1.0, "an error of {error}");
        let end = |sign: f64| {
            // In steps of `sign`: refuted at `from`, not refuted at `to`.
            let refuted = |m: f64| self.evidence(m, sign) >= 2.0 / error;
            let (mut from, mut to) = (-sign * LOG_RATIO_MAX, mean(&self.log_ratios));
            if !refuted(from) {
                return -sign * f64::INFINITY;
            }
            for _ in 0..HALVINGS {
                let middle = from + (to - from) / 2.0;
                if refuted(middle) { from = middle } else { to = middle }
            }
            from
        };
        let (low, high) = (end(1.0), end(-1.0));
        assert!(low <= high, "an interval from {low} to {high}");
        (low, high)
    }

    /// The typical logarithm, which a few disturbed pairs do not change (Hodges and Lehmann's location); 0 of
    /// none.
    pub fn location(&self) -> f64 {
        robust::location(&self.log_ratios)
    }

    /// The probability that the challenger costs less, for a single look when all rounds are over. It follows
    /// from the signed ranks (Wilcoxon, "Individual comparisons by ranking methods", Biometrics Bulletin 1,
    /// 1945), in which a few disturbed pairs weigh no more than others. It is one half with fewer than
    /// [`ROUNDS_OF_ALL`] pairs.
    pub fn probability_better(&self) -> f64 {
        let mut pairs = self.log_ratios.clone();
        pairs.retain(|log_ratio| *log_ratio != 0.0);
        if pairs.len() < ROUNDS_OF_ALL {
            return 0.5;
        }
        pairs.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        let ranks = pairs.iter().enumerate().filter(|(_, log_ratio)| **log_ratio > 0.0);
        let sum: f64 = ranks.map(|(place, _)| (place + 1) as f64).sum();
        let count = pairs.len() as f64;
        let (mean, variance) =
            (count * (count + 1.0) / 4.0, count * (count + 1.0) * (2.0 * count + 1.0) / 24.0);
        normal_cdf((sum - mean - 0.5) / variance.sqrt())
    }
}

/// The mean of some logarithms; 0 of none.
fn mean(logs: &[f64]) -> f64 {
    logs.iter().sum::<f64>() / logs.len().max(1) as f64
}

/// The number of rounds that prove a gain of 2 % where the logarithm of a measurement has the standard
/// deviation `noise`: at least [`ROUNDS_OF_ALL`], and at most `rounds_max`.
pub fn rounds_needed(noise: f64, rounds_max: usize) -> usize {
    let needed = 2.0 * (GAIN_SOUGHT_DEVIATIONS * noise / GAIN_SOUGHT).powi(2);
    (needed.ceil() as usize).max(ROUNDS_OF_ALL).min(rounds_max)
}

/// `exp(λS - λ²V/2)` mixed over the positive half of a normal distribution of λ with variance 1/`scale`.
fn one_sided(sum: f64, v: f64, scale: f64) -> f64 {
    let width = scale + v;
    let value = libm::exp((sum * sum / (2.0 * width)).min(600.0)) * (scale / width).sqrt();
    2.0 * value * normal_cdf(sum / width.sqrt())
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Racer {
    /// Logarithms of its costs, one a round.
    log_costs: Vec<f64>,
    /// It does not run any more: it cannot be run, or cannot win.
    is_out: bool,
}

/// The gain of one contender over another, by the rounds of a race alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaceGain {
    /// The typical logarithm of the other's cost over the one's.
    pub log_ratio: f64,
    /// The ends of its 95 % interval; infinite where nothing is known.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// The probability that the one costs less.
    pub probability_better: f64,
}

/// The result of a race.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RaceResult {
    /// Not decided yet.
    Open,
    /// No challenger is proven better than the incumbent.
    NothingBetter,
    /// This contender is proven better than the incumbent: its place, above 0.
    Better(usize),
}

/// A race between the incumbent, place 0, and its challengers. Plain data, exact through serde.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Race {
    contenders: Vec<Racer>,
    noise: Option<f64>,
    rounds_max: usize,
}

impl Race {
    /// A race of `contenders` contenders with the incumbent, over at most `rounds_max` rounds. `noise` as for
    /// [`Pairs::new`].
    pub fn new(contenders: usize, noise: Option<f64>, rounds_max: usize) -> Self {
        assert!(contenders > 0, "somebody is the incumbent");
        Race { contenders: vec![Racer::default(); contenders], noise, rounds_max }
    }

    /// The contender to measure next: the one with the fewest runs among those that stand. `running` gives
    /// the number of its measurements in progress. `None` once the race is decided, or while only those can
    /// decide it.
    pub fn next(&self, running: impl Fn(usize) -> usize) -> Option<usize> {
        if self.verdict() != RaceResult::Open {
            return None;
        }
        let standing = (0..self.contenders.len()).filter(|&place| !self.contenders[place].is_out);
        let rounds = standing.map(|place| (self.contenders[place].log_costs.len() + running(place), place));
        let limit = match self.standing().count() {
            0 | 1 => self.rounds_max,
            _ => self.rounds_max.min(ROUNDS_OF_ALL),
        };
        rounds.min().filter(|&(rounds, _)| rounds < limit).map(|(_, place)| place)
    }

    /// Takes a measured cost of a contender, finite and not negative.
    pub fn tell(&mut self, place: usize, cost: f64) {
        if let Some(contender) = self.contenders.get_mut(place) {
            contender.log_costs.push(libm::log(cost.max(f64::MIN_POSITIVE)));
            self.sort_out();
        }
    }

    /// A contender cannot be run: it is out. An incumbent that cannot be run loses to the best that can.
    pub fn fail(&mut self, place: usize) {
        if let Some(contender) = self.contenders.get_mut(place) {
            contender.is_out = true;
            self.sort_out();
        }
    }

    /// The pairs of two contenders, round by round: logarithms of the first one's cost over the second's.
    /// Pairs that a disturbance separated are drawn in.
    pub fn pairs(&self, one: usize, other: usize) -> Pairs {
        let rounds = self.contenders[one].log_costs.iter().zip(&self.contenders[other].log_costs);
        let logs: Vec<f64> = rounds.map(|(a, b)| a - b).collect();
        let middle = robust::location(&logs);
        let expected = self.noise.unwrap_or(0.0) * std::f64::consts::SQRT_2;
        let reach = match logs.len() >= EXACT_AFTER {
            true => WILD * robust::deviation(&logs, middle).max(expected).max(f64::MIN_POSITIVE),
            false => f64::INFINITY,
        };
        let mut pairs = Pairs::new(self.noise);
        logs.into_iter().for_each(|log| pairs.push(log.clamp(middle - reach, middle + reach)));
        pairs
    }

    /// The error probability of each statement of the race for which all of them together have at most
    /// `error`.
    fn error_each(&self, error: f64) -> f64 {
        error / (self.contenders.len().max(2) - 1) as f64
    }

    /// Whether each contender's costs are equal in all rounds, as counts are and times never: then one
    /// comparison decides.
    fn is_exact(&self) -> bool {
        let ran = self.contenders.iter().filter(|contender| !contender.is_out);
        let is_same = |contender: &Racer| {
            let costs = &contender.log_costs;
            costs.len() >= EXACT_AFTER && costs.iter().all(|cost| *cost == costs[0])
        };
        !self.contenders[0].is_out && ran.into_iter().all(is_same)
    }

    /// The gain of one contender over another by the rounds alone. It has the logarithm of the ratio of their
    /// costs, and the probability that this is above 0. Its 95 % interval holds for all contenders together
    /// and at any time. `None` without a round of both.
    pub fn gain(&self, of: usize, over: usize) -> Option<RaceGain> {
        let pairs = self.pairs(over, of);
        if pairs.log_ratios.is_empty() {
            return None;
        }
        let log_ratio = pairs.location();
        if self.is_exact() {
            let probability_better = if log_ratio > 0.0 { 1.0 } else { 0.0 };
            return Some(RaceGain { log_ratio, low: log_ratio, high: log_ratio, probability_better });
        }
        let (low, high) = pairs.interval(self.error_each(ERROR_MAX));
        let error = (1.0 / pairs.evidence_better()).min(1.0 - pairs.probability_better());
        let probability_better = 1.0 - (error * (self.contenders.len() - 1) as f64).min(1.0);
        assert!((0.0..=1.0).contains(&probability_better), "a probability of {probability_better}");
        Some(RaceGain { log_ratio, low: low.min(log_ratio), high: high.max(log_ratio), probability_better })
    }

    /// Whether a challenger is proven better than the incumbent, or the incumbent cannot be run.
    fn is_proven(&self, place: usize) -> bool {
        let bar = 1.0 / self.error_each(PROVEN_ERROR_MAX);
        self.contenders[0].is_out || self.pairs(0, place).evidence_better() >= bar
    }

    /// The places of the challengers that still run.
    fn standing(&self) -> impl Iterator<Item = usize> + '_ {
        (1..self.contenders.len()).filter(|&place| !self.contenders[place].is_out)
    }

    /// Whether all contenders that can be run, and stand, have run that many rounds.
    fn have_run(&self, rounds: usize) -> bool {
        self.contenders.iter().all(|contender| contender.is_out || contender.log_costs.len() >= rounds)
    }

    /// Drops challengers that cannot gain enough any more, and those that are proven worse than another one.
    /// Once all have run their part of the rounds only the best one stays, as long as it is ahead.
    fn sort_out(&mut self) {
        let bar = 1.0 / self.error_each(ERROR_MAX);
        for place in 1..self.contenders.len() {
            if self.contenders[place].is_out {
                continue;
            }
            let hopeless = self.pairs(0, place).evidence(GAIN_LEAST, -1.0) >= bar;
            let beaten = (1..self.contenders.len()).any(|other| {
                let stands = other != place && !self.contenders[other].is_out;
                stands
                    && (self.pairs(place, other).evidence_better() >= bar
                        || self.is_as_good(other, place, bar))
            });
            self.contenders[place].is_out = beaten || hopeless;
        }
        if !self.have_run(ROUNDS_OF_ALL) {
            return;
        }
        let best = match self.contenders[0].is_out {
            true => {
                let of = |place: &usize| mean(&self.contenders[*place].log_costs);
                self.standing().min_by(|a, b| of(a).total_cmp(&of(b)))
            }
            false => {
                let ahead = self.standing().map(|place| (place, self.pairs(0, place).location()));
                let best = ahead.max_by(|a, b| a.1.total_cmp(&b.1));
                best.filter(|(_, ahead)| *ahead > 0.0).map(|(place, _)| place)
            }
        };
        for place in (1..self.contenders.len()).filter(|&place| Some(place) != best) {
            self.contenders[place].is_out = true;
        }
    }

    /// Whether one challenger is proven better than the incumbent, ahead of another, and the other one cannot
    /// gain enough over it to be worth more rounds.
    fn is_as_good(&self, one: usize, other: usize, bar: f64) -> bool {
        let between = self.pairs(one, other);
        let gain = self.pairs(0, one).location();
        between.location() <= 0.0
            && between.evidence((GAIN_LEAST_SHARE * gain).max(GAIN_LEAST), -1.0) >= bar
            && self.is_proven(one)
    }

    /// The contender that is better than the incumbent by the rounds themselves, once they are over. It is
    /// the best challenger, if chance alone would put any of them this far ahead with a probability of at
    /// most `error`.
    pub fn better_by_rounds(&self, error: f64) -> Option<usize> {
        let probability = |place: usize| self.pairs(0, place).probability_better();
        self.standing().find(|&place| probability(place) >= 1.0 - self.error_each(error))
    }

    /// The result of the race so far. It is decided once the one remaining challenger is proven better, no
    /// challenger remains, or the rounds are over.
    pub fn verdict(&self) -> RaceResult {
        let standing: Vec<usize> = self.standing().collect();
        if standing.is_empty() {
            return RaceResult::NothingBetter;
        }
        if self.is_exact() {
            let log_cost = |place: usize| self.contenders[place].log_costs[0];
            let better = standing.into_iter().filter(|&place| log_cost(place) < log_cost(0));
            let best = better.min_by(|&a, &b| log_cost(a).total_cmp(&log_cost(b)));
            return best.map_or(RaceResult::NothingBetter, RaceResult::Better);
        }
        let is_over = self.have_run(self.rounds_max);
        if !is_over && (standing.len() > 1 || !self.is_proven(standing[0])) {
            return RaceResult::Open;
        }
        let mean = |place: usize| mean(&self.contenders[place].log_costs);
        let best = standing
            .into_iter()
            .filter(|&place| self.is_proven(place) && !self.contenders[place].log_costs.is_empty());
        let best = best.min_by(|&a, &b| mean(a).total_cmp(&mean(b)));
        best.map_or(RaceResult::NothingBetter, RaceResult::Better)
    }

    /// The number of rounds that a contender has run.
    pub fn rounds(&self, place: usize) -> usize {
        self.contenders.get(place).map_or(0, |contender| contender.log_costs.len())
    }

    /// The number of measurements.
    pub fn measurements(&self) -> usize {
        self.contenders.iter().map(|contender| contender.log_costs.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    /// Runs a race between costs with noise; its result, and the number of measurements.
    fn run(costs: &[f64], noise: f64, known: bool, seed: u64) -> (RaceResult, usize) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut race = Race::new(costs.len(), known.then_some(noise), 24);
        while let Some(place) = race.next(|_| 0) {
            race.tell(place, costs[place] * (noise * normal(&mut random)).exp());
        }
        (race.verdict(), race.measurements())
    }

    #[test]
    fn equals_do_not_replace_the_incumbent() {
        for known in [false, true] {
            let wrong =
                (0..100).filter(|&seed| run(&[10.0; 5], 0.07, known, seed).0 != RaceResult::NothingBetter);
            // At most 5 % are allowed at any time.
            let wrong = wrong.count();
            assert!(wrong <= 5, "{wrong} of 100");
        }
    }

    #[test]
    fn a_better_challenger_wins_the_sooner_the_better_it_is() {
        let mut before = usize::MAX;
        for (gain, least) in [(0.08, 30), (0.15, 39), (0.4, 40)] {
            let races: Vec<_> =
                (0..40).map(|seed| run(&[10.0, 10.0 * (1.0 - gain)], 0.04, true, seed)).collect();
            let won = races.iter().filter(|(verdict, _)| *verdict == RaceResult::Better(1)).count();
            let taken: usize = races.iter().map(|(_, taken)| taken).sum();
            assert!(won >= least, "gain {gain}: {won} of 40");
            assert!(taken < before, "gain {gain}: {taken} after {before}");
            before = taken;
        }
    }

    #[test]
    fn the_interval_holds_at_every_time() {
        let (truth, mut missed) = (0.1, 0);
        for seed in 0..100 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut pairs = Pairs::new(None);
            let holds = (0..25).all(|_| {
                pairs.push(truth + 0.1 * normal(&mut random));
                let (low, high) = pairs.interval(0.05);
                low <= truth && truth <= high
            });
            missed += u32::from(!holds);
        }
        assert!(missed <= 5, "{missed} of 100");
    }

    #[test]
    fn who_cannot_be_run_is_out() {
        let mut race = Race::new(3, None, 4);
        race.fail(1);
        race.fail(2);
        assert_eq!(race.verdict(), RaceResult::NothingBetter);
        let mut race = Race::new(2, None, 4);
        race.fail(0);
        for _ in 0..4 {
            assert_eq!(race.next(|_| 0), Some(1).filter(|_| race.verdict() == RaceResult::Open));
            race.tell(1, 5.0);
        }
        assert_eq!(race.verdict(), RaceResult::Better(1));
    }

    #[test]
    fn what_is_out_is_not_asked_twice() {
        let race = Race::new(2, None, 2);
        assert_eq!(race.next(|_| 0), Some(0));
        assert_eq!(race.next(|place| usize::from(place == 0)), Some(1));
        assert_eq!(race.next(|_| 2), None);
    }

    #[test]
    fn noise_asks_for_rounds_and_only_the_best_runs_in_them() {
        assert_eq!(rounds_needed(0.01, 40), ROUNDS_OF_ALL);
        assert_eq!(rounds_needed(0.03, 40), 29);
        assert_eq!(rounds_needed(0.3, 40), 40);
        assert_eq!(rounds_needed(0.3, 4), 4);
        let mut race = Race::new(4, Some(0.1), 40);
        for round in 0..ROUNDS_OF_ALL {
            for (place, cost) in [10.0, 9.9, 9.7, 10.2].into_iter().enumerate() {
                assert_eq!(race.next(|_| 0), Some(place), "round {round}");
                race.tell(place, cost + 0.001 * round as f64);
            }
        }
        assert_eq!(race.next(|_| 0), Some(0));
        race.tell(0, 10.0);
        assert_eq!(race.next(|_| 0), Some(2), "the best one");
        race.tell(2, 30.0);
        assert_eq!(race.verdict(), RaceResult::Open, "one disturbed round says little");
        for _ in 0..2 * ROUNDS_OF_ALL {
            if let Some(place) = race.next(|_| 0) {
                race.tell(place, if place == 0 { 10.0 } else { 10.5 });
            }
        }
        assert_eq!(race.verdict(), RaceResult::NothingBetter, "it is not ahead any more");
    }

    #[test]
    fn a_small_gain_is_seen_in_much_noise_and_none_where_there_is_none() {
        let (noise, rounds) = (0.05, 40);
        let race = |gain: f64, seed| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let costs = [10.0, 10.0, 10.0 * (1.0 - gain), 10.1, 10.0];
            let mut race = Race::new(costs.len(), Some(noise), rounds_needed(noise, rounds));
            while let Some(place) = race.next(|_| 0) {
                race.tell(place, costs[place] * (noise * normal(&mut random)).exp());
            }
            (race.better_by_rounds(ERROR_MAX), race.measurements())
        };
        let found = (0..100).filter(|&seed| race(0.05, seed).0 == Some(2)).count();
        let wrong = (0..100).filter(|&seed| race(0.0, seed).0.is_some()).count();
        let most = (0..100).map(|seed| race(0.05, seed).1).max();
        assert!(found >= 80, "{found} of 100");
        assert!(wrong <= 5, "{wrong} of 100");
        assert!(most <= Some(5 * ROUNDS_OF_ALL + 2 * (rounds - ROUNDS_OF_ALL)), "{most:?}");
    }

    #[test]
    fn extremes_stay_finite() {
        let mut race = Race::new(2, Some(0.0), 30);
        for cost in [0.0, f64::MAX, 5e-324, 1.0].repeat(6) {
            race.tell(0, cost);
            race.tell(1, f64::MAX - cost);
        }
        assert!(!race.pairs(0, 1).evidence_better().is_nan());
        let (low, high) = race.pairs(0, 1).interval(0.05);
        assert!(low <= high && !low.is_nan());
    }
}
