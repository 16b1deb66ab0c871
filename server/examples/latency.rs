//! Measures what a frame pays for tuning: Suggest plus Report as two calls, one round trip of the Tune
//! stream, and Predict, over loopback against a durable SQLite database.
//!
//! `cargo run --release -p treewright-server --example latency [-- DIRECTORY]`
//!
//! The study has the size of the paper's: eleven parameters and seventeen indicators. Every answer is
//! checked, so that a fast wrong one does not count. The database lies in DIRECTORY, else in the system's
//! folder for temporary files; a folder in memory would measure no disk, so the time of a bare
//! `fdatasync` there is printed as well.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::{Seek as _, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::net::TcpListener;
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as wire, outcome, parameter, value};
use treewright_server::clock::SystemClock;
use treewright_server::serve;
use treewright_store::SqliteStore;

const WARM_UP: usize = 200;
const ROUNDS: usize = 3000;
const PARAMETERS: usize = 11;
const INDICATORS: usize = 17;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

fn study() -> wire::Study {
    let integer = |n| wire::Value { kind: Some(value::Kind::Integer(n)) };
    let parameters = (0..PARAMETERS).map(|number| wire::Parameter {
        name: format!("parameter_{number}"),
        domain: Some(parameter::Domain::Integer(wire::IntegerDomain { min: 1, max: 1000, scale: 0 })),
        default_value: Some(integer(10)),
        active_if: None,
    });
    let indicators = (0..INDICATORS).map(|number| wire::Indicator {
        name: format!("indicator_{number}"),
        min: 0.0,
        max: 1.0,
        scale: 0,
    });
    wire::Study {
        space: Some(wire::Space { parameters: parameters.collect(), constraints: Vec::new() }),
        indicators: indicators.collect(),
        objective: Some(wire::Objective {
            terms: vec![wire::ObjectiveTerm { metric: "render_ms".to_owned(), weight: 1.0 }],
            ..Default::default()
        }),
        policy: Some(wire::Policy { epsilon: Some(1.0), trials_per_state: 80, ..wire::Policy::default() }),
        ..wire::Study::default()
    }
}

/// A new state every hundred frames, so that searches begin and end as they do in use.
fn ask(client: &str, frame: usize) -> wire::SuggestRequest {
    let place = (frame / 100) as f64 * 0.02;
    let indicators = (0..INDICATORS).map(|n| (format!("indicator_{n}"), place * 0.5 + 0.01));
    wire::SuggestRequest {
        study: "studies/latency".to_owned(),
        client_id: client.to_owned(),
        indicators: indicators.collect(),
        ..wire::SuggestRequest::default()
    }
}

fn report(trial: &wire::Trial) -> wire::ReportRequest {
    // A bowl around the middle of the space.
    let values = trial.configuration.iter().flat_map(|c| c.values.values());
    let render_ms = values.fold(5.0, |sum, value| match value.kind {
        Some(value::Kind::Integer(n)) => sum + ((n - 500) as f64 / 500.0).powi(2),
        _ => sum,
    });
    wire::ReportRequest {
        trial: trial.name.clone(),
        measurements: BTreeMap::from([("build_ms".to_owned(), 2.0), ("render_ms".to_owned(), render_ms)]),
        outcome: Some(wire::Outcome { kind: Some(outcome::Kind::Ok(wire::Ok {})) }),
    }
}

fn print(what: &str, mut times: Vec<Duration>) {
    times.sort();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    println!(
        "{what:<34} p50 {:.3} ms   p90 {:.3} ms   p99 {:.3} ms   max {:.3} ms",
        at(0.5),
        at(0.9),
        at(0.99),
        at(1.0)
    );
}

/// What one write of a page costs the disk under the database.
fn bare_sync(directory: &Path) -> std::io::Result<Vec<Duration>> {
    let mut file = tempfile::tempfile_in(directory)?;
    (0..500)
        .map(|_| {
            file.rewind()?;
            let begin = Instant::now();
            file.write_all(&[1; 4096])?;
            file.sync_data()?;
            Ok(begin.elapsed())
        })
        .collect()
}

#[tokio::main]
async fn main() -> Outcome<()> {
    let directory = match std::env::args_os().nth(1) {
        Some(parent) => tempfile::tempdir_in(parent)?,
        None => tempfile::tempdir()?,
    };
    print("bare write + fdatasync", bare_sync(directory.path())?);

    let store = SqliteStore::open(&directory.path().join("latency.db")).await?;
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    let address = listener.local_addr()?;
    let (stop, stopped) = oneshot::channel::<()>();
    let server = tokio::spawn(serve::run(
        listener,
        Arc::new(store),
        Arc::new(SystemClock::default()),
        Duration::from_secs(5),
        async {
            let _ = stopped.await;
        },
    ));
    // The client has a thread and a runtime of its own, as in a process of its own.
    let client = std::thread::spawn(move || {
        tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?
            .block_on(measure(&format!("http://{address}")))
    });
    let measured = tokio::task::spawn_blocking(|| client.join()).await?;
    measured.map_err(|_| "the client panicked")??;
    drop(stop);
    server.await??;
    Ok(())
}

async fn measure(address: &str) -> Outcome<()> {
    let mut client = TuningServiceClient::connect(address.to_owned()).await?;
    client
        .create_study(wire::CreateStudyRequest { study_id: "latency".to_owned(), study: Some(study()) })
        .await?;

    let mut calls = Vec::with_capacity(ROUNDS);
    for frame in 0..WARM_UP + ROUNDS {
        let question = ask("calls", frame);
        let begin = Instant::now();
        let trial = client.suggest(question).await?.into_inner();
        let suggested = begin.elapsed();
        let result = report(&trial);
        let begin = Instant::now();
        let answer = client.report(result).await?.into_inner();
        let reported = begin.elapsed();
        if answer.duplicate || answer.trial.is_none_or(|stored| stored.cost.is_none()) {
            return Err("a report was not taken".into());
        }
        if frame >= WARM_UP {
            calls.push(suggested + reported);
        }
    }
    print("Suggest + Report, two calls", calls);

    let mut predictions = Vec::with_capacity(ROUNDS);
    for frame in 0..ROUNDS {
        let wire::SuggestRequest { study, indicators, .. } = ask("calls", frame);
        let begin = Instant::now();
        let question = wire::PredictRequest { study, indicators, ..Default::default() };
        let answer = client.predict(question).await?.into_inner();
        predictions.push(begin.elapsed());
        answer.configuration.ok_or("no configuration")?;
    }
    print("Predict, which writes nothing", predictions);

    let (frames, outgoing) = mpsc::channel(1);
    let mut answers = client.tune(ReceiverStream::new(outgoing)).await?.into_inner();
    let mut result = None;
    let mut rounds = Vec::with_capacity(ROUNDS);
    for frame in 0..WARM_UP + ROUNDS {
        let request = wire::TuneRequest { report: result.take(), suggest: Some(ask("stream", frame)) };
        let is_joint = request.report.is_some();
        let begin = Instant::now();
        frames.send(request).await?;
        let answer = answers.message().await?.ok_or("the stream ended")?;
        if frame >= WARM_UP {
            rounds.push(begin.elapsed());
        }
        if is_joint && answer.reported.is_none_or(|reported| reported.duplicate) {
            return Err("a report was not taken".into());
        }
        result = Some(report(&answer.trial.ok_or("no trial")?));
    }
    print("Tune, one round trip", rounds);
    Ok(())
}
