//! The results of one state: every configuration that ran there, and its measured costs.
//!
//! This is the table of paper section 6.1 ("a table of previous states, configurations, and the observed
//! runtime") and the database of section 6 that keeps a pair of state and configuration from being sampled
//! twice. Finding and adding a result takes time logarithmic in the number of configurations.
//!
//! The cost of a configuration is a robust mean of its latest measurements, so that one outlier does no harm
//! (see [`crate::robust`]). Where the costs of one configuration have changed for good (the machine's clock,
//! another program), those of the others are scaled likewise until they are measured again.

mod at_rest;
mod known;

use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::fnv;
use crate::limits::{FAILURES_PER_CONFIGURATION_MAX, NOISE_SAMPLES_MAX, RECORDS_PER_STATE_MAX};
use crate::pace::Pace;
use crate::quiet::QuietCosts;
use crate::robust::{Deviation, Evidence, MAD_TO_DEVIATION, Moment, REACH_AFTER, is_torn, median, reach_of};
use crate::search::Verdict;
use crate::space::Space;
use crate::trial::{Mode, Outcome, Trial};
pub use known::KnownState;
pub(crate) use known::runs_start;
use known::{Rank, moment};

/// A search of fewer configurations says little of a state.
pub(crate) const SEARCHED_LEAST: usize = 6;

/// A repeat counts as immediate when its trial number differs from the last one's by at most this.
const AT_ONCE: u64 = 3;
/// Least number of immediate repeats, and of later ones, before a machine's speed is judged.
const WANDERS_AFTER: usize = 3;
/// Least ratio of later to immediate differences of a wandering speed, and least immediate difference taken.
const WANDERS: f64 = 2.0;
const WANDERS_LEAST: f64 = 0.01;

/// Costs count as exact after this number of repeats without any difference.
const EXACT_AFTER: usize = 2;
/// Greatest number of measurements with which a change of one can leave two.
const TORN_MOST: usize = 3;
/// Distance between the quartiles of a normal distribution, in standard deviations.
const QUARTILES_APART: f64 = 1.349;

/// The results of one configuration in one state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The configuration.
    #[serde(with = "crate::configuration::unchecked")]
    pub configuration: Configuration,
    /// Completed measurements.
    pub measurements: u64,
    /// Their typical objective, a robust mean of the latest; 0 without any.
    pub mean_cost: f64,
    /// The latest of them.
    pub evidence: Evidence,
    /// The most recent trial that measured it; 0 without any.
    pub last_trial: u64,
    /// The time of that trial, in milliseconds of the caller's clock.
    pub last_measure_ms: i64,
    /// The highest lower bound of a trial that was stopped early.
    pub lower_bound: Option<f64>,
    /// It could not be run once; it is never exploited here.
    pub infeasible: bool,
    /// Trials that failed without a verdict.
    pub failures: u32,
    /// Trials that reported that it cannot be run. Earlier versions did not count them.
    #[serde(default)]
    crashes: u32,
    /// A trial that the tuner chose, not its client, gave a result.
    is_searched: bool,
    /// The place of its last trial in the order of all trials here.
    touch: u64,
}

impl Record {
    /// Whether at least one trial said something about the configuration.
    fn is_tried(&self) -> bool {
        self.measurements > 0 || self.infeasible || self.lower_bound.is_some()
    }

    /// Judges whether it can be run: it cannot if it never ran, or if it crashes more often than it runs.
    fn judge(&mut self) {
        self.crashes = self.crashes.max(u32::from(self.infeasible));
        let crashes = u64::from(self.crashes);
        let often = crashes >= u64::from(FAILURES_PER_CONFIGURATION_MAX) && crashes >= self.measurements;
        self.infeasible = crashes > 0 && (self.measurements == 0 || often);
    }

    /// Whether it cannot be run: it never could, or cannot any more.
    pub fn fails(&self) -> bool {
        self.infeasible || self.measurements == 0 && self.failures > 0
    }

    /// Whether it was measured once, outside of the range in which its table
    /// [believes](ResultTable::reach) that: a find or a mistake.
    pub(crate) fn is_doubtful(&self, reach: Option<(f64, f64)>) -> bool {
        self.measurements == 1 && reach.is_some_and(|(low, high)| !(low..=high).contains(&self.mean_cost))
    }

    fn rank(&self, index: usize) -> Option<Rank> {
        let usable = self.measurements > 0 && !self.infeasible;
        usable.then_some(Rank { cost: self.mean_cost, index })
    }
}

/// Every configuration that ran in one state, with its measurements.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ResultTable {
    records: Vec<Record>,
    /// Only looked up, never walked, so its order does not matter.
    #[serde(skip)]
    index: HashMap<Configuration, usize>,
    #[serde(skip)]
    ranking: BTreeSet<Rank>,
    tried: usize,
    searched: usize,
    /// The distances of repeated measurements from the cost known before, as shares of it.
    repeats: Vec<f64>,
    /// Absolute logarithms of the ratios of consecutive measurements of one configuration by one client: of
    /// immediate repeats, and of later ones.
    at_once: Vec<f64>,
    later: Vec<f64>,
    outliers: u64,
    drifts: u64,
    /// The number of jumps of clients' machines.
    disturbances: u64,
    touches: u64,
    latest: u64,
    /// Completed trials that explored the state, repeats included and confirmations excluded.
    #[serde(default)]
    runs: u64,
    /// The speeds of the clients' machines.
    #[serde(default)]
    pace: Pace,
    /// What configurations cost that ran before, as it was measured.
    #[serde(default)]
    quiet: QuietCosts,
    /// Some of its results were carried over, ran in an earlier space, or are of clients' starts.
    #[serde(default)]
    is_carried_over: bool,
    /// Tried configurations that were forgotten, where the space has few, by a hash of each, and whether the
    /// tuner chose it, not its client. They are not counted once more when they are met again.
    #[serde(default)]
    forgotten: BTreeMap<u64, bool>,
}

fn hash(configuration: &Configuration) -> u64 {
    fnv::hash(configuration.key().bytes())
}

impl ResultTable {
    /// Takes a completed trial. Costs are finite: reports are checked before. `default` is never forgotten.
    pub fn learn(&mut self, trial: &Trial, default: &Configuration) {
        self.learn_all(trial, default);
        if self.records.len() > RECORDS_PER_STATE_MAX {
            // By an eighth, so that it costs little on average.
            self.forget(RECORDS_PER_STATE_MAX - RECORDS_PER_STATE_MAX / 8, default, false);
        }
        assert!(self.records.len() <= RECORDS_PER_STATE_MAX, "{} are remembered", self.records.len());
    }

    fn learn_all(&mut self, trial: &Trial, default: &Configuration) {
        let Some(outcome) = &trial.outcome else { return };
        let index = self.slot(&trial.configuration);
        self.touches += 1;
        self.records[index].touch = self.touches;
        self.latest = trial.completion.unwrap_or(self.latest);
        self.runs += u64::from(trial.decision.is_run_of_search());
        self.is_carried_over |= trial.decision.is_unasked();
        if let (Outcome::Ok, Some(cost)) = (outcome, trial.cost) {
            self.note_repeat(index, cost, moment(trial));
        }
        let mut changed = None;
        let usual = self.usual_beside(index);
        let record = &mut self.records[index];
        let (old_rank, was_tried) = (record.rank(index), record.is_tried());
        match outcome {
            Outcome::Ok => {
                if let Some(cost) = trial.cost {
                    record.measurements += 1;
                    record.judge();
                    match record.evidence.push(cost, moment(trial)) {
                        Deviation::Usual => {}
                        Deviation::Outlier => self.outliers += 1,
                        Deviation::Changed(factor) => changed = Some(factor),
                    }
                    record.mean_cost = record.evidence.location(usual);
                    record.last_trial = trial.number;
                    record.last_measure_ms = trial.complete_ms.unwrap_or(trial.create_ms);
                }
            }
            Outcome::Infeasible { .. } => {
                record.crashes = record.crashes.max(u32::from(record.infeasible)).saturating_add(1);
                record.judge();
            }
            Outcome::Aborted { lower_bound } => {
                record.lower_bound =
                    Some(record.lower_bound.map_or(*lower_bound, |old| old.max(*lower_bound)));
            }
            Outcome::Failed { .. } => record.failures = record.failures.saturating_add(1),
        }
        let (new_rank, is_tried) = (record.rank(index), record.is_tried());
        assert!(is_tried || !was_tried, "a trial takes no verdict back");
        let is_new = is_tried && !was_tried;
        // Nearly all tables have forgotten nothing.
        let may_be_known = is_new && !self.forgotten.is_empty();
        let again = if may_be_known { self.forgotten.remove(&hash(&trial.configuration)) } else { None };
        self.tried += usize::from(is_new && again.is_none());
        let record = &mut self.records[index];
        record.is_searched |= again == Some(true);
        if is_tried && !record.is_searched && trial.mode() != Mode::Pinned && !runs_start(trial, default) {
            record.is_searched = true;
            self.searched += 1;
        }
        if old_rank != new_rank {
            old_rank.map(|rank| self.ranking.remove(&rank));
            self.ranking.extend(new_rank);
        }
        if let Some(factor) = changed {
            self.age(index, factor);
        }
    }

    /// Notes the distance of a measurement from the configuration's known cost.
    fn note_repeat(&mut self, index: usize, cost: f64, moment: Option<Moment>) {
        let Record { evidence, mean_cost, .. } = &self.records[index];
        if evidence.count() == 0 || *mean_cost <= 0.0 {
            return;
        }
        let push = |samples: &mut Vec<f64>, sample: f64| {
            if samples.len() == NOISE_SAMPLES_MAX {
                samples.remove(0);
            }
            samples.push(sample);
        };
        let before = evidence.latest().and_then(|(before, then)| Some((before, then?)));
        if let (Some((before, then)), Some(now)) = (before, moment)
            && then.client == now.client
            && before.min(cost) > 0.0
        {
            let off = (libm::log(cost) - libm::log(before)).abs();
            let is_at_once = now.time.abs_diff(then.time) <= AT_ONCE;
            push(if is_at_once { &mut self.at_once } else { &mut self.later }, off);
        }
        // The known cost has an error of its own.
        let spread = (1.0 + 1.0 / evidence.count() as f64).sqrt();
        let share = (cost / mean_cost - 1.0).abs() / spread;
        push(&mut self.repeats, share.min(1.0));
    }

    /// All but one configuration were measured before costs changed by a factor.
    fn age(&mut self, but: usize, factor: f64) {
        assert!(factor.is_finite() && factor > 0.0, "costs changed by a factor of {factor}");
        self.drifts += 1;
        // Speeds were estimated from the costs before the change.
        self.pace.shift(factor);
        for (index, record) in self.records.iter_mut().enumerate() {
            if index != but {
                record.evidence.scale(factor);
                record.mean_cost = (record.mean_cost * factor).min(f64::MAX);
                record.lower_bound = record.lower_bound.map(|bound| (bound * factor).min(f64::MAX));
            }
        }
        self.rank_all();
    }

    /// Takes a trial's cost back that is not believed any more: the configuration may be measured again.
    pub fn take_back(&mut self, configuration: &Configuration, trial: u64, cost: f64) {
        let change = |record: &mut Record| {
            if record.evidence.take_back(trial, cost) {
                record.measurements = (record.measurements.max(1) - 1).max(record.evidence.count() as u64);
            }
        };
        self.rewrite(configuration, change);
    }

    /// Replaces the latest costs of a configuration, each with its trial's number; none if all were revoked.
    pub fn restate(&mut self, configuration: &Configuration, costs: &[(u64, f64)]) {
        let change = |record: &mut Record| {
            record.evidence.restate(costs);
            if costs.is_empty() {
                record.measurements = 0;
            }
        };
        self.rewrite(configuration, change);
    }

    /// Drops the latest cost of a configuration, which is about to be learnt as that of a trial.
    pub fn withhold(&mut self, configuration: &Configuration) {
        self.rewrite(configuration, |record| record.evidence.drop_latest());
    }

    /// Notes that the speed of a client's machine jumped.
    pub fn note_disturbance(&mut self) {
        self.disturbances += 1;
    }

    /// Forgets all results, because the costs of the state have changed. The version rises as well.
    pub fn begin_again(&mut self) {
        let (touches, latest, disturbances) = (self.touches + 1, self.latest, self.disturbances);
        let pace = std::mem::take(&mut self.pace);
        *self = Self { touches, latest, disturbances, pace, ..Self::default() };
    }

    fn rewrite(&mut self, configuration: &Configuration, change: impl FnOnce(&mut Record)) {
        let Some(&index) = self.index.get(configuration) else { return };
        self.touches += 1;
        let usual = self.usual_beside(index);
        let record = &mut self.records[index];
        let (old_rank, was_tried) = (record.rank(index), record.is_tried());
        change(record);
        if record.evidence.count() == 0 {
            record.measurements = 0;
        }
        record.judge();
        record.mean_cost = record.evidence.location(usual);
        let (new_rank, is_tried) = (record.rank(index), record.is_tried());
        self.tried = self.tried + usize::from(is_tried) - usize::from(was_tried);
        old_rank.map(|rank| self.ranking.remove(&rank));
        self.ranking.extend(new_rank);
    }

    /// The usual cost of the other configurations, where that of one may depend on it: the median.
    fn usual_beside(&self, index: usize) -> Option<f64> {
        // One more measurement, or one fewer, and two are left.
        if self.records[index].evidence.count() > TORN_MOST {
            return None;
        }
        let mut others = self.ranking.iter().filter(|rank| rank.index != index).map(|rank| rank.cost);
        let middle = self.ranking.len().saturating_sub(1) / 2;
        others.clone().nth(middle).or_else(|| others.next_back())
    }

    /// The range in which a single measurement is believed; `None` while too few configurations are ranked.
    pub fn reach(&self) -> Option<(f64, f64)> {
        let count = Some(self.ranking.len()).filter(|&count| count >= REACH_AFTER)?;
        let mut costs = self.ranking.iter().map(|rank| rank.cost);
        let (quarter, half) = (count / 4, count / 2);
        let (low, middle) = (costs.nth(quarter)?, costs.nth(half - quarter - 1)?);
        let high = costs.nth((count - 1 - quarter).checked_sub(half + 1)?)?;
        let log = |cost: f64| libm::log(cost.max(f64::MIN_POSITIVE));
        let reach = libm::exp(reach_of((log(high) - log(low)) / QUARTILES_APART));
        assert!(low <= middle && middle <= high, "{low}, {middle}, {high} are of a ranking");
        Some((middle / reach, (middle * reach).min(f64::MAX)))
    }

    /// The believed cost of a measurement before it is learnt: a cost far from all others here is drawn in,
    /// unless the configuration had about this cost before.
    pub fn believed(&self, configuration: &Configuration, cost: f64) -> f64 {
        let record = self.record(configuration).filter(|record| record.measurements > 0);
        if record.is_some_and(|record| !is_torn(record.mean_cost, cost)) {
            return cost;
        }
        self.reach().map_or(cost, |(low, high)| cost.clamp(low, high))
    }

    /// The best or the incumbent, if it was measured once and lies far from all others: a find or a mistake.
    pub fn doubtful(&self, incumbent: &Configuration) -> Option<&Record> {
        let reach = self.reach()?;
        let is_doubtful = |record: &&Record| !record.infeasible && record.is_doubtful(Some(reach));
        let best = self.best().filter(is_doubtful).filter(|best| best.mean_cost < reach.0);
        best.or_else(|| self.record(incumbent).filter(is_doubtful))
    }

    fn rank_all(&mut self) {
        self.ranking = self.records.iter().enumerate().filter_map(|(i, record)| record.rank(i)).collect();
    }

    fn index_all(&mut self) {
        let places = self.records.iter().enumerate();
        self.index = places.map(|(index, record)| (record.configuration.clone(), index)).collect();
    }

    /// Forgets all but about `most` configurations: half of those that stay are the best, the others those
    /// met last, and `default` is among them. A forgotten configuration may be sampled again; its verdict
    /// still counts, and where the space has few configurations, once.
    pub fn forget(&mut self, most: usize, default: &Configuration, is_few: bool) {
        if self.records.len() <= most {
            return;
        }
        let mut kept: BTreeSet<usize> = self.index.get(default).copied().into_iter().collect();
        kept.extend(self.ranking.iter().take(most.div_ceil(2)).map(|rank| rank.index));
        let mut latest: Vec<usize> = (0..self.records.len()).collect();
        latest.sort_unstable_by_key(|&index| std::cmp::Reverse(self.records[index].touch));
        for index in latest {
            if kept.len() >= most {
                break;
            }
            kept.insert(index);
        }
        for (index, record) in self.records.iter().enumerate() {
            if is_few && record.is_tried() && !kept.contains(&index) {
                self.forgotten.insert(hash(&record.configuration), record.is_searched);
            }
        }
        let mut index = 0..;
        self.records.retain(|_| index.next().is_some_and(|index| kept.contains(&index)));
        self.records.shrink_to_fit();
        self.index_all();
        self.rank_all();
        assert_eq!(self.records.len(), kept.len(), "those that were to stay");
        assert_eq!(self.index.len(), self.records.len(), "every record is found by its configuration");
    }

    /// All remembered configurations, in an arbitrary order.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Whether some results are such that no search of the state asked for them.
    pub fn is_carried_over(&self) -> bool {
        self.is_carried_over
    }

    /// The number of remembered configurations.
    pub fn remembered(&self) -> usize {
        self.records.len()
    }

    /// Rises with everything that changes costs: equal numbers, equal tables.
    pub fn version(&self) -> u64 {
        self.touches
    }

    /// The completion of the trial learnt last.
    pub fn latest(&self) -> u64 {
        self.latest
    }

    /// Completes a table from a checkpoint. `false` when a configuration does not fit the space.
    pub(crate) fn settle(&mut self, space: &Space) -> bool {
        self.index_all();
        self.rank_all();
        let fits = self.records.iter().all(|record| space.owns(&record.configuration));
        fits && self.index.len() == self.records.len()
    }

    /// The relative difference of repeated measurements of one configuration: a robust standard deviation, at
    /// most about 1.5. `None` before anything was measured twice.
    pub fn noise(&self) -> Option<f64> {
        let mut repeats = self.repeats.clone();
        (!repeats.is_empty()).then(|| MAD_TO_DEVIATION * median(&mut repeats))
    }

    /// Whether the speed of the machine wanders: immediate repeats then agree much better than later ones.
    pub fn wanders(&self) -> bool {
        let typical = |samples: &[f64]| median(&mut samples.to_vec());
        self.at_once.len().min(self.later.len()) >= WANDERS_AFTER
            && typical(&self.later) > WANDERS * typical(&self.at_once).max(WANDERS_LEAST)
    }

    /// The number of measurements that were far from all earlier ones of their configuration.
    pub fn outliers(&self) -> u64 {
        self.outliers
    }

    /// The number of lasting changes of costs.
    pub fn drifts(&self) -> u64 {
        self.drifts
    }

    /// The number of jumps of clients' machines while the state was measured.
    pub fn disturbances(&self) -> u64 {
        self.disturbances
    }

    fn slot(&mut self, configuration: &Configuration) -> usize {
        if let Some(&index) = self.index.get(configuration) {
            return index;
        }
        let index = self.records.len();
        self.index.insert(configuration.clone(), index);
        self.records.push(Record {
            configuration: configuration.clone(),
            measurements: 0,
            mean_cost: 0.0,
            evidence: Evidence::default(),
            last_trial: 0,
            last_measure_ms: 0,
            lower_bound: None,
            infeasible: false,
            failures: 0,
            crashes: 0,
            is_searched: false,
            touch: 0,
        });
        assert_eq!(self.index.len(), self.records.len(), "every record is found by its configuration");
        index
    }

    /// Whether the last trial that was learnt here is one of that configuration.
    pub fn is_latest(&self, record: &Record) -> bool {
        record.touch == self.touches
    }

    /// The results of one configuration; `None` when no trial of it was ever completed here.
    pub fn record(&self, configuration: &Configuration) -> Option<&Record> {
        self.index.get(configuration).map(|&index| &self.records[index])
    }

    /// The measured configurations that can be run, best mean first.
    pub fn ranked(&self) -> impl ExactSizeIterator<Item = &Record> {
        self.ranking.iter().map(|rank| &self.records[rank.index])
    }

    /// The best measured configuration that can be run.
    pub fn best(&self) -> Option<&Record> {
        self.ranked().next()
    }

    /// The number of configurations with a verdict.
    pub fn tried(&self) -> usize {
        self.tried
    }

    /// The tried configurations that the tuner chose, not a client: they count towards a search's budget.
    pub fn searched(&self) -> usize {
        self.searched
    }

    /// The number of trials that count towards a budget: those that explored, without confirmations.
    pub fn runs(&self) -> usize {
        usize::try_from(self.runs).unwrap_or(usize::MAX)
    }

    /// The number of configurations that have a verdict or were given up.
    pub fn decided(&self) -> usize {
        let is_given_up =
            |record: &&Record| !record.is_tried() && record.failures >= FAILURES_PER_CONFIGURATION_MAX;
        self.tried + self.records.iter().filter(is_given_up).count()
    }

    /// Whether repeats of a cost were always equal: counts are, times are not.
    pub fn is_exact(&self) -> bool {
        self.repeats.len() >= EXACT_AFTER && self.repeats.iter().all(|share| *share == 0.0)
    }

    /// Whether clients tried enough configurations of their own choice that the state counts as searched.
    pub fn is_searched_by_clients(&self) -> bool {
        self.tried.saturating_sub(self.searched) >= SEARCHED_LEAST
    }

    /// Whether the configuration could not be run here.
    pub fn is_infeasible(&self, configuration: &Configuration) -> bool {
        self.record(configuration).is_some_and(|record| record.infeasible)
    }

    /// The measurements of a configuration that can be run.
    pub fn ran(&self, configuration: &Configuration) -> Option<&Record> {
        self.record(configuration).filter(|record| record.measurements > 0 && !record.infeasible)
    }

    /// Whether the configuration was tried here and never ran to its end: it was stopped, or cannot be run.
    pub fn fails(&self, configuration: &Configuration) -> bool {
        let stopped = |record: &Record| record.measurements == 0 && record.lower_bound.is_some();
        self.record(configuration).is_some_and(|record| record.fails() || stopped(record))
    }

    /// Whether the configuration has a verdict, final or not.
    pub fn is_tried(&self, configuration: &Configuration) -> bool {
        self.record(configuration).is_some_and(Record::is_tried)
    }

    /// Whether every configuration that has a verdict was measured as often as asked.
    pub fn is_settled(&self, replicates: u32) -> bool {
        let mut tried = self.records.iter().filter(|record| record.is_tried());
        tried.all(|record| self.settled(&record.configuration, replicates).is_some())
    }

    /// The verdict on a configuration that a search receives; `None` while it has fewer than `replicates`
    /// measurements and should be measured again. One abort settles it. So do repeated failures: a search
    /// takes them for infeasible because it must go on.
    pub fn settled(&self, configuration: &Configuration, replicates: u32) -> Option<Verdict> {
        let record = self.record(configuration)?;
        if record.infeasible {
            return Some(Verdict::Infeasible);
        }
        let given_up = record.failures >= FAILURES_PER_CONFIGURATION_MAX;
        match record.lower_bound {
            _ if record.measurements >= u64::from(replicates) => Some(Verdict::Cost(record.mean_cost)),
            _ if record.measurements > 0 && given_up => Some(Verdict::Cost(record.mean_cost)),
            Some(_) if record.measurements > 0 => Some(Verdict::Cost(record.mean_cost)),
            Some(bound) => Some(Verdict::AtLeast(bound)),
            None if given_up => Some(Verdict::Infeasible),
            None => None,
        }
    }
}
