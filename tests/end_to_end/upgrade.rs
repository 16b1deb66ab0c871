//! A database that a released version wrote opens in this one, and its searches go on where they stood.
//!
//! `tests/released/VERSION` holds such a database and the next answers on it (`answers.json`). Where this
//! version gives others on purpose, they are recorded again by
//! `TREEWRIGHT_RECORD_CHANGES=1 cargo test --workspace --test end_to_end upgrade`.
//! To record another version: check it out, then
//! `TREEWRIGHT_RECORD=FOLDER cargo test --workspace --test end_to_end upgrade`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tonic::transport::Channel;
use treewright_client::Space;
use treewright_proto::convert::space_to_wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as pb, value::Kind};
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::workspace;

use crate::wire;

/// Trials of each study before the database is put away.
const TRIALS: usize = 48;
/// The states that its two clients visit in turn, four trials at a time.
const STATES: [f64; 3] = [0.1, 0.45, 0.8];
/// A state that nobody has met before.
const UNSEEN: f64 = 0.6;

type Client = TuningServiceClient<Channel>;

/// A study for each search, each predictor and each rule of the policy that decides by itself.
fn policies() -> Vec<(String, pb::Policy)> {
    let plain = pb::Policy { epsilon: Some(0.7), trials_per_state: 30, ..pb::Policy::default() };
    let searches = (1..=5).map(|search| (format!("search-{search}"), pb::Policy { search, ..plain.clone() }));
    let predictors = (1..=7)
        .map(|predictor| (format!("predictor-{predictor}"), pb::Policy { predictor, ..plain.clone() }));
    let rules = [
        ("budget", pb::Policy { regret_budget: Some(0.3), ..plain.clone() }),
        ("gain", pb::Policy { weigh_gain: true, ..plain.clone() }),
        // Version 0.1.0 recorded it with `freeze_risk`, which is ignored since.
        ("risk", plain.clone()),
        ("shadow", pb::Policy { operation: pb::Operation::Shadow as i32, ..plain.clone() }),
        ("replicates", pb::Policy { replicates: 2, warm_up: 1, epsilon_halves_after: 6, ..plain.clone() }),
    ];
    searches.chain(predictors).chain(rules.map(|(name, policy)| (name.to_owned(), policy))).collect()
}

/// Mixed and conditional: leaf sizes in order, a cost on a logarithmic scale, and one parameter of each of
/// two builders.
fn study(policy: pb::Policy) -> pb::Study {
    let space = Space::builder().categorical("builder", ["sah", "morton"]).default("sah");
    let space = space.integer("fewest", 1..=32).default(1).integer("most", 1..=32).default(32);
    let space = space.float("traversal_cost", 0.1..=10.0).log().default(1.0).active_if("builder", ["sah"]);
    let space = space.integer("bits", 3..=10).default(10).active_if("builder", ["morton"]);
    let space = space.boolean("compact").default(false).less_or_equal("fewest", "most").build();
    let space = Some(space_to_wire(&space.expect("a space")));
    pb::Study { space, policy: Some(policy), ..wire::study() }
}

/// A measurement of the pretend renderer: another optimum in each state, and noise from the trial's number.
fn render_ms(configuration: &pb::Configuration, near: f64, trial: usize) -> f64 {
    let number = |name: &str| match configuration.values.get(name).and_then(|value| value.kind.clone()) {
        Some(Kind::Integer(value)) => value as f64,
        Some(Kind::Float(value)) => value,
        Some(Kind::Boolean(value)) => f64::from(u8::from(value)),
        _ => 0.0,
    };
    let is_morton = configuration.values["builder"].kind == Some(Kind::Text("morton".into()));
    let branch =
        if is_morton { 3.0 + (number("bits") - 8.0).abs() } else { number("traversal_cost").ln().abs() };
    let noise = ((trial * 7919) % 101) as f64 / 101.0 - 0.5;
    let leaves = (number("most") - 6.0 - 20.0 * near).powi(2) / 60.0 + number("fewest") / 16.0;
    (20.0 + leaves + branch + 2.0 * near * number("compact")) * (1.0 + 0.04 * noise)
}

/// A configuration as comparable text, its floats to nine digits: logarithms of another library differ in the
/// last.
fn text(configuration: &pb::Configuration) -> String {
    let value = |value: &pb::Value| match &value.kind {
        Some(Kind::Float(float)) => format!("{float:.8e}"),
        other => format!("{other:?}"),
    };
    configuration.values.iter().map(|(name, it)| format!("{name}={} ", value(it))).collect()
}

fn report(trial: &pb::Trial, near: f64, number: usize) -> pb::ReportRequest {
    let configuration = trial.configuration.as_ref().expect("a trial has a configuration");
    let infeasible = number % 17 == 5;
    let kind = if infeasible {
        pb::outcome::Kind::Infeasible(pb::Infeasible { reason: "too deep".into() })
    } else {
        pb::outcome::Kind::Ok(pb::Ok {})
    };
    let render_ms = render_ms(configuration, near, number);
    pb::ReportRequest {
        trial: trial.name.clone(),
        measurements: BTreeMap::from([("render_ms".to_owned(), render_ms)]),
        outcome: Some(pb::Outcome { kind: Some(kind) }),
        ..pb::ReportRequest::default()
    }
}

/// Writes the trials of a study.
async fn teach(client: &mut Client, id: &str, policy: pb::Policy) {
    let request = pb::CreateStudyRequest { study_id: id.into(), study: Some(study(policy)) };
    let study = client.create_study(request).await.expect("the study is taken").into_inner().name;
    for number in 0..TRIALS {
        let near = STATES[number / 4 % STATES.len()];
        let who = if number / 12 % 2 == 0 { "one" } else { "two" };
        let trial = client.suggest(wire::suggestion(&study, who, near)).await.expect("a trial").into_inner();
        client.report(report(&trial, near, number)).await.expect("the report is taken");
    }
}

/// The next answers: to a client that comes back to a state, and to one in an unknown state.
async fn answers(client: &mut Client) -> Value {
    let mut answers = BTreeMap::new();
    for (id, _) in policies() {
        let mut next = Vec::new();
        for (step, near) in [STATES[0], UNSEEN, STATES[2], UNSEEN].into_iter().enumerate() {
            let question = wire::suggestion(&format!("studies/{id}"), "one", near);
            let trial = client.suggest(question).await.expect("a trial").into_inner();
            let configuration = text(trial.configuration.as_ref().expect("a configuration"));
            next.push(format!("mode {} {configuration}", trial.mode));
            client.report(report(&trial, near, TRIALS + step)).await.expect("the report is taken");
        }
        answers.insert(id, next);
    }
    json!(answers)
}

/// Records what this version writes and answers.
async fn record(folder: &Path) {
    std::fs::create_dir_all(folder).expect("a folder to record to");
    let database = folder.join("tuning.db");
    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    for (id, policy) in policies() {
        teach(&mut client, &id, policy).await;
    }
    assert!(daemon.terminate().success(), "the daemon ends and folds its log into the file");
    let scratch = tempfile::tempdir().expect("a scratch folder");
    write(folder, &answers_of(&database, scratch.path()).await);
}

fn write(folder: &Path, answers: &Value) {
    let text = serde_json::to_string_pretty(answers).expect("JSON");
    std::fs::write(folder.join("answers.json"), text + "\n").expect("the answers are written");
}

/// The answers of this version on a copy of a database.
async fn answers_of(database: &Path, scratch: &Path) -> Value {
    let copy = scratch.join("tuning.db");
    std::fs::copy(database, &copy).expect("the recorded database is there");
    let daemon = Daemon::start(&copy);
    answers(&mut wire::connect(daemon.url()).await).await
}

fn released() -> Vec<PathBuf> {
    let folder = workspace().join("tests/released");
    let entries = std::fs::read_dir(folder).expect("recorded versions");
    entries.map(|entry| entry.expect("a version").path()).filter(|path| path.is_dir()).collect()
}

#[tokio::test]
async fn a_database_of_every_released_version_goes_on_with_the_same_suggestions() {
    if let Some(folder) = std::env::var_os("TREEWRIGHT_RECORD") {
        return record(Path::new(&folder)).await;
    }
    let versions = released();
    assert!(!versions.is_empty(), "there is a recorded version");
    for version in versions {
        let scratch = tempfile::tempdir().expect("a scratch folder");
        let found = answers_of(&version.join("tuning.db"), scratch.path()).await;
        if std::env::var_os("TREEWRIGHT_RECORD_CHANGES").is_some() {
            write(&version, &found);
        }
        let text = std::fs::read_to_string(version.join("answers.json")).expect("recorded answers");
        let expected: Value = serde_json::from_str(&text).expect("JSON");
        for (id, _) in policies() {
            assert_eq!(found[&id], expected[&id], "{id}, recorded by {}", version.display());
        }
    }
}
