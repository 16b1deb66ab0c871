//! The costs of a long history: start-up to the first answer, memory, and the time of a frame, at any number
//! of stored trials of one study of six parameters.
//!
//! `cargo run --release -p treewright-server --example growth -- DIRECTORY TRIALS [STATES]`
//!
//! The first 20,000 trials go through the daemon's own code, client after client. Then the table is filled
//! with copies of their rows under new numbers, up to TRIALS trials. The daemon would have written such rows
//! if the clients had stayed in the explored states. All measurements, with loading, are real. Each runs in a
//! separate process on the database of the one before: the first replays all trials and saves a checkpoint,
//! the second starts from it. At last two more processes serve the dashboard from it. They print when the
//! first page of the study was there, with its picture, and how long each page takes then.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

use sqlx::{AssertSqlSafe, Connection as _, Executor as _};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use treewright_core::policy::{Policy, SearchMethod};
use treewright_core::space::{Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::Ask;
use treewright_core::value::Value;
use treewright_server::clock::SystemClock;
use treewright_server::convert::from_proto::{Report, Suggest};
use treewright_server::convert::names::TrialName;
use treewright_server::error::Error;
use treewright_server::serve::{self, Options};
use treewright_server::tuning::Tuning;
use treewright_store::{SqliteStore, Store};

type Done<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

const STUDY: &str = "growth";
const SEEDED: u64 = 20_000;
const FRAMES: usize = 2_000;
const CLIENTS: u64 = 32;
/// The pages that are asked for, below the study's address.
const PAGES: [&str; 7] = [
    "",
    "?state=1",
    "/parameters?state=1",
    "/map",
    "/trials",
    "/trials?filter=cost%20%3C%2011&order=cost",
    "/policy",
];
const COLUMNS: &str = "client_id, state_id, mode, state, outcome, outcome_reason, outcome_lower_bound, cost, \
     predicted_cost, late, create_ms, lease_expire_ms, complete_ms, configuration, indicators, measurements, reason, \
     fingerprint";

fn spec() -> Done<StudySpec> {
    let first = Space::builder().float("parameter_0", 0.0..=1.0).default(0.5);
    let space = (1..6)
        .fold(first, |space, number| space.float(&format!("parameter_{number}"), 0.0..=1.0).default(0.5));
    let spec = StudySpec::builder(space.build()?)
        .indicator("x", 0.0..=1.0, Scale::Linear)
        .indicator("y", 0.0..=1.0, Scale::Linear)
        .minimise("render_ms", 1.0)
        .state_tolerance(0.001)
        .seed(1);
    Ok(spec.build()?.with_policy(Policy { search: SearchMethod::Random, ..Policy::default() }))
}

/// One frame of a client: report and suggest in one, as a stream does it.
async fn frame(tuning: &Tuning, number: u64, states: u64, previous: Option<Trial>) -> Done<Trial> {
    let place = (number / CLIENTS / 25 * 7 + number % CLIENTS) % states;
    let ask = Ask {
        client_id: format!("client-{:02}", number % CLIENTS),
        indicators: BTreeMap::from([
            ("x".to_owned(), place as f64 / states as f64),
            ("y".to_owned(), (place * 37 % states) as f64 / states as f64),
        ]),
        ..Ask::default()
    };
    let report = previous.map(|trial| {
        let value = |parameter: usize| {
            trial
                .configuration
                .get(&format!("parameter_{parameter}"))
                .and_then(Value::as_number)
                .unwrap_or(0.5)
        };
        let cost: f64 = (0..6).map(|parameter| (value(parameter) - 0.15 * parameter as f64).powi(2)).sum();
        let noise = 1.0 + 0.02 * ((trial.number * 7919 % 101) as f64 / 101.0);
        Report {
            trial: TrialName { study: STUDY.into(), number: trial.number },
            measurements: BTreeMap::from([("render_ms".to_owned(), 10.0 * noise * (1.0 + cost))]),
            standard_errors: BTreeMap::new(),
            outcome: Outcome::Ok,
        }
    });
    let reports = report.is_some();
    let answer = tuning
        .frame(report, Some(Suggest { study: STUDY.into(), ask, wanted: None, space_revision: 0 }))
        .await;
    if reports {
        answer.reported.ok_or("no answer to a report")??;
    }
    Ok(answer.suggested.ok_or("no answer to a question")??)
}

/// Frames of all clients in turn; the time of each in microseconds.
async fn frames(tuning: &Tuning, count: u64, states: u64) -> Done<Vec<f64>> {
    let mut held: Vec<Option<Trial>> = vec![None; CLIENTS as usize];
    let mut times = Vec::new();
    for number in 0..count {
        let client = (number % CLIENTS) as usize;
        let begun = Instant::now();
        held[client] = Some(frame(tuning, number, states, held[client].take()).await?);
        times.push(begun.elapsed().as_secs_f64() * 1e6);
    }
    for trial in held.into_iter().flatten() {
        tuning.abandon(&TrialName { study: STUDY.into(), number: trial.number }).await?;
    }
    Ok(times)
}

async fn seed(path: &Path, trials: u64, states: u64) -> Done<()> {
    let store = Arc::new(SqliteStore::open(path).await?);
    let tuning = Tuning::new(Arc::clone(&store) as _, Arc::new(SystemClock::default()));
    tuning.create_study(STUDY, &spec()?).await?;
    frames(&tuning, trials.min(SEEDED) + CLIENTS, states).await?;
    store.close().await;
    Ok(())
}

/// The completed rows again and again, under new numbers.
async fn multiply(path: &Path, trials: u64) -> Done<()> {
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(path).foreign_keys(false);
    let mut database = sqlx::SqliteConnection::connect_with(&options).await?;
    database.execute("PRAGMA synchronous = OFF").await?;
    // Trials given back at the end of the first part would block the numbers that follow.
    database.execute("DELETE FROM trials WHERE state <> 'COMPLETED'").await?;
    let seeded: i64 = sqlx::query_scalar("SELECT max(number) FROM trials").fetch_one(&mut database).await?;
    let count: i64 =
        sqlx::query_scalar("SELECT max(completion) FROM trials").fetch_one(&mut database).await?;
    let copies = i64::try_from(trials)? / count;
    for copy in 1..copies {
        let insert = format!(
            "INSERT INTO trials (study, number, completion, {COLUMNS}) SELECT study, number + {}, completion + {}, \
             {COLUMNS} FROM trials WHERE number <= {seeded} ORDER BY number",
            copy * seeded,
            copy * count
        );
        database.execute(AssertSqlSafe(insert)).await?;
    }
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)").await?;
    database.close().await?;
    Ok(())
}

fn status(name: &str) -> Done<f64> {
    let text = std::fs::read_to_string("/proc/self/status")?;
    let line = text.lines().find(|line| line.starts_with(name)).ok_or("no such line in /proc/self/status")?;
    let kib: f64 = line.split_whitespace().nth(1).ok_or("an empty line")?.parse()?;
    Ok(kib / 1024.0)
}

async fn measure(path: &Path, states: u64) -> Done<()> {
    let begun = Instant::now();
    let store = Arc::new(SqliteStore::open(path).await?);
    let tuning = Tuning::new(Arc::clone(&store) as _, Arc::new(SystemClock::default()));
    // The daemon's clients ask again while a study is loaded.
    let first = loop {
        match frame(&tuning, 0, states, None).await {
            Err(error) if matches!(error.downcast_ref(), Some(Error::Loading(_))) => {}
            answer => break answer?,
        }
    };
    let first_ms = begun.elapsed().as_secs_f64() * 1e3;
    tuning.abandon(&TrialName { study: STUDY.into(), number: first.number }).await?;
    tuning.save_checkpoints().await;
    let trials = tuning.get_study(STUDY).await?.statistics.completed_trials;
    let mut times = frames(&tuning, FRAMES as u64, states).await?;
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[(share * (times.len() - 1) as f64) as usize];
    println!(
        "{trials:>9} trials  first answer {first_ms:>9.1} ms  frame p50 {:>6.0} us  p99 {:>6.0} us  resident {:>5.1} MB, \
         at most {:>5.1} MB  file {:>8.1} MB",
        at(0.5),
        at(0.99),
        status("VmRSS")?,
        status("VmHWM")?,
        std::fs::metadata(path)?.len() as f64 / 1e6,
    );
    store.close().await;
    Ok(())
}

async fn page_ms(dashboard: SocketAddr, page: &str) -> Done<f64> {
    let begun = Instant::now();
    let mut stream = TcpStream::connect(dashboard).await?;
    let head =
        format!("GET /studies/{STUDY}{page} HTTP/1.1\r\nHost: {dashboard}\r\nConnection: close\r\n\r\n");
    stream.write_all(head.as_bytes()).await?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await?;
    let is_page = answer.starts_with(b"HTTP/1.1 200 ");
    is_page.then(|| begun.elapsed().as_secs_f64() * 1e3).ok_or_else(|| format!("{page} is no page").into())
}

async fn measure_pages(path: &Path) -> Done<()> {
    let begun = Instant::now();
    let store = Arc::new(SqliteStore::open(path).await?);
    let (listener, pages) =
        (TcpListener::bind("127.0.0.1:0").await?, TcpListener::bind("127.0.0.1:0").await?);
    let dashboard = pages.local_addr()?;
    let options = Options { dashboard: Some(pages), ..Options::default() };
    let (stop, stopped) = oneshot::channel::<()>();
    let served =
        tokio::spawn(serve::run(listener, store, Arc::new(SystemClock::default()), options, async {
            // A dropped end stops it as well.
            let _ = stopped.await;
        }));
    page_ms(dashboard, PAGES[0]).await?;
    println!("first page {:.0} ms after the start", begun.elapsed().as_secs_f64() * 1e3);
    for page in PAGES {
        let mut times = [0.0; 5];
        for time in &mut times {
            *time = page_ms(dashboard, page).await?;
        }
        times.sort_by(f64::total_cmp);
        let [_, _, median, _, most] = times;
        println!("    {median:>7.1} ms, at most {most:>7.1} ms  /studies/{STUDY}{page}");
    }
    drop(stop);
    served.await??;
    Ok(())
}

#[tokio::main(flavor = "multi_thread", worker_threads = 2)]
async fn main() -> Done<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |place: usize, default| arguments.get(place).map_or(Ok(default), |text| text.parse::<u64>());
    let usage = "usage: growth DIRECTORY TRIALS [STATES]";
    let directory = PathBuf::from(arguments.first().ok_or(usage)?);
    let (trials, states) = (number(1, 100_000)?, number(2, 64)?);
    let path = directory.join("growth.db");
    match arguments.get(3).map(String::as_str) {
        Some("measure") => return measure(&path, states).await,
        Some("pages") => return measure_pages(&path).await,
        _ => {}
    }
    for suffix in ["", "-wal", "-shm", ".lock"] {
        let _ = std::fs::remove_file(directory.join(format!("growth.db{suffix}")));
    }
    let begun = Instant::now();
    seed(&path, trials, states).await?;
    println!("filled by the daemon's code in {:.1} s", begun.elapsed().as_secs_f64());
    let again = |what: &str| -> Done<()> {
        let (trials, states) = (trials.to_string(), states.to_string());
        let status =
            Command::new(std::env::current_exe()?).arg(&directory).args([&trials, &states, what]).status()?;
        if status.success() { Ok(()) } else { Err("a measurement failed".into()) }
    };
    again("measure")?;
    if trials > SEEDED {
        let begun = Instant::now();
        multiply(&path, trials).await?;
        println!("multiplied in {:.1} s", begun.elapsed().as_secs_f64());
        (0..3).try_for_each(|_| again("measure"))?;
    }
    (0..2).try_for_each(|_| again("pages"))
}
