//! A study that grows wide: a given number of states or of client ids, each with one trial, and retention on.
//! Shows the memory and time that the daemon needs, and whether the last are served like the first.
//!
//! `cargo run --release -p treewright-tests --example breadth -- states|clients [COUNT] [STREAMS] [FOLDER] [FROM]`
//! (by default a million states or 100,000 clients over 32 streams; the daemon keeps 20,000 trials). With a
//! folder the database stays there, and a later run goes on from FROM. Prints a line of JSON for each tenth:
//! times in milliseconds, memory and files in MB.

mod leaf_study;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use leaf_study::report;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;
use tonic::transport::Channel;
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_tests::daemon::Daemon;

/// Trials that the daemon keeps: the fewest that it takes.
const KEPT: &str = "20000";
/// Places of one indicator; three indicators have 1,000,000 states.
const PLACES: u64 = 100;

#[derive(Clone, Copy)]
enum Width {
    States,
    Clients,
}

impl Width {
    fn question(self, number: u64) -> wire::SuggestRequest {
        let (client_id, place) = match self {
            Width::States => ("wide".to_owned(), number),
            Width::Clients => (format!("node-{number}"), number % PLACES),
        };
        let digit = |power| (place / PLACES.pow(power) % PLACES) as f64;
        let indicators = (0..3).map(|axis| (format!("at_{axis}"), digit(axis))).collect();
        wire::SuggestRequest { study: "studies/wide".into(), client_id, indicators, ..Default::default() }
    }
}

/// The study of one integer with the indicators of the states.
fn study() -> wire::Study {
    let indicator = |axis: u32| wire::Indicator {
        name: format!("at_{axis}"),
        min: 0.0,
        max: PLACES as f64,
        scale: wire::Scale::Linear as i32,
    };
    let indicators = (0..3).map(indicator).collect();
    wire::Study { indicators, state_tolerance: Some(0.001), ..leaf_study::study() }
}

/// Takes numbers until there are none left. How long each frame took, in milliseconds.
async fn frames(url: String, width: Width, next: Arc<AtomicU64>, end: u64) -> Vec<f64> {
    let mut client = TuningServiceClient::connect(url).await.expect("a connection");
    let (say, outgoing) = mpsc::channel(1);
    let mut answers = client.tune(ReceiverStream::new(outgoing)).await.expect("a stream").into_inner();
    let (mut times_ms, mut result) = (Vec::new(), None);
    loop {
        let number = next.fetch_add(1, Ordering::Relaxed);
        if number >= end {
            return times_ms;
        }
        let begin = Instant::now();
        let mut question = width.question(number);
        if matches!(width, Width::States) {
            // Each stream is a client of its own, for which every frame is another state.
            question.client_id = format!("wide-{:?}", tokio::task::id());
        }
        let frame = wire::TuneRequest { report: result.take(), suggest: Some(question) };
        say.send(frame).await.expect("the stream is open");
        let answer = answers.message().await.expect("an answer").expect("the stream goes on");
        times_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        match (answer.trial, answer.suggest_error, answer.report_error) {
            (Some(trial), _, None) => result = Some(report(trial)),
            (_, refused, unreported) => panic!("frame {number}: {refused:?} {unreported:?}"),
        }
    }
}

fn file_mb(path: &Path) -> f64 {
    std::fs::metadata(path).map_or(0.0, |file| file.len() as f64 / 1e6)
}

/// Asks until the daemon has read the study, and says how long that took.
async fn wait_until_loaded(client: &mut TuningServiceClient<Channel>) {
    let begin = Instant::now();
    while let Err(refused) =
        client.get_best(wire::GetBestRequest { study: "studies/wide".into(), ..Default::default() }).await
    {
        assert_eq!(refused.code(), Code::Unavailable, "{refused}");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    println!("{}", serde_json::json!({ "seconds_to_load": begin.elapsed().as_secs_f64() }));
}

#[tokio::main]
async fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (width, count) = match arguments.first().map(String::as_str) {
        Some("states") => (Width::States, 1_000_000),
        Some("clients") => (Width::Clients, 100_000),
        _ => panic!("say states or clients"),
    };
    let number =
        |place: usize, or: u64| arguments.get(place).map_or(or, |text| text.parse().expect("a number"));
    let (count, streams) = (number(1, count), number(2, 32));
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = arguments.get(3).map_or_else(|| temporary.path().to_owned(), PathBuf::from);
    let from = number(4, 0);
    let database = folder.join("wide.db");
    let daemon = Daemon::start_with(&database, &["--keep-trials", KEPT], &folder.join("log"));
    let mut first = TuningServiceClient::connect(daemon.url().to_owned()).await.expect("a connection");
    if from == 0 {
        let request = wire::CreateStudyRequest { study_id: "wide".into(), study: Some(study()) };
        first.create_study(request).await.expect("the study is taken");
    } else {
        wait_until_loaded(&mut first).await;
    }
    let next = Arc::new(AtomicU64::new(0));
    for tenth in 1..=10 {
        let (begin, end) = (Instant::now(), from + (count - from) * tenth / 10);
        next.store(from + (count - from) * (tenth - 1) / 10, Ordering::Relaxed);
        let mut all = JoinSet::new();
        for _ in 0..streams {
            all.spawn(frames(daemon.url().to_owned(), width, Arc::clone(&next), end));
        }
        let mut times_ms: Vec<f64> = all.join_all().await.into_iter().flatten().collect();
        times_ms.sort_by(f64::total_cmp);
        let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
        let record = wire::GetStudyRequest { name: "studies/wide".into() };
        let statistics = first.get_study(record).await.expect("it is there").into_inner().statistics;
        let line = serde_json::json!({
            "done": end, "seconds": begin.elapsed().as_secs_f64(), "p50_ms": at(0.5), "p99_ms": at(0.99),
            "longest_ms": at(1.0), "states": statistics.map(|all| all.states),
            "daemon_mb": daemon.memory_bytes() as f64 / 1e6, "database_mb": file_mb(&database),
        });
        println!("{line}");
    }
    assert!(daemon.terminate().success());
}
