//! Records of studies and trials from the service, in types of this crate.

use std::collections::BTreeSet;
use std::time::SystemTime;

use serde::{Serialize, Serializer};

use crate::insight::{Explanation, StateInsight};
use crate::{
    ClientError, Configuration, Fingerprint, Indicators, Measurements, Mode, OpenEnum, Outcome, Plain,
    Policy, Standing, StudySpec, TrialState,
};

/// The reason of an answer.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Reason {
    /// One plain sentence.
    pub summary: String,
    /// The search or predictor that chose, e.g. `nelder_mead`.
    pub source: String,
    /// The step of the search, e.g. `reflect`; empty when exploiting.
    pub step: String,
    /// The known states the answer rests on, nearest first.
    pub neighbours: Vec<Neighbour>,
    /// The figures that the policy weighed.
    pub explanation: Explanation,
}

/// A known state near the asked one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Neighbour {
    /// The state's number.
    pub state_id: i64,
    /// Euclidean distance of the normalised indicators.
    pub distance: f64,
    /// Best objective known there.
    pub best_cost: f64,
}

/// A trial as the service has stored it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrialRecord {
    /// `studies/{study}/trials/{trial}`.
    pub name: String,
    /// The client that the trial was handed to.
    pub client_id: String,
    /// Equal for equal states of the study.
    pub state_id: i64,
    /// The indicators as the client sent them.
    pub indicators: Indicators,
    /// The configuration to run with.
    pub configuration: Configuration,
    /// Parameters of it whose values are of a kind that this version cannot read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unreadable: Vec<String>,
    /// Why this configuration.
    pub mode: OpenEnum<Mode>,
    /// In the objective's units, where something is known.
    pub predicted_cost: Option<f64>,
    /// The reason of the answer.
    pub reason: Reason,
    /// Until when the client may take its time.
    #[serde(serialize_with = "time_as_text")]
    pub lease_expire_time: Option<SystemTime>,
    /// Where the trial stands.
    pub state: OpenEnum<TrialState>,
    /// The raw measurements of the report.
    pub measurements: Measurements,
    /// The standard errors of measurements that are estimates, as the report gave them.
    #[serde(skip_serializing_if = "Measurements::is_empty")]
    pub standard_errors: Measurements,
    /// The objective computed from the measurements; `None` at a cheaper level.
    pub cost: Option<f64>,
    /// The reported outcome; `None` before the report.
    pub outcome: Option<OpenEnum<Outcome>>,
    /// The report came after the lease had expired.
    pub late: bool,
    /// When it was handed out.
    #[serde(serialize_with = "time_as_text")]
    pub create_time: Option<SystemTime>,
    /// When it was reported.
    #[serde(serialize_with = "time_as_text")]
    pub complete_time: Option<SystemTime>,
    /// The machine and software that the client named.
    pub fingerprint: Option<Fingerprint>,
    /// The trial is to be stopped as soon as its cost exceeds this.
    pub abort_above: Option<f64>,
    /// Where it was measured, if it was carried over from another study or database.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin: Option<String>,
    /// The name of the cheaper level at which it is to run; `None` at the full one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fidelity: Option<String>,
    /// Why it is excluded from all that is learnt; `None` where it counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exclusion: Option<String>,
}

impl TrialRecord {
    /// The number at the end of the name; `None` when the name has another form.
    pub fn number(&self) -> Option<u64> {
        self.name.rsplit_once('/').and_then(|(_, number)| number.parse().ok())
    }
}

/// A study as the service has stored it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyRecord {
    /// `studies/{study}`.
    pub name: String,
    /// Its identity, drawn when it was created; empty from a daemon that does not send one.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub uid: String,
    /// A line for people; may be empty.
    pub display_name: String,
    /// A text for people of several lines; may be empty.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Words by which people group studies.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub tags: BTreeSet<String>,
    /// How the service decides.
    pub policy: Policy,
    /// The revision of its space, from 1; 0 from a daemon that does not say. In the answer to its creation
    /// with a space that it had before: that space's.
    pub space_revision: u32,
    /// Its specification; else the reason why this version cannot read it.
    #[serde(serialize_with = "spec_or_problem")]
    pub(crate) spec: Result<StudySpec, String>,
    /// When it was created.
    #[serde(serialize_with = "time_as_text")]
    pub create_time: Option<SystemTime>,
    /// Its counts of trials and states.
    pub statistics: StudyStatistics,
    /// In the answer to its creation: the fields of the given policy that differ from the stored one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub policy_differs: Vec<String>,
}

impl StudyRecord {
    /// Its specification, with its policy at the time.
    ///
    /// # Errors
    /// [`ClientError::Malformed`] for a study of a newer version, when this one cannot read it.
    pub fn spec(&self) -> Result<&StudySpec, ClientError> {
        self.spec
            .as_ref()
            .map_err(|problem| ClientError::Malformed { call: "GetStudy", problem: problem.clone() })
    }

    /// `studies/{study}@{uid}`, which never names another study that is called `studies/{study}` later.
    pub fn identified_name(&self) -> String {
        if self.uid.is_empty() { self.name.clone() } else { format!("{}@{}", self.name, self.uid) }
    }

    /// The name without `studies/`.
    pub fn id(&self) -> &str {
        self.name.strip_prefix("studies/").unwrap_or(&self.name)
    }
}

/// New texts for people of a study; what is `None` stays as it is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TextChange {
    /// A line, at most 200 characters.
    pub display_name: Option<String>,
    /// A text of several lines, at most 4096 bytes.
    pub note: Option<String>,
    /// All tags from now on, at most 16, each of 1 to 32 letters and digits of any script, `_`, `-` and `.`.
    pub tags: Option<BTreeSet<String>>,
    /// Tags to add. Those that others add or remove at the same time are not concerned.
    pub added_tags: BTreeSet<String>,
    /// Tags to remove, where they are there. One that is also added is removed.
    pub removed_tags: BTreeSet<String>,
}

/// A study's changed space, and what that means for its trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChangedSpace {
    /// The study after the change, or as it is where the change was only tried.
    pub study: StudyRecord,
    /// Completed trials inside the new space.
    pub kept_trials: i64,
    /// Completed trials outside, which are kept and not used.
    pub outside_trials: i64,
    /// Open trials outside, which are given back.
    pub given_back_trials: i64,
}

/// Counts of a study's trials and states.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct StudyStatistics {
    /// Distinct states met.
    pub states: i64,
    /// Trials handed out.
    pub trials: i64,
    /// Trials with a final outcome.
    pub completed_trials: i64,
    /// Trials under a live lease.
    pub open_trials: i64,
}

/// The exploitation for some indicators.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prediction {
    /// The configuration.
    pub configuration: Configuration,
    /// `Default` when nothing is known yet, `Pinned` when pinned, else `Exploit`.
    pub mode: OpenEnum<Mode>,
    /// In the objective's units, where something is known.
    pub predicted_cost: Option<f64>,
    /// The reason of the answer.
    pub reason: Reason,
    /// The insight into the state, if the study has met it.
    pub state: Option<StateInsight>,
}

/// The best known configuration, which is exploited in the state. Its standing says how sure that is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Best {
    /// The configuration.
    pub configuration: Configuration,
    /// Mean objective of its measurements.
    pub cost: f64,
    /// Mean objective of the default configuration in this state, if it was measured there.
    pub default_cost: Option<f64>,
    /// The number of measurements behind `cost`.
    pub measurements: i32,
    /// The state it holds for.
    pub state_id: i64,
    /// The most recent trial that measured it.
    pub trial: String,
    /// When that was.
    #[serde(serialize_with = "time_as_text")]
    pub last_measure_time: Option<SystemTime>,
    /// How far it is proven; `None` from a daemon that does not say.
    pub standing: Option<Standing>,
}

/// A specification in plain values, or `{"unreadable": "…"}`.
fn spec_or_problem<S: Serializer>(
    spec: &Result<StudySpec, String>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match spec {
        Ok(spec) => Plain(spec).serialize(serializer),
        Err(problem) => serializer.collect_map([("unreadable", problem)]),
    }
}

/// Times are written as RFC 3339 text.
#[allow(clippy::ref_option)] // serde hands over a reference to the field
fn time_as_text<S: Serializer>(time: &Option<SystemTime>, serializer: S) -> Result<S::Ok, S::Error> {
    match time {
        Some(time) => serializer.collect_str(&humantime::format_rfc3339_millis(*time)),
        None => serializer.serialize_none(),
    }
}
