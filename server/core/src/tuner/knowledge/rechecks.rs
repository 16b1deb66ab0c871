//! Whether a machine has changed its speed, or a state its costs.
//!
//! The cost of a known configuration may jump for two reasons. The machine became slower or faster, which
//! moves all costs alike. Or the state changed in a way that its indicators do not show, and its old results
//! no longer hold. A second known configuration, run in turns with the first, separates the two: neighbouring
//! runs share the machine's speed, so the ratio of their costs is that of the state. Where the ratio
//! contradicts the old one, the state is searched again from the beginning.
//!
//! All of it follows from the completed trials in their order, so a restored tuner has it again.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::RECHECKS_MAX;
use crate::results::{Record, ResultTable};
use crate::robust::lower_median;
use crate::tuner::knowledge::Stored;

/// Ratios of neighbouring runs that decide a recheck.
const RATIOS: usize = 4;
/// Trials of a state after which a recheck without enough ratios is dropped.
const TRIALS_MAX: u64 = 32;
/// Number of measurements after which the cost of the jumped configuration, or of the second one, is known.
const JUMPED_LEAST: usize = 4;
const BESIDE_LEAST: usize = 2;
/// Standard deviations of one measurement by which the ratio has to be off.
const CLEAR: f64 = 4.0;
/// Least change of a ratio, as a logarithm, that makes a state worth another search.
const CHANGE_LEAST: f64 = 0.05;

/// The end of a recheck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moved {
    /// All costs moved alike.
    Machine,
    /// The ratio of the two costs has changed.
    State,
}

/// A run of one of the two configurations by the client that saw the jump.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Run {
    is_jumped: bool,
    log_cost: f64,
}

/// The recheck of one state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Recheck {
    /// The client that saw the jump, and alone measures.
    client_id: String,
    /// The configuration whose cost jumped, and the one that is run beside it.
    jumped: Stored,
    beside: Stored,
    /// Logarithm of the cost of the second over that of the first, as known before, and the noise of one
    /// measurement.
    log_ratio: f64,
    noise: f64,
    last: Option<Run>,
    /// Logarithms of the ratios seen, over the known one.
    changes: Vec<f64>,
    trials: u64,
}

impl Recheck {
    fn finding(&self) -> Option<Moved> {
        let median = lower_median(&self.changes).filter(|_| self.changes.len() >= RATIOS)?;
        let is_clear = median.abs() > (CLEAR * self.noise).max(CHANGE_LEAST);
        let agree = self.changes.iter().all(|change| change * median > 0.0);
        Some(if is_clear && agree { Moved::State } else { Moved::Machine })
    }
}

/// The open rechecks of a study, by state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Rechecks {
    open: BTreeMap<u64, Recheck>,
}

impl Rechecks {
    /// Begins a recheck, if none is open and there is a second known configuration: the default, else the
    /// best other one. `results` are those from before the jump.
    pub(crate) fn begin(
        &mut self,
        (client_id, state): (&str, StateId),
        jumped: &Configuration,
        (results, default): (&ResultTable, &Configuration),
    ) {
        let is_known = |record: &&Record, measurements: usize| {
            !record.infeasible && record.mean_cost > 0.0 && record.evidence.count() >= measurements
        };
        let is_beside = |record: &&Record| is_known(record, BESIDE_LEAST) && record.configuration != *jumped;
        let of_default = results.record(default).filter(is_beside);
        let beside = of_default.or_else(|| results.ranked().find(is_beside));
        let before = results.record(jumped).filter(|record| is_known(record, JUMPED_LEAST));
        let (Some(before), Some(beside)) = (before, beside) else { return };
        let usual = results.assumed_noise();
        let restless = [before, beside].map(|record| record.evidence.log_deviation(usual));
        assert!(before.configuration != beside.configuration, "one configuration tells nothing");
        assert!(before.mean_cost > 0.0 && beside.mean_cost > 0.0, "costs have logarithms");
        if self.open.len() >= RECHECKS_MAX {
            self.open.pop_first();
        }
        assert!(self.open.len() < RECHECKS_MAX, "{} rechecks", self.open.len());
        self.open.entry(state.0).or_insert_with(|| Recheck {
            client_id: client_id.to_owned(),
            jumped: Stored(jumped.clone()),
            beside: Stored(beside.configuration.clone()),
            log_ratio: libm::log(beside.mean_cost) - libm::log(before.mean_cost),
            noise: restless.into_iter().fold(usual, f64::max),
            last: None,
            changes: Vec::new(),
            trials: 0,
        });
    }

    /// Takes a cost as it was measured. `None` while nothing is decided.
    pub(crate) fn take(
        &mut self,
        (client_id, state): (&str, StateId),
        configuration: &Configuration,
        cost: f64,
    ) -> Option<Moved> {
        let recheck = self.open.get_mut(&state.0)?;
        recheck.trials += 1;
        if recheck.client_id == client_id {
            let is_jumped = *configuration == recheck.jumped.0;
            let takes_part = is_jumped || *configuration == recheck.beside.0;
            let now = takes_part.then(|| Run { is_jumped, log_cost: libm::log(cost.max(f64::MIN_POSITIVE)) });
            if let (Some(last), Some(now)) = (recheck.last, now)
                && last.is_jumped != now.is_jumped
            {
                let (jumped, beside) = if now.is_jumped { (now, last) } else { (last, now) };
                assert!(jumped.is_jumped && !beside.is_jumped, "one of each");
                recheck.changes.push(beside.log_cost - jumped.log_cost - recheck.log_ratio);
            }
            recheck.last = now;
        }
        let finding = recheck.finding();
        if finding.is_some() || recheck.trials >= TRIALS_MAX {
            self.open.remove(&state.0);
        }
        finding
    }

    /// The configuration that a client should run next, in turns with the one whose cost jumped.
    pub(crate) fn wanted(&self, client_id: &str, state: StateId) -> Option<&Configuration> {
        let recheck = self.open.get(&state.0).filter(|recheck| recheck.client_id == client_id)?;
        let is_due = recheck.last.is_some_and(|last| last.is_jumped);
        is_due.then_some(&recheck.beside.0)
    }

    /// Whether the configurations that it names are of the space.
    pub(crate) fn fits(&self, space: &crate::space::Space) -> bool {
        self.open.values().all(|recheck| space.owns(&recheck.jumped.0) && space.owns(&recheck.beside.0))
    }
}
