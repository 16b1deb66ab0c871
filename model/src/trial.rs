//! Trials: one configuration, handed to one client for one state under a lease, and what came of it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, RawConfiguration};
use crate::decision::Decision;
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
    /// What the policy weighed.
    #[serde(default, skip_serializing_if = "Explanation::is_empty")]
    pub explanation: Explanation,
}

/// Which rule of the policy an answer follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The dice said explore.
    Explore,
    /// Explored, because nothing is known that could be exploited.
    NothingKnown,
    /// The dice said exploit.
    Exploit,
    /// The state's search is over.
    Finished,
    /// Not explored, because the regret budget does not allow it yet.
    Budget,
    /// Not explored, because the expected gain does not pay for it, or is below the noise.
    Gain,
    /// What was exploited here did clearly worse than another configuration.
    RolledBack,
    /// The study is frozen.
    Frozen,
    /// The study answers the default and learns silently.
    Shadow,
    /// The policy pins the configuration.
    Pinned,
    /// The client asked for the configuration.
    Wanted,
    /// Explores, but the search waits for what others are measuring; the best that is known is run meanwhile.
    Waiting,
}

/// What the policy weighed when it answered. Costs are in the objective's units, and finite.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Explanation {
    /// The rule that decided.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rule: Option<Rule>,
    /// The probability of exploring that the dice were thrown with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    /// What was left of the client's regret budget before this answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_left: Option<f64>,
    /// What was set aside of it for this trial: the most that it can cost above the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_aside: Option<f64>,
    /// The client is to stop the trial as soon as its cost exceeds this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub abort_above: Option<f64>,
    /// The cost of what would have been run without exploring.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_cost: Option<f64>,
    /// By how much exploring is expected to lower the cost of each later frame, as a share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_gain: Option<f64>,
    /// How many frames are expected to profit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_frames: Option<f64>,
    /// What exploring is expected to cost in all, in frames of the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exploring_cost: Option<f64>,
    /// Parameters that were left at their best known value because they do not matter here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<String>,
    /// What would have been answered, were the study not in shadow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instead_of: Option<RawConfiguration>,
    /// What this trial costs is not learnt.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub silent: bool,
}

impl Explanation {
    /// An explanation that only names the rule.
    pub fn of(rule: Rule) -> Self {
        Explanation { rule: Some(rule), ..Explanation::default() }
    }

    /// Whether there is nothing to tell.
    pub fn is_empty(&self) -> bool {
        *self == Explanation::default()
    }
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
    pub decision: Decision,
    /// Predicted objective; `None` where nothing is known.
    pub predicted_cost: Option<f64>,
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
    /// What kind of answer it is.
    pub fn mode(&self) -> Mode {
        self.decision.mode()
    }

    /// How the answer came about, for people and for logs.
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
