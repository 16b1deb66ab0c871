//! Ten thousand clients on one daemon, which ask for a trial and report it now and then: the memory, the
//! number of served clients, and the waits of an active client, which renders at 30 frames a second.
//!
//! `cargo run --release -p treewright-tests --example crowd -- [CLIENTS] [SECONDS BETWEEN A CLIENT'S FRAMES] [SECONDS]`
//! (10000, 20 and 15 by default). The crowd is a process of its own, begun by the command in
//! TREEWRIGHT_CROWD_BY if there is one: `taskset --cpu-list 0,1` gives it processors of its own, as on
//! another machine. Needs a descriptor for each client (`ulimit -n`). Prints JSON: times in milliseconds,
//! memory in MB.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use treewright_client::blocking::Client;
use treewright_client::{Indicators, Measurements, Options, Outcome, Scale, Source, Space, StudySpec};
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_tests::daemon::Daemon;

/// Makes a process the crowd of the daemon that it names.
const CROWD: &str = "TREEWRIGHT_CROWD_OF";
/// A command that becomes the program whose words follow its own.
const CROWD_BY: &str = "TREEWRIGHT_CROWD_BY";
const FRAME: Duration = Duration::from_micros(33_333);

fn spec() -> StudySpec {
    let space = Space::builder().float("cost", 0.1..=10.0).default(1.0).integer("leaf", 1..=32).default(8);
    let spec =
        StudySpec::builder(space.build().expect("a space")).indicator("triangles", 1.0..=1e7, Scale::Log);
    spec.minimise("render_ms", 1.0).build().expect("a study")
}

fn argument(place: usize, or: f64) -> f64 {
    std::env::args().nth(place).map_or(or, |text| text.parse().expect("a number"))
}

/// The value below which a share of them lies.
fn quantile(times_ms: &mut [f64], share: f64) -> f64 {
    times_ms.sort_by(f64::total_cmp);
    times_ms.get((share * (times_ms.len() - 1) as f64) as usize).copied().unwrap_or(f64::NAN)
}

/// Renders. Returns the wait of each frame for its answer, and the number of frames with a trial.
fn active(url: &str, time: Duration) -> (Vec<f64>, usize) {
    let options = Options::new().client_id("active").deadline(Duration::from_secs(2));
    let client = Client::connect(url, options).expect("a good address");
    let study = client.study("hall", spec()).expect("a study");
    let indicators = Indicators::from([("triangles", 5e5)]);
    let (mut tuner, mut previous, mut waits_ms, mut with_trial) = (study.tuner(), None, Vec::new(), 0);
    let begin = Instant::now();
    while begin.elapsed() < time {
        let asked = Instant::now();
        let suggestion = tuner.next(&indicators, previous.take());
        waits_ms.push(asked.elapsed().as_secs_f64() * 1e3);
        with_trial += usize::from(suggestion.source() == Source::Daemon);
        std::thread::sleep(FRAME.saturating_sub(asked.elapsed()));
        let measured = Measurements::from([("render_ms", 33.0)]);
        previous = Some(suggestion.finished(measured, Outcome::Ok).expect("a result"));
    }
    (waits_ms, with_trial)
}

/// One of the crowd: a connection of its own, a trial now and then. Returns how long each frame took, and how
/// many failed. `connecting` is given back once it is connected.
async fn passer(
    url: String,
    connecting: OwnedSemaphorePermit,
    number: usize,
    every: Duration,
    until: Instant,
) -> (Vec<f64>, usize) {
    let (mut times_ms, mut failed) = (Vec::new(), 0);
    let endpoint = tonic::transport::Endpoint::from_shared(url).expect("a good address");
    let mut client = loop {
        match endpoint.connect().await {
            Ok(channel) => break TuningServiceClient::new(channel),
            Err(_) => {
                failed += 1;
                tokio::time::sleep(Duration::from_millis(200)).await;
            }
        }
    };
    drop(connecting);
    println!("connected");
    let spread = every.mul_f64((number as f64 * 0.618_034).fract());
    tokio::time::sleep(spread).await;
    while Instant::now() < until {
        let begin = Instant::now();
        let ask = wire::SuggestRequest {
            study: "studies/hall".into(),
            client_id: format!("passer-{number}"),
            indicators: BTreeMap::from([("triangles".to_owned(), 10f64.powi(1 + number as i32 % 6))]),
            ..wire::SuggestRequest::default()
        };
        let kind = Some(wire::outcome::Kind::Ok(wire::Ok {}));
        let reported = match client.suggest(ask).await {
            Ok(trial) => {
                let report = wire::ReportRequest {
                    trial: trial.into_inner().name,
                    measurements: BTreeMap::from([("render_ms".to_owned(), 10.0 + number as f64 % 7.0)]),
                    outcome: Some(wire::Outcome { kind }),
                    ..wire::ReportRequest::default()
                };
                client.report(report).await.is_ok()
            }
            Err(_) => false,
        };
        times_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        failed += usize::from(!reported);
        tokio::time::sleep(every.saturating_sub(begin.elapsed())).await;
    }
    (times_ms, failed)
}

/// The crowd's process: connects all clients, and prints their results.
async fn crowd(url: String) {
    let (clients, every, time) = (argument(1, 10_000.0) as usize, argument(2, 20.0), argument(3, 15.0));
    // Connecting all of them takes a while, in which the first ask already.
    let until = Instant::now() + Duration::from_secs_f64(time + 30.0 + clients as f64 / 1000.0);
    let connecting = std::sync::Arc::new(Semaphore::new(256));
    let mut all = tokio::task::JoinSet::new();
    for number in 0..clients {
        let place = std::sync::Arc::clone(&connecting).acquire_owned().await.expect("open");
        let url = url.clone();
        all.spawn(passer(url, place, number, Duration::from_secs_f64(every), until));
    }
    let (mut times_ms, mut failed) = (Vec::new(), 0);
    while let Some(done) = all.join_next().await {
        let (times, failures) = done.expect("no panic");
        times_ms.extend(times);
        failed += failures;
    }
    let (p50, p99) = (quantile(&mut times_ms, 0.5), quantile(&mut times_ms, 0.99));
    let line =
        serde_json::json!({ "frames": times_ms.len(), "failed": failed, "p50_ms": p50, "p99_ms": p99 });
    writeln!(std::io::stdout(), "done {line}").expect("somebody listens");
}

fn row(mut waits_ms: Vec<f64>, with_trial: usize, memory_mb: f64) -> serde_json::Value {
    let frames = waits_ms.len();
    let (p50, p99) = (quantile(&mut waits_ms, 0.5), quantile(&mut waits_ms, 0.99));
    let longest = waits_ms.last().copied();
    serde_json::json!({
        "frames": frames, "with_a_trial": with_trial, "p50_ms": p50, "p99_ms": p99, "longest_ms": longest,
        "daemon_mb": memory_mb,
    })
}

fn main() {
    if let Ok(url) = std::env::var(CROWD) {
        let runtime = tokio::runtime::Runtime::new().expect("a runtime");
        return runtime.block_on(crowd(url));
    }
    let (clients, every, time) = (argument(1, 10_000.0) as usize, argument(2, 20.0), argument(3, 15.0));
    let folder = tempfile::tempdir().expect("a folder");
    let most = (clients + 100).to_string();
    let limits = ["--max-connections", &most, "--max-connections-per-address", &most];
    let daemon = Daemon::start_with(&folder.path().join("tuning.db"), &limits, &folder.path().join("log"));
    let memory_mb = || daemon.memory_bytes() as f64 / 1e6;
    let (waits_ms, with_trial) = active(daemon.url(), Duration::from_secs_f64(time));
    let alone = row(waits_ms, with_trial, memory_mb());

    let begun_by = std::env::var(CROWD_BY).unwrap_or_else(|_| "env".to_owned());
    let mut words = begun_by.split_whitespace();
    let mut crowd = Command::new(words.next().expect("a command"))
        .args(words)
        .arg(std::env::current_exe().expect("this program"))
        .args([clients.to_string(), every.to_string(), time.to_string()])
        .env(CROWD, daemon.url())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut lines = BufReader::new(crowd.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let begin = Instant::now();
    let connected = lines.by_ref().take(clients).filter(|line| line == "connected").count();
    let connecting_s = begin.elapsed().as_secs_f64();
    let (waits_ms, with_trial) = active(daemon.url(), Duration::from_secs_f64(time));
    let among = row(waits_ms, with_trial, memory_mb());
    let done = lines.find_map(|line| line.strip_prefix("done ").map(str::to_owned));
    let served: Option<serde_json::Value> = done.and_then(|line| serde_json::from_str(&line).ok());
    crowd.wait().expect("it ends");
    let report = serde_json::json!({
        "clients": clients, "connected": connected, "connecting_s": connecting_s,
        "seconds_between_frames": every, "crowd": served, "active_alone": alone, "active_among_them": among,
    });
    println!("{report:#}");
    assert!(daemon.terminate().success());
}
