//! Round trips from Rust, by the SDK and by bare gRPC: `round_trips URL COUNT`. See
//! integrations/latency/run.sh.

use std::time::{Duration, Instant};

use treewright_client::blocking::Client;
use treewright_client::{Indicators, Options, Outcome, Space, StudySpec};
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self, outcome::Kind};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let (url, count) = (arguments.next().ok_or("URL")?, arguments.next().ok_or("COUNT")?.parse()?);
    let space = Space::builder().integer("leaf", 1..=32).default(8).log().build()?;
    let spec = StudySpec::builder(space).minimise("ms", 1.0).build()?;
    let client = Client::connect(&url, Options::new().deadline(Duration::from_secs(5)))?;
    let study = client.study("latency-rust", spec.clone())?;
    client.create_study("latency-raw", &spec)?;
    let (mut predict, mut suggest) = (Vec::new(), Vec::new());
    for _ in 0..count + 50 {
        let start = Instant::now();
        study.predict(&Indicators::new())?;
        let middle = Instant::now();
        let suggestion = study.suggest(&Indicators::new());
        suggest.push(middle.elapsed());
        predict.push(middle - start);
        suggestion.report([("ms", 1.0)].into(), Outcome::Ok)?;
        client.flush(Duration::from_secs(5))?;
    }
    show("Rust", predict, suggest);
    tokio::runtime::Builder::new_current_thread().enable_all().build()?.block_on(raw(url, count))
}

/// These calls without an SDK.
async fn raw(url: String, count: usize) -> Result<(), Failure> {
    let mut service = TuningServiceClient::connect(url).await?;
    let name = "studies/latency-raw".to_owned();
    let (mut predict, mut suggest) = (Vec::new(), Vec::new());
    for _ in 0..count + 50 {
        let start = Instant::now();
        service.predict(v1::PredictRequest { study: name.clone(), ..Default::default() }).await?;
        let middle = Instant::now();
        let asked = v1::SuggestRequest { study: name.clone(), client_id: "raw".into(), ..Default::default() };
        let trial = service.suggest(asked).await?.into_inner();
        suggest.push(middle.elapsed());
        predict.push(middle - start);
        let outcome = Some(v1::Outcome { kind: Some(Kind::Ok(v1::Ok {})) });
        let measurements = [("ms".to_owned(), 1.0)].into();
        let trial = trial.name;
        service.report(v1::ReportRequest { trial, measurements, outcome, ..Default::default() }).await?;
    }
    show("bare gRPC (tonic)", predict, suggest);
    Ok(())
}

/// Median and 99th percentile, the first fifty left out.
fn show(from: &str, predict: Vec<Duration>, suggest: Vec<Duration>) {
    let both = [predict, suggest].map(|all| {
        let mut us: Vec<f64> = all.into_iter().skip(50).map(|one| one.as_secs_f64() * 1e6).collect();
        us.sort_by(f64::total_cmp);
        [us[us.len() / 2].round(), us[us.len() * 99 / 100].round()]
    });
    println!("{}", serde_json::json!({ "from": from, "predict_us": both[0], "suggest_us": both[1] }));
}
