//! A storm of `kill -9` at random moments under 32 clients, on one daemon with SQLite and on three with
//! PostgreSQL, and a storm of SIGSTOP against the one of three that holds the study. No acknowledged report
//! is lost, no trial is handed to two clients, and every restart works by itself. The study has the default
//! policy, and the daemons ask for tokens. Half of the clients make calls and begin a new session now and
//! then, the other half keep a Tune stream open. Another program reads the database all the while: it opens
//! the file, counts and closes it, again and again. The first of the kills is an orderly end, which saves
//! checkpoints; they are deleted before the second, as `docs/operations.md` says.
//!
//! Eight kills and two stops in a usual run;
//! `TREEWRIGHT_STORM_KILLS=1000 TREEWRIGHT_STORM_STOPS=100 cargo test --release -p treewright-tests --test end_to_end storm -- --nocapture`
//! shows more and prints what happened.

use std::collections::BTreeMap;
use std::error::Error as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;
use tonic::transport::Endpoint;
use treewright_proto::v1 as pb;
use treewright_test_postgres::{Database, Server, holder_of};
use treewright_tests::daemon::Daemon;
use treewright_tests::ports::lasting_address;
use treewright_tests::programs::{run, stderr, token};

use crate::guard::{self, Caller, in_force};
use crate::site::assert_sound;
use crate::wire;

const STUDY: &str = "storm";
const CLIENTS: u32 = 32;
const KILLS: u32 = 8;
const STOPS: u32 = 2;
/// Frames after which a client that makes calls begins another session.
const SESSION_FRAMES: u32 = 40;
/// No call takes longer; one that does is tried again.
const DEADLINE: Duration = Duration::from_secs(5);

/// The answers to clients, which the database must bear out.
#[derive(Default)]
struct Book {
    /// The cost of each acknowledged trial.
    acknowledged: BTreeMap<String, Option<f64>>,
    /// The client that was handed each trial.
    handed: BTreeMap<String, String>,
    wrong: Vec<String>,
}

struct Storm {
    /// Where the daemons listen; any of them answers.
    urls: Vec<String>,
    token: String,
    study: String,
    book: Mutex<Book>,
    is_over: AtomicBool,
    failed_calls: AtomicU64,
    /// From the first time a client asks until it is answered, with all attempts.
    longest_wait_ms: AtomicU64,
}

impl Storm {
    fn new(daemons: &[Daemon], token: String, study: String) -> Arc<Self> {
        Arc::new(Self {
            urls: daemons.iter().map(|daemon| daemon.url().to_owned()).collect(),
            token,
            study,
            book: Mutex::default(),
            is_over: AtomicBool::new(false),
            failed_calls: AtomicU64::new(0),
            longest_wait_ms: AtomicU64::new(0),
        })
    }

    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn answered(&self, since: Instant) {
        let waited_ms = u64::try_from(since.elapsed().as_millis()).expect("no storm is that long");
        self.longest_wait_ms.fetch_max(waited_ms, Ordering::Relaxed);
    }

    fn refused(&self, trial: &pb::Trial, code: Code, message: &str) {
        self.note(|book| book.wrong.push(format!("{}: {code}: {message}", trial.name)));
    }

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

/// A client of one daemon, which connects when it asks.
fn caller(url: &str, token: &str) -> Caller {
    let endpoint = Endpoint::from_shared(url.to_owned()).expect("an address").timeout(DEADLINE);
    guard::caller(endpoint.connect_lazy(), Some(token))
}

/// A client's connections, one to each daemon, of which it uses one until a call on it fails.
struct Connections {
    all: Vec<Caller>,
    current: usize,
}

impl Connections {
    fn to(storm: &Storm, first: u32) -> Self {
        let urls = &storm.urls;
        let all = urls.iter().map(|url| caller(url, &storm.token)).collect();
        Self { all, current: first as usize % urls.len() }
    }

    fn current(&mut self) -> &mut Caller {
        &mut self.all[self.current]
    }

    async fn failed(&mut self, storm: &Storm) {
        self.current = (self.current + 1) % self.all.len();
        storm.failed_calls.fetch_add(1, Ordering::Relaxed);
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

/// The question of a client in a frame. It moves among states that others visit, too.
fn question(storm: &Storm, number: u32, step: u32) -> pb::SuggestRequest {
    let near = f64::from(number % 8) / 8.0 + f64::from(step / 20 % 3) / 40.0;
    let session = u64::from(step / SESSION_FRAMES + 1);
    pb::SuggestRequest { session, ..wire::suggestion(&storm.study, &format!("client-{number}"), near) }
}

/// Whether a report was refused for good although it was of a trial that had been handed out.
fn is_wrong(code: Code) -> bool {
    matches!(code, Code::Internal | Code::NotFound)
}

/// A client that makes calls.
async fn by_calls(storm: Arc<Storm>, number: u32) {
    let mut connections = Connections::to(&storm, number);
    let (mut step, mut asked) = (0u32, Instant::now());
    while !storm.is_over() {
        let question = question(&storm, number, step);
        let client_id = question.client_id.clone();
        let Ok(trial) = connections.current().suggest(question).await else {
            connections.failed(&storm).await;
            continue;
        };
        storm.answered(asked);
        let trial = trial.into_inner();
        storm.handed(&trial, &client_id);
        // Reported until it is acknowledged, also when the storm is over.
        asked = Instant::now();
        loop {
            match connections.current().report(wire::report(&trial)).await {
                Ok(answer) => {
                    storm.acknowledged(answer.into_inner().trial.as_ref().expect("the stored trial"));
                    break;
                }
                // A status with a source was made on this side, out of a connection that broke.
                Err(status) if status.source().is_none() && is_wrong(status.code()) => {
                    storm.refused(&trial, status.code(), status.message());
                    break;
                }
                Err(_) => connections.failed(&storm).await,
            }
        }
        storm.answered(asked);
        (step, asked) = (step + 1, Instant::now());
    }
}

/// A client that keeps a Tune stream open, and opens another where it breaks.
async fn by_stream(storm: Arc<Storm>, number: u32) {
    let mut connections = Connections::to(&storm, number);
    let (mut step, mut asked) = (0u32, Instant::now());
    // A report that no daemon has acknowledged yet.
    let mut unacknowledged: Option<pb::Trial> = None;
    while !storm.is_over() || unacknowledged.is_some() {
        let (say, frames) = mpsc::channel(1);
        // There is room for one, and its receiver is still here.
        say.send(frame(&storm, number, step, unacknowledged.as_ref())).await.expect("room for one");
        let opened = timeout(DEADLINE, connections.current().tune(ReceiverStream::new(frames))).await;
        let Ok(Ok(opened)) = opened else {
            connections.failed(&storm).await;
            continue;
        };
        let mut answers = opened.into_inner();
        while let Ok(Ok(Some(answer))) = timeout(DEADLINE, answers.message()).await {
            let is_refused = answer.report_error.is_some() || answer.suggest_error.is_some();
            hear(&storm, &mut unacknowledged, &answer);
            if let Some(trial) = answer.trial {
                storm.handed(&trial, &format!("client-{number}"));
                storm.answered(asked);
                (step, asked) = (step + 1, Instant::now());
                unacknowledged = Some(trial);
            }
            if is_refused {
                storm.failed_calls.fetch_add(1, Ordering::Relaxed);
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            if storm.is_over() && unacknowledged.is_none() {
                return;
            }
            if say.send(frame(&storm, number, step, unacknowledged.as_ref())).await.is_err() {
                break;
            }
        }
        connections.failed(&storm).await;
    }
}

/// The last result, and, as long as the storm lasts, the next question.
fn frame(storm: &Storm, number: u32, step: u32, unacknowledged: Option<&pb::Trial>) -> pb::TuneRequest {
    let suggest =
        (!storm.is_over()).then(|| pb::SuggestRequest { session: 1, ..question(storm, number, step) });
    pb::TuneRequest { report: unacknowledged.map(wire::report), suggest }
}

/// Takes an answer's word about the result that was sent along.
fn hear(storm: &Storm, unacknowledged: &mut Option<pb::Trial>, answer: &pb::TuneResponse) {
    if let Some(reported) = &answer.reported {
        storm.acknowledged(reported.trial.as_ref().expect("the stored trial"));
        *unacknowledged = None;
    }
    if let Some(error) = &answer.report_error
        && is_wrong(error.code.into())
        && let Some(trial) = unacknowledged.take()
    {
        storm.refused(&trial, error.code.into(), &error.message);
    }
}

fn number_of(variable: &str, or: u32) -> u32 {
    std::env::var(variable).map_or(or, |text| text.parse().expect("a number"))
}

/// Daemons on one database with a study of the default policy, and clients that use it.
struct Weather {
    daemons: Vec<Daemon>,
    storm: Arc<Storm>,
    clients: JoinSet<()>,
    /// The other reader of the database; it returns the number of its successful reads.
    reader: JoinHandle<u32>,
    begin: Instant,
}

fn start(database: &Path, address: &str) -> Daemon {
    Daemon::start_at_with(database, address, &["--tokens"])
}

/// Runs a statement in another program, as the shell of SQLite does.
fn other_program(database: &Path, statement: &str) {
    let script = "import sqlite3, sys\n\
                  c = sqlite3.connect(sys.argv[1], isolation_level=None, timeout=20)\n\
                  c.execute(sys.argv[2]).fetchall()\n\
                  c.close()";
    let output = Command::new("python3").args(["-c", script]).arg(database).arg(statement).output();
    let output = output.expect("python3 runs");
    assert!(output.status.success(), "{statement}: {}", stderr(&output));
}

/// Reads a database again and again until the storm is over, by a program that is started again each time: a
/// file as any program that knows SQLite does it, PostgreSQL by way of its tokens.
fn read_beside(database: PathBuf, storm: Arc<Storm>) -> u32 {
    let mut count = 0;
    while !storm.is_over() {
        if database.exists() {
            other_program(&database, "SELECT count(*) FROM trials");
        } else {
            let listed = run("treewrightd", &["token", "list", "--database", &database.to_string_lossy()]);
            assert!(listed.status.success(), "{}", stderr(&listed));
        }
        count += 1;
        std::thread::sleep(Duration::from_millis(20));
    }
    count
}

impl Weather {
    async fn begin(database: &Path, replicas: usize) -> Self {
        let daemons: Vec<Daemon> = (0..replicas).map(|_| start(database, &lasting_address())).collect();
        let token = token(database, &["--scope", "admin"]);
        let mut first = caller(daemons[0].url(), &token);
        in_force(&mut first).await;
        let study = pb::Study { policy: None, ..wire::study() };
        let request = pb::CreateStudyRequest { study_id: STUDY.into(), study: Some(study) };
        let study = first.create_study(request).await.expect("the study is taken").into_inner().name;
        let storm = Storm::new(&daemons, token, study);
        let mut clients = JoinSet::new();
        for number in 0..CLIENTS {
            let storm = Arc::clone(&storm);
            if number % 2 == 0 {
                clients.spawn(by_calls(storm, number));
            } else {
                clients.spawn(by_stream(storm, number));
            }
        }
        let (file, of_reader) = (database.to_owned(), Arc::clone(&storm));
        let reader = tokio::task::spawn_blocking(move || read_beside(file, of_reader));
        Self { daemons, storm, clients, reader, begin: Instant::now() }
    }

    /// Waits for the end of all clients, then compares the answers to them with the stored trials.
    async fn end(mut self, what: &str, troubles: u32) {
        self.storm.is_over.store(true, Ordering::Relaxed);
        while let Some(ended) = self.clients.join_next().await {
            ended.expect("a client ends");
        }
        let read = self.reader.await.expect("the database can be read all the while");
        let mut reader = caller(self.daemons[0].url(), &self.storm.token);
        let ask = async |request| reader.query_trials(request).await;
        let completed = wire::query_by(ask, &self.storm.study, "state = COMPLETED").await;
        let stored: BTreeMap<String, pb::Trial> =
            completed.into_iter().map(|trial| (trial.name.clone(), trial)).collect();
        let book = self.storm.book.lock().expect("nobody has it open");
        let is_lost = |name: &str, cost: Option<f64>| stored.get(name).is_none_or(|trial| trial.cost != cost);
        let lost = book.acknowledged.iter().filter(|(name, cost)| is_lost(name, **cost)).count();
        println!(
            "{} daemons, {troubles} {what} in {:.0} s: {} reports acknowledged, {lost} lost, {} trials handed out, {} wrong, \
             {} calls failed and were tried again, longest wait of a client {} ms, read {read} times beside",
            self.daemons.len(),
            self.begin.elapsed().as_secs_f64(),
            book.acknowledged.len(),
            book.handed.len(),
            book.wrong.len(),
            self.storm.failed_calls.load(Ordering::Relaxed),
            self.storm.longest_wait_ms.load(Ordering::Relaxed),
        );
        assert_eq!(lost, 0);
        assert!(book.wrong.is_empty(), "{:?}", book.wrong);
        let went_through = book.acknowledged.len();
        assert!(went_through >= troubles as usize, "only {went_through} reports went through");
    }
}

/// Waits until reports have gone through since the last trouble, so that a slow machine sees as much of a
/// storm as a quick one. Returns their number by now.
async fn progress(storm: &Storm, before: usize) -> usize {
    let patience = Instant::now() + Duration::from_secs(300);
    loop {
        let now = storm.book.lock().expect("no client panics with the book open").acknowledged.len();
        if now > before {
            return now;
        }
        assert!(Instant::now() < patience, "no report goes through");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

/// Kills one daemon after the other, at moments without a pattern.
async fn rage(database: &Path, replicas: usize) {
    let kills = number_of("TREEWRIGHT_STORM_KILLS", KILLS);
    let mut weather = Weather::begin(database, replicas).await;
    let addresses: Vec<String> = weather.daemons.iter().map(|daemon| daemon.address().to_owned()).collect();
    let (mut longest_start, mut reports) = (Duration::ZERO, 0);
    for kill in 0..kills {
        reports = progress(&weather.storm, reports).await;
        // Multiples of the golden ratio spread evenly (Weyl, 1916).
        let share = (f64::from(kill + 1) * 0.618_033_988_749_895).fract();
        tokio::time::sleep(Duration::from_millis(5 + (share * 400.0) as u64)).await;
        let victim = kill as usize % replicas;
        if kill == 1 && database.exists() {
            other_program(database, "DELETE FROM checkpoints");
        }
        match (kill, weather.daemons.remove(victim)) {
            (0, daemon) => assert!(daemon.terminate().success()),
            (_, daemon) => daemon.kill(),
        }
        let started = Instant::now();
        weather.daemons.insert(victim, start(database, &addresses[victim]));
        longest_start = longest_start.max(started.elapsed());
    }
    println!("longest start {} ms", longest_start.as_millis());
    weather.end("kills", kills).await;
    if database.exists() {
        assert_sound(database);
    }
}

/// Stops whichever daemon holds the study until another one answers in its place, then lets it go on.
async fn freeze(database: &Database) {
    let stops = number_of("TREEWRIGHT_STORM_STOPS", STOPS);
    let weather = Weather::begin(Path::new(database.url()), 3).await;
    let mut connection = database.connect().await;
    let (mut longest_takeover, mut reports) = (Duration::ZERO, 0);
    for _ in 0..stops {
        reports = progress(&weather.storm, reports).await;
        let victim = loop {
            let holder = holder_of(&mut connection, STUDY).await;
            let found = weather
                .daemons
                .iter()
                .position(|one| holder.as_ref().is_some_and(|holder| holder.ends_with(one.address())));
            if let Some(found) = found {
                break found;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        };
        weather.daemons[victim].signal("STOP");
        let stopped = Instant::now();
        let mut other = caller(weather.daemons[(victim + 1) % 3].url(), &weather.storm.token);
        while other.suggest(wire::suggestion(&weather.storm.study, "watcher", 0.9)).await.is_err() {
            assert!(stopped.elapsed() < Duration::from_secs(120), "nobody takes the study over");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        longest_takeover = longest_takeover.max(stopped.elapsed());
        weather.daemons[victim].signal("CONT");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    println!("longest time until another daemon answered {} ms", longest_takeover.as_millis());
    weather.end("stops of the study's holder", stops).await;
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

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_storm_of_frozen_holders_loses_nothing() {
    freeze(&Database::create().await).await;
}
