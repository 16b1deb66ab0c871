//! From every released version of the schema to the newest: a database with data of its time is brought up to
//! date with all its contents, and an interrupted migration leaves no trace.
//!
//! A database of version k is made by the first k migrations, and its rows are written as the program of that
//! version did: without columns, fields and formats that came later.

mod common;

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use common::{alter, change, completed, foreign, open, spec};
use sqlx::migrate::{Migrate, Migrator};
use sqlx::{AssertSqlSafe, Connection as _, Executor as _};
use treewright_core::decision::Decision;
use treewright_core::study::StudySpec;
use treewright_core::trial::{Explanation, Outcome, Rule, Trial};
use treewright_core::tuner::{Ask, StateRecord, Tuner, VisitDecision};
use treewright_store::tokens::TokenStore as _;
use treewright_store::{OpenError, PostgresAddress, PostgresStore, SqliteStore, SqliteTokens, Store};

/// The first `count` migrations of a folder.
async fn first(folder: &str, count: usize) -> Migrator {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../migrations").join(folder);
    let mut all = Migrator::new(folder).await.expect("migrations");
    all.migrations = Cow::Owned(all.migrations.iter().take(count).cloned().collect());
    all
}

async fn count(folder: &str) -> usize {
    first(folder, usize::MAX).await.migrations.len()
}

/// A study whose first state is being searched.
fn searched() -> (StudySpec, StateRecord) {
    let spec = spec();
    let policy = treewright_core::policy::Policy { epsilon: 1.0, ..spec.policy.clone() };
    let spec = StudySpec { policy, ..spec };
    let mut tuner = Tuner::new(Arc::new(spec.clone())).expect("valid");
    let indicators = [("triangles".to_owned(), 10.0)].into();
    let ask = Ask { client_id: "renderer".to_owned(), indicators, ..Ask::default() };
    let (_, mut change) = tuner.suggest(&ask, 0).expect("a trial");
    let state = change.states.pop().expect("the state is written");
    assert!(state.search.is_some(), "it is explored");
    (spec, state)
}

/// The trials as they come back: the first version stored less of its reasons.
fn trials(version: usize) -> [Trial; 2] {
    let earlier = |mut trial: Trial| {
        let mut reason = trial.reason();
        reason.summary = "The next point.".to_owned();
        if version < 2 {
            reason.explanation = Explanation::default();
        }
        trial.decision = Decision::recorded(trial.mode(), reason);
        trial.standard_errors.clear();
        trial
    };
    [earlier(completed(1, 1, Outcome::Ok)), earlier(open(2))]
}

/// Rows that both databases hold in equal words: a study, a state, a visit, two trials.
fn rows(version: usize, truth: &str, bytes: impl Fn(&[u8]) -> String) -> Vec<String> {
    let (spec, state) = searched();
    let quote = |json: &serde_json::Value| format!("'{}'", json.to_string().replace('\'', "''"));
    let mut specification = serde_json::to_value(&spec).expect("plain");
    let fields = specification.as_object_mut().expect("an object");
    fields.remove("policy");
    // Policies knew no more than this in the first version.
    let policy = serde_json::json!({
        "epsilon": 1.0, "search": "auto", "predictor": "nearest_neighbour", "trials_per_state": 80,
        "replicates": 1, "lease_s": 60, "pinned": null
    });
    let indicators = serde_json::to_value(&state.indicators).expect("plain");
    let search = state.search.as_ref().expect("searched");
    let (search_column, search) = match version {
        ..3 => ("search", quote(&serde_json::to_value(search).expect("plain"))),
        _ => ("search_packed", bytes(&search.pack())),
    };
    let mut reason = serde_json::json!({
        "summary": "The next point.", "source": "nelder_mead", "step": "reflect",
        "neighbours": [{"state_id": 1, "distance": 0.25, "best_cost": 12.5}]
    });
    let mut weighed = ("", String::new());
    if version >= 2 {
        let explanation = open(1).reason().explanation;
        let explanation = serde_json::to_value(&explanation).expect("plain");
        reason.as_object_mut().expect("an object").insert("explanation".to_owned(), explanation);
        let of_visit = Explanation { epsilon: Some(0.1), ..Explanation::of(Rule::Explore) };
        weighed = (", weighed", format!(", {}", quote(&serde_json::to_value(of_visit).expect("plain"))));
    }
    let configuration = r#"'{"compact":true,"cost":2.0,"leaf":8,"quality":"high"}'"#;
    let kept = serde_json::json!({"exploit": {
        "configuration": {
            "leaf": {"integer": 8}, "cost": {"float": 2.0}, "quality": {"text": "high"}, "compact": {"boolean": true}
        },
        "mode": "exploit", "predicted_cost": 0.1,
        "reason": {"summary": "As it was.", "source": "best_known", "step": "", "neighbours": []}
    }});
    let fingerprint = serde_json::json!({
        "cpu_model": "a \"fast\" one", "isa": "avx512", "threads": 2, "software": {"embree": "4.4.0"}
    });
    let reason = quote(&reason);
    let trial_row = |number, state, rest: &str, measurements| {
        format!(
            "INSERT INTO trials (study, number, client_id, state_id, mode, state, predicted_cost, late, create_ms, \
             lease_expire_ms, configuration, indicators, measurements, reason, fingerprint, outcome, cost, \
             complete_ms, completion) VALUES (1, {number}, 'renderer', 1, 'EXPLORE', '{state}', 0.3333333333333333, \
             {truth}, 1000, 60000, {configuration}, '{{\"triangles\":0.30000000000000004}}', '{measurements}', \
             {reason}, {}, {rest})",
            quote(&fingerprint)
        )
    };
    vec![
        format!(
            "INSERT INTO studies (name, specification, policy, create_ms) VALUES ('hall', {}, {}, 5)",
            quote(&specification),
            quote(&policy)
        ),
        format!(
            "INSERT INTO states (study, id, indicators, {search_column}) VALUES (1, 1, {}, {search})",
            quote(&indicators)
        ),
        format!(
            "INSERT INTO visits (study, client_id, state_id, number, decision{}) VALUES (1, 'renderer', 1, 3, {}{})",
            weighed.0,
            quote(&kept),
            weighed.1
        ),
        trial_row(1, "COMPLETED", "'OK', 1.5, 2000, 1", r#"{"render_ms":1.5}"#),
        trial_row(2, "OPEN", "NULL, NULL, NULL, NULL", "{}"),
    ]
}

/// All of it is there, and the study goes on.
async fn goes_on(store: &dyn Store, version: usize) {
    let (spec, state) = searched();
    let loaded = store.load("hall").await.unwrap();
    assert_eq!(loaded.study.spec.first_difference(&spec), None);
    assert_eq!((loaded.study.create_ms, loaded.study.spec.policy.epsilon), (5, 1.0));
    assert_eq!(loaded.snapshot.states, [state], "the search stands where it stood");
    let visit = &loaded.snapshot.visits[0];
    assert_eq!((visit.client_id.as_str(), visit.number), ("renderer", 3));
    let VisitDecision::Exploit { said, .. } = &visit.decision else {
        panic!("{visit:?}");
    };
    assert_eq!(said.as_deref(), Some("As it was."), "as it was said then");
    assert_eq!(loaded.snapshot.models_since, 0);
    let [finished, running] = trials(version);
    assert_eq!(loaded.open_trials, [running]);
    let raw = store.get_trial("hall", 1).await.unwrap();
    assert_eq!(raw.check(&spec.space).unwrap(), finished);
    let statistics = store.get_study("hall").await.unwrap().statistics;
    assert_eq!((statistics.trials, statistics.completed_trials, statistics.open_trials), (2, 1, 1));

    let more = change(vec![completed(2, 2, Outcome::Ok), open(3)]);
    store.commit(&loaded.fence, &[more]).durable().await.unwrap();
    let again = store.load("hall").await.unwrap();
    assert_eq!((again.snapshot.last_trial, again.open_trials.len()), (3, 1));
}

/// A file of version `version`.
async fn file(folder: &Path, version: usize) -> PathBuf {
    let path = folder.join(format!("version_{version}.db"));
    let mut connection = foreign(&path).await;
    connection.execute("PRAGMA application_id = 0x54577274; PRAGMA journal_mode = WAL").await.unwrap();
    first("sqlite", version).await.run(&mut connection).await.unwrap();
    let hex = |bytes: &[u8]| {
        let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("x'{digits}'")
    };
    for row in rows(version, "0", hex) {
        connection.execute(AssertSqlSafe(row)).await.unwrap();
    }
    if version >= 8 {
        connection.execute("UPDATE studies SET uid = '0123456789abcdef'").await.unwrap();
    }
    if version >= 3 {
        connection.execute("INSERT INTO checkpoints VALUES (1, 1, 0, 1, x'0102')").await.unwrap();
    }
    if version >= 4 {
        let token = "INSERT INTO tokens (id, name, hash, scope, studies, quota, create_ms) VALUES \
                     ('abc', 'farm', zeroblob(32), 'TUNE', '[\"hall*\"]', '{}', 7)";
        connection.execute(token).await.unwrap();
    }
    connection.close().await.unwrap();
    path
}

#[tokio::test]
async fn every_released_file_is_brought_up_to_date() {
    let folder = tempfile::tempdir().unwrap();
    let newest = count("sqlite").await;
    assert!(newest >= 4, "migrations that were released are never removed");
    for version in 1..=newest {
        let path = file(folder.path(), version).await;
        // Opening compares the tables with those of a new database.
        let store =
            SqliteStore::open(&path).await.unwrap_or_else(|error| panic!("version {version}: {error}"));
        goes_on(&store, version).await;
        let checkpoint = store.load("hall").await.unwrap().checkpoint;
        assert_eq!(checkpoint.map(|checkpoint| checkpoint.bytes), (version >= 3).then(|| vec![1, 2]));
        store.close().await;
        let tokens = SqliteTokens::open(&path).await.unwrap();
        assert_eq!(tokens.list().await.unwrap().len(), usize::from(version >= 4));
        tokens.close().await;
        treewright_store::maintenance::check(&path).await.unwrap();
    }
}

/// A file whose next migration fails at its end is left as it was, and goes on once the obstacle is gone.
#[tokio::test]
async fn a_migration_of_a_file_happens_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    for (version, obstacle, removed, first_made) in [
        (
            1,
            "ALTER TABLE visits ADD COLUMN account TEXT",
            "ALTER TABLE visits DROP COLUMN account",
            "weighed",
        ),
        (
            2,
            "ALTER TABLE states ADD COLUMN search_packed BLOB",
            "ALTER TABLE states DROP COLUMN search_packed",
            "checkpoints",
        ),
        (3, "CREATE TABLE token_revision (x)", "DROP TABLE token_revision", "tokens"),
    ] {
        let path = file(folder.path(), version).await;
        alter(&path, obstacle).await;
        for _ in 0..2 {
            let error = SqliteStore::open(&path).await.expect_err("an obstacle");
            assert!(matches!(error, OpenError::Other { .. }), "{error}");
        }
        let mut other = foreign(&path).await;
        let applied: i64 = sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations")
            .fetch_one(&mut other)
            .await
            .unwrap();
        assert_eq!(applied, version as i64);
        let traces: i64 = sqlx::query_scalar("SELECT count(*) FROM sqlite_master WHERE instr(sql, $1) > 0")
            .bind(first_made)
            .fetch_one(&mut other)
            .await
            .unwrap();
        assert_eq!(traces, 0, "{first_made} is there before its version");
        other.execute(removed).await.unwrap();
        other.close().await.unwrap();
        let store = SqliteStore::open(&path).await.unwrap();
        goes_on(&store, version).await;
        store.close().await;
    }
}

async fn postgres(database: &treewright_test_postgres::Database) -> Result<PostgresStore, OpenError> {
    let address = PostgresAddress::parse(database.url()).expect("an address");
    PostgresStore::open(address, "http://127.0.0.1:1", Duration::ZERO).await
}

#[tokio::test]
async fn every_released_database_of_postgresql_is_brought_up_to_date() {
    for version in 1..=count("postgres").await {
        let database = treewright_test_postgres::Database::create().await;
        let mut connection = database.connect().await;
        first("postgres", version).await.run(&mut connection).await.unwrap();
        let hex = |bytes: &[u8]| {
            let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
            format!("'\\x{digits}'")
        };
        // Its first version came when searches were packed already.
        for row in rows(3, "false", hex) {
            let row = row.replace("search_packed", "search");
            connection.execute(AssertSqlSafe(row)).await.unwrap();
        }
        connection.close().await.unwrap();
        let store = postgres(&database).await.unwrap_or_else(|error| panic!("version {version}: {error}"));
        goes_on(&store, 3).await;
        store.close().await;
    }
}

/// The last object of the first migration exists already: nothing of the migration stays.
#[tokio::test]
async fn a_migration_of_postgresql_happens_whole_or_not_at_all() {
    let database = treewright_test_postgres::Database::create().await;
    let mut connection = database.connect().await;
    let obstacle = "CREATE FUNCTION refuse_change_of_completed_trial() RETURNS trigger LANGUAGE plpgsql AS \
                    'BEGIN RETURN new; END'";
    connection.execute(obstacle).await.unwrap();
    for _ in 0..2 {
        let error = postgres(&database).await.err().expect("an obstacle");
        assert!(matches!(error, OpenError::Refused { .. }), "{error}");
    }
    let applied = connection.list_applied_migrations("_sqlx_migrations").await.unwrap();
    assert!(applied.is_empty());
    let tables: i64 =
        sqlx::query_scalar("SELECT count(*) FROM pg_class WHERE relname IN ('studies', 'trials')")
            .fetch_one(&mut connection)
            .await
            .unwrap();
    assert_eq!(tables, 0);
    connection.execute("DROP FUNCTION refuse_change_of_completed_trial()").await.unwrap();
    postgres(&database).await.expect("nothing is in the way").close().await;
}

/// Only an accelerator: a study is worth more than the search of one of its states.
#[tokio::test]
async fn a_search_that_cannot_be_read_begins_anew() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), 4).await;
    alter(&path, "UPDATE states SET search_packed = x'00ff00ff'").await;
    let store = SqliteStore::open(&path).await.unwrap();
    let loaded = store.load("hall").await.unwrap();
    assert_eq!(loaded.snapshot.states.iter().filter(|state| state.search.is_some()).count(), 0);
    assert_eq!(loaded.open_trials.len(), 1);
}
