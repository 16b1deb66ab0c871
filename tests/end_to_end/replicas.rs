//! Three daemons on one PostgreSQL, killed and started again in mid-run, and the database restarted under
//! them: no acknowledged report is lost, no trial is handed out twice, and no client fails for good.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use treewright_client::{Client, Indicators, Options, Outcome, Stats, TrialQuery};
use treewright_proto::v1 as pb;
use treewright_test_postgres::{Database, Server};
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr};

use crate::site::leaf_study;

const CLIENTS: usize = 6;
const STUDIES: usize = 3;

/// Renders until `stop` changes, at 50 frames a second, and returns the trials it was handed and the counts.
async fn render(
    urls: String,
    number: usize,
    mut stop: tokio::sync::watch::Receiver<bool>,
) -> (usize, Vec<String>, Stats) {
    let options = Options::new().client_id(format!("renderer-{number}")).deadline(Duration::from_secs(2));
    let client = Client::connect(&urls, options).expect("good addresses");
    let study = client.study(&format!("hall-{}", number % STUDIES), leaf_study()).await.expect("a study");
    let mut tuner = study.tuner();
    let mut previous = None;
    let mut trials = Vec::new();
    while !*stop.borrow_and_update() {
        let frame = trials.len() as f64;
        let indicators = Indicators::from([("triangles", (number * 10) as f64 + frame % 3.0)]);
        let suggestion = tuner.next(&indicators, previous.take()).await;
        trials.extend(suggestion.trial().map(str::to_owned));
        let cost = suggestion.configuration().integer("leaf").expect("a leaf") as f64;
        let finished = suggestion.finished([("render_ms", cost)].into(), Outcome::Ok).expect("measured");
        previous = Some(finished);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    drop(previous);
    client.flush(Duration::from_secs(60)).await.expect("every report is acknowledged");
    (number, trials, client.stats())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_outlive_killed_daemons_and_a_restarted_database() {
    let server = tokio::task::spawn_blocking(Server::start).await.expect("PostgreSQL starts");
    let database = Database::create_on(&server.url("postgres")).await;
    let path = Path::new(&database);
    let mut daemons: Vec<Daemon> = (0..3).map(|_| Daemon::start(path)).collect();
    let addresses: Vec<String> = daemons.iter().map(|daemon| daemon.address().to_owned()).collect();
    let urls: Vec<String> = daemons.iter().map(|daemon| daemon.url().to_owned()).collect();

    let (stop, stopped) = tokio::sync::watch::channel(false);
    let mut renderers = tokio::task::JoinSet::new();
    for number in 0..CLIENTS {
        let mut mine = urls.clone();
        mine.rotate_left(number % 3);
        renderers.spawn(render(mine.join(","), number, stopped.clone()));
    }
    for round in 0..9 {
        tokio::time::sleep(Duration::from_millis(600)).await;
        if round % 3 == 2 {
            server.stop();
            tokio::time::sleep(Duration::from_millis(300)).await;
            server.start_again();
        } else {
            let victim = round % daemons.len();
            daemons.remove(victim).kill();
            tokio::time::sleep(Duration::from_millis(200)).await;
            // The address of the one that is gone; the list keeps the order of the addresses.
            daemons.insert(victim, Daemon::start_at(path, &addresses[victim]));
        }
    }
    // The last one does not come back: its clients go on with another.
    daemons.remove(0).kill();
    tokio::time::sleep(Duration::from_millis(1200)).await;
    stop.send(true).expect("the renderers listen");

    let mut handed_out = BTreeMap::new();
    let mut acknowledged = 0;
    while let Some(done) = renderers.join_next().await {
        let (number, trials, stats) = done.expect("a renderer ends well");
        assert_eq!((stats.dropped, stats.refused, stats.queued), (0, 0, 0), "{stats:?}");
        assert!(stats.suggestions > 0, "each is tuned between the kills: {stats:?}");
        acknowledged += stats.acknowledged;
        for trial in trials {
            // A client gets its own open trial again when an answer was lost; nobody else ever does.
            let owner = *handed_out.entry(trial.clone()).or_insert(number);
            assert_eq!(owner, number, "{trial} was handed out twice");
        }
    }
    let client = Client::connect(daemons[0].url(), Options::new()).expect("a good address");
    let mut stored = BTreeSet::new();
    for number in 0..STUDIES {
        stored.extend(completed(&client, &format!("hall-{number}")).await);
    }
    let reported: BTreeSet<String> = handed_out.into_keys().map(|name| plain(&name)).collect();
    assert_eq!(stored, reported, "what was reported is stored, and nothing else");
    assert!(stored.len() > 100, "{} trials are few", stored.len());
    assert!(acknowledged >= stored.len() as u64, "{acknowledged} acknowledged, {} stored", stored.len());
    for daemon in daemons {
        assert!(daemon.terminate().success());
    }
}

async fn completed(client: &Client, study: &str) -> BTreeSet<String> {
    let mut trials = client.trials(study, TrialQuery::all().filter("state = COMPLETED"));
    let mut names = BTreeSet::new();
    while let Some(trial) = trials.next().await.expect("a page") {
        names.insert(trial.name);
    }
    names
}

#[test]
fn a_database_that_does_not_answer_is_exit_code_4_without_the_password() {
    let url = "postgres://anna:geheim@127.0.0.1:9/farm";
    let arguments =
        ["serve", "--listen", "127.0.0.1:0", "--database", url, "--database-wait-s", "0", "--log", "trace"];
    let output = run("treewrightd", &arguments);
    assert_eq!(output.status.code(), Some(4));
    let said = stderr(&output);
    assert!(said.contains("no PostgreSQL answers at postgres://anna@127.0.0.1:9/farm"), "{said}");
    assert!(!said.contains("geheim"), "{said}");
}

/// A daemon that is stopped keeps its connections and its lock and says nothing: requests that were passed on
/// to it go to the replica that takes its studies, soon after it is taken for dead, and its decisions are
/// refused when it wakes.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn requests_do_not_wait_for_a_frozen_daemon() {
    let database = Database::create().await;
    let path = Path::new(database.url());
    let (holder, other) = (Daemon::start(path), Daemon::start(path));
    let options = || Options::new().client_id("a").deadline(Duration::from_secs(20));
    let first = Client::connect(holder.url(), options()).expect("a good address");
    let study = first.study("hall", leaf_study()).await.expect("a study");
    let indicators = Indicators::from([("triangles", 3.0)]);
    let frozen = study.suggest(&indicators).await;
    let trial = frozen.trial().expect("a trial").to_owned();
    drop(frozen);

    let options = options().call_deadline(Duration::from_secs(20));
    let second = Client::connect(other.url(), options.client_id("b")).expect("a good address");
    let study = second.existing_study("hall").await.expect("it is there");
    let before = study.suggest(&indicators).await;
    assert!(before.trial().is_some(), "passed on: {before:?}");
    before.report([("render_ms", 1.0)].into(), Outcome::Ok).expect("measured");
    second.flush(Duration::from_secs(10)).await.expect("acknowledged");

    let mut wire = crate::wire::connect(other.url()).await;
    holder.signal("STOP");
    let since = std::time::Instant::now();
    let question = crate::wire::suggestion("studies/hall", "c", 3.0);
    let indicators_of = BTreeMap::from([("triangles".to_owned(), 3.0)]);
    let unary = wire.suggest(pb::SuggestRequest { indicators: indicators_of, ..question }).await;
    let waited = since.elapsed();
    assert!(unary.is_ok(), "{unary:?}");
    // Six seconds until it is taken for dead, one until that is looked at, and some for a loaded machine.
    assert!(waited < Duration::from_secs(15), "waited {waited:?}");
    let next = study.tuner().next(&indicators, None).await;
    assert!(next.trial().is_some(), "by a stream as well: {next:?}");
    holder.signal("CONT");
    let reported = second.get_study("hall").await.expect("it is there").statistics;
    assert!(reported.trials >= 3, "{trial}: {reported:?}");
    assert!(other.terminate().success());
}

/// The name of a trial without the identity of its study.
fn plain(name: &str) -> String {
    let (study, trial) = name.split_once("/trials/").expect("a name of a trial");
    format!("{}/trials/{trial}", study.split('@').next().unwrap_or(study))
}
