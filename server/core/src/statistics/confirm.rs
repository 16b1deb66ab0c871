//! Whether a challenger is better than the incumbent: a race of paired measurements.
//!
//! In every round each contender that still stands is measured once, so that what disturbs the machine disturbs all of
//! them. What is compared are logarithms of ratios of costs within a round. The evidence for "the challenger is better by
//! more than m" is an e-value: a quantity that, where the statement is wrong, exceeds 1/α at any time with a probability
//! of at most α, so that one may look after each round and stop as soon as it is convincing (Ramdas, Grünwald, Vovk
//! and Shafer, "Game-theoretic statistics and safe anytime-valid inference", Statistical Science 38, 2023). It is the
//! mean of self-normalised supermartingales `exp(λS - λ²V/2)`, mixed over λ in closed form (Robbins, "Statistical methods
//! related to the law of the iterated logarithm", Annals of Mathematical Statistics 41, 1970), with two choices of V:
//! - the sum of the squares, which needs nothing but that a ratio and its inverse are as likely where both cost the same
//!   (de la Peña, "A general class of exponential inequalities for martingales and ratios", Annals of Probability 27,
//!   1999),
//! - where the noise of a measurement is known, a third of that sum and two thirds of the expected one, which only needs
//!   that the noise is no larger (Delyon, "Exponential inequalities for sums of weakly dependent variables", Electronic
//!   Journal of Probability 14, 2009). It is convinced of large differences after few rounds.
//!
//! All values of m that are not refuted make a confidence interval that is valid at every time. Nobody replaces the
//! incumbent without evidence: where no challenger is proven better, the verdict says so.

use serde::{Deserialize, Serialize};

use crate::statistics::distribution::normal_cdf;

/// The probability that any verdict "is better" of a race is wrong.
pub const ERROR_MAX: f64 = 0.05;
/// A gain of less is not worth another round.
pub const GAIN_LEAST: f64 = 0.01;
/// Scales of V at which evidence is sought: variances of logarithms of ratios, from a quiet clock to a busy machine.
const SCALES: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];
/// Largest magnitude of a logarithm of a ratio that is looked for when an interval is sought.
const LOG_RATIO_MAX: f64 = 20.0;
/// Halvings when the end of an interval is sought.
const HALVINGS: usize = 50;

/// Paired comparisons of a challenger with the incumbent: logarithms of the incumbent's cost over the challenger's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pairs {
    log_ratios: Vec<f64>,
    /// Variance of a logarithm of a ratio, where the noise is known.
    variance: Option<f64>,
}

impl Pairs {
    /// No pairs yet. `noise` is the standard deviation of the logarithm of one measurement, if it is known; it must not
    /// be too small for what is proven to hold.
    pub fn new(noise: Option<f64>) -> Self {
        Pairs { log_ratios: Vec::new(), variance: noise.map(|noise| 2.0 * noise * noise) }
    }

    /// Takes the logarithm of the incumbent's cost over the challenger's.
    pub fn push(&mut self, log_ratio: f64) {
        self.log_ratios.push(log_ratio.clamp(-LOG_RATIO_MAX, LOG_RATIO_MAX));
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.log_ratios.len()
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
        match self.variance {
            None => mixed(squares),
            Some(variance) => {
                let expected = variance * self.log_ratios.len() as f64;
                0.5 * mixed(squares) + 0.5 * mixed((squares + 2.0 * expected) / 3.0)
            }
        }
    }

    /// The evidence that the challenger costs less than the incumbent.
    pub fn evidence_better(&self) -> f64 {
        self.evidence(0.0, 1.0)
    }

    /// The interval of the logarithm of the ratio of the incumbent's cost over the challenger's, at any time with a
    /// probability of at least 1 - `error`. Infinite ends say that nothing is known.
    pub fn interval(&self, error: f64) -> (f64, f64) {
        let end = |sign: f64| {
            // In steps of `sign`: refuted at `from`, not refuted at `to`.
            let refuted = |m: f64| self.evidence(m, sign) >= 2.0 / error;
            let (mut from, mut to) = (-sign * LOG_RATIO_MAX, self.mean());
            if !refuted(from) {
                return -sign * f64::INFINITY;
            }
            for _ in 0..HALVINGS {
                let middle = from + (to - from) / 2.0;
                if refuted(middle) { from = middle } else { to = middle }
            }
            from
        };
        (end(1.0), end(-1.0))
    }

    /// The mean of the logarithms; 0 of none.
    pub fn mean(&self) -> f64 {
        self.log_ratios.iter().sum::<f64>() / self.log_ratios.len().max(1) as f64
    }
}

/// `exp(λS - λ²V/2)` mixed over the positive half of a normal distribution of λ with variance 1/`scale`.
fn one_sided(sum: f64, v: f64, scale: f64) -> f64 {
    let width = scale + v;
    let value = libm::exp((sum * sum / (2.0 * width)).min(600.0)) * (scale / width).sqrt();
    2.0 * value * normal_cdf(sum / width.sqrt())
}

/// A contender of a race.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Racer {
    /// Logarithms of its costs, one a round.
    log_costs: Vec<f64>,
    /// It does not run any more: it cannot be run, or cannot win.
    is_out: bool,
}

/// What a race came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RaceResult {
    /// Not decided yet.
    Open,
    /// Nobody is proven better than the incumbent.
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
    /// A race of so many contenders, the incumbent among them, over at most so many rounds. `noise` as for
    /// [`Pairs::new`].
    pub fn new(contenders: usize, noise: Option<f64>, rounds_max: usize) -> Self {
        Race { contenders: vec![Racer::default(); contenders], noise, rounds_max }
    }

    /// Who is to be measured next: whoever has run least among those that stand. `running` tells how often each is being
    /// measured just now. `None` once the race is decided, or while only measurements that are out can decide it.
    pub fn next(&self, running: impl Fn(usize) -> usize) -> Option<usize> {
        if self.verdict() != RaceResult::Open {
            return None;
        }
        let standing = (0..self.contenders.len()).filter(|&place| !self.contenders[place].is_out);
        let rounds = standing.map(|place| (self.contenders[place].log_costs.len() + running(place), place));
        rounds.min().filter(|&(rounds, _)| rounds < self.rounds_max).map(|(_, place)| place)
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
        }
    }

    /// The pairs of two contenders, round by round: logarithms of the first one's cost over the second's.
    pub fn pairs(&self, one: usize, other: usize) -> Pairs {
        let mut pairs = Pairs::new(self.noise);
        let rounds = self.contenders[one].log_costs.iter().zip(&self.contenders[other].log_costs);
        rounds.for_each(|(a, b)| pairs.push(a - b));
        pairs
    }

    /// What every statement of the race may be wrong with, so that all of them together hold.
    fn error_each(&self) -> f64 {
        ERROR_MAX / (self.contenders.len().max(2) - 1) as f64
    }

    /// Drops challengers that cannot gain enough any more, and those that another one is proven better than.
    fn sort_out(&mut self) {
        let error = self.error_each();
        for place in 1..self.contenders.len() {
            if self.contenders[place].is_out {
                continue;
            }
            let hopeless = self.pairs(0, place).evidence(GAIN_LEAST, -1.0) >= 1.0 / error;
            let beaten = (1..self.contenders.len()).any(|other| {
                let stands = other != place && !self.contenders[other].is_out;
                stands && self.pairs(place, other).evidence_better() >= 1.0 / error
            });
            self.contenders[place].is_out = beaten || hopeless;
        }
    }

    /// What the race came to so far. It is decided once the one challenger that is left is proven better, nobody is left,
    /// or the rounds are over.
    pub fn verdict(&self) -> RaceResult {
        let standing: Vec<usize> =
            (1..self.contenders.len()).filter(|&place| !self.contenders[place].is_out).collect();
        if standing.is_empty() {
            return RaceResult::NothingBetter;
        }
        let incumbent_fails = self.contenders[0].is_out;
        let bar = 1.0 / self.error_each();
        let proven = |place: usize| incumbent_fails || self.pairs(0, place).evidence_better() >= bar;
        let has_run = |place: usize| self.contenders[place].log_costs.len() >= self.rounds_max;
        let incumbent_has_run = incumbent_fails || has_run(0);
        let is_over = incumbent_has_run && standing.iter().all(|&place| has_run(place));
        if !is_over && (standing.len() > 1 || !proven(standing[0])) {
            return RaceResult::Open;
        }
        let mean = |place: usize| {
            let costs = &self.contenders[place].log_costs;
            costs.iter().sum::<f64>() / costs.len().max(1) as f64
        };
        let best = standing
            .into_iter()
            .filter(|&place| proven(place) && !self.contenders[place].log_costs.is_empty());
        let best = best.min_by(|&a, &b| mean(a).total_cmp(&mean(b)));
        best.map_or(RaceResult::NothingBetter, RaceResult::Better)
    }

    /// How many rounds a contender has run.
    pub fn rounds(&self, place: usize) -> usize {
        self.contenders.get(place).map_or(0, |contender| contender.log_costs.len())
    }

    /// How many measurements were taken.
    pub fn measurements(&self) -> usize {
        self.contenders.iter().map(|contender| contender.log_costs.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::statistics::simulated::normal;

    /// Runs a race between costs with noise; what it came to, and how many measurements that took.
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
            // At most 5 % are allowed, at whatever time one looks.
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
