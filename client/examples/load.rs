//! One client under load, for measurements with many of them: asks and reports as fast as it is answered.
//!
//! `cargo run --release -p treewright-client --example load -- URL CLIENT_ID SECONDS tune|calls [random|auto]`
//!
//! It creates the study `load` (six parameters, one state), says `ready`, waits for a line on standard input,
//! works for SECONDS, and prints a JSON object with the time of each trial in microseconds: one round trip of
//! the Tune stream, or a Suggest and a Report. `tests/peers/service/run.py` starts many of them at once.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Write as _;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;
use treewright_client::{Policy, SearchMethod, Space, StudySpec};
use treewright_proto::convert::spec_to_wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as wire, outcome, value};

type Failed = Box<dyn Error + Send + Sync>;

const STUDY: &str = "studies/load";
const PARAMETERS: usize = 6;

fn study(search: SearchMethod) -> wire::Study {
    let first = Space::builder().float("p0", 0.0..=1.0).default(0.5);
    let space = (1..PARAMETERS)
        .fold(first, |space, number| space.float(&format!("p{number}"), 0.0..=1.0).default(0.5));
    let spec = StudySpec::builder(space.build().expect("a space")).minimise("render_ms", 1.0);
    let policy = Policy::new().search(search).epsilon(1.0).trials_per_state(100_000);
    spec_to_wire(&spec.policy(policy).build().expect("a specification"))
}

fn ask(client_id: &str) -> wire::SuggestRequest {
    wire::SuggestRequest { study: STUDY.to_owned(), client_id: client_id.to_owned(), ..Default::default() }
}

/// A bowl with its minimum inside the space.
fn report(trial: &wire::Trial) -> wire::ReportRequest {
    let values = trial.configuration.iter().flat_map(|configuration| configuration.values.values());
    let render_ms = values.fold(5.0, |sum, value| match value.kind {
        Some(value::Kind::Float(x)) => sum + (x - 0.3).powi(2),
        _ => sum,
    });
    wire::ReportRequest {
        trial: trial.name.clone(),
        measurements: BTreeMap::from([("render_ms".to_owned(), render_ms)]),
        outcome: Some(wire::Outcome { kind: Some(outcome::Kind::Ok(wire::Ok {})) }),
        ..wire::ReportRequest::default()
    }
}

async fn by_calls(
    client: &mut TuningServiceClient<Channel>,
    client_id: &str,
    until: Instant,
) -> Result<Vec<u64>, Failed> {
    let mut times_us = Vec::new();
    while Instant::now() < until {
        let begin = Instant::now();
        let trial = client.suggest(ask(client_id)).await?.into_inner();
        let answer = client.report(report(&trial)).await?.into_inner();
        times_us.push(begin.elapsed().as_micros() as u64);
        if answer.duplicate {
            return Err("a report was not taken".into());
        }
    }
    Ok(times_us)
}

async fn by_stream(
    client: &mut TuningServiceClient<Channel>,
    client_id: &str,
    until: Instant,
) -> Result<Vec<u64>, Failed> {
    let (frames, outgoing) = mpsc::channel(1);
    let mut answers = client.tune(ReceiverStream::new(outgoing)).await?.into_inner();
    let mut result = None;
    let mut times_us = Vec::new();
    while Instant::now() < until {
        let is_joint = result.is_some();
        let begin = Instant::now();
        frames.send(wire::TuneRequest { report: result.take(), suggest: Some(ask(client_id)) }).await?;
        let answer = answers.message().await?.ok_or("the stream ended")?;
        if is_joint {
            times_us.push(begin.elapsed().as_micros() as u64);
            if answer.reported.is_none_or(|reported| reported.duplicate) {
                return Err(format!("a report was not taken: {:?}", answer.report_error).into());
            }
        }
        let trial = answer.trial.ok_or_else(|| format!("no trial: {:?}", answer.suggest_error))?;
        result = Some(report(&trial));
    }
    Ok(times_us)
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Failed> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [url, client_id, seconds, how, rest @ ..] = arguments.as_slice() else {
        return Err("usage: load URL CLIENT_ID SECONDS tune|calls [random|auto]".into());
    };
    let seconds: f64 = seconds.parse().map_err(|error| format!("SECONDS {seconds:?}: {error}"))?;
    let search = match rest.first().map(String::as_str) {
        None | Some("random") => SearchMethod::Random,
        Some("auto") => SearchMethod::Auto,
        Some(other) => return Err(format!("no search {other:?}; say random or auto").into()),
    };
    let mut client = TuningServiceClient::connect(url.clone()).await?;
    let request = wire::CreateStudyRequest { study_id: "load".to_owned(), study: Some(study(search)) };
    client.create_study(request).await?;
    println!("ready");
    std::io::stdout().flush()?;
    std::io::stdin().read_line(&mut String::new())?;

    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let times_us = match how.as_str() {
        "tune" => by_stream(&mut client, client_id, until).await?,
        "calls" => by_calls(&mut client, client_id, until).await?,
        other => return Err(format!("no way {other:?}; say tune or calls").into()),
    };
    println!("{}", serde_json::json!({ "times_us": times_us }));
    Ok(())
}
