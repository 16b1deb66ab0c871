//! A storm of `kill -9` at random moments under 32 clients, on one daemon with SQLite and on three with PostgreSQL:
//! nothing acknowledged is lost, no trial is handed to two clients, and every restart works by itself.
//!
//! A dozen kills in a usual run; `TREEWRIGHT_STORM_KILLS=1000 cargo test --release -p treewright-tests --test end_to_end
//! storm -- --nocapture` shows more and prints what happened.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tokio::task::JoinSet;
use tonic::Code;
use tonic::transport::{Channel, Endpoint};
use treewright_proto::v1 as pb;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_test_postgres::{Database, Server};
use treewright_tests::daemon::Daemon;

use crate::wire;

const CLIENTS: u32 = 32;
const KILLS: u32 = 12;
/// No call takes longer; one that does is tried again.
const DEADLINE: Duration = Duration::from_secs(5);

/// What clients were told, which the database must bear out.
#[derive(Default)]
struct Book {
    /// The cost of each acknowledged trial.
    acknowledged: BTreeMap<String, Option<f64>>,
    /// Who was handed each trial.
    handed: BTreeMap<String, String>,
    /// What should not have been.
    wrong: Vec<String>,
}

struct Storm {
    /// Where the daemons listen; any of them answers.
    urls: Vec<String>,
    study: String,
    book: Mutex<Book>,
    is_over: AtomicBool,
    failed_calls: AtomicU64,
}

impl Storm {
    fn note(&self, note: impl FnOnce(&mut Book)) {
        note(&mut self.book.lock().expect("no client panics with the book open"));
    }

    fn handed(&self, trial: &pb::Trial, client_id: &str) {
        self.note(|book| {
            let holder = book.handed.entry(trial.name.clone()).or_insert_with(|| client_id.to_owned());
            if holder != client_id {
                book.wrong.push(format!("{} went to {holder} and to {client_id}", trial.name));
            }
        });
    }

    fn acknowledged(&self, trial: &pb::Trial) {
        self.note(|book| {
            let before = book.acknowledged.insert(trial.name.clone(), trial.cost);
            if before.is_some_and(|before| before != trial.cost) {
                book.wrong.push(format!("{} was acknowledged with two costs", trial.name));
            }
        });
    }
}

/// A client's connections, one to each daemon, of which it uses one until a call on it fails.
struct Connections {
    all: Vec<TuningServiceClient<Channel>>,
    current: usize,
}

impl Connections {
    fn to(urls: &[String], first: u32) -> Self {
        let connect = |url: &String| {
            let endpoint = Endpoint::from_shared(url.clone()).expect("an address").timeout(DEADLINE);
            TuningServiceClient::new(endpoint.connect_lazy())
        };
        Self { all: urls.iter().map(connect).collect(), current: first as usize % urls.len() }
    }

    fn current(&mut self) -> &mut TuningServiceClient<Channel> {
        &mut self.all[self.current]
    }

    async fn failed(&mut self, storm: &Storm) {
        self.current = (self.current + 1) % self.all.len();
        storm.failed_calls.fetch_add(1, Ordering::Relaxed);
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

async fn client(storm: Arc<Storm>, number: u32) {
    let client_id = format!("client-{number}");
    let mut connections = Connections::to(&storm.urls, number);
    let mut step = 0u32;
    while !storm.is_over.load(Ordering::Relaxed) {
        step += 1;
        let near = f64::from(number % 8) / 8.0 + f64::from(step / 20 % 3) / 40.0;
        let question = wire::suggestion(&storm.study, &client_id, near);
        let Ok(trial) = connections.current().suggest(question).await else {
            connections.failed(&storm).await;
            continue;
        };
        let trial = trial.into_inner();
        storm.handed(&trial, &client_id);
        // Told until somebody has heard it, also when the storm is over.
        loop {
            match connections.current().report(wire::report(&trial)).await {
                Ok(answer) => {
                    storm.acknowledged(answer.into_inner().trial.as_ref().expect("the stored trial"));
                    break;
                }
                Err(status) if matches!(status.code(), Code::Internal | Code::NotFound) => {
                    let problem = format!("{}: {status}", trial.name);
                    storm.note(|book| book.wrong.push(problem));
                    break;
                }
                Err(_) => connections.failed(&storm).await,
            }
        }
    }
}

/// Kills one daemon after the other, at moments without a pattern, under 32 clients; then compares what clients were
/// told with what is stored.
async fn rage(database: &Path, replicas: usize) {
    let kills: u32 =
        std::env::var("TREEWRIGHT_STORM_KILLS").map_or(KILLS, |kills| kills.parse().expect("a number"));
    let mut daemons: Vec<Daemon> = (0..replicas).map(|_| Daemon::start(database)).collect();
    let addresses: Vec<String> = daemons.iter().map(|daemon| daemon.address().to_owned()).collect();
    let study = wire::create(&mut wire::connect(daemons[0].url()).await, "storm").await;
    let storm = Arc::new(Storm {
        urls: daemons.iter().map(|daemon| daemon.url().to_owned()).collect(),
        study: study.clone(),
        book: Mutex::default(),
        is_over: AtomicBool::new(false),
        failed_calls: AtomicU64::new(0),
    });
    let mut clients = JoinSet::new();
    for number in 0..CLIENTS {
        clients.spawn(client(Arc::clone(&storm), number));
    }
    let begin = Instant::now();
    let mut longest_start = Duration::ZERO;
    for kill in 0..kills {
        // Multiples of the golden ratio spread evenly (Weyl, 1916).
        let share = (f64::from(kill + 1) * 0.618_033_988_749_895).fract();
        tokio::time::sleep(Duration::from_millis(5 + (share * 400.0) as u64)).await;
        let victim = kill as usize % replicas;
        daemons.remove(victim).kill();
        let started = Instant::now();
        daemons.insert(victim, Daemon::start_at(database, &addresses[victim]));
        longest_start = longest_start.max(started.elapsed());
    }
    storm.is_over.store(true, Ordering::Relaxed);
    while let Some(ended) = clients.join_next().await {
        ended.expect("a client ends");
    }
    let mut reader = wire::connect(daemons[0].url()).await;
    let completed = wire::query(&mut reader, &study, "state = COMPLETED").await;
    let stored: BTreeMap<String, pb::Trial> =
        completed.into_iter().map(|trial| (trial.name.clone(), trial)).collect();
    let book = storm.book.lock().expect("nobody has it open");
    let lost = book
        .acknowledged
        .iter()
        .filter(|(name, cost)| stored.get(*name).is_none_or(|trial| trial.cost != **cost))
        .count();
    println!(
        "{replicas} daemons, {kills} kills in {:.0} s: {} reports acknowledged, {lost} lost, {} trials handed out, {} \
         wrong, {} calls failed and were tried again, longest start {} ms",
        begin.elapsed().as_secs_f64(),
        book.acknowledged.len(),
        book.handed.len(),
        book.wrong.len(),
        storm.failed_calls.load(Ordering::Relaxed),
        longest_start.as_millis()
    );
    assert_eq!(lost, 0);
    assert!(book.wrong.is_empty(), "{:?}", book.wrong);
    assert!(
        book.acknowledged.len() > kills as usize,
        "only {} reports went through",
        book.acknowledged.len()
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_storm_of_kills_loses_nothing() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    rage(&folder.path().join("storm.db"), 1).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_storm_over_three_replicas_loses_nothing() {
    let server = tokio::task::spawn_blocking(Server::start).await.expect("PostgreSQL starts");
    let database = Database::create_on(&server.url("postgres")).await;
    rage(Path::new(&database), 3).await;
}
