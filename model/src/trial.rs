//! Trials: one configuration, handed to one client for one state under a lease, and its result.

use std::collections::BTreeMap;
use std::convert::Infallible;

use serde::{Deserialize, Serialize, Serializer};

use crate::configuration::{Configuration, RawConfiguration};
use crate::decision::{Choice, Decision};
use crate::limits::{FINGERPRINT_SOFTWARE_MAX, OUTCOME_REASON_CHARACTERS_MAX};
use crate::space::{EarlierSpaces, Space, SpaceError};
use crate::words::{OpenEnum, words};

pub use crate::reason::{Explanation, Mode, Neighbour, OmissionReason, Reason, Rule};

words! {
    /// The state of a trial.
    pub enum TrialState {
        /// Leased and not reported.
        Open = "OPEN",
        /// Reported; see the outcome.
        Completed = "COMPLETED",
        /// Given back by its client.
        Abandoned = "ABANDONED",
        /// The lease ran out. A late report still completes it.
        Expired = "EXPIRED",
    }
}

/// The outcome of a trial.
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
    /// Stopped early because its cost was already too high.
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

words! {
    /// The kinds of outcomes.
    pub enum OutcomeKind {
        /// Measured.
        Ok = "OK",
        /// The configuration cannot work here.
        Infeasible = "INFEASIBLE",
        /// Stopped early.
        Aborted = "ABORTED",
        /// Failed for another reason.
        Failed = "FAILED",
    }
}

impl Outcome {
    /// The configuration cannot work here. A reason beyond 1000 characters is cut.
    pub fn infeasible(reason: impl Into<String>) -> Self {
        Self::Infeasible { reason: cut(reason.into()) }
    }

    /// Stopped early; the objective is at least `lower_bound`.
    pub fn aborted(lower_bound: f64) -> Self {
        Self::Aborted { lower_bound }
    }

    /// The client failed for a reason that says nothing about the configuration. A reason beyond 1000
    /// characters is cut.
    pub fn failed(reason: impl Into<String>) -> Self {
        Self::Failed { reason: cut(reason.into()) }
    }

    /// The kind of outcome, without its details.
    pub fn kind(&self) -> OutcomeKind {
        match self {
            Outcome::Ok => OutcomeKind::Ok,
            Outcome::Infeasible { .. } => OutcomeKind::Infeasible,
            Outcome::Aborted { .. } => OutcomeKind::Aborted,
            Outcome::Failed { .. } => OutcomeKind::Failed,
        }
    }
}

/// The form for people: the outcome, or a word for an unrecognised one.
impl Serialize for OpenEnum<Outcome> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            OpenEnum::Known(outcome) => outcome.serialize(serializer),
            OpenEnum::Unrecognised(_) => serializer.serialize_str("unrecognised"),
        }
    }
}

/// Cuts at the limit, between characters.
fn cut(mut reason: String) -> String {
    if let Some((end, _)) = reason.char_indices().nth(OUTCOME_REASON_CHARACTERS_MAX) {
        reason.truncate(end);
    }
    reason
}

/// The machine and the software of a measurement.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The processor's name.
    pub cpu_model: String,
    /// Widest vector instructions in use, for example `avx512`.
    pub isa: String,
    /// Threads in use.
    pub threads: u32,
    /// Names and versions of relevant software, at most 32.
    pub software: BTreeMap<String, String>,
}

impl Fingerprint {
    /// Adds a relevant piece of software; those beyond 32 are left out.
    #[must_use]
    pub fn software(mut self, name: impl Into<String>, version: impl Into<String>) -> Self {
        if self.software.len() < FINGERPRINT_SOFTWARE_MAX {
            self.software.insert(name.into(), version.into());
        }
        self
    }

    /// Sets the number of threads that the program really uses.
    #[must_use]
    pub fn threads(mut self, threads: u32) -> Self {
        self.threads = threads;
        self
    }
}

/// One configuration, handed to one client for one state under a lease. `C` is [`Configuration`] once
/// checked, [`RawConfiguration`] as read from a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial<C = Configuration> {
    /// Rises by one from 1 within the study.
    pub number: u64,
    /// The client that holds it.
    pub client_id: String,
    /// The state it is for.
    pub state_id: u64,
    /// The indicators as the client sent them, all finite.
    pub indicators: BTreeMap<String, f64>,
    /// The configuration to run with.
    pub configuration: C,
    /// The decision for this configuration.
    pub decision: Decision,
    /// Predicted objective; `None` where nothing is known.
    pub predicted_cost: Option<f64>,
    /// The end of the lease, in milliseconds of the caller's clock.
    pub lease_expire_ms: i64,
    /// Its state.
    pub state: TrialState,
    /// The raw measurements of the final report, finite and not negative. Empty before.
    pub measurements: BTreeMap<String, f64>,
    /// The standard errors of measurements, where the client gave them: finite, not negative, in their units.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub standard_errors: BTreeMap<String, f64>,
    /// The objective computed from the measurements; the lower bound of an aborted trial. `None` before
    /// the report, for infeasible and failed trials, and for trials at a cheaper level.
    pub cost: Option<f64>,
    /// `None` before the report.
    pub outcome: Option<Outcome>,
    /// The report came after the lease had run out.
    pub late: bool,
    /// The time of the hand-out, in milliseconds of the caller's clock.
    pub create_ms: i64,
    /// The time of the report.
    pub complete_ms: Option<i64>,
    /// Place in the order of completion within the study, from 1. `None` before the report.
    pub completion: Option<u64>,
    /// The client's description of its machine.
    pub fingerprint: Option<Fingerprint>,
    /// Why a completed trial is excluded: it stays in the log, and nothing is learnt from it. `None` where it
    /// counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exclusion: Option<String>,
}

/// A trial whose configuration has not been checked yet: as it is read from a table.
pub type RawTrial = Trial<RawConfiguration>;

impl RawTrial {
    /// Checks the configuration against the space of the study.
    pub fn check(self, space: &Space) -> Result<Trial, SpaceError> {
        self.map_configuration(|raw| space.configuration(raw))
    }

    /// Reads a trial in the space that its study has by now: `None` where it is outside. A trial from before
    /// the last change counts as one that its client wanted: it takes nothing of the budgets of the searches.
    /// These start over in the changed space and learn its result.
    pub fn adopt(self, earlier: &EarlierSpaces, space: &Space) -> Result<Option<Trial>, SpaceError> {
        let revision = earlier.revision_of(self.number);
        if revision == earlier.revision() {
            return self.check(space).map(Some);
        }
        let adopted = self.map_configuration(|raw| earlier.adopt(revision, raw, space).ok_or(()));
        Ok(adopted.ok().map(|mut trial| {
            let own = std::mem::replace(&mut trial.decision.choice, Choice::Wanted);
            trial.decision.adopted = Some(Box::new(own));
            trial
        }))
    }
}

impl Trial {
    /// The trial as it is read from a table, with a configuration that has not been checked.
    pub fn into_raw(self) -> RawTrial {
        let Ok(raw) = self.map_configuration(|checked| Ok::<_, Infallible>(checked.into()));
        raw
    }
}

impl<C> Trial<C> {
    /// An open trial without an end of its lease, of which nothing more is known.
    pub fn new(number: u64, client_id: &str, state_id: u64, configuration: C, decision: Decision) -> Self {
        Trial {
            number,
            client_id: client_id.to_owned(),
            state_id,
            indicators: BTreeMap::new(),
            configuration,
            decision,
            predicted_cost: None,
            lease_expire_ms: 0,
            state: TrialState::Open,
            measurements: BTreeMap::new(),
            standard_errors: BTreeMap::new(),
            cost: None,
            outcome: None,
            late: false,
            create_ms: 0,
            complete_ms: None,
            completion: None,
            fingerprint: None,
            exclusion: None,
        }
    }

    /// The kind of answer.
    pub fn mode(&self) -> Mode {
        self.decision.mode()
    }

    /// The reason of the answer, for people and for logs.
    pub fn reason(&self) -> Reason {
        self.decision.reason()
    }

    fn map_configuration<D, E>(self, map: impl FnOnce(C) -> Result<D, E>) -> Result<Trial<D>, E> {
        Ok(Trial {
            number: self.number,
            client_id: self.client_id,
            state_id: self.state_id,
            indicators: self.indicators,
            configuration: map(self.configuration)?,
            decision: self.decision,
            predicted_cost: self.predicted_cost,
            lease_expire_ms: self.lease_expire_ms,
            state: self.state,
            measurements: self.measurements,
            standard_errors: self.standard_errors,
            cost: self.cost,
            outcome: self.outcome,
            late: self.late,
            create_ms: self.create_ms,
            complete_ms: self.complete_ms,
            completion: self.completion,
            fingerprint: self.fingerprint,
            exclusion: self.exclusion,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_reasons_are_cut_between_characters() {
        let Outcome::Failed { reason } = Outcome::failed("é".repeat(1500)) else {
            panic!("it was made as a failure")
        };
        assert_eq!(reason.chars().count(), 1000);
    }

    #[test]
    fn software_is_limited() {
        let add = |so_far: Fingerprint, index| so_far.software(format!("s{index}"), "1");
        assert_eq!((0..40).fold(Fingerprint::default(), add).software.len(), 32);
    }

    #[test]
    fn stored_names_are_not_the_words() {
        assert_eq!(serde_json::to_string(&Rule::NothingKnown).expect("plain data"), "\"nothing_known\"");
        assert_eq!(Rule::NothingKnown.to_string(), "NOTHING_KNOWN");
        assert_eq!(serde_json::to_string(&TrialState::Open).expect("plain data"), "\"open\"");
    }
}
