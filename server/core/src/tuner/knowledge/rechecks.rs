//! Whether a machine has changed its speed, or a state its costs.
//!
//! The cost of a known configuration may shift for two reasons. The machine became slower or faster, which
//! moves all costs alike. Or the state changed in a way that its indicators do not show, and its old results
//! no longer hold. A second known configuration, run in turns with the first, separates the two: neighbouring
//! runs share the machine's speed, so the ratio of their costs is that of the state. Where the ratio
//! contradicts the old one, the state is searched again from the beginning.
//!
//! The ratios are weighed after each pair of runs by the likelihood of a change of 10 % over that of none
//! (Wald, "Sequential tests of statistical hypotheses", Annals of Mathematical Statistics 16, 1945). So a
//! clear case takes two pairs, and a machine that became slower often one.
//!
//! One client measures. Where it wants no exploring, or is not heard of any more, the next one that runs the
//! shifted configuration takes its place. A run of one of the two without a result ends the recheck, so that
//! nobody is asked again for what cannot be run any more.
//!
//! All of it follows from the completed trials in their order, so a restored tuner has it again.

use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::RECHECKS_MAX;
use crate::results::{Record, ResultTable};
use crate::tuner::knowledge::Stored;

/// The least number of ratios of neighbouring runs that show a change of the state, and the most that are
/// waited for.
const RATIOS_LEAST: usize = 2;
const RATIOS_MAX: usize = 6;
/// Trials of clients that measure after which a recheck without enough ratios is dropped, and trials of
/// others between two of them after which another client measures.
const TRIALS_MAX: u64 = 32;
const UNHEARD_MAX: u64 = 256;
/// Number of measurements after which the cost of the shifted configuration, or of the second one, is known.
const SHIFTED_LEAST: usize = 4;
const BESIDE_LEAST: usize = 2;
/// The change of a ratio that is looked for, as a logarithm: 10 %.
const CHANGE: f64 = 0.095;
/// Logarithms of likelihood ratios that show a change of the state: 33 to 1 where that explains the shift,
/// and 1,100 to 1 where it does not. 55 to 1 show that there is none.
const EXPLAINED: f64 = 3.5;
const UNEXPLAINED: f64 = 7.0;
const UNCHANGED: f64 = -4.0;
/// Standard deviations between two runs of one configuration at different speeds of the machine.
const APART: f64 = 4.0;

/// The end of a recheck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moved {
    /// All costs moved alike.
    Machine,
    /// The ratio of the two costs has changed.
    State,
}

/// A run of one of the two configurations by the client that saw the shift.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Run {
    is_shifted: bool,
    log_cost: f64,
}

/// The recheck of one state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Recheck {
    /// The client that alone measures: the one that saw the shift, or one that took its place.
    client_id: String,
    /// The configuration whose cost shifted, and the one that is run beside it.
    shifted: Stored,
    beside: Stored,
    /// Logarithm of the cost of the second over that of the first, as known before, and its variance.
    log_ratio: f64,
    ratio_variance: f64,
    /// Logarithm of the cost that was expected of the first at the machine's speed before the shift; `None`
    /// where the client took the place of another.
    log_expected: Option<f64>,
    /// The noise of one measurement.
    noise: f64,
    last: Option<Run>,
    /// The logarithm of the first one's cost right before the last run of the second.
    before: Option<f64>,
    /// Logarithms of the ratios seen, over the known one, and of the first one's costs over the expected one.
    changes: Vec<f64>,
    shifts: Vec<f64>,
    /// The trials of clients that measured, and those of others since the last of these.
    trials: u64,
    #[serde(default)]
    unheard: u64,
    /// The client ran the first one again where the second was due: it wants no exploring.
    #[serde(default)]
    is_declined: bool,
}

impl Recheck {
    /// Takes a run of the client. A ratio counts where the first configuration ran before and after the
    /// second at one speed of the machine. Its run before was partly chosen for being far off, so the one
    /// after makes the ratio.
    fn note(&mut self, configuration: &Configuration, log_cost: f64) {
        let is_shifted = *configuration == self.shifted.0;
        if !is_shifted && *configuration != self.beside.0 {
            (self.last, self.before) = (None, None);
            return;
        }
        let last = self.last.replace(Run { is_shifted, log_cost });
        self.is_declined |= is_shifted && last.is_some_and(|last| last.is_shifted);
        let of_other = last.filter(|last| last.is_shifted != is_shifted).map(|last| last.log_cost);
        if !is_shifted {
            self.before = of_other;
            return;
        }
        let before = self.before.take();
        if let (Some(before), Some(beside)) = (before, of_other)
            && (log_cost - before).abs() <= APART * SQRT_2 * self.noise
        {
            self.changes.push(beside - log_cost - self.log_ratio);
            self.shifts.extend(self.log_expected.map(|expected| log_cost - expected));
            assert!(self.changes.len() <= RATIOS_MAX, "{} ratios", self.changes.len());
        }
    }

    /// Takes a run of another client, which measures from now on where the one before does not.
    fn note_other(&mut self, client_id: &str, configuration: &Configuration, log_cost: f64) {
        self.unheard = self.unheard.saturating_add(1);
        let is_idle = self.is_declined || self.unheard >= UNHEARD_MAX;
        if is_idle && *configuration == self.shifted.0 {
            client_id.clone_into(&mut self.client_id);
            (self.last, self.before) = (Some(Run { is_shifted: true, log_cost }), None);
            (self.unheard, self.is_declined, self.log_expected) = (0, false, None);
            self.changes.clear();
            self.shifts.clear();
        }
    }

    fn finding(&self) -> Option<Moved> {
        let ratios = self.changes.len();
        if ratios == 0 {
            return None;
        }
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let change = mean(&self.changes);
        let shift = self.log_expected.map(|_| mean(&self.shifts));
        assert!(shift.is_none() || self.shifts.len() == ratios, "{} shifts", self.shifts.len());
        let variance = 2.0 * self.noise * self.noise / ratios as f64 + self.ratio_variance;
        assert!(variance > 0.0, "a variance of {variance}");
        // The logarithm of the likelihood of a change by `size` over that of none, where `seen` was seen.
        let evidence = |size: f64, seen: f64| size * (seen - size / 2.0) / variance;
        let of_change = evidence(CHANGE, change.abs());
        // A shift that the ratio does not share is the machine's.
        let shares = |shift: f64| {
            change * shift < 0.0 && change.abs() >= shift.abs() / 2.0 && shift.abs() >= CHANGE / 2.0
        };
        let bound = if shift.is_some_and(shares) { EXPLAINED } else { UNEXPLAINED };
        let agree = self.changes.iter().all(|one| one * change > 0.0);
        if ratios >= RATIOS_LEAST && agree && of_change >= bound {
            return Some(Moved::State);
        }
        let is_machine =
            |shift: f64| evidence(CHANGE.max(shift.abs()), -change * shift.signum()) <= UNCHANGED;
        let is_none = of_change <= UNCHANGED || of_change <= 0.0 && shift.is_some_and(is_machine);
        (is_none || ratios == RATIOS_MAX).then_some(Moved::Machine)
    }
}

/// The open rechecks of a study, by state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Rechecks {
    open: BTreeMap<u64, Recheck>,
}

impl Rechecks {
    /// Begins a recheck, if none is open and there is a second known configuration: the default, else the
    /// best other one. `results` are those from before the shift, `cost` is the one that shifted, and `pace`
    /// the machine's factor on all costs before.
    pub(crate) fn begin(
        &mut self,
        (client_id, state): (&str, StateId),
        shifted: &Configuration,
        (cost, pace): (f64, f64),
        (results, default): (&ResultTable, &Configuration),
    ) {
        let is_known = |record: &&Record, measurements: usize| {
            !record.infeasible && record.mean_cost > 0.0 && record.evidence.count() >= measurements
        };
        let is_beside = |record: &&Record| is_known(record, BESIDE_LEAST) && record.configuration != *shifted;
        let of_default = results.record(default).filter(is_beside);
        let beside = of_default.or_else(|| results.ranked().find(is_beside));
        let before = results.record(shifted).filter(|record| is_known(record, SHIFTED_LEAST));
        let (Some(before), Some(beside)) = (before, beside) else { return };
        let usual = results.assumed_noise();
        let restless = [before, beside].map(|record| record.evidence.log_deviation(usual));
        let noise = restless.into_iter().fold(usual, f64::max);
        let parts = [before, beside].map(|record| 1.0 / record.evidence.count() as f64);
        assert!(before.configuration != beside.configuration, "one configuration tells nothing");
        assert!(before.mean_cost > 0.0 && beside.mean_cost > 0.0, "costs have logarithms");
        if self.open.contains_key(&state.0) {
            return;
        }
        if self.open.len() >= RECHECKS_MAX {
            self.open.pop_first();
        }
        assert!(self.open.len() < RECHECKS_MAX, "{} rechecks", self.open.len());
        let log_expected = libm::log(before.mean_cost);
        let recheck = Recheck {
            client_id: client_id.to_owned(),
            shifted: Stored(shifted.clone()),
            beside: Stored(beside.configuration.clone()),
            log_ratio: libm::log(beside.mean_cost) - log_expected,
            ratio_variance: noise * noise * (parts[0] + parts[1]),
            log_expected: Some(log_expected + libm::log(pace)),
            noise,
            last: Some(Run { is_shifted: true, log_cost: log_of(cost) }),
            before: None,
            changes: Vec::new(),
            shifts: Vec::new(),
            trials: 0,
            unheard: 0,
            is_declined: false,
        };
        self.open.insert(state.0, recheck);
    }

    /// Takes a cost as it was measured. `None` while nothing is decided.
    pub(crate) fn take(
        &mut self,
        (client_id, state): (&str, StateId),
        configuration: &Configuration,
        cost: f64,
    ) -> Option<Moved> {
        let recheck = self.open.get_mut(&state.0)?;
        if recheck.client_id == client_id {
            (recheck.trials, recheck.unheard) = (recheck.trials + 1, 0);
            recheck.note(configuration, log_of(cost));
        } else {
            recheck.note_other(client_id, configuration, log_of(cost));
        }
        let finding = recheck.finding();
        if finding.is_some() || recheck.trials >= TRIALS_MAX {
            self.open.remove(&state.0);
        }
        finding
    }

    /// Ends the recheck in which a client ran one of the two configurations without a result.
    pub(crate) fn give_up(&mut self, (client_id, state): (&str, StateId), configuration: &Configuration) {
        let is_of = |recheck: &Recheck| {
            let is_one = [&recheck.shifted.0, &recheck.beside.0].contains(&configuration);
            recheck.client_id == client_id && is_one
        };
        if self.open.get(&state.0).is_some_and(is_of) {
            self.open.remove(&state.0);
        }
    }

    /// The configuration that a client should run next, in turns with the one whose cost shifted.
    pub(crate) fn wanted(&self, client_id: &str, state: StateId) -> Option<&Configuration> {
        let recheck = self.open.get(&state.0).filter(|recheck| recheck.client_id == client_id)?;
        let is_due = recheck.last.is_some_and(|last| last.is_shifted);
        is_due.then_some(&recheck.beside.0)
    }

    /// Whether the configurations that it names are of the space.
    pub(crate) fn fits(&self, space: &crate::space::Space) -> bool {
        self.open.values().all(|recheck| space.owns(&recheck.shifted.0) && space.owns(&recheck.beside.0))
    }
}

/// The logarithm of a cost, which may be 0.
fn log_of(cost: f64) -> f64 {
    libm::log(cost.max(f64::MIN_POSITIVE))
}
