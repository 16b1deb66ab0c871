//! A filter has one meaning in memory and in SQL: random trials, random filters, random orders, read page by
//! page from every store.

mod common;

use std::cell::Cell;

use common::{change, completed, decided, open, pages, spec};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use treewright_core::configuration::RawConfiguration;
use treewright_core::trial::{Mode, Outcome, Trial, TrialState};
use treewright_core::value::Value;
use treewright_store::filter::{Filter, Order};
use treewright_store::{MemoryStore, SqliteStore, Store, TrialQuery};

/// Numbers that collide often, some with all their digits in use, some extreme.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => (-3_i32..4).prop_map(|n| f64::from(n) * 0.5),
        2 => prop::sample::select(vec![0.1, 0.1 + 0.2, 1.0 / 3.0, 12.345_678_901_234_567]),
        2 => -1e6..1e6,
        1 => prop::sample::select(vec![1e-300, 1e9, 999_999_999.999_999_9, 5e-324, -1e9]),
    ]
}

fn text() -> impl Strategy<Value = String> {
    prop::sample::select(vec!["low", "high", "it's \"odd\" \\ ä", "renderer", "", "LOW"])
        .prop_map(str::to_owned)
}

prop_compose! {
    fn trial()(
        kind in 0..7,
        client in text(),
        mode in prop::sample::select(vec![Mode::Default, Mode::Explore, Mode::Exploit, Mode::Pinned]),
        numbers in prop::collection::vec(number(), 4),
        leaf in 1_i64..4,
        quality in prop::sample::select(vec!["low", "high", "it's \"odd\" \\ ä"]),
        flags in any::<(bool, bool, bool)>(),
    ) -> Trial {
        let reason = String::new;
        let mut trial = match kind {
            0 => completed(1, 1, Outcome::Ok),
            1 => completed(1, 1, Outcome::Infeasible { reason: reason() }),
            2 => completed(1, 1, Outcome::Failed { reason: reason() }),
            3 => completed(1, 1, Outcome::Aborted { lower_bound: 0.5 }),
            4 => open(1),
            5 => Trial { state: TrialState::Abandoned, ..open(1) },
            _ => Trial { state: TrialState::Expired, ..open(1) },
        };
        trial.client_id = client;
        trial.decision = decided(mode);
        trial.late = flags.0;
        trial.cost = trial.cost.map(|_| numbers[0]);
        if trial.outcome.is_some() && flags.1 {
            trial.measurements.insert("build_ms".to_owned(), numbers[1]);
        }
        trial.indicators.insert("triangles".to_owned(), numbers[2]);
        let values = RawConfiguration::from([
            ("leaf".to_owned(), Value::Integer(leaf)),
            ("cost".to_owned(), Value::Float(numbers[3])),
            ("quality".to_owned(), Value::Text(quality.to_owned())),
            ("compact".to_owned(), Value::Boolean(flags.2)),
        ]);
        trial.configuration = spec().space.configuration(values).expect("inside the space");
        trial
    }
}

fn literal() -> impl Strategy<Value = String> {
    prop_oneof![
        3 => number().prop_map(|n| format!("{n:?}")),
        2 => (0_i64..5).prop_map(|n| n.to_string()),
        2 => text().prop_map(quoted),
        1 => any::<bool>().prop_map(|b| b.to_string()),
    ]
}

fn quoted(text: String) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

fn word(words: &'static [&'static str]) -> impl Strategy<Value = String> {
    prop::sample::select(words).prop_map(str::to_owned)
}

fn comparison() -> impl Strategy<Value = String> {
    let equality = || word(&["=", "!="]);
    let operator = || word(&["=", "!=", "<", "<=", ">", ">="]);
    let join = |(field, operator, value): (String, String, String)| format!("{field} {operator} {value}");
    prop_oneof![
        (word(&["state"]), equality(), word(&["OPEN", "COMPLETED", "ABANDONED", "EXPIRED"])).prop_map(join),
        (word(&["mode"]), equality(), word(&["DEFAULT", "EXPLORE", "EXPLOIT", "PINNED"])).prop_map(join),
        (word(&["outcome"]), equality(), word(&["OK", "INFEASIBLE", "ABORTED", "FAILED"])).prop_map(join),
        (word(&["late", "excluded"]), equality(), word(&["true", "false"])).prop_map(join),
        (word(&["client_id"]), operator(), text().prop_map(quoted)).prop_map(join),
        (word(&["number", "state_id"]), operator(), (0_i64..15).prop_map(|n| n.to_string())).prop_map(join),
        (
            word(&[
                "cost",
                "measurement.build_ms",
                "measurement.render_ms",
                "measurement.absent",
                "indicator.triangles"
            ]),
            operator(),
            number().prop_map(|n| format!("{n:?}")),
        )
            .prop_map(join),
        // Some of these do not parse (a boolean with an order); they are skipped below.
        (
            word(&["config.leaf", "config.cost", "config.quality", "config.compact", "config.absent"]),
            operator(),
            literal()
        )
            .prop_map(join),
    ]
}

fn order() -> impl Strategy<Value = String> {
    word(&[
        "",
        "number desc",
        "cost",
        "cost desc",
        "measurement.build_ms",
        "measurement.build_ms desc",
        "measurement.absent desc",
    ])
}

#[test]
fn every_store_answers_alike() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let directory = tempfile::tempdir().expect("a directory");
    let memory = MemoryStore::new();
    let sqlite =
        runtime.block_on(SqliteStore::open(&directory.path().join("studies.db"))).expect("a new database");
    let database = runtime.block_on(treewright_test_postgres::Database::create());
    let postgres = runtime.block_on(common::postgres(&database));
    let case = Cell::new(0);
    let config = ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() };
    // Equal trials and filters on every run.
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let questions = prop::collection::vec((prop::collection::vec(comparison(), 0..4), order(), 1_u32..6), 24);
    runner
        .run(&(prop::collection::vec(trial(), 0..14), questions), |(mut trials, questions)| {
            case.set(case.get() + 1);
            let study = format!("case-{}", case.get());
            for (number, trial) in (1..).zip(&mut trials) {
                trial.number = number;
                trial.completion = trial.completion.map(|_| number);
            }
            let stored = change(trials);
            runtime.block_on(async {
                for store in [&memory as &dyn Store, &sqlite, &postgres] {
                    store.create_study(&study, &spec(), 0).await.expect("created");
                    let fence = store.load(&study).await.expect("loaded").fence;
                    let receipt = store.commit(&fence, std::slice::from_ref(&stored));
                    receipt.durable().await.expect("stored");
                }
            });
            for (comparisons, order, size) in questions {
                let text = comparisons.join(" AND ");
                let Ok(filter) = Filter::parse(&text) else {
                    continue;
                };
                let query =
                    TrialQuery { filter, order: Order::parse(&order).expect("an order"), after: None, size };
                let expected = runtime.block_on(pages(&memory, &study, query.clone()));
                for store in [&sqlite as &dyn Store, &postgres] {
                    let found = runtime.block_on(pages(store, &study, query.clone()));
                    prop_assert_eq!(&found, &expected, "filter {:?}, order {:?}", text, order);
                }
            }
            Ok(())
        })
        .expect("the stores agree");
}
