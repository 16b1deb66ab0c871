//! One, two and three daemons on one PostgreSQL, side by side: trials a second and times of a trial, durable;
//! then three daemons of which one is killed every two seconds, as renderers see it, with searches that draw
//! points and with those that fit models.
//!
//! `cargo run --release -p treewright-tests --example scale_out -- [SECONDS] [CLIENTS]` (10 seconds a row and
//! 32 clients by default). Prints a table in Markdown. PostgreSQL is started privately, or `DATABASE_URL`
//! names one. The clients are tasks of this process and share the processors with daemons and database.

use std::path::Path;
use std::time::{Duration, Instant};

use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio_stream::wrappers::ReceiverStream;
use treewright_client::{
    Client, Indicators, Options, Outcome, Policy, Scale, SearchMethod, Space, StudySpec,
};
use treewright_proto::convert::spec_to_wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as wire, outcome};
use treewright_test_postgres::{Database, Server};
use treewright_tests::daemon::Daemon;

const STUDIES: usize = 6;
const REPLICAS_MAX: usize = 3;
const KILL_EVERY: Duration = Duration::from_secs(2);
const FRAME: Duration = Duration::from_millis(20);
const DEADLINE: Duration = Duration::from_millis(50);

/// Which daemon a client talks to.
#[derive(Clone, Copy)]
enum Spread {
    /// All clients of a study to one: nothing is passed on.
    ByStudy,
    /// Any to any: of n replicas n - 1 pass a request on.
    ByClient,
}

fn study() -> wire::Study {
    let first = Space::builder().float("p0", 0.0..=1.0).default(0.5);
    let space =
        (1..6).fold(first, |space, number| space.float(&format!("p{number}"), 0.0..=1.0).default(0.5));
    let spec = StudySpec::builder(space.build().expect("a space")).minimise("render_ms", 1.0);
    let policy = Policy::new().search(SearchMethod::Random).epsilon(1.0).trials_per_state(100_000);
    spec_to_wire(&spec.policy(policy).build().expect("a specification"))
}

fn report(trial: &wire::Trial) -> wire::ReportRequest {
    wire::ReportRequest {
        trial: trial.name.clone(),
        measurements: [("render_ms".to_owned(), 5.0)].into(),
        outcome: Some(wire::Outcome { kind: Some(outcome::Kind::Ok(wire::Ok {})) }),
        ..wire::ReportRequest::default()
    }
}

/// One client's trials through a Tune stream: how long each took, in microseconds.
async fn trials(url: String, number: usize, mut go: watch::Receiver<Option<Instant>>) -> Vec<u64> {
    let study = format!("studies/load-{}", number % STUDIES);
    let mut client = TuningServiceClient::connect(url).await.expect("the daemon listens");
    let (frames, outgoing) = mpsc::channel(1);
    let mut answers = client.tune(ReceiverStream::new(outgoing)).await.expect("a stream begins").into_inner();
    let until = go.wait_for(Option::is_some).await.expect("the measurement begins").expect("a time");
    let suggest = wire::SuggestRequest { study, client_id: format!("c{number}"), ..Default::default() };
    let (mut result, mut times_us) = (None, Vec::new());
    while Instant::now() < until {
        let begin = Instant::now();
        let is_joint = result.is_some();
        let frame = wire::TuneRequest { report: result.take(), suggest: Some(suggest.clone()) };
        frames.send(frame).await.expect("the stream is open");
        let answer = answers.message().await.expect("the stream is open").expect("an answer");
        assert!(answer.report_error.is_none(), "a report was refused: {answer:?}");
        if is_joint {
            times_us.push(begin.elapsed().as_micros() as u64);
        }
        let trial = answer.trial.unwrap_or_else(|| panic!("no trial: {:?}", answer.suggest_error));
        result = Some(report(&trial));
    }
    times_us
}

fn at(sorted: &[u64], share: f64) -> f64 {
    let place = ((sorted.len() - 1) as f64 * share).round() as usize;
    sorted[place] as f64 / 1e3
}

async fn measure(server: &Server, replicas: usize, spread: Spread, clients: usize, time: Duration) {
    let database = Database::create_on(&server.url("postgres")).await;
    let daemons: Vec<Daemon> = (0..replicas).map(|_| Daemon::start(Path::new(&database))).collect();
    for number in 0..STUDIES {
        // The daemon that is asked first holds the study.
        let url = daemons[number % replicas].url().to_owned();
        let mut client = TuningServiceClient::connect(url).await.expect("the daemon listens");
        let id = format!("load-{number}");
        let request = wire::CreateStudyRequest { study_id: id.clone(), study: Some(study()) };
        client.create_study(request).await.expect("a study");
        let study = format!("studies/{id}");
        let ask = wire::SuggestRequest { study, client_id: "first".to_owned(), ..Default::default() };
        client.suggest(ask).await.expect("a trial");
    }
    let (go, begin) = watch::channel(None);
    let mut running = JoinSet::new();
    for number in 0..clients {
        let replica = match spread {
            Spread::ByStudy => number % STUDIES % replicas,
            Spread::ByClient => number / STUDIES % replicas,
        };
        running.spawn(trials(daemons[replica].url().to_owned(), number, begin.clone()));
    }
    tokio::time::sleep(Duration::from_millis(500)).await;
    go.send(Some(Instant::now() + time)).expect("clients wait");
    let mut times_us: Vec<u64> = running.join_all().await.concat();
    times_us.sort_unstable();
    let spread = match spread {
        Spread::ByStudy => "of the study",
        Spread::ByClient => "any",
    };
    println!(
        "| {replicas} | {clients} | {spread} | {:.0} | {:.2} | {:.2} |",
        times_us.len() as f64 / time.as_secs_f64(),
        at(&times_us, 0.5),
        at(&times_us, 0.99)
    );
}

/// The frames of a renderer, those without an answer in time, and its longest wait.
#[derive(Default)]
struct Seen {
    frames: u64,
    fallbacks: u64,
    dropped: u64,
    longest: Duration,
}

async fn render(
    urls: String,
    number: usize,
    search: SearchMethod,
    stop: watch::Receiver<Option<Instant>>,
) -> Seen {
    let options = Options::new().client_id(format!("renderer-{number}")).deadline(DEADLINE);
    let client = Client::connect(&urls, options).expect("good addresses");
    let space = Space::builder().integer("leaf", 1..=32).default(8).float("p0", 0.0..=1.0).default(0.5);
    let space =
        (1..5).fold(space, |space, number| space.float(&format!("p{number}"), 0.0..=1.0).default(0.5));
    let space = space.build().expect("a space");
    let spec = StudySpec::builder(space).indicator("triangles", 0.0..=100.0, Scale::Linear);
    // All explore, all the time.
    let spec = spec.policy(Policy::new().search(search).epsilon(1.0).trials_per_state(100_000));
    let spec = spec.minimise("render_ms", 1.0).build().expect("a specification");
    let study = client.study(&format!("hall-{}", number % STUDIES), spec).await.expect("a study");
    let mut tuner = study.tuner();
    let (mut previous, mut seen) = (None, Seen::default());
    while stop.borrow().is_none() {
        let indicators = Indicators::from([("triangles", (number * 3) as f64)]);
        let begin = Instant::now();
        let suggestion = tuner.next(&indicators, previous.take()).await;
        seen.longest = seen.longest.max(begin.elapsed());
        seen.frames += 1;
        let cost = suggestion.configuration().integer("leaf").expect("a leaf") as f64;
        previous = Some(suggestion.finished([("render_ms", cost)].into(), Outcome::Ok).expect("measured"));
        tokio::time::sleep(FRAME).await;
    }
    drop(previous);
    client.flush(Duration::from_secs(60)).await.expect("every report is acknowledged");
    let stats = client.stats();
    Seen { fallbacks: stats.fallbacks, dropped: stats.dropped + stats.refused, ..seen }
}

/// Renderers at three daemons, of which one after the other is killed, or none; `search` decides whether a
/// suggestion needs a fitted model.
async fn under_fire(server: &Server, clients: usize, search: SearchMethod, time: Duration, is_calm: bool) {
    let database = Database::create_on(&server.url("postgres")).await;
    let path = Path::new(&database);
    let mut daemons: Vec<Daemon> = (0..REPLICAS_MAX).map(|_| Daemon::start(path)).collect();
    let addresses: Vec<String> = daemons.iter().map(|daemon| daemon.address().to_owned()).collect();
    let urls: Vec<String> = daemons.iter().map(|daemon| daemon.url().to_owned()).collect();
    let (stop, stopped) = watch::channel(None);
    let mut renderers = JoinSet::new();
    for number in 0..clients {
        let mut mine = urls.clone();
        mine.rotate_left(number % REPLICAS_MAX);
        renderers.spawn(render(mine.join(","), number, search, stopped.clone()));
    }
    let until = Instant::now() + time;
    let mut kills = 0;
    while Instant::now() < until {
        tokio::time::sleep(KILL_EVERY).await;
        if is_calm {
            continue;
        }
        let victim = kills % daemons.len();
        daemons.remove(victim).kill();
        tokio::time::sleep(KILL_EVERY / 4).await;
        daemons.insert(victim, Daemon::start_at(path, &addresses[victim]));
        kills += 1;
    }
    stop.send(Some(Instant::now())).expect("renderers listen");
    let mut all = Seen::default();
    for seen in renderers.join_all().await {
        all.frames += seen.frames;
        all.fallbacks += seen.fallbacks;
        all.dropped += seen.dropped;
        all.longest = all.longest.max(seen.longest);
    }
    println!(
        "\n{search:?}: {REPLICAS_MAX} daemons, {kills} kills, one every {:.1} s, {clients} renderers of at most {:.0} frames a second: \
         {} frames, {} of them with the configuration at hand for want of an answer within {} ms, {} reports dropped, \
         longest wait {:.1} ms",
        (KILL_EVERY + KILL_EVERY / 4).as_secs_f64(),
        1.0 / FRAME.as_secs_f64(),
        all.frames,
        all.fallbacks,
        DEADLINE.as_millis(),
        all.dropped,
        all.longest.as_secs_f64() * 1e3
    );
}

#[tokio::main]
async fn main() {
    let mut numbers = std::env::args().skip(1).map(|text| {
        text.parse::<u32>().unwrap_or_else(|_| {
            eprintln!("usage: scale_out [SECONDS] [CLIENTS]; {text:?} is no whole number");
            std::process::exit(2);
        })
    });
    let time = Duration::from_secs(numbers.next().unwrap_or(10).into());
    let clients = numbers.next().unwrap_or(32) as usize;
    let server = tokio::task::spawn_blocking(Server::start).await.expect("PostgreSQL starts");
    println!("| daemons | clients | asked daemon | trials/s | p50 ms | p99 ms |\n|---|---|---|---|---|---|");
    measure(&server, 1, Spread::ByStudy, 1, time).await;
    for replicas in 1..=REPLICAS_MAX {
        measure(&server, replicas, Spread::ByStudy, clients, time).await;
        if replicas > 1 {
            measure(&server, replicas, Spread::ByClient, clients, time).await;
        }
    }
    for search in [SearchMethod::Random, SearchMethod::Auto] {
        under_fire(&server, clients, search, time, true).await;
        under_fire(&server, clients, search, time.max(KILL_EVERY * 10), false).await;
    }
}
