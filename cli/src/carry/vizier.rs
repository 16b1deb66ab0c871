//! Studies of OSS Vizier, from its SQLite database (`vizier/_src/service/sql_datastore.py`): tables of serialized messages, of
//! which those parts are read here that `study.proto` of that project defines and that mean something here.
//!
//! Succeeded trials become measurements and infeasible ones findings. What Vizier does not have is made up visibly: the
//! values of the first trial are the defaults where the specification names none. A study that maximises is refused, because costs are at
//! least 0 here, and so is one whose parameters depend on others.

use std::collections::BTreeMap;
use std::path::Path;

use prost::Message;
use serde_json::{Value as Json, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Row as _};
use treewright_client::{Configuration, Outcome, Value};

use super::CarriedTrial;
use super::foreign::{Foreign, METRIC, json_of, our_name};
use crate::failure::Failure;

/// `Trial.State` of a trial with a final measurement, and of one that could not be used.
const SUCCEEDED: i32 = 4;
const INFEASIBLE: i32 = 5;
/// `MetricSpec.GoalType`.
const MINIMIZE: i32 = 2;
/// `ParameterSpec.ScaleType`.
const LOG: i32 = 2;

#[derive(Clone, PartialEq, Message)]
struct Study {
    #[prost(message, optional, tag = "3")]
    spec: Option<StudySpec>,
}

#[derive(Clone, PartialEq, Message)]
struct StudySpec {
    #[prost(message, repeated, tag = "1")]
    metrics: Vec<MetricSpec>,
    #[prost(message, repeated, tag = "2")]
    parameters: Vec<ParameterSpec>,
}

#[derive(Clone, PartialEq, Message)]
struct MetricSpec {
    #[prost(string, tag = "1")]
    id: String,
    #[prost(int32, tag = "2")]
    goal: i32,
}

#[derive(Clone, PartialEq, Message)]
struct ParameterSpec {
    #[prost(string, tag = "1")]
    id: String,
    #[prost(message, optional, tag = "2")]
    double: Option<Doubles>,
    #[prost(message, optional, tag = "3")]
    integer: Option<Integers>,
    #[prost(message, optional, tag = "4")]
    categorical: Option<Categories>,
    #[prost(message, optional, tag = "5")]
    discrete: Option<Discrete>,
    #[prost(int32, tag = "6")]
    scale: i32,
    #[prost(message, repeated, tag = "10")]
    children: Vec<Child>,
}

#[derive(Clone, PartialEq, Message)]
struct Doubles {
    #[prost(double, tag = "1")]
    min: f64,
    #[prost(double, tag = "2")]
    max: f64,
}

#[derive(Clone, PartialEq, Message)]
struct Integers {
    #[prost(int64, tag = "1")]
    min: i64,
    #[prost(int64, tag = "2")]
    max: i64,
}

#[derive(Clone, PartialEq, Message)]
struct Categories {
    #[prost(string, repeated, tag = "1")]
    values: Vec<String>,
}

#[derive(Clone, PartialEq, Message)]
struct Discrete {
    #[prost(double, repeated, tag = "1")]
    values: Vec<f64>,
}

/// A parameter that depends on another; only that there is one is read.
#[derive(Clone, PartialEq, Message)]
struct Child {}

#[derive(Clone, PartialEq, Message)]
struct Trial {
    #[prost(string, tag = "2")]
    id: String,
    #[prost(int32, tag = "3")]
    state: i32,
    #[prost(message, repeated, tag = "4")]
    parameters: Vec<Parameter>,
    #[prost(message, optional, tag = "5")]
    measurement: Option<Measurement>,
    #[prost(string, tag = "9")]
    client_id: String,
    #[prost(string, tag = "10")]
    infeasible_reason: String,
}

#[derive(Clone, PartialEq, Message)]
struct Parameter {
    #[prost(string, tag = "1")]
    id: String,
    #[prost(message, optional, tag = "2")]
    value: Option<prost_types::Value>,
}

#[derive(Clone, PartialEq, Message)]
struct Measurement {
    #[prost(message, repeated, tag = "3")]
    metrics: Vec<Metric>,
}

#[derive(Clone, PartialEq, Message)]
struct Metric {
    #[prost(string, tag = "1")]
    id: String,
    #[prost(double, tag = "2")]
    value: f64,
}

/// Reads a study by its whole name, `owners/OWNER/studies/STUDY`, or by the last part of it.
///
/// # Errors
/// [`Failure::File`] when the file is no such database, the study is not in it, or it cannot be one here.
pub(crate) fn read(path: &Path, name: &str) -> Result<Foreign, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::file(path, error.to_string()))?;
    runtime.block_on(read_study(path, name)).map_err(|problem| Failure::file(path, problem))
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
    let named = |row: &&sqlx::sqlite::SqliteRow| {
        let whole: String = row.get(0);
        whole == name || row.get::<String, _>(3) == name
    };
    let Some(row) = rows.iter().find(named) else {
        let names: Vec<String> = rows.iter().map(|row| row.get(0)).collect();
        return Err(format!("there is no study {name}; there is {}", names.join(", ")));
    };
    let (whole, bytes): (String, Vec<u8>) = (row.get(0), row.get(1));
    let (owner, id): (String, String) = (row.get(2), row.get(3));
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
    let trials: Result<Vec<Trial>, _> =
        rows.iter().map(|row| Trial::decode(row.get::<Vec<u8>, _>(0).as_slice())).collect();
    let trials = trials.map_err(|error| format!("a trial of {whole} cannot be read: {error}"))?;
    translate(&whole, &study.spec.unwrap_or_default(), &trials)
}

fn translate(name: &str, spec: &StudySpec, trials: &[Trial]) -> Result<Foreign, String> {
    let metric = match spec.metrics.as_slice() {
        [one] if one.goal == MINIMIZE => &one.id,
        [_] => return Err(format!("{name} maximises, and costs are minimised here: store a cost instead")),
        many => return Err(format!("{name} has {} metrics, and only one can be taken over", many.len())),
    };
    if let Some(parent) = spec.parameters.iter().find(|parameter| !parameter.children.is_empty()) {
        return Err(format!("other parameters depend on {}, which cannot be taken over", parent.id));
    }
    let configurations: Vec<Configuration> = trials.iter().map(|trial| configuration(spec, trial)).collect();
    let entry = |parameter: &ParameterSpec| {
        let name = our_name(&parameter.id);
        let first = configurations.iter().find_map(|one| one.get(&name).cloned());
        entry(parameter, &name, first)
    };
    let entries: Option<Vec<Json>> = spec.parameters.iter().map(entry).collect();
    let entries = entries.filter(|entries| !entries.is_empty());
    let entries = entries.ok_or_else(|| format!("{name} has a parameter of an unknown kind, or none"))?;
    let file = json!({ "parameters": entries, "objective": [{ "metric": METRIC }] });
    let study = serde_json::from_value(file).map_err(|error| error.to_string())?;
    let mut foreign = Foreign { study, trials: Vec::new(), without_value: 0 };
    for (trial, configuration) in trials.iter().zip(configurations) {
        let value = trial.measurement.iter().flat_map(|of| &of.metrics).find(|one| one.id == *metric);
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
        foreign.trials.push(CarriedTrial {
            origin: format!("vizier/{name}/trials/{}", trial.id),
            client_id: if trial.client_id.is_empty() { "vizier".to_owned() } else { trial.client_id.clone() },
            indicators: BTreeMap::new(),
            configuration,
            measurements,
            outcome,
            cost: None,
            fingerprint: None,
            complete_time: None,
        });
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

/// A parameter as one of a study file; `None` where its kind is unknown.
fn entry(parameter: &ParameterSpec, name: &str, first: Option<Value>) -> Option<Json> {
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
    entry["default"] = json_of(&first.unwrap_or(lowest));
    Some(entry)
}

#[cfg(test)]
mod tests {
    use prost_types::value::Kind;

    use super::*;

    fn spec(goal: i32) -> StudySpec {
        let parameter = |id: &str| ParameterSpec { id: id.into(), ..ParameterSpec::default() };
        StudySpec {
            metrics: vec![MetricSpec { id: "loss".into(), goal }],
            parameters: vec![
                ParameterSpec { integer: Some(Integers { min: 1, max: 20 }), ..parameter("Depth") },
                ParameterSpec {
                    double: Some(Doubles { min: 0.001, max: 1.0 }),
                    scale: LOG,
                    ..parameter("lr")
                },
                ParameterSpec {
                    categorical: Some(Categories { values: vec!["sgd".into(), "adam".into()] }),
                    ..parameter("kind")
                },
                ParameterSpec {
                    categorical: Some(Categories { values: vec!["True".into(), "False".into()] }),
                    ..parameter("fast")
                },
                ParameterSpec {
                    discrete: Some(Discrete { values: vec![2.0, 4.0, 8.0] }),
                    ..parameter("width")
                },
            ],
        }
    }

    fn trial(id: &str, state: i32, depth: f64, loss: Option<f64>) -> Trial {
        let parameter = |id: &str, kind| Parameter {
            id: id.into(),
            value: Some(prost_types::Value { kind: Some(kind) }),
        };
        Trial {
            id: id.into(),
            state,
            parameters: vec![
                parameter("Depth", Kind::NumberValue(depth)),
                parameter("lr", Kind::NumberValue(0.5)),
                parameter("kind", Kind::StringValue("adam".into())),
                parameter("fast", Kind::StringValue("True".into())),
                parameter("width", Kind::NumberValue(4.0)),
            ],
            measurement: loss.map(|value| Measurement { metrics: vec![Metric { id: "loss".into(), value }] }),
            client_id: "worker".into(),
            infeasible_reason: if state == INFEASIBLE { "no memory".into() } else { String::new() },
        }
    }

    /// A database as Vizier makes it, without the tables of operations.
    fn database(path: &Path, spec: StudySpec, trials: &[Trial]) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        runtime.block_on(async {
            let options = SqliteConnectOptions::new().filename(path).create_if_missing(true);
            let mut database = options.connect().await.expect("a database");
            for statement in [
                "CREATE TABLE studies (study_name VARCHAR PRIMARY KEY, owner_id VARCHAR, study_id VARCHAR, serialized_study BLOB)",
                "CREATE TABLE trials (trial_name VARCHAR PRIMARY KEY, owner_id VARCHAR, study_id VARCHAR, trial_id INTEGER, serialized_trial BLOB)",
            ] {
                sqlx::query(statement).execute(&mut database).await.expect(statement);
            }
            let study = Study { spec: Some(spec) }.encode_to_vec();
            sqlx::query("INSERT INTO studies VALUES ('owners/me/studies/mine', 'me', 'mine', ?)")
                .bind(study)
                .execute(&mut database)
                .await
                .expect("a study");
            for trial in trials {
                sqlx::query("INSERT INTO trials VALUES (?, 'me', 'mine', ?, ?)")
                    .bind(format!("owners/me/studies/mine/trials/{}", trial.id))
                    .bind(trial.id.parse::<i64>().expect("a number"))
                    .bind(trial.encode_to_vec())
                    .execute(&mut database)
                    .await
                    .expect("a trial");
            }
        });
    }

    #[test]
    fn a_study_of_vizier_becomes_one_of_ours() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("vizier.db");
        let trials = [
            trial("1", SUCCEEDED, 7.0, Some(3.5)),
            trial("2", INFEASIBLE, 20.0, None),
            trial("3", 2, 5.0, None),
            trial("4", SUCCEEDED, 9.0, Some(f64::NAN)),
        ];
        database(&path, spec(MINIMIZE), &trials);
        for name in ["mine", "owners/me/studies/mine"] {
            let read = read(&path, name).expect("a study").with_metric("loss");
            assert_eq!((read.trials.len(), read.without_value), (2, 1));
            let first = Configuration::new()
                .with("depth", 7)
                .with("lr", 0.5)
                .with("kind", "adam")
                .with("fast", true)
                .with("width", 4);
            assert_eq!(read.trials[0].configuration, first);
            assert_eq!(read.trials[0].measurements["loss"], 3.5);
            assert_eq!(read.trials[0].origin, "vizier/owners/me/studies/mine/trials/1");
            assert_eq!(read.trials[1].outcome, Outcome::infeasible("no memory"));
            let spec = read.study.spec().expect("a specification");
            assert_eq!(Configuration::from(spec.space.default_configuration()), first);
        }
    }

    #[test]
    fn what_cannot_be_taken_over_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("vizier.db");
        database(&path, spec(1), &[]);
        let problem = |name: &str| read(&path, name).expect_err("cannot be read").to_string();
        assert!(problem("other").contains("there is owners/me/studies/mine"));
        assert!(problem("mine").contains("maximises"));
        let mut nested = spec(MINIMIZE);
        nested.parameters[2].children.push(Child {});
        assert!(translate("x", &nested, &[]).expect_err("refused").contains("depend on kind"));
        std::fs::write(&path, "no database").expect("a file");
        assert!(problem("mine").contains("no database of Vizier"));
    }
}
