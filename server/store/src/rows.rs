//! Rows of the tables of both databases, and their conversion from and to domain types. Only the stores see
//! them.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;
use treewright_core::configuration::RawConfiguration;
use treewright_core::decision::recorded::Recorded;
use treewright_core::policy::Policy;
use treewright_core::space::EarlierSpaces;
use treewright_core::study::StudySpec;
use treewright_core::trial::{Explanation, Outcome, OutcomeKind, RawTrial, Trial, TrialState};
use treewright_core::tuner::{
    Change, Checkpoint, Exploration, RawVisit, RecordedVisitDecision, StateRecord, Visit,
};
use treewright_core::value::Value;
use treewright_core::words::Word;

use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::from_row::row;
use crate::limits::CHECKPOINT_PART_BYTES;
use crate::store::StudyWrite;

row! {
    /// A row of `trials`, without its study.
    #[derive(Debug)]
    pub(crate) struct TrialRow {
        pub(crate) number: i64,
        pub(crate) client_id: String,
        pub(crate) state_id: i64,
        pub(crate) mode: String,
        pub(crate) state: String,
        pub(crate) outcome: Option<String>,
        pub(crate) outcome_reason: Option<String>,
        pub(crate) outcome_lower_bound: Option<f64>,
        pub(crate) cost: Option<f64>,
        pub(crate) predicted_cost: Option<f64>,
        pub(crate) late: bool,
        pub(crate) create_ms: i64,
        pub(crate) lease_expire_ms: i64,
        pub(crate) complete_ms: Option<i64>,
        pub(crate) completion: Option<i64>,
        pub(crate) configuration: String,
        pub(crate) indicators: String,
        pub(crate) measurements: String,
        pub(crate) standard_errors: Option<String>,
        pub(crate) reason: String,
        pub(crate) fingerprint: Option<String>,
        pub(crate) exclusion: Option<String>,
    }
}

row! {
    /// A row of `states`, without its study.
    #[derive(Debug)]
    pub(crate) struct StateRow {
        pub(crate) id: i64,
        pub(crate) indicators: String,
        pub(crate) fingerprint: Option<String>,
        pub(crate) search: Option<String>,
        pub(crate) search_packed: Option<Vec<u8>>,
    }
}

/// A part of a checkpoint: a row of `checkpoints`, without its study.
#[derive(Debug)]
pub(crate) struct PartRow {
    pub(crate) completion: i64,
    pub(crate) part: i64,
    pub(crate) parts: i64,
    pub(crate) bytes: Vec<u8>,
}

impl PartRow {
    /// The parts of a checkpoint, each of which is written at once.
    pub(crate) fn cut(checkpoint: &Checkpoint) -> impl Iterator<Item = Result<Self>> + '_ {
        assert!(!checkpoint.bytes.is_empty(), "a checkpoint of nothing has no parts to be found by");
        let parts = checkpoint.bytes.chunks(CHECKPOINT_PART_BYTES);
        let count = parts.len() as u64;
        (0..).zip(parts).map(move |(part, bytes)| {
            let completion = signed(checkpoint.completion)?;
            Ok(Self { completion, part: signed(part)?, parts: signed(count)?, bytes: bytes.to_vec() })
        })
    }
}

row! {
    /// A row of `visits`, without its study.
    #[derive(Debug)]
    pub(crate) struct VisitRow {
        pub(crate) client_id: String,
        pub(crate) state_id: i64,
        pub(crate) number: i64,
        pub(crate) since: i64,
        pub(crate) decision: String,
        /// The estimate that earlier versions stored beside a decision to explore. It is now part of the
        /// decision.
        pub(crate) weighed: Option<String>,
        pub(crate) account: Option<String>,
    }
}

/// The rows of a change. Of several changes to one row only the last is kept, which halves the writes of
/// a report that is followed by a suggestion.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    pub(crate) states: Vec<StateRow>,
    pub(crate) visits: Vec<VisitRow>,
    pub(crate) trials: Vec<TrialRow>,
    pub(crate) forgotten: Vec<String>,
}

impl Rows {
    pub(crate) fn of(changes: &[Change]) -> Result<Self> {
        let mut states = BTreeMap::new();
        let mut visits = BTreeMap::new();
        let mut trials = BTreeMap::new();
        let mut forgotten = BTreeSet::new();
        for change in changes {
            states.extend(change.states.iter().map(|state| (state.id, state)));
            for client_id in &change.forgotten {
                visits.remove(client_id);
                forgotten.insert(client_id);
            }
            visits.extend(change.visits.iter().map(|visit| (&visit.client_id, visit)));
            trials.extend(change.trials.iter().map(|trial| (trial.number, trial)));
        }
        // A client that has come back since is stored like any other.
        forgotten.retain(|client_id| !visits.contains_key(*client_id));
        let rows = Self {
            forgotten: forgotten.into_iter().cloned().collect(),
            states: states.into_values().map(StateRow::of).collect::<Result<_, _>>()?,
            visits: visits.into_values().map(VisitRow::of).collect::<Result<_, _>>()?,
            trials: trials.into_values().map(TrialRow::of).collect::<Result<_, _>>()?,
        };
        // A commit without rows only waits for those before it.
        assert_eq!(rows.is_empty(), changes.iter().all(Change::is_empty));
        Ok(rows)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.count() == 0
    }

    pub(crate) fn count(&self) -> usize {
        self.states.len() + self.visits.len() + self.trials.len() + self.forgotten.len()
    }
}

/// A change of one study, as rows and texts.
pub(crate) enum StudyChange {
    Commit(Rows),
    // The specification and the policy of a study that keeps its space.
    Study { specification: String, policy: String, models_since: i64 },
    // The specification and the policy of a changed space.
    Space { specification: String, policy: String },
    // The reason for which a completed trial is excluded; none where it counts.
    Exclude { number: i64, reason: Option<String> },
    // A part of a checkpoint. Its failure breaks no fence.
    Part(PartRow),
}

impl StudyChange {
    pub(crate) fn of(write: StudyWrite<'_>) -> Result<Self> {
        Ok(match write {
            StudyWrite::Commit(changes) => Self::Commit(Rows::of(changes)?),
            StudyWrite::Study(spec, earlier, models_since) => {
                let (specification, policy) = specification(spec, earlier)?;
                Self::Study { specification, policy, models_since: signed(models_since)? }
            }
            StudyWrite::Space(spec, earlier) => {
                let (specification, policy) = specification(spec, earlier)?;
                Self::Space { specification, policy }
            }
            StudyWrite::Exclude(number, reason) => {
                Self::Exclude { number: signed(number)?, reason: reason.map(str::to_owned) }
            }
        })
    }

    /// Breaks the fence after an error: the caller's change is lost, so no later change computed on it may be
    /// stored.
    pub(crate) fn fail(&self, fence: &Fence, error: &StoreError) {
        if !matches!(self, Self::Part(_)) {
            fence.break_up();
            tracing::warn!(study = fence.study(), %error, "a change was not stored");
        }
    }
}

impl TrialRow {
    fn of(trial: &Trial) -> Result<Self> {
        let has_result = trial.outcome.is_some() && trial.completion.is_some();
        assert!(has_result || trial.state != TrialState::Completed, "trial {} has no result", trial.number);
        assert!(
            trial.state == TrialState::Completed || trial.completion.is_none(),
            "trial {} is {:?} and has a place among the completed",
            trial.number,
            trial.state
        );
        assert!(trial.number > 0 && trial.state_id > 0, "trials and states are counted from 1");
        assert!(trial.cost.is_none_or(f64::is_finite), "trial {} costs {:?}", trial.number, trial.cost);
        let (outcome_reason, outcome_lower_bound) = match &trial.outcome {
            Some(Outcome::Infeasible { reason } | Outcome::Failed { reason }) => (Some(reason.clone()), None),
            Some(Outcome::Aborted { lower_bound }) => (None, Some(*lower_bound)),
            Some(Outcome::Ok) | None => (None, None),
        };
        let decision = trial.decision.stored();
        Ok(Self {
            number: signed(trial.number)?,
            client_id: trial.client_id.clone(),
            state_id: signed(trial.state_id)?,
            mode: decision.mode().word().to_owned(),
            state: trial.state.word().to_owned(),
            outcome: trial.outcome.as_ref().map(|outcome| outcome.kind().word().to_owned()),
            outcome_reason,
            outcome_lower_bound,
            cost: trial.cost,
            predicted_cost: trial.predicted_cost,
            late: trial.late,
            create_ms: trial.create_ms,
            lease_expire_ms: trial.lease_expire_ms,
            complete_ms: trial.complete_ms,
            completion: trial.completion.map(signed).transpose()?,
            configuration: configuration_to_json(trial.configuration.values()),
            indicators: write(&trial.indicators)?,
            measurements: write(&trial.measurements)?,
            standard_errors: Some(&trial.standard_errors)
                .filter(|errors| !errors.is_empty())
                .map(write)
                .transpose()?,
            reason: write(&decision)?,
            fingerprint: trial.fingerprint.as_ref().map(write).transpose()?,
            exclusion: None,
        })
    }

    pub(crate) fn into_trial(self) -> Result<RawTrial> {
        let mode = value(&self.mode)?;
        let state = value(&self.state)?;
        let kind = self.outcome.as_deref().map(value).transpose()?;
        let reason_text = self.outcome_reason.unwrap_or_default();
        let outcome = match kind {
            None => None,
            Some(OutcomeKind::Ok) => Some(Outcome::Ok),
            Some(OutcomeKind::Infeasible) => Some(Outcome::Infeasible { reason: reason_text }),
            Some(OutcomeKind::Failed) => Some(Outcome::Failed { reason: reason_text }),
            Some(OutcomeKind::Aborted) => Some(Outcome::Aborted {
                lower_bound: self
                    .outcome_lower_bound
                    .ok_or_else(|| inconsistent("an aborted trial has no lower bound"))?,
            }),
        };
        Ok(RawTrial {
            number: unsigned(self.number)?,
            client_id: self.client_id,
            state_id: unsigned(self.state_id)?,
            indicators: read("indicators", &self.indicators)?,
            configuration: configuration_from_json(&self.configuration)?,
            decision: read::<Recorded>("reason", &self.reason)?.decision(mode),
            predicted_cost: self.predicted_cost,
            lease_expire_ms: self.lease_expire_ms,
            state,
            measurements: read("measurements", &self.measurements)?,
            standard_errors: self
                .standard_errors
                .map_or_else(|| Ok(BTreeMap::new()), |text| read("standard_errors", &text))?,
            cost: self.cost,
            outcome,
            late: self.late,
            create_ms: self.create_ms,
            complete_ms: self.complete_ms,
            completion: self.completion.map(unsigned).transpose()?,
            fingerprint: self.fingerprint.map(|text| read("fingerprint", &text)).transpose()?,
            exclusion: self.exclusion,
        })
    }
}

impl StateRow {
    fn of(state: &StateRecord) -> Result<Self> {
        Ok(Self {
            id: signed(state.id)?,
            indicators: write(&state.indicators)?,
            fingerprint: state.fingerprint.as_ref().map(write).transpose()?,
            search: None,
            search_packed: state.search.as_ref().map(Exploration::pack),
        })
    }

    pub(crate) fn into_state(self) -> Result<StateRecord> {
        Ok(StateRecord {
            id: unsigned(self.id)?,
            indicators: read("indicators", &self.indicators)?,
            fingerprint: self.fingerprint.map(|text| read("fingerprint", &text)).transpose()?,
            search: match (self.search_packed, self.search) {
                (Some(bytes), _) => readable(self.id, Exploration::unpack(&bytes)),
                (None, Some(text)) => readable(self.id, serde_json::from_str(&text)),
                (None, None) => None,
            },
        })
    }
}

/// The search of a state, unless another version wrote it in an unreadable form. A new one then begins with
/// the state's table; refusing the whole study would be worse.
fn readable<E: std::fmt::Display>(state: i64, search: Result<Exploration, E>) -> Option<Exploration> {
    search
        .inspect_err(
            |error| tracing::warn!(state, %error, "the search of a state cannot be read and starts over"),
        )
        .ok()
}

impl VisitRow {
    fn of(visit: &Visit) -> Result<Self> {
        Ok(Self {
            client_id: visit.client_id.clone(),
            state_id: signed(visit.state_id)?,
            number: signed(visit.number)?,
            since: signed(visit.since)?,
            decision: write(&visit.decision)?,
            weighed: None,
            account: visit.account.as_ref().map(write).transpose()?,
        })
    }

    pub(crate) fn into_visit(self) -> Result<RawVisit> {
        let weighed =
            self.weighed.map_or_else(|| Ok(Explanation::default()), |text| read("weighed", &text))?;
        Ok(RawVisit {
            client_id: self.client_id,
            state_id: unsigned(self.state_id)?,
            number: unsigned(self.number)?,
            since: unsigned(self.since)?,
            decision: read::<RecordedVisitDecision>("decision", &self.decision)?.decision(&weighed),
            account: self.account.map(|text| read("account", &text)).transpose()?,
        })
    }
}

/// The field of the specification with the spaces before the present one. Earlier versions ignore it.
const EARLIER_SPACES: &str = "earlier_spaces";

/// The two texts of a study: everything but the policy, and the policy.
pub(crate) fn specification(spec: &StudySpec, earlier: &EarlierSpaces) -> Result<(String, String)> {
    let json = |error: serde_json::Error| inconsistent(error.to_string());
    let mut fields = serde_json::to_value(spec).map_err(json)?;
    if let Some(fields) = fields.as_object_mut() {
        fields.remove("policy");
        if !earlier.is_empty() {
            fields.insert(EARLIER_SPACES.to_owned(), serde_json::to_value(earlier).map_err(json)?);
        }
    }
    let texts = (fields.to_string(), policy(&spec.policy)?);
    debug_assert_eq!(
        into_specification(&texts.0, &texts.1).as_ref(),
        Ok(&(spec.clone(), earlier.clone())),
        "it is read as another"
    );
    Ok(texts)
}

fn policy(policy: &Policy) -> Result<String> {
    let text = write(policy)?;
    debug_assert_eq!(read("policy", &text), Ok(policy.to_raw()), "it is read as another");
    Ok(text)
}

/// Joins the two texts of a study again, and returns its earlier spaces.
pub(crate) fn into_specification(specification: &str, policy: &str) -> Result<(StudySpec, EarlierSpaces)> {
    let refused = |error: serde_json::Error| inconsistent(format!("column specification: {error}"));
    let mut json: Json = read("specification", specification)?;
    let policy: Json = read("policy", policy)?;
    let mut earlier = EarlierSpaces::default();
    if let Some(fields) = json.as_object_mut() {
        fields.insert("policy".to_owned(), policy);
        if let Some(spaces) = fields.remove(EARLIER_SPACES) {
            earlier = serde_json::from_value(spaces).map_err(refused)?;
        }
    }
    Ok((serde_json::from_value(json).map_err(refused)?, earlier))
}

/// A configuration in the form for people and filters:
/// `{"max_leaf_size":8,"robust":false,"travel_cost":1.5}`. A point or exponent marks a float, and JSON text
/// keeps it.
fn configuration_to_json(values: &RawConfiguration) -> String {
    let fields = values.iter().map(|(name, value)| {
        let value = match value {
            Value::Integer(integer) => Json::from(*integer),
            Value::Float(float) => Json::from(*float),
            Value::Text(text) => Json::from(text.as_str()),
            Value::Boolean(boolean) => Json::from(*boolean),
        };
        (name.clone(), value)
    });
    let text = Json::Object(fields.collect()).to_string();
    debug_assert_eq!(configuration_from_json(&text).as_ref(), Ok(values));
    text
}

fn configuration_from_json(text: &str) -> Result<RawConfiguration> {
    let fields: BTreeMap<String, Json> = read("configuration", text)?;
    fields
        .into_iter()
        .map(|(name, value)| {
            let value = match value {
                Json::Bool(boolean) => Value::Boolean(boolean),
                Json::String(text) => Value::Text(text),
                Json::Number(number) => match (number.as_i64(), number.as_f64()) {
                    (Some(integer), _) => Value::Integer(integer),
                    (None, Some(float)) => Value::Float(float),
                    (None, None) => return Err(inconsistent("column configuration: a number")),
                },
                _ => return Err(inconsistent("column configuration: not a plain value")),
            };
            Ok((name, value))
        })
        .collect()
}

fn value<T: Word>(word: &str) -> Result<T> {
    T::from_word(word).ok_or_else(|| inconsistent(format!("{word:?} has no meaning")))
}

pub(crate) fn write(value: &impl Serialize) -> Result<String> {
    serde_json::to_string(value).map_err(|error| inconsistent(error.to_string()))
}

fn read<T: DeserializeOwned>(column: &str, text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|error| inconsistent(format!("column {column}: {error}")))
}

pub(crate) fn signed(number: u64) -> Result<i64> {
    i64::try_from(number).map_err(|_| inconsistent("a number is out of range"))
}

pub(crate) fn unsigned(number: i64) -> Result<u64> {
    u64::try_from(number).map_err(|_| inconsistent("a number is negative"))
}

/// Checks the rows of a statement that names one by its key.
pub(crate) fn one_at_most(rows: u64) {
    assert!(rows <= 1, "{rows} rows have one key");
}

pub(crate) fn inconsistent(problem: impl Into<String>) -> StoreError {
    StoreError::Inconsistent { study: None, problem: problem.into() }
}
