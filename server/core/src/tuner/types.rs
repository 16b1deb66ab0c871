//! The inputs and outputs of the state machine of a study.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::convert::Infallible;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::configuration::{Configuration, RawConfiguration};
use crate::decision::{Choice, Decision, Exploit, ExplorationEstimate, ExploreRule};
use crate::indicator::IndicatorError;
use crate::limits::{
    CLIENT_ID_CHARACTERS_MAX, CLIENTS_MAX, FINGERPRINT_SOFTWARE_MAX, FINGERPRINT_TEXT_CHARACTERS_MAX,
    LEASES_LOST_MAX, OPEN_TRIALS_PER_CLIENT_MAX, ORIGIN_CHARACTERS_MAX, OUTCOME_REASON_CHARACTERS_MAX,
    STATES_MAX,
};
use crate::objective::ObjectiveError;
use crate::policy::Policy;
use crate::session::SessionPolicy;
use crate::space::{EarlierSpaces, Space, SpaceError};
use crate::standing::Standing;
use crate::study::StudyError;
use crate::trial::{Fingerprint, Mode, Reason, Trial, TrialState};
use crate::tuner::budget::Account;
use crate::tuner::exploring::exploration::Exploration;
use crate::tuner::insight::Insight;

/// A client's question for its next configuration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ask {
    /// Stable over the client's restarts, unique among clients; 1 to 128 printable characters.
    pub client_id: String,
    /// A value for each indicator of the study.
    pub indicators: BTreeMap<String, f64>,
    /// The machine, if the client names it. Clients that name none count as one machine.
    pub fingerprint: Option<Fingerprint>,
    /// The number of the client's session; 0 for one endless session.
    pub session: u64,
    /// The client stops every trial when its cost reaches the trial's cap.
    pub can_abort: bool,
    /// The session's own policy, in place of the study's. Only [`Ask::at`] reads its deadline.
    pub session_policy: SessionPolicy,
    /// The origin of a wanted configuration that was measured before; at most 200 printable characters.
    pub origin: Option<String>,
    /// The client runs a trial at the cheaper level that the trial names.
    pub fidelities: bool,
    /// The configuration that the client runs by default, in place of the study's.
    pub start: Option<RawConfiguration>,
}

impl Ask {
    /// The question as it counts at a time: past its deadline a session explores no more.
    pub fn at(&self, now_ms: i64) -> Cow<'_, Ask> {
        let session_policy = self.session_policy.at(now_ms);
        match session_policy == self.session_policy {
            true => Cow::Borrowed(self),
            false => Cow::Owned(Ask { session_policy, ..self.clone() }),
        }
    }

    /// Whether the client was restarted since it received the trial that it holds.
    pub(crate) fn is_restarted_since(&self, held: &Trial) -> bool {
        let session = held.decision.session;
        session != self.session && session != 0 && self.session != 0 && !self.is_back_to(held)
    }

    /// Whether a session asks that held the trial before another one did. Both live, and share a client id.
    pub(crate) fn is_back_to(&self, held: &Trial) -> bool {
        held.decision.earlier_sessions.contains(&self.session)
    }
}

/// A state of the study as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StateRecord {
    /// Rises by one from 1 within the study.
    pub id: u64,
    /// The normalised indicators that founded the state: its anchor.
    pub indicators: Vec<f64>,
    /// The machine that founded it, and alone measures in it; `None` where it was not named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fingerprint: Option<Fingerprint>,
    /// The search in it, if it was ever explored. Opaque to the store, exact through serde.
    pub search: Option<Exploration>,
}

/// A client's state, and the decision that was taken when it came there. One row per client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Visit<C = Configuration> {
    /// The client.
    pub client_id: String,
    /// The state it is in.
    pub state_id: u64,
    /// The number of visits of the client, this one included.
    pub number: u64,
    /// The number of the last trial before the latest decision: clients with the lowest are forgotten first.
    #[serde(default)]
    pub since: u64,
    /// Explore or exploit.
    pub decision: VisitDecision<C>,
    /// The client's budget for exploring, where the policy limits it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub account: Option<Account>,
}

/// A visit whose configuration has not been checked yet: as it is read from a table.
pub type RawVisit = Visit<RawConfiguration>;

/// The decision for a visit (paper section 6).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VisitDecision<C = Configuration> {
    /// Points of the state's search, one after the other.
    Explore {
        /// Why.
        rule: ExploreRule,
        /// The expected gain and cost of exploring.
        #[serde(rename = "weighed", default, skip_serializing_if = "treewright_model::plain::is_default")]
        estimate: ExplorationEstimate,
    },
    /// One configuration, kept until the client's state changes.
    Exploit {
        /// The kept configuration.
        configuration: C,
        /// Predicted objective, where something is known.
        predicted_cost: Option<f64>,
        /// Why.
        exploit: Box<Exploit>,
        /// The text of an earlier version for people, where it was stored by one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        said: Option<String>,
    },
}

impl RawVisit {
    /// Reads a visit in the space that its study has by now: `None` where the kept configuration is outside,
    /// so that the client's next question begins another visit.
    pub fn adopt(self, earlier: &EarlierSpaces, space: &Space) -> Result<Option<Visit>, SpaceError> {
        let since = self.since;
        // One that was decided right after a change is of the present space, and stays as it is.
        let adopted = self.map_configuration(|raw| match earlier.is_empty() {
            true => space.configuration(raw).map_err(Some),
            false => earlier.adopt(earlier.revision_of(since), raw, space).ok_or(None),
        });
        match adopted {
            Ok(visit) => Ok(Some(visit)),
            Err(None) => Ok(None),
            Err(Some(error)) => Err(error),
        }
    }
}

impl Visit {
    /// The visit as it is read from a table, with a configuration that has not been checked.
    #[must_use]
    pub fn into_raw(self) -> RawVisit {
        let Ok(raw) = self.map_configuration(|checked| Ok::<_, Infallible>(checked.into()));
        raw
    }
}

impl<C> Visit<C> {
    fn map_configuration<D, E>(self, map: impl FnOnce(C) -> Result<D, E>) -> Result<Visit<D>, E> {
        let decision = match self.decision {
            VisitDecision::Explore { rule, estimate } => VisitDecision::Explore { rule, estimate },
            VisitDecision::Exploit { configuration, predicted_cost, exploit, said } => {
                VisitDecision::Exploit { configuration: map(configuration)?, predicted_cost, exploit, said }
            }
        };
        Ok(Visit {
            client_id: self.client_id,
            state_id: self.state_id,
            number: self.number,
            since: self.since,
            decision,
            account: self.account,
        })
    }
}

/// Rows to insert or replace in one transaction, keyed by trial number, state id and client id. No answer may
/// reach the client before its change is stored.
#[derive(Clone, Debug, Default, PartialEq)]
#[must_use = "a change that is not stored is lost at the next restart"]
pub struct Change {
    /// Trials.
    pub trials: Vec<Trial>,
    /// States.
    pub states: Vec<StateRecord>,
    /// Visits.
    pub visits: Vec<Visit>,
    /// Clients whose visits are forgotten, before the visits above are stored.
    pub forgotten: Vec<String>,
}

impl Change {
    /// Whether there is nothing to store.
    pub fn is_empty(&self) -> bool {
        self.trials.is_empty()
            && self.states.is_empty()
            && self.visits.is_empty()
            && self.forgotten.is_empty()
    }
}

/// The rows that rebuild a tuner, without its trials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Every state, by rising id.
    pub states: Vec<StateRecord>,
    /// Every visit.
    pub visits: Vec<Visit>,
    /// The highest trial number ever handed out; 0 when none was.
    pub last_trial: u64,
    /// The completion at which the models that the policy's predictor needs were begun; 0 for the beginning.
    pub models_since: u64,
}

/// The knowledge of a tuner from the completed trials up to one of them. Opaque; only an accelerator, see
/// [`crate::tuner::Restoring`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// It covers the trials up to this place in the order of completion.
    pub completion: u64,
    /// The rest, packed.
    pub bytes: Vec<u8>,
}

/// Why there is no checkpoint: it could not be read again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("it has {bytes} bytes before it is packed, and at most {most} can be read")]
pub struct CheckpointTooLarge {
    /// Its length before it is packed.
    pub bytes: usize,
    /// The limit.
    pub most: usize,
}

/// The exploitation for given indicators.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// The configuration.
    pub configuration: Configuration,
    /// In the objective's units, where something is known.
    pub predicted_cost: Option<f64>,
    /// Why this configuration was chosen.
    pub decision: Decision,
    /// The state's insight, where [`crate::tuner::Tuner::predict`] recognised the state.
    pub insight: Option<Insight>,
}

impl Prediction {
    /// The pinned configuration, if the policy has one.
    pub(crate) fn pinned(policy: &Policy) -> Option<Prediction> {
        let (configuration, decision) = (policy.pinned.clone()?, Choice::Pinned.decided());
        Some(Prediction { configuration, predicted_cost: None, decision, insight: None })
    }

    /// `Default` when nothing is known, `Pinned` when pinned, else `Exploit`.
    pub fn mode(&self) -> Mode {
        self.decision.mode()
    }

    /// The reason of the answer, for people and for logs.
    pub fn reason(&self) -> Reason {
        self.decision.reason()
    }
}

/// The best known configuration of a state, by its own measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// The configuration.
    pub configuration: Configuration,
    /// Mean objective of its measurements in the state.
    pub cost: f64,
    /// Mean objective of the default configuration, or of the client's start, in the same state, if it was
    /// measured there.
    pub default_cost: Option<f64>,
    /// The number of measurements behind `cost`.
    pub measurements: u64,
    /// The state.
    pub state_id: u64,
    /// The most recent trial that measured it.
    pub trial: u64,
    /// The time of that measurement, in milliseconds of the caller's clock.
    pub last_measure_ms: i64,
    /// Its standing.
    pub standing: Standing,
}

/// Counts of a study's progress.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StudyCounts {
    /// Distinct states met.
    pub states: u64,
    /// Trials handed out.
    pub trials: u64,
    /// Trials with a final outcome.
    pub completed_trials: u64,
    /// Trials under a live lease.
    pub open_trials: u64,
}

/// Why the tuner refuses. Nothing was changed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TunerError {
    /// The client id is malformed.
    #[error("client_id must be 1 to {CLIENT_ID_CHARACTERS_MAX} printable characters")]
    ClientId,
    /// The indicators do not fit the study.
    #[error(transparent)]
    Indicators(#[from] IndicatorError),
    /// The configuration that the client wants does not fit the study's space.
    #[error("wanted configuration: {0}")]
    Wanted(#[from] SpaceError),
    /// The client's start does not fit the study's space.
    #[error("start: {0}")]
    Start(SpaceError),
    /// The fingerprint is over a limit.
    #[error(
        "fingerprint: at most {FINGERPRINT_SOFTWARE_MAX} software entries, and at most \
         {FINGERPRINT_TEXT_CHARACTERS_MAX} characters in each text"
    )]
    Fingerprint,
    /// The study is full of states.
    #[error(
        "the study has more than {STATES_MAX} states, and no room for those of further machines; use a larger state_tolerance or a new study"
    )]
    TooManyStates,
    /// The study is full of clients.
    #[error(
        "{CLIENTS_MAX} clients hold trials of the study, which is the limit; let some report theirs, or spread them over studies"
    )]
    TooManyClients,
    /// The client holds too many trials.
    #[error(
        "client {0:?} holds {OPEN_TRIALS_PER_CLIENT_MAX} open trials, which is the limit; report or abandon some"
    )]
    TooManyOpenTrials(String),
    /// A measurement, or the objective computed from them, is not usable.
    #[error(transparent)]
    Objective(#[from] ObjectiveError),
    /// A lower bound is not usable.
    #[error("outcome aborted: the lower bound is {0}; it must be finite and not negative")]
    LowerBound(f64),
    /// A reason is too long.
    #[error("outcome: the reason has more than {OUTCOME_REASON_CHARACTERS_MAX} characters")]
    OutcomeReason,
    /// The origin of a trial is too long or not printable.
    #[error("origin must have 1 to {ORIGIN_CHARACTERS_MAX} printable characters")]
    Origin,
    /// The trial is complete: answer a repeated report with the stored trial.
    #[error("trial {0} is already completed")]
    AlreadyCompleted(u64),
    /// The trial is complete, but by no report: its leases were lost.
    #[error(
        "trial {0} was given up as infeasible after {LEASES_LOST_MAX} lost leases, and this report is not \
         stored; measure the configuration again as a wanted one"
    )]
    GivenUp(u64),
    /// A client of an earlier revision of the space can run nothing that the present space allows.
    #[error(
        "no known configuration of the study's space fits revision {0} of it, with which this program \
         works; start the program with the present space"
    )]
    Outdated(u32),
    /// The trial's configuration lies outside the space that the study has by now.
    #[error("trial {0} is outside the space that the study has by now; ask for a new one")]
    OutsideSpace(u64),
    /// The client gave the trial back.
    #[error("trial {0} was abandoned by its client; ask for a new one")]
    Abandoned(u64),
    /// The trial is not under a lease.
    #[error("trial {number} is {state:?}, not open; ask for a new one")]
    NotOpen {
        /// The trial.
        number: u64,
        /// Its state.
        state: TrialState,
    },
    /// The trial has no result that could be excluded.
    #[error("trial {number} is {state:?}; only a completed one is excluded or counts again")]
    NotCompleted {
        /// The trial.
        number: u64,
        /// Its state.
        state: TrialState,
    },
    /// The study never handed out such a trial.
    #[error("trial {0} is not of this study")]
    UnknownTrial(u64),
    /// The specification or the new policy is not acceptable.
    #[error(transparent)]
    Study(#[from] StudyError),
}

/// Why stored rows do not make a tuner. It means that the database was damaged or changed by hand.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RestoreError {
    /// The specification is not acceptable.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// A row contradicts another.
    #[error("the stored study is inconsistent: {0}; restore the database from a backup")]
    Inconsistent(String),
}
