//! Trials: one configuration, handed to one client for one state under a lease, and what came of it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, RawConfiguration};
use crate::space::{Space, SpaceError};

/// Why a client got a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The space's defaults: the first measurement in a state that is explored, or nothing better is known.
    Default,
    /// The next point of the state's search.
    Explore,
    /// The predictor's answer or the best known configuration.
    Exploit,
    /// The policy pins it.
    Pinned,
}

/// Where a trial stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialState {
    /// Leased and not reported.
    Open,
    /// Reported; see the outcome.
    Completed,
    /// Given back by its client.
    Abandoned,
    /// The lease ran out. A late report still completes it.
    Expired,
}

/// How a trial ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Measured: the report carries every metric of the objective.
    Ok,
    /// The configuration cannot work in this state. A finding, not an error.
    Infeasible {
        /// For people, at most 1000 characters.
        reason: String,
    },
    /// Stopped early because it was already worse than needed.
    Aborted {
        /// The objective is at least this: finite, not negative.
        lower_bound: f64,
    },
    /// The client failed for a reason that says nothing about the configuration.
    Failed {
        /// For people, at most 1000 characters.
        reason: String,
    },
}

/// How an answer came about, for people and for logs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reason {
    /// One plain sentence.
    pub summary: String,
    /// Name of the search or predictor that chose: `nelder_mead`, `nearest_neighbour`, `default`, ...
    pub source: String,
    /// The step of the search: `latin_hypercube`, `reflect`, ... Empty when exploiting.
    pub step: String,
    /// The known states that the answer rests on, nearest first, at most 5.
    pub neighbours: Vec<Neighbour>,
}

/// A known state near the asked one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Neighbour {
    /// The state.
    pub state_id: u64,
    /// Euclidean distance of the normalised indicators.
    pub distance: f64,
    /// Best mean objective known there.
    pub best_cost: f64,
}

/// The machine and software a measurement holds for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The processor's name.
    pub cpu_model: String,
    /// Widest vector instructions in use, for example `avx512`.
    pub isa: String,
    /// Threads in use.
    pub threads: u32,
    /// Names and versions of what matters, at most 32.
    pub software: BTreeMap<String, String>,
}

/// One configuration, handed to one client for one state under a lease. `C` is [`Configuration`] once
/// checked, [`RawConfiguration`] as read from a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial<C = Configuration> {
    /// Rises by one from 1 within the study.
    pub number: u64,
    /// Who holds it.
    pub client_id: String,
    /// The state it is for.
    pub state_id: u64,
    /// The indicators as the client sent them, all finite.
    pub indicators: BTreeMap<String, f64>,
    /// What to run with.
    pub configuration: C,
    /// Why this configuration.
    pub mode: Mode,
    /// Predicted objective; `None` where nothing is known.
    pub predicted_cost: Option<f64>,
    /// How the answer came about.
    pub reason: Reason,
    /// Until when the client may take its time, in milliseconds of the caller's clock.
    pub lease_expire_ms: i64,
    /// Where it stands.
    pub state: TrialState,
    /// The raw measurements of the final report, finite and not negative. Empty before.
    pub measurements: BTreeMap<String, f64>,
    /// The objective computed from the measurements; the lower bound of an aborted trial. `None` before
    /// the report, and for infeasible and failed trials.
    pub cost: Option<f64>,
    /// `None` before the report.
    pub outcome: Option<Outcome>,
    /// The report came after the lease had run out.
    pub late: bool,
    /// When it was handed out, in milliseconds of the caller's clock.
    pub create_ms: i64,
    /// When it was reported.
    pub complete_ms: Option<i64>,
    /// Place in the order of completion within the study, from 1. `None` before the report.
    pub completion: Option<u64>,
    /// What the client said of its machine.
    pub fingerprint: Option<Fingerprint>,
}

/// A trial whose configuration has not been checked yet: as it is read from a table.
pub type RawTrial = Trial<RawConfiguration>;

impl RawTrial {
    /// Checks the configuration against the space of the study.
    pub fn check(self, space: &Space) -> Result<Trial, SpaceError> {
        self.map_configuration(|raw| space.configuration(raw))
    }
}

impl<C> Trial<C> {
    fn map_configuration<D, E>(self, map: impl FnOnce(C) -> Result<D, E>) -> Result<Trial<D>, E> {
        Ok(Trial {
            number: self.number,
            client_id: self.client_id,
            state_id: self.state_id,
            indicators: self.indicators,
            configuration: map(self.configuration)?,
            mode: self.mode,
            predicted_cost: self.predicted_cost,
            reason: self.reason,
            lease_expire_ms: self.lease_expire_ms,
            state: self.state,
            measurements: self.measurements,
            cost: self.cost,
            outcome: self.outcome,
            late: self.late,
            create_ms: self.create_ms,
            complete_ms: self.complete_ms,
            completion: self.completion,
            fingerprint: self.fingerprint,
        })
    }
}
