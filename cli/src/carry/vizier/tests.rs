//! Reading studies of Vizier: messages made here, and a database that Vizier 0.1.24 wrote, compared with the
//! values that Vizier's own client reads.

use prost_types::value::Kind;

use super::messages::*;
use super::*;

fn spec(goal: i32) -> StudySpec {
    let parameter = |id: &str| ParameterSpec { id: id.into(), ..ParameterSpec::default() };
    StudySpec {
        metrics: vec![MetricSpec { id: "loss".into(), goal }],
        parameters: vec![
            ParameterSpec {
                integer: Some(Integers { min: 1, max: 20, default: None }),
                ..parameter("Depth")
            },
            ParameterSpec {
                double: Some(Doubles { min: 0.001, max: 1.0, default: None }),
                scale: LOG,
                ..parameter("lr")
            },
            ParameterSpec {
                categorical: Some(Categories { values: vec!["sgd".into(), "adam".into()], default: None }),
                ..parameter("kind")
            },
            ParameterSpec {
                categorical: Some(Categories { values: vec!["True".into(), "False".into()], default: None }),
                ..parameter("fast")
            },
            ParameterSpec {
                discrete: Some(Discrete { values: vec![2.0, 4.0, 8.0], default: None }),
                ..parameter("width")
            },
        ],
    }
}

fn trial(id: &str, state: i32, depth: f64, loss: Option<f64>) -> Trial {
    let parameter =
        |id: &str, kind| Parameter { id: id.into(), value: Some(prost_types::Value { kind: Some(kind) }) };
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
        measurement: loss
            .map(|value| Measurement { metrics: vec![MetricValue { id: "loss".into(), value }] }),
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
        let insert = "INSERT INTO studies VALUES ('owners/me/studies/mine', 'me', 'mine', ?)";
        sqlx::query(insert).bind(study).execute(&mut database).await.expect("a study");
        for trial in trials {
            let (name, id) = (format!("owners/me/studies/mine/trials/{}", trial.id), trial.id.parse::<i64>());
            let saving = sqlx::query("INSERT INTO trials VALUES (?, 'me', 'mine', ?, ?)").bind(name);
            let saving = saving.bind(id.expect("a number")).bind(trial.encode_to_vec());
            saving.execute(&mut database).await.expect("a trial");
        }
    });
}

/// A database of one study with two trials.
pub(in crate::carry) fn example(path: &Path) {
    let trials = [trial("1", SUCCEEDED, 7.0, Some(3.5)), trial("2", INFEASIBLE, 20.0, None)];
    database(path, spec(MINIMIZE), &trials);
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
        let first = Configuration::new().with("depth", 7).with("lr", 0.5).with("kind", "adam");
        let first = first.with("fast", true).with("width", 4);
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
    database(&path, spec(0), &[]);
    let problem = |name: &str| read(&path, name).expect_err("cannot be read").to_string();
    assert!(problem("other").contains("there is owners/me/studies/mine"));
    assert!(problem("mine").contains("does not say whether"));
    let mut nested = spec(MINIMIZE);
    nested.parameters[2].children.push(Child {});
    assert!(translate("x", &nested, &[]).expect_err("refused").contains("depend on kind"));
    let mut alike = spec(MINIMIZE);
    alike.parameters[1].id = "depth".into();
    assert!(translate("x", &alike, &[]).expect_err("refused").contains("both be called depth"));
    std::fs::write(&path, "no database").expect("a file");
    assert!(problem("mine").contains("no database of Vizier"));
}

/// A trial as Vizier's own client reads it.
#[derive(serde::Deserialize)]
struct Written {
    id: u64,
    client: String,
    infeasible: Option<String>,
    parameters: BTreeMap<String, serde_json::Value>,
    cost: Option<f64>,
}

/// The database that Vizier 0.1.24 wrote (`tests/peers/service/vizier_database.py`).
fn written(path: &Path) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        let options = SqliteConnectOptions::new().filename(path).create_if_missing(true);
        let mut database = options.connect().await.expect("a database");
        sqlx::raw_sql(include_str!("written.sql")).execute(&mut database).await.expect("its tables");
    });
}

#[test]
fn every_trial_that_vizier_wrote_is_read_as_vizier_reads_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vizier.db");
    written(&path);
    let study = read(&path, "owners/ann/studies/builds").expect("a study");
    let spec = study.study.spec().expect("a specification");
    let study = study.with_metric("render_ms");
    let vizier: Vec<Written> = serde_json::from_str(include_str!("written.json")).expect("trials");
    let (done, open): (Vec<_>, Vec<_>) =
        vizier.iter().partition(|trial| trial.cost.is_some() || trial.infeasible.is_some());
    assert_eq!((done.len(), open.len(), study.trials.len(), study.without_value), (11, 1, 11, 0));
    for (theirs, ours) in done.iter().zip(&study.trials) {
        assert_eq!(ours.origin, format!("vizier/owners/ann/studies/builds/trials/{}", theirs.id));
        assert_eq!(ours.client_id, theirs.client);
        assert_eq!(ours.measurements.get("render_ms").copied(), theirs.cost);
        match &theirs.infeasible {
            Some(reason) => assert_eq!(ours.outcome, Outcome::infeasible(reason)),
            None => assert_eq!(ours.outcome, Outcome::Ok),
        }
        assert_eq!(theirs.parameters.len(), 9);
        for (name, value) in &theirs.parameters {
            let ours = ours.configuration.get(&our_name(name)).expect("a value");
            match (ours, value) {
                (Value::Integer(ours), value) => assert_eq!(Some(*ours as f64), value.as_f64(), "{name}"),
                (Value::Float(ours), value) => assert_eq!(Some(*ours), value.as_f64(), "{name}"),
                (Value::Text(ours), value) => assert_eq!(Some(ours.as_str()), value.as_str(), "{name}"),
                (Value::Boolean(ours), value) => {
                    assert_eq!(Some(if *ours { "True" } else { "False" }), value.as_str(), "{name}");
                }
            }
        }
        spec.space.complete(&ours.configuration).expect("inside the space");
    }
    assert_eq!(spec.objective.terms()[0].metric, "render_ms");
    let defaults = Configuration::from(spec.space.default_configuration());
    let first = &study.trials[0].configuration;
    for (name, value) in [
        ("alpha", Value::Float(0.25)),
        ("depth", Value::Integer(8)),
        ("width", Value::Integer(8)),
        ("ratio", Value::Float(0.5)),
        ("kind", Value::Text("median".into())),
        ("spatial_splits", Value::Boolean(true)),
        ("momentum", first.get("momentum").expect("a value").clone()),
    ] {
        assert_eq!(defaults.get(name), Some(&value), "{name}");
    }
}

#[test]
fn what_vizier_wrote_and_cannot_be_taken_over_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vizier.db");
    written(&path);
    for (name, problem) in [
        ("builds", "builds is ambiguous: say which of owners/ann/studies/builds, owners/bob/studies/builds"),
        ("two", "has 2 metrics"),
        ("nested", "has parameters that depend on builder"),
    ] {
        let error = read(&path, name).expect_err("cannot be read").to_string();
        assert!(error.contains(problem), "{error}");
    }
    assert!(read(&path, "owners/bob/studies/builds").expect("a study").trials.is_empty());
    let upside = read(&path, "upside").expect("a study that maximises");
    let spec = upside.study.spec().expect("a specification");
    assert_eq!((spec.objective.to_string().as_str(), upside.is_maximised), ("maximises render_ms", true));
}
