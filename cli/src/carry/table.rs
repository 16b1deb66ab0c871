//! Trials as a table: a column for each parameter, indicator and measurement. CSV and Parquet files are such
//! tables.

use std::time::SystemTime;

use treewright_client::{CostView, Domain, Measurements, Outcome, StudySpec, TrialRecord, Value};

use super::{CarriedTrial, client_id, origin};
use crate::show;

/// Prefixes of columns that hold one number or value each.
const CONFIGURATION: &str = "config.";
const INDICATOR: &str = "indicator.";
pub(super) const MEASUREMENT: &str = "measurement.";
const STANDARD_ERROR: &str = "standard_error.";
/// The column that holds the machine, as JSON.
pub(super) const FINGERPRINT: &str = "fingerprint";
/// The column with the reason of an excluded trial.
const EXCLUSION: &str = "exclusion";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Boolean,
    Integer,
    Number,
    Text,
    Time,
}

/// The contents of one place of a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum TrialCell {
    Boolean(bool),
    Integer(i64),
    Number(f64),
    Text(String),
    Time(SystemTime),
}

impl From<&Value> for TrialCell {
    fn from(value: &Value) -> Self {
        match value {
            Value::Boolean(value) => Self::Boolean(*value),
            Value::Integer(value) => Self::Integer(*value),
            Value::Float(value) => Self::Number(*value),
            Value::Text(value) => Self::Text(value.clone()),
        }
    }
}

type Read = Box<dyn Fn(&TrialRecord) -> Option<TrialCell>>;

/// A column of a table that is written.
pub(super) struct TrialColumn {
    pub(super) title: String,
    pub(super) kind: Kind,
    read: Read,
}

impl TrialColumn {
    fn new(
        title: impl Into<String>,
        kind: Kind,
        read: impl Fn(&TrialRecord) -> Option<TrialCell> + 'static,
    ) -> Self {
        Self { title: title.into(), kind, read: Box::new(read) }
    }

    pub(super) fn of(&self, trial: &TrialRecord) -> Option<TrialCell> {
        (self.read)(trial)
    }
}

pub(super) fn columns(spec: &StudySpec, trials: &[TrialRecord], site: &str) -> Vec<TrialColumn> {
    let mut columns = fixed(site.to_owned(), spec.objective.view());
    columns.extend(spec.space.parameters().iter().map(|parameter| {
        let name = parameter.name.clone();
        TrialColumn::new(format!("{CONFIGURATION}{name}"), kind(&parameter.domain), move |trial| {
            trial.configuration.get(&name).map(TrialCell::from)
        })
    }));
    columns.extend(spec.indicators.indicators().iter().map(|indicator| {
        let name = indicator.name.clone();
        TrialColumn::new(format!("{INDICATOR}{name}"), Kind::Number, move |trial| {
            trial.indicators.get(&name).map(TrialCell::Number)
        })
    }));
    columns.extend(measured(trials, MEASUREMENT, |trial| &trial.measurements));
    columns.extend(measured(trials, STANDARD_ERROR, |trial| &trial.standard_errors));
    columns
}

/// A column for each name among certain numbers of the trials.
fn measured(trials: &[TrialRecord], prefix: &str, of: fn(&TrialRecord) -> &Measurements) -> Vec<TrialColumn> {
    let mut names: Vec<&str> =
        trials.iter().flat_map(|trial| of(trial).iter().map(|(name, _)| name)).collect();
    names.sort_unstable();
    names.dedup();
    let column = |name: &str| {
        let title = format!("{prefix}{name}");
        let name = name.to_owned();
        TrialColumn::new(title, Kind::Number, move |trial| of(trial).get(&name).map(TrialCell::Number))
    };
    names.into_iter().map(column).collect()
}

/// The columns of every study. Where one metric is maximised and nothing else counts, its `value` stands in
/// the place of the `cost`.
fn fixed(site: String, view: CostView) -> Vec<TrialColumn> {
    let outcome = |trial: &TrialRecord| show::outcome_parts(trial.outcome.as_ref());
    let text = |text: String| (!text.is_empty()).then_some(TrialCell::Text(text));
    vec![
        TrialColumn::new("number", Kind::Integer, |trial| {
            Some(TrialCell::Integer(i64::try_from(trial.number()?).ok()?))
        }),
        TrialColumn::new("state", Kind::Text, move |trial| text(trial.state.to_string())),
        TrialColumn::new("mode", Kind::Text, move |trial| text(trial.mode.to_string())),
        TrialColumn::new("outcome", Kind::Text, move |trial| text(outcome(trial).0)),
        TrialColumn::new("reason", Kind::Text, move |trial| text(outcome(trial).1)),
        TrialColumn::new("lower_bound", Kind::Number, move |trial| outcome(trial).2.map(TrialCell::Number)),
        TrialColumn::new(if view.is_maximised() { "value" } else { "cost" }, Kind::Number, move |trial| {
            trial.cost.map(|cost| TrialCell::Number(view.value(cost)))
        }),
        TrialColumn::new("state_id", Kind::Integer, |trial| Some(TrialCell::Integer(trial.state_id))),
        TrialColumn::new("client_id", Kind::Text, move |trial| text(client_id(trial).to_owned())),
        TrialColumn::new("complete_time", Kind::Time, |trial| trial.complete_time.map(TrialCell::Time)),
        TrialColumn::new("origin", Kind::Text, move |trial| text(origin(trial, &site))),
        TrialColumn::new(FINGERPRINT, Kind::Text, |trial| {
            serde_json::to_string(trial.fingerprint.as_ref()?).ok().map(TrialCell::Text)
        }),
        TrialColumn::new(EXCLUSION, Kind::Text, |trial| trial.exclusion.clone().map(TrialCell::Text)),
    ]
}

fn kind(domain: &Domain) -> Kind {
    match domain {
        Domain::Integer { .. } => Kind::Integer,
        Domain::Float { .. } => Kind::Number,
        Domain::Boolean => Kind::Boolean,
        // Choices are of one kind.
        Domain::Categorical { values } => match values.first() {
            Some(Value::Integer(_)) => Kind::Integer,
            Some(Value::Float(_)) => Kind::Number,
            _ => Kind::Text,
        },
    }
}

/// The part of a trial that a column holds.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Role {
    Configuration(String),
    Indicator(String),
    Measurement(String),
    StandardError(String),
    Outcome,
    Reason,
    LowerBound,
    Client,
    Origin,
    Fingerprint,
    Exclusion,
}

impl Role {
    /// By the column's title; `None` for what an import does not need.
    pub(super) fn of(title: &str) -> Option<Self> {
        let after = |prefix| title.strip_prefix(prefix).map(str::to_owned);
        let named = after(CONFIGURATION)
            .map(Self::Configuration)
            .or_else(|| after(INDICATOR).map(Self::Indicator))
            .or_else(|| after(MEASUREMENT).map(Self::Measurement))
            .or_else(|| after(STANDARD_ERROR).map(Self::StandardError));
        named.or(match title {
            "outcome" => Some(Self::Outcome),
            "reason" => Some(Self::Reason),
            "lower_bound" => Some(Self::LowerBound),
            "client_id" => Some(Self::Client),
            "origin" => Some(Self::Origin),
            FINGERPRINT => Some(Self::Fingerprint),
            EXCLUSION => Some(Self::Exclusion),
            _ => None,
        })
    }
}

/// A row while it is read.
pub(super) struct Row {
    trial: CarriedTrial,
    outcome: Option<String>,
    reason: String,
    lower_bound: Option<f64>,
}

impl Row {
    /// The row at a place of a file. They stand for its origin and its client where it names none.
    pub(super) fn new(file: &str, place: usize) -> Self {
        let trial = CarriedTrial::new(format!("{file}:{place}"), file);
        Self { trial, outcome: None, reason: String::new(), lower_bound: None }
    }

    /// Adds a value. The error says why it cannot stand in this column.
    pub(super) fn take(&mut self, role: &Role, value: Value) -> Result<(), String> {
        let number = |value: &Value| value.as_number().ok_or_else(|| format!("`{value}` is no number"));
        match role {
            Role::Configuration(name) => self.trial.configuration.set(name.clone(), value),
            Role::Indicator(name) => {
                self.trial.indicators.insert(name.clone(), number(&value)?);
            }
            Role::Measurement(name) => {
                self.trial.measurements.insert(name.clone(), number(&value)?);
            }
            Role::StandardError(name) => {
                self.trial.standard_errors.insert(name.clone(), number(&value)?);
            }
            Role::Outcome => self.outcome = Some(value.to_string()),
            Role::Reason => self.reason = value.to_string(),
            Role::LowerBound => self.lower_bound = Some(number(&value)?),
            Role::Client => self.trial.client_id = value.to_string(),
            Role::Origin => self.trial.origin = value.to_string(),
            Role::Exclusion => self.trial.exclusion = Some(value.to_string()),
            Role::Fingerprint => {
                let machine = serde_json::from_str(&value.to_string());
                self.trial.fingerprint = Some(machine.map_err(|error| format!("{FINGERPRINT}: {error}"))?);
            }
        }
        Ok(())
    }

    /// The trial; `None` for one without a result, such as one that is open or failed.
    pub(super) fn trial(self) -> Result<Option<CarriedTrial>, String> {
        let outcome = match self.outcome.as_deref() {
            None if self.trial.measurements.is_empty() => return Ok(None),
            None | Some("OK") => Outcome::Ok,
            Some("INFEASIBLE") => Outcome::infeasible(self.reason),
            Some("ABORTED") => Outcome::aborted(self.lower_bound.ok_or("ABORTED needs a lower_bound")?),
            Some("FAILED") => return Ok(None),
            Some(other) => {
                return Err(format!("outcome `{other}` is none of OK, INFEASIBLE, ABORTED, FAILED"));
            }
        };
        Ok(Some(CarriedTrial { outcome, ..self.trial }))
    }
}
