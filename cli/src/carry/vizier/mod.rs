//! Studies of OSS Vizier, from its SQLite database (`vizier/_src/service/sql_datastore.py`). Its tables hold
//! serialized messages of that project's `study.proto`; only the parts that mean something here are read.
//!
//! Succeeded trials become measurements and infeasible ones findings. Missing values are made up visibly: the
//! values of the first trial are the defaults where the specification names none. The metric is minimised or
//! maximised as there. A study whose parameters depend on others is refused.

mod messages;

use std::collections::BTreeMap;
use std::path::Path;

use prost::Message as _;
use serde_json::{Value as Json, json};
use sqlx::sqlite::{SqliteConnectOptions, SqliteRow};
use sqlx::{ConnectOptions as _, Row as _};
use treewright_client::{Configuration, Outcome, Value};

use self::messages::{
    INFEASIBLE, LOG, MAXIMIZE, MINIMIZE, ParameterSpec, SUCCEEDED, Study, StudySpec, Trial,
};
use super::CarriedTrial;
use super::foreign::{Foreign, METRIC, check_names, json_of, our_name, read_with};
use crate::failure::Result;

/// Reads a study by its whole name, `owners/OWNER/studies/STUDY`, or by the last part of it.
pub(crate) fn read(path: &Path, name: &str) -> Result<Foreign> {
    read_with(path, read_study(path, name))
}

async fn read_study(path: &Path, name: &str) -> Result<Foreign, String> {
    let no_database = |error: sqlx::Error| format!("it is no database of Vizier: {error}");
    let options = SqliteConnectOptions::new().filename(path).read_only(true);
    let mut database = options.connect().await.map_err(no_database)?;
    let rows = sqlx::query(
        "SELECT study_name, serialized_study, owner_id, study_id FROM studies ORDER BY study_name",
    )
    .fetch_all(&mut database)
    .await
    .map_err(no_database)?;
    let studies: Result<Vec<StoredStudy>, _> = rows.iter().map(StoredStudy::read).collect();
    let studies = studies.map_err(no_database)?;
    let found: Vec<&StoredStudy> =
        studies.iter().filter(|study| study.name == name || study.id == name).collect();
    let names = |studies: &mut dyn Iterator<Item = &StoredStudy>| {
        studies.map(|study| study.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let StoredStudy { name: whole, bytes, owner, id } = match found.as_slice() {
        [study] => study,
        [] => return Err(format!("there is no study {name}; there is {}", names(&mut studies.iter()))),
        several => {
            let all = names(&mut several.iter().copied());
            return Err(format!("{name} is ambiguous: say which of {all}"));
        }
    };
    let study =
        Study::decode(bytes.as_slice()).map_err(|error| format!("{whole} cannot be read: {error}"))?;
    let rows = sqlx::query(
        "SELECT serialized_trial FROM trials WHERE owner_id = ? AND study_id = ? ORDER BY trial_id",
    )
    .bind(owner)
    .bind(id)
    .fetch_all(&mut database)
    .await
    .map_err(no_database)?;
    let bytes: Result<Vec<Vec<u8>>, _> = rows.iter().map(|row| row.try_get(0)).collect();
    let bytes = bytes.map_err(no_database)?;
    let trials: Result<Vec<Trial>, _> = bytes.iter().map(|bytes| Trial::decode(bytes.as_slice())).collect();
    let trials = trials.map_err(|error| format!("a trial of {whole} cannot be read: {error}"))?;
    translate(whole, &study.spec.unwrap_or_default(), &trials)
}

struct StoredStudy {
    name: String,
    bytes: Vec<u8>,
    owner: String,
    id: String,
}

impl StoredStudy {
    fn read(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            name: row.try_get(0)?,
            bytes: row.try_get(1)?,
            owner: row.try_get(2)?,
            id: row.try_get(3)?,
        })
    }
}

fn translate(name: &str, spec: &StudySpec, trials: &[Trial]) -> Result<Foreign, String> {
    let (metric, is_maximised) = match spec.metrics.as_slice() {
        [one] if [MINIMIZE, MAXIMIZE].contains(&one.goal) => (one.id.as_str(), one.goal == MAXIMIZE),
        [_] => return Err(format!("{name} does not say whether it minimises or maximises")),
        many => return Err(format!("{name} has {} metrics, and only one can be taken over", many.len())),
    };
    if let Some(parent) = spec.parameters.iter().find(|parameter| !parameter.children.is_empty()) {
        return Err(format!(
            "{name} has parameters that depend on {}, which cannot be taken over",
            parent.id
        ));
    }
    check_names(spec.parameters.iter().map(|parameter| parameter.id.as_str()))?;
    let configurations: Vec<Configuration> = trials.iter().map(|trial| configuration(spec, trial)).collect();
    let entry = |parameter: &ParameterSpec| {
        let name = our_name(&parameter.id);
        let first = || configurations.iter().find_map(|one| one.get(&name).cloned());
        entry(parameter, &name, default(parameter).or_else(first))
    };
    let entries: Option<Vec<Json>> = spec.parameters.iter().map(entry).collect();
    let entries = entries.filter(|entries| !entries.is_empty());
    let entries = entries.ok_or_else(|| format!("{name} has a parameter of an unknown kind, or none"))?;
    let our_metric = if metric.is_empty() { METRIC.to_owned() } else { our_name(metric) };
    let objective = json!([{ "metric": our_metric, "maximise": is_maximised }]);
    let file = json!({ "parameters": entries, "objective": objective });
    let study = serde_json::from_value(file).map_err(|error| error.to_string())?;
    let mut foreign = Foreign { study, trials: Vec::new(), without_value: 0, is_maximised };
    for (trial, configuration) in trials.iter().zip(configurations) {
        let value = trial.measurement.iter().flat_map(|of| &of.metrics).find(|one| one.id == metric);
        let value = value.map(|one| one.value).filter(|value| value.is_finite());
        let (measurements, outcome) = match (trial.state, value) {
            (SUCCEEDED, Some(value)) => ([(METRIC.to_owned(), value)].into(), Outcome::Ok),
            (INFEASIBLE, _) => (BTreeMap::new(), Outcome::infeasible(&trial.infeasible_reason)),
            (SUCCEEDED, None) => {
                foreign.without_value += 1;
                continue;
            }
            _ => continue,
        };
        let client_id = if trial.client_id.is_empty() { "vizier" } else { &trial.client_id };
        let known = CarriedTrial::new(format!("vizier/{name}/trials/{}", trial.id), client_id);
        foreign.trials.push(CarriedTrial { configuration, measurements, outcome, ..known });
    }
    Ok(foreign)
}

fn configuration(spec: &StudySpec, trial: &Trial) -> Configuration {
    let mut all = Configuration::new();
    for parameter in &trial.parameters {
        let Some(spec) = spec.parameters.iter().find(|known| known.id == parameter.id) else { continue };
        if let Some(value) = parameter.value.as_ref().and_then(|value| value_of(spec, value)) {
            all.set(our_name(&parameter.id), value);
        }
    }
    all
}

/// A value in the kind that its parameter has here. Vizier writes whole numbers as floating-point ones.
fn value_of(parameter: &ParameterSpec, value: &prost_types::Value) -> Option<Value> {
    use prost_types::value::Kind;
    match value.kind.as_ref()? {
        Kind::NumberValue(number) if parameter.integer.is_some() || is_whole(parameter) => {
            Some(Value::Integer(*number as i64))
        }
        Kind::NumberValue(number) => Some(Value::Float(*number)),
        Kind::StringValue(text) if is_boolean(parameter) => {
            Some(Value::Boolean(text.eq_ignore_ascii_case("true")))
        }
        Kind::StringValue(text) => Some(Value::Text(text.clone())),
        _ => None,
    }
}

/// Whether a list of numbers holds whole ones only.
fn is_whole(parameter: &ParameterSpec) -> bool {
    parameter
        .discrete
        .as_ref()
        .is_some_and(|discrete| discrete.values.iter().all(|value| *value == value.trunc()))
}

/// Vizier writes a boolean as the categories True and False.
fn is_boolean(parameter: &ParameterSpec) -> bool {
    parameter.categorical.as_ref().is_some_and(|categories| {
        let mut values: Vec<String> = categories.values.iter().map(|value| value.to_lowercase()).collect();
        values.sort_unstable();
        values == ["false", "true"]
    })
}

fn default(parameter: &ParameterSpec) -> Option<Value> {
    use prost_types::value::Kind;
    let number = |number: &f64| Kind::NumberValue(*number);
    let named = if let Some(range) = &parameter.double {
        range.default.as_ref().map(number)
    } else if let Some(range) = &parameter.integer {
        range.default.map(|whole| Kind::NumberValue(whole as f64))
    } else if let Some(categories) = &parameter.categorical {
        categories.default.clone().map(Kind::StringValue)
    } else {
        parameter.discrete.as_ref()?.default.as_ref().map(number)
    };
    value_of(parameter, &prost_types::Value { kind: Some(named?) })
}

/// A parameter as one of a study file; `None` where its kind is unknown.
fn entry(parameter: &ParameterSpec, name: &str, default: Option<Value>) -> Option<Json> {
    let scale = if parameter.scale == LOG { "log" } else { "linear" };
    let (mut entry, lowest) = if let Some(range) = &parameter.double {
        let entry = json!({ "type": "float", "min": range.min, "max": range.max, "scale": scale });
        (entry, Value::Float(range.min))
    } else if let Some(range) = &parameter.integer {
        let entry = json!({ "type": "integer", "min": range.min, "max": range.max, "scale": scale });
        (entry, Value::Integer(range.min))
    } else if is_boolean(parameter) {
        (json!({ "type": "boolean" }), Value::Boolean(false))
    } else if let Some(categories) = &parameter.categorical {
        let lowest = Value::Text(categories.values.first()?.clone());
        (json!({ "type": "categorical", "values": categories.values }), lowest)
    } else {
        let values = &parameter.discrete.as_ref()?.values;
        let whole = is_whole(parameter);
        let value = |value: &f64| if whole { Value::Integer(*value as i64) } else { Value::Float(*value) };
        let all: Vec<Json> = values.iter().map(|each| json_of(&value(each))).collect();
        (json!({ "type": "categorical", "values": all }), value(values.first()?))
    };
    entry["name"] = json!(name);
    entry["default"] = json_of(&default.unwrap_or(lowest));
    Some(entry)
}

#[cfg(test)]
pub(super) mod tests;
