//! A state with its table, an even choice of its results, and the noise that is assumed of them.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::sync::Arc;

use super::{Record, ResultTable};
use crate::configuration::Configuration;
use crate::fnv;
use crate::ids::{MachineId, StateId};
use crate::robust::{FRAME_NOISE_PRIOR, Moment, NOISE_LEAST, NOISE_PRIOR};
use crate::trial::{Mode, Outcome, Trial};

/// The most noise that is assumed.
const NOISE_MAX: f64 = 0.2;
/// Standard deviations of their difference by which one configuration beats another.
const BEATS: f64 = 2.5;

/// Place in the ranking: by cost, then by age.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rank {
    /// The mean of its measurements.
    pub(super) cost: f64,
    /// Its place in the table, in the order in which configurations came.
    pub(super) index: usize,
}

impl Eq for Rank {}

impl Ord for Rank {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost.total_cmp(&other.cost).then(self.index.cmp(&other.index))
    }
}

impl PartialOrd for Rank {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Whether a client ran its own default, its start, by any decision. All others run the study's `default`.
pub(crate) fn runs_start(trial: &Trial, default: &Configuration) -> bool {
    trial.mode() == Mode::Default && trial.configuration != *default
}

/// The client and the time of a trial; a result carried over from elsewhere has neither.
pub(super) fn moment(trial: &Trial) -> Option<Moment> {
    let of = || Moment { client: fnv::hash(trial.client_id.bytes()), time: trial.number };
    trial.decision.origin.is_none().then(of)
}

/// A known state of the study with its measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownState {
    /// Rises by one from 1 within the study.
    pub id: StateId,
    /// The normalised indicators that founded it.
    pub anchor: Vec<f64>,
    /// The machine of these measurements: its place in the study's [`Machines`](crate::machines::Machines).
    pub machine: MachineId,
    /// A search was begun in it, or clients brought along the measurements of one.
    pub explored: bool,
    /// The table of its configurations.
    pub results: Arc<ResultTable>,
}

impl Record {
    /// The cost of a measured configuration that other states hear of. A single measurement counts not at all
    /// below the range in which its table [believes](ResultTable::reach) it. Above that range it counts as
    /// its end, because dear configurations are not measured again.
    pub(crate) fn told_cost(&self, reach: Option<(f64, f64)>) -> Option<f64> {
        match reach {
            Some((low, high)) if self.measurements == 1 => {
                Some(self.mean_cost.min(high)).filter(|cost| *cost >= low)
            }
            _ => Some(self.mean_cost),
        }
    }
}

impl ResultTable {
    /// Notes the standard error of the cost of the trial that was learnt last, as a share of that cost. 0
    /// where it is not known.
    pub(crate) fn note_error(&mut self, trial: &Trial, error: f64) {
        let is_measured = trial.outcome == Some(Outcome::Ok) && trial.cost.is_some();
        if error > 0.0
            && is_measured
            && let Some(&index) = self.index.get(&trial.configuration)
        {
            self.records[index].evidence.note_error(error);
        }
    }

    /// The mean weight of a configuration's measurements in usual ones: above 0, at most 1. `None` where no
    /// client gave a standard error of them.
    pub(crate) fn weight(&self, configuration: &Configuration) -> Option<f64> {
        self.record(configuration)?.evidence.mean_weight(|| self.assumed_noise())
    }

    /// The standard deviation of a measurement, relative to its cost, as searches assume it.
    pub(crate) fn assumed_noise(&self) -> f64 {
        self.noise().unwrap_or(NOISE_PRIOR).clamp(NOISE_LEAST, NOISE_MAX)
    }

    /// Whether the measured costs of a configuration are lower than those of another one beyond the noise.
    pub(crate) fn beats(&self, one: &Record, other: &Record) -> bool {
        let parts = 1.0 / one.measurements as f64 + 1.0 / other.measurements as f64;
        libm::log(other.mean_cost / one.mean_cost) > BEATS * self.assumed_noise() * parts.sqrt()
    }

    /// The noise of a frame: as measured, else what is assumed of frames.
    pub(crate) fn frame_noise(&self) -> f64 {
        self.noise().unwrap_or(FRAME_NOISE_PRIOR).max(NOISE_LEAST)
    }

    /// The best measured configuration that can be run, without those that were measured once, far from all
    /// others.
    pub(crate) fn believed_best(&self) -> Option<&Record> {
        let reach = self.reach();
        self.ranked().find(|record| !record.is_doubtful(reach))
    }

    /// The number of configurations of which it is only known that they cost more than a bound.
    pub(crate) fn stopped(&self) -> usize {
        let is_stopped = |record: &&Record| record.measurements == 0 && record.lower_bound.is_some();
        self.records.iter().filter(is_stopped).count()
    }

    /// The `best` best of the ranked records, `others` of the rest, evenly spread over their ranks, and those
    /// of the named configurations. They are in the order of the ranking. All records where there are no
    /// more.
    pub(crate) fn spread(&self, best: usize, others: usize, named: &[&Configuration]) -> Vec<&Record> {
        let ranked: Vec<&Record> = self.ranked().collect();
        if ranked.len() <= best + others + named.len() {
            return ranked;
        }
        let rest = ranked.len() - best;
        let mut places: BTreeSet<usize> = (0..best).collect();
        places.extend((0..others).map(|step| best + step * rest / others));
        let is_named = |place: &usize| named.contains(&&ranked[*place].configuration);
        places.extend((0..ranked.len()).filter(is_named));
        assert!(places.len() <= best + others + named.len(), "{} records", places.len());
        places.into_iter().map(|place| ranked[place]).collect()
    }
}
