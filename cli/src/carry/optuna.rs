//! Studies of Optuna, from its RDB storage in SQLite (`optuna/storages/_rdb/models.py`, schema versions 1 to
//! 12): distributions become parameters, complete trials become measurements.
//!
//! Missing values are made up visibly: the values of the first complete trial are the defaults, and its one
//! objective is the metric of the study, minimised or maximised as there.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value as Json, json};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Row as _};
use treewright_client::{Configuration, Value};

use super::CarriedTrial;
use super::foreign::{Foreign, METRIC, check_names, json_of, our_name, read_with};
use crate::failure::Result;
use crate::study_file::StudyFile;

/// Steps of a parameter that are written out as choices, at most.
const CHOICES_MAX: f64 = 64.0;

pub(crate) fn read(path: &Path, name: &str) -> Result<Foreign> {
    read_with(path, read_study(path, name))
}

async fn read_study(path: &Path, name: &str) -> Result<Foreign, String> {
    let no_database = |error: sqlx::Error| format!("it is no database of Optuna: {error}");
    let options = SqliteConnectOptions::new().filename(path).read_only(true);
    let mut database = options.connect().await.map_err(no_database)?;
    let id = study_id(&mut database, name).await.map_err(no_database)??;
    let is_maximised = is_maximised(&mut database, id, name).await.map_err(no_database)??;
    let rows = sqlx::query(
        "SELECT t.number, p.param_name, p.param_value, p.distribution_json FROM trials t \
         JOIN trial_params p ON p.trial_id = t.trial_id \
         WHERE t.study_id = ? AND t.state = 'COMPLETE' ORDER BY t.number, p.param_id",
    )
    .bind(id)
    .fetch_all(&mut database)
    .await
    .map_err(no_database)?;
    let mut parameters: Vec<(String, Distribution)> = Vec::new();
    let mut assigned: BTreeMap<i64, Configuration> = BTreeMap::new();
    let mut names = BTreeSet::new();
    for row in rows {
        let cell = |place| -> Result<_, String> { row.try_get(place).map_err(no_database) };
        let (number, name): (i64, String) = (row.try_get(0).map_err(no_database)?, cell(1)?);
        let stored: f64 = row.try_get(2).map_err(no_database)?;
        let distribution = Distribution::read(&cell(3)?)
            .ok_or_else(|| format!("the distribution of {name} is of an unknown kind"))?;
        names.insert(name.clone());
        let name = our_name(&name);
        let value =
            distribution.value(stored).ok_or_else(|| format!("{name} of trial {number} is {stored}"))?;
        if !parameters.iter().any(|(known, _)| *known == name) {
            parameters.push((name.clone(), distribution));
        }
        assigned.entry(number).or_default().set(name, value);
    }
    check_names(names.iter().map(String::as_str))?;
    let values = sqlx::query(
        "SELECT t.number, v.value FROM trials t LEFT JOIN trial_values v ON v.trial_id = t.trial_id \
         WHERE t.study_id = ? AND t.state = 'COMPLETE' ORDER BY t.number",
    )
    .bind(id)
    .fetch_all(&mut database)
    .await
    .map_err(no_database)?;
    let first = assigned.values().next().cloned().unwrap_or_default();
    let study = study_file(&parameters, &first, is_maximised)?;
    let mut read = Foreign { study, trials: Vec::new(), without_value: 0, is_maximised };
    for row in values {
        let number: i64 = row.try_get(0).map_err(no_database)?;
        let value: Option<f64> = row.try_get(1).map_err(no_database)?;
        let Some(value) = value.filter(|value| value.is_finite()) else {
            read.without_value += 1;
            continue;
        };
        read.trials.push(CarriedTrial {
            configuration: assigned.remove(&number).unwrap_or_default(),
            measurements: [(METRIC.to_owned(), value)].into(),
            ..CarriedTrial::new(format!("optuna/{name}/{number}"), "optuna")
        });
    }
    Ok(read)
}

async fn is_maximised(
    database: &mut SqliteConnection,
    id: i64,
    name: &str,
) -> Result<Result<bool, String>, sqlx::Error> {
    let rows = sqlx::query("SELECT direction FROM study_directions WHERE study_id = ? ORDER BY objective")
        .bind(id)
        .fetch_all(database)
        .await?;
    let directions: Result<Vec<String>, _> = rows.iter().map(|row| row.try_get(0)).collect();
    Ok(match directions?.as_slice() {
        [one] if one == "MINIMIZE" => Ok(false),
        [one] if one == "MAXIMIZE" => Ok(true),
        [_] => Err(format!("{name} does not say whether it minimises or maximises")),
        many => Err(format!("{name} has {} objectives, and only one can be taken over", many.len())),
    })
}

async fn study_id(database: &mut SqliteConnection, name: &str) -> Result<Result<i64, String>, sqlx::Error> {
    let rows = sqlx::query("SELECT study_id, study_name FROM studies ORDER BY study_name")
        .fetch_all(database)
        .await?;
    let studies: Result<Vec<(i64, String)>, _> =
        rows.iter().map(|row| Ok::<_, sqlx::Error>((row.try_get(0)?, row.try_get(1)?))).collect();
    let studies = studies?;
    let found = studies.iter().find(|(_, known)| known == name).map(|(id, _)| *id);
    Ok(found.ok_or_else(|| {
        let names: Vec<&str> = studies.iter().map(|(_, name)| name.as_str()).collect();
        format!("there is no study {name}; there is {}", names.join(", "))
    }))
}

/// A distribution of Optuna (`optuna/distributions.py`).
#[derive(Clone, Debug, PartialEq)]
enum Distribution {
    Integer { low: i64, high: i64, step: i64, log: bool },
    Float { low: f64, high: f64, step: Option<f64>, log: bool },
    Categorical(Vec<Json>),
}

impl Distribution {
    fn read(text: &str) -> Option<Self> {
        let json: Json = serde_json::from_str(text).ok()?;
        let attributes = &json["attributes"];
        let number = |key: &str| attributes[key].as_f64();
        let whole = |key: &str| attributes[key].as_i64();
        let is_log = attributes["log"].as_bool().unwrap_or(false);
        Some(match json["name"].as_str()? {
            "IntDistribution" | "IntUniformDistribution" => Self::Integer {
                low: whole("low")?,
                high: whole("high")?,
                step: whole("step").unwrap_or(1),
                log: is_log,
            },
            "IntLogUniformDistribution" => {
                Self::Integer { low: whole("low")?, high: whole("high")?, step: 1, log: true }
            }
            "FloatDistribution" => {
                Self::Float { low: number("low")?, high: number("high")?, step: number("step"), log: is_log }
            }
            "UniformDistribution" => {
                Self::Float { low: number("low")?, high: number("high")?, step: None, log: false }
            }
            "LogUniformDistribution" => {
                Self::Float { low: number("low")?, high: number("high")?, step: None, log: true }
            }
            "DiscreteUniformDistribution" => {
                Self::Float { low: number("low")?, high: number("high")?, step: number("q"), log: false }
            }
            "CategoricalDistribution" => Self::Categorical(attributes["choices"].as_array()?.clone()),
            _ => return None,
        })
    }

    /// The value that Optuna stores as a number.
    fn value(&self, stored: f64) -> Option<Value> {
        match self {
            Self::Integer { .. } => Some(Value::Integer(stored as i64)),
            Self::Float { .. } => Some(Value::Float(stored)),
            Self::Categorical(choices) => {
                choices.get(stored as usize).map(|choice| value_of(choice, choices))
            }
        }
    }

    /// As a parameter of a study file.
    fn entry(&self, name: &str, default: &Value) -> Json {
        let scale = |log: bool| if log { "log" } else { "linear" };
        let mut entry = match self {
            Self::Integer { low, high, step, log } => match steps(*low as f64, *high as f64, *step as f64) {
                Some(count) if *step > 1 => {
                    let value = |index: i64| low.saturating_add(index.saturating_mul(*step));
                    let values: Vec<i64> = (0..count).map(value).collect();
                    json!({ "type": "categorical", "values": values })
                }
                _ => json!({ "type": "integer", "min": low, "max": high, "scale": scale(*log) }),
            },
            Self::Float { low, high, step: Some(step), .. } if steps(*low, *high, *step).is_some() => {
                let count = steps(*low, *high, *step).unwrap_or_default();
                let values: Vec<f64> = (0..count).map(|index| low + index as f64 * step).collect();
                json!({ "type": "categorical", "values": values })
            }
            Self::Float { low, high, log, .. } => {
                json!({ "type": "float", "min": low, "max": high, "scale": scale(*log) })
            }
            Self::Categorical(choices) => {
                let values: Vec<Json> =
                    choices.iter().map(|choice| json_of(&value_of(choice, choices))).collect();
                match values.as_slice() {
                    [Json::Bool(_), Json::Bool(_)] => json!({ "type": "boolean" }),
                    _ => json!({ "type": "categorical", "values": values }),
                }
            }
        };
        entry["name"] = json!(name);
        entry["default"] = json_of(default);
        entry
    }
}

/// The number of values of a stepped range, where they can be written out.
fn steps(low: f64, high: f64, step: f64) -> Option<i64> {
    let count = ((high - low) / step + 1e-9).floor() + 1.0;
    (step > 0.0 && count <= CHOICES_MAX).then_some(count as i64)
}

/// A choice; where kinds are mixed they become words.
fn value_of(choice: &Json, choices: &[Json]) -> Value {
    let all = |is: fn(&Json) -> bool| choices.iter().all(is);
    match choice {
        Json::Bool(boolean) if choices.len() == 2 && all(Json::is_boolean) => Value::Boolean(*boolean),
        Json::Number(number) if all(Json::is_i64) => Value::Integer(number.as_i64().unwrap_or_default()),
        Json::Number(number) if all(Json::is_number) => Value::Float(number.as_f64().unwrap_or_default()),
        Json::String(text) => Value::Text(text.clone()),
        other => Value::Text(other.to_string()),
    }
}

fn study_file(
    parameters: &[(String, Distribution)],
    first: &Configuration,
    is_maximised: bool,
) -> Result<StudyFile, String> {
    let entry = |(name, distribution): &(String, Distribution)| {
        let default = first.get(name).cloned();
        default.or_else(|| distribution.lowest()).map(|default| distribution.entry(name, &default))
    };
    let entries: Vec<Json> = parameters.iter().filter_map(entry).collect();
    if entries.is_empty() {
        return Err("no trial is complete, so that nothing is known of its parameters".into());
    }
    let objective = json!([{ "metric": METRIC, "maximise": is_maximised }]);
    let file = json!({ "parameters": entries, "objective": objective });
    serde_json::from_value(file).map_err(|error| error.to_string())
}

impl Distribution {
    /// A default where the first trial did not have the parameter.
    fn lowest(&self) -> Option<Value> {
        match self {
            Self::Integer { low, .. } => Some(Value::Integer(*low)),
            Self::Float { low, .. } => Some(Value::Float(*low)),
            Self::Categorical(choices) => choices.first().map(|choice| value_of(choice, choices)),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The tables as Optuna 4 makes them, without those that are not read.
    const TABLES: &[&str] = &[
        "CREATE TABLE studies (study_id INTEGER PRIMARY KEY, study_name VARCHAR(512) NOT NULL)",
        "CREATE TABLE study_directions (study_direction_id INTEGER PRIMARY KEY, direction VARCHAR(8) NOT NULL, \
         study_id INTEGER NOT NULL, objective INTEGER NOT NULL)",
        "CREATE TABLE trials (trial_id INTEGER PRIMARY KEY, number INTEGER, study_id INTEGER, state VARCHAR(8) NOT \
         NULL, datetime_start DATETIME, datetime_complete DATETIME)",
        "CREATE TABLE trial_params (param_id INTEGER PRIMARY KEY, trial_id INTEGER, param_name VARCHAR(512), \
         param_value FLOAT, distribution_json TEXT)",
        "CREATE TABLE trial_values (trial_value_id INTEGER PRIMARY KEY, trial_id INTEGER NOT NULL, objective INTEGER \
         NOT NULL, value FLOAT, value_type VARCHAR(7) NOT NULL)",
        "INSERT INTO studies VALUES (1, 'mine'), (2, 'up')",
        "INSERT INTO study_directions VALUES (1, 'MINIMIZE', 1, 0), (2, 'MAXIMIZE', 2, 0)",
        "INSERT INTO trials VALUES (1, 0, 1, 'COMPLETE', NULL, NULL), (2, 1, 1, 'FAIL', NULL, NULL), \
         (3, 2, 1, 'COMPLETE', NULL, NULL), (4, 3, 1, 'COMPLETE', NULL, NULL), \
         (5, 0, 2, 'COMPLETE', NULL, NULL)",
        r#"INSERT INTO trial_params VALUES
         (1, 1, 'Depth', 7, '{"name": "IntDistribution", "attributes": {"log": false, "step": 1, "low": 1, "high": 20}}'),
         (2, 1, 'lr', 0.5, '{"name": "FloatDistribution", "attributes": {"step": null, "low": 0.001, "high": 1.0, "log": true}}'),
         (3, 1, 'kind', 1, '{"name": "CategoricalDistribution", "attributes": {"choices": ["sgd", "adam"]}}'),
         (4, 3, 'Depth', 9, '{"name": "IntDistribution", "attributes": {"log": false, "step": 1, "low": 1, "high": 20}}'),
         (5, 3, 'lr', 0.25, '{"name": "FloatDistribution", "attributes": {"step": null, "low": 0.001, "high": 1.0, "log": true}}'),
         (6, 3, 'kind', 0, '{"name": "CategoricalDistribution", "attributes": {"choices": ["sgd", "adam"]}}'),
         (7, 4, 'Depth', 9, '{"name": "IntDistribution", "attributes": {"log": false, "step": 1, "low": 1, "high": 20}}'),
         (8, 5, 'Depth', 3, '{"name": "IntDistribution", "attributes": {"log": false, "step": 1, "low": 1, "high": 20}}')"#,
        "INSERT INTO trial_values VALUES (1, 1, 0, 3.5, 'FINITE'), (2, 3, 0, 2.5, 'FINITE'), (3, 4, 0, NULL, 'INF_POS'), \
         (4, 5, 0, 0.9, 'FINITE')",
    ];

    /// A database of two studies, of which one can be read.
    pub(in crate::carry) fn database(folder: &Path) -> std::path::PathBuf {
        let path = folder.join("optuna.db");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        runtime.block_on(async {
            let options = SqliteConnectOptions::new().filename(&path).create_if_missing(true);
            let mut database = options.connect().await.expect("a database");
            for statement in TABLES {
                sqlx::query(*statement).execute(&mut database).await.expect(statement);
            }
        });
        path
    }

    #[test]
    fn a_study_of_optuna_becomes_one_of_ours() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = database(folder.path());
        let read = read(&path, "mine").expect("a study").with_metric("loss");
        assert_eq!((read.trials.len(), read.without_value), (2, 1));
        let first = Configuration::new().with("depth", 7).with("lr", 0.5).with("kind", "adam");
        assert_eq!(read.trials[0].configuration, first);
        assert_eq!(read.trials[1].measurements["loss"], 2.5);
        assert_eq!(read.trials[1].origin, "optuna/mine/2");
        let spec = read.study.spec().expect("a specification");
        assert_eq!(Configuration::from(spec.space.default_configuration()), first);
    }

    #[test]
    fn a_study_that_maximises_does_so_here() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = database(folder.path());
        let up = read(&path, "up").expect("a study");
        let spec = up.study.spec().expect("a specification");
        assert_eq!(spec.objective.to_string(), "maximises value");
        assert_eq!(up.trials[0].measurements[METRIC], 0.9, "as it was measured");
        assert_eq!(up.metric_in(&spec), Ok(METRIC.to_owned()));
        let down = read(&path, "mine").expect("a study");
        assert!(down.metric_in(&spec).expect_err("other directions").contains("this one maximises value"));
        let spec = down.study.spec().expect("a specification");
        assert!(up.metric_in(&spec).expect_err("other directions").contains("this one minimises value"));
    }

    #[test]
    fn what_cannot_be_taken_over_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = database(folder.path());
        let problem = |name: &str| read(&path, name).expect_err("cannot be read").to_string();
        assert!(problem("other").contains("there is mine, up"));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        runtime.block_on(async {
            let mut database =
                SqliteConnectOptions::new().filename(&path).connect().await.expect("a database");
            let renamed = "UPDATE trial_params SET param_name = 'DEPTH' WHERE param_id = 4";
            sqlx::query(renamed).execute(&mut database).await.expect("a parameter");
        });
        assert!(problem("mine").contains("DEPTH and Depth would both be called depth"));
        std::fs::write(&path, "no database").expect("a file");
        assert!(problem("mine").contains("no database of Optuna"));
    }

    #[test]
    fn distributions_of_earlier_versions_are_read() {
        let read = |text: &str| Distribution::read(text).expect("a distribution");
        let old = read(
            r#"{"name": "DiscreteUniformDistribution", "attributes": {"low": 0, "high": 1, "q": 0.25}}"#,
        );
        let entry = old.entry("x", &Value::Float(0.5));
        assert_eq!(entry["values"].as_array().map(Vec::len), Some(5));
        let even =
            read(r#"{"name": "IntUniformDistribution", "attributes": {"low": 2, "high": 64, "step": 2}}"#);
        assert_eq!(even.entry("x", &Value::Integer(2))["values"][31], 64);
        assert_eq!(Distribution::read(r#"{"name": "Other", "attributes": {}}"#), None);
        assert_eq!(our_name("Max-Depth"), "max_depth");
        assert_eq!(our_name("2x"), "p_2x");
    }
}
