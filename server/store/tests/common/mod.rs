//! Studies and changes to store.
#![allow(dead_code, unused_macros)] // Each test file uses its own part.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _, Executor as _};
use treewright_core::configuration::RawConfiguration;
use treewright_core::decision::{
    BudgetStatus, Choice, Decision, Exploit, ExploitRule, ExploitSource, ExplorationEstimate, Explore,
    ExploreRule, ExploredPoint, Step,
};
use treewright_core::policy::{Policy, SearchMethod};
use treewright_core::space::{Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Fingerprint, Mode, Neighbour, Outcome, Trial, TrialState};
use treewright_core::tuner::{Account, Change, StateRecord, Visit, VisitDecision};
use treewright_core::value::Value;
use treewright_store::filter::{Filter, Order};
use treewright_store::{PostgresAddress, PostgresStore, Store, TrialQuery};

/// Runs each function of the suite on each store, or on what else is made in memory, of a path and of a
/// database.
macro_rules! contract {
    ($($name:ident),* $(,)?) => {
        contract! {
            treewright_store::MemoryStore::new();
            path => treewright_store::SqliteStore::open(&path).await.expect("a new database");
            database => crate::common::postgres(&database).await;
            $($name),*
        }
    };
    ($memory:expr; $path:ident => $sqlite:expr; $database:ident => $postgres:expr; $($name:ident),* $(,)?) => {
        mod memory {
            $(#[tokio::test] async fn $name() {
                super::$name(&$memory).await;
            })*
        }
        mod sqlite {
            $(#[tokio::test] async fn $name() {
                let directory = tempfile::tempdir().expect("a directory");
                let $path = directory.path().join("studies.db");
                super::$name(&$sqlite).await;
            })*
        }
        mod postgres {
            $(#[tokio::test] async fn $name() {
                let $database = treewright_test_postgres::Database::create().await;
                super::$name(&$postgres).await;
            })*
        }
    };
}

/// A store on a database, as one replica of several.
pub(crate) async fn postgres(database: &treewright_test_postgres::Database) -> PostgresStore {
    let address = PostgresAddress::parse(database.url()).expect("an address");
    PostgresStore::open(address, "http://127.0.0.1:1", Duration::ZERO).await.expect("a new database")
}

/// Another program's connection to a database file.
pub(crate) async fn foreign(path: &Path) -> SqliteConnection {
    let options = SqliteConnectOptions::new().filename(path).create_if_missing(true);
    options.connect().await.expect("a connection")
}

/// Has another program change a database file.
pub(crate) async fn alter(path: &Path, sql: &'static str) {
    let mut other = foreign(path).await;
    other.execute(sql).await.expect("it is done");
    other.close().await.expect("closed");
}

/// The migration of a program that is newer than this one.
pub(crate) const NEWER_MIGRATION: &str = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
     VALUES (9999, 'from the future', true, x'00', 1)";

/// A question for trials.
pub(crate) fn ask(filter: &str, order: &str, size: u32) -> TrialQuery {
    let (filter, order) = (Filter::parse(filter).expect("a filter"), Order::parse(order).expect("an order"));
    TrialQuery { filter, order, after: None, size }
}

/// The trials of the study "hall" that a filter finds.
pub(crate) async fn numbers(store: &dyn Store, filter: &str) -> Vec<u64> {
    let page = store.query_trials("hall", &ask(filter, "", 1000)).await.expect("an answer");
    page.trials.iter().map(|trial| trial.number).collect()
}

/// All pages of an answer, as lists of numbers.
pub(crate) async fn pages(store: &dyn Store, study: &str, mut query: TrialQuery) -> Vec<Vec<u64>> {
    let mut pages = Vec::new();
    loop {
        let page = store.query_trials(study, &query).await.expect("an answer");
        pages.push(page.trials.iter().map(|trial| trial.number).collect());
        match page.next {
            Some(next) => query.after = Some(next),
            None => return pages,
        }
    }
}

/// A study with a parameter of each kind.
pub(crate) fn spec() -> StudySpec {
    let space = Space::builder().integer("leaf", 1..=32).default(8).float("cost", -1e9..=1e9).default(1.5);
    let space = space
        .categorical("quality", ["low", "high", "it's \"odd\" \\ ä"])
        .default("low")
        .boolean("compact")
        .default(false);
    let spec = StudySpec::builder(space.build().expect("a valid space")).display_name("A hall");
    let spec = spec.indicator("triangles", 0.0..=1e6, Scale::Log).minimise("render_ms", 1.0).seed(7);
    spec.build().expect("a valid study").with_policy(Policy::default())
}

pub(crate) fn state(id: u64) -> StateRecord {
    let machine = Fingerprint { cpu_model: "any".into(), threads: id as u32, ..Fingerprint::default() };
    let fingerprint = (id > 1).then_some(machine);
    StateRecord { id, indicators: vec![0.1 * id as f64], fingerprint, search: None }
}

/// An open trial of state 1.
pub(crate) fn open(number: u64) -> Trial {
    let configuration: RawConfiguration = BTreeMap::from([
        ("leaf".to_owned(), Value::Integer(8)),
        ("cost".to_owned(), Value::Float(2.0)),
        ("quality".to_owned(), Value::Text("high".to_owned())),
        ("compact".to_owned(), Value::Boolean(true)),
    ]);
    let configuration = spec().space.configuration(configuration).expect("valid");
    Trial {
        indicators: BTreeMap::from([("triangles".to_owned(), 0.1 + 0.2)]),
        predicted_cost: Some(1.0 / 3.0),
        lease_expire_ms: 60_000,
        create_ms: 1_000,
        fingerprint: Some(Fingerprint {
            cpu_model: "a \"fast\" one".to_owned(),
            isa: "avx512".to_owned(),
            threads: 2,
            software: BTreeMap::from([("embree".to_owned(), "4.4.0".to_owned())]),
        }),
        ..Trial::new(number, "renderer", 1, configuration, decided(Mode::Explore))
    }
}

fn exploited() -> Exploit {
    Exploit {
        source: ExploitSource::BestKnown {
            tried: 3,
            measurements: 2,
            state: Neighbour { state_id: 1, distance: 0.0, best_cost: 12.5 },
            gain: None,
            is_maximised: false,
            beside_start: false,
        },
        rule: ExploitRule::Dice,
        estimate: ExplorationEstimate { epsilon: Some(0.1), ..ExplorationEstimate::default() },
        budget: BudgetStatus::default(),
    }
}

/// A decision of each kind.
pub(crate) fn decided(mode: Mode) -> Decision {
    let choice = match mode {
        Mode::Pinned => Choice::Pinned,
        Mode::Exploit => Choice::Exploit(exploited()),
        Mode::Default => Choice::Exploit(Exploit { source: ExploitSource::Default, ..exploited() }),
        Mode::Explore => Choice::Explore(Explore {
            point: ExploredPoint::Search {
                search: SearchMethod::NelderMead,
                step: Step::Reflect,
                measurements: 0,
                neighbours: vec![Neighbour { state_id: 1, distance: 0.25, best_cost: 12.5 }],
            },
            rule: ExploreRule::Dice,
            estimate: ExplorationEstimate::default(),
            budget: BudgetStatus::default(),
            abort_above: Some(0.1),
        }),
    };
    choice.decided()
}

/// The trial after its report.
pub(crate) fn completed(number: u64, completion: u64, outcome: Outcome) -> Trial {
    let cost = match &outcome {
        Outcome::Ok => Some(0.5 + number as f64),
        Outcome::Aborted { lower_bound } => Some(*lower_bound),
        Outcome::Infeasible { .. } | Outcome::Failed { .. } => None,
    };
    Trial {
        state: TrialState::Completed,
        measurements: BTreeMap::from([("render_ms".to_owned(), 0.5 + number as f64)]),
        // Every other one has none.
        standard_errors: (0..number % 2).map(|_| ("render_ms".to_owned(), 0.1 + 0.2)).collect(),
        cost,
        outcome: Some(outcome),
        complete_ms: Some(2_000),
        completion: Some(completion),
        ..open(number)
    }
}

pub(crate) fn visit(client_id: &str, number: u64) -> Visit {
    Visit {
        client_id: client_id.to_owned(),
        state_id: 1,
        number,
        since: 4,
        decision: VisitDecision::Exploit {
            configuration: open(1).configuration,
            predicted_cost: Some(0.1),
            exploit: Box::new(exploited()),
            said: None,
        },
        account: Some(Account::default()),
    }
}

/// A change with one state and some trials.
pub(crate) fn change(trials: Vec<Trial>) -> Change {
    Change { trials, states: vec![state(1)], ..Change::default() }
}
