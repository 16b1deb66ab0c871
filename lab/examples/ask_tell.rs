//! Drives one study over standard input and output, a JSON object a line, so that programs in other languages
//! can put the tuner beside other optimisers on identical problems.
//!
//! Requests and answers:
//!
//! | request | answer |
//! |---|---|
//! | `{"open": STUDY}` with the specification of a study as the core stores it | `{"opened": true}` |
//! | `{"ask": INDICATORS}`, an object of numbers | `{"trial": 1, "configuration": {"name": value}}` |
//! | `{"tell": {"trial": 1, "cost": 1.5}}`, or `"cost": null` where it cannot be run | `{"told": 1}` |
//! | `{"best": INDICATORS}` | `{"configuration": …}`, null while nothing is known |
//!
//! Studies that are opened here have one metric, `cost`. A refused request is answered by `{"error": "…"}`.
//! `nanoseconds` in each answer is the core's own time, without reading and writing.

use std::io::{BufRead, Write};
use std::{collections::BTreeMap, sync::Arc, time::Instant};

use serde::Deserialize;
use serde_json::{Value as Json, json};
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::{configuration::Configuration, study::StudySpec, value::Value};
use treewright_lab::simulated::METRIC;

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Request {
    Open(Box<StudySpec>),
    Ask(BTreeMap<String, f64>),
    Tell { trial: u64, cost: Option<f64> },
    Best(BTreeMap<String, f64>),
}

/// The study that is open, and a clock that only counts.
#[derive(Default)]
struct Session {
    tuner: Option<Tuner>,
    open: BTreeMap<u64, Trial>,
    now_ms: i64,
}

fn plain(configuration: &Configuration) -> Json {
    let value = |value: &Value| match value {
        Value::Integer(integer) => json!(integer),
        Value::Float(float) => json!(float),
        Value::Text(text) => json!(text),
        Value::Boolean(boolean) => json!(boolean),
    };
    configuration.values().iter().map(|(name, of)| (name.clone(), value(of))).collect()
}

impl Session {
    fn answer(&mut self, line: &str) -> Result<Json, String> {
        let request: Request = serde_json::from_str(line).map_err(|error| error.to_string())?;
        self.now_ms += 1;
        if let Request::Open(spec) = request {
            self.open.clear();
            self.tuner = Some(Tuner::new(Arc::new(*spec)).map_err(|error| error.to_string())?);
            return Ok(json!({ "opened": true }));
        }
        let tuner = self.tuner.as_mut().ok_or("no study is open")?;
        let refused = |error: treewright_core::tuner::TunerError| error.to_string();
        match request {
            Request::Open(_) => unreachable!("handled above"),
            Request::Ask(indicators) => {
                let ask = Ask { client_id: "bench".into(), indicators, ..Ask::default() };
                let (trial, _change) = tuner.suggest(&ask, self.now_ms).map_err(refused)?;
                let answer = json!({ "trial": trial.number, "configuration": plain(&trial.configuration) });
                self.open.insert(trial.number, trial);
                Ok(answer)
            }
            Request::Tell { trial, cost } => {
                let open = self.open.remove(&trial).ok_or("that trial is not open")?;
                let (measurements, outcome) = match cost {
                    Some(cost) => (BTreeMap::from([(METRIC.to_owned(), cost)]), Outcome::Ok),
                    None => (BTreeMap::new(), Outcome::Infeasible { reason: "cannot be run".into() }),
                };
                // Nothing is stored here: the process is the study.
                let (_, _change) =
                    tuner.report(&open, measurements, outcome, self.now_ms).map_err(refused)?;
                Ok(json!({ "told": trial }))
            }
            Request::Best(indicators) => {
                let best = tuner.best(Some(&indicators), None).map_err(refused)?;
                Ok(json!({ "configuration": best.map(|best| plain(&best.configuration)) }))
            }
        }
    }
}

fn main() -> std::io::Result<()> {
    let mut session = Session::default();
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let begin = Instant::now();
        let mut answer = session.answer(&line).unwrap_or_else(|error| json!({ "error": error }));
        answer["nanoseconds"] = json!(begin.elapsed().as_nanos() as u64);
        writeln!(out, "{answer}")?;
        out.flush()?;
    }
    Ok(())
}
