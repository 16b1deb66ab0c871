//! The tuner's time for a frame, report and suggestion together, by the number of completed trials; and for a
//! checkpoint, the time under the study's lock, the time to pack it, and its size.
//!
//! `cargo bench -p treewright-core --bench history`. Six parameters, two indicators, a thousand states, 32
//! clients. A table of the median and the 99th percentile of the last frames before each mark comes out, in
//! microseconds.
// A benchmark reads the clock.
#![allow(clippy::disallowed_methods)]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::{Policy, PredictorMethod, SearchMethod};
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;

const MARKS: [usize; 3] = [100, 10_000, 1_000_000];
const LAST: usize = 2_000;
const CLIENTS: usize = 32;
const STATES: usize = 1_000;

fn spec(policy: Policy) -> StudySpec {
    let parameter = |number: usize| Parameter {
        name: format!("parameter_{number}"),
        domain: Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear },
        default: Value::Float(0.5),
        active_if: None,
    };
    let indicator = |name: &str| Indicator { name: name.into(), min: 0.0, max: 1.0, scale: Scale::Linear };
    let term = ObjectiveTerm { metric: "render_ms".into(), weight: 1.0 };
    StudySpec {
        display_name: String::new(),
        space: Space::new((0..6).map(parameter).collect(), vec![]).expect("valid"),
        indicators: IndicatorSchema::new(vec![indicator("x"), indicator("y")]).expect("valid"),
        objective: Objective::new(vec![term]).expect("valid"),
        state_tolerance: 1e-4,
        policy,
        seed: 1,
    }
}

fn cost(trial: &Trial) -> f64 {
    let numbers = trial.configuration.values().values().filter_map(Value::as_number);
    let bowl: f64 = numbers.map(|x| (x - 0.3).powi(2)).sum();
    (1.0 + bowl) * (1.0 + 0.02 * (trial.number as f64 * 0.754_877_666).fract())
}

fn history(name: &str, policy: Policy, most: usize) {
    let mut tuner = Tuner::new(Arc::new(spec(policy))).expect("valid");
    let mut held: Vec<Option<Trial>> = vec![None; CLIENTS];
    let mut times = Vec::with_capacity(most);
    for frame in 0..most {
        let client = frame % CLIENTS;
        let place = (frame / CLIENTS / 25 * 7 + client * 31) % STATES;
        let ask = Ask {
            client_id: format!("client-{client:02}"),
            indicators: BTreeMap::from([
                ("x".to_owned(), place as f64 / STATES as f64),
                ("y".to_owned(), (place * 37 % STATES) as f64 / STATES as f64),
            ]),
            ..Ask::default()
        };
        let begun = Instant::now();
        if let Some(trial) = held[client].take() {
            let measurements = BTreeMap::from([("render_ms".to_owned(), cost(&trial))]);
            let _ = tuner.report(&trial, measurements, Outcome::Ok, frame as i64).expect("open");
        }
        held[client] = Some(tuner.suggest(&ask, frame as i64).expect("valid").0);
        times.push(1e6 * begun.elapsed().as_secs_f64());
        if MARKS.contains(&(frame + 1)) {
            let mut last = times[times.len().saturating_sub(LAST)..].to_vec();
            last.sort_by(f64::total_cmp);
            let at = |share: f64| last[(share * (last.len() - 1) as f64) as usize];
            let begun = Instant::now();
            let learnt = tuner.learnt();
            let taken_us = 1e6 * begun.elapsed().as_secs_f64();
            let begun = Instant::now();
            let bytes = learnt.checkpoint().bytes.len();
            println!(
                "{name:24}{:>9}{:>8}{:>10.1}{:>10.1}{:>12.1}{:>10.1}{:>10.2}",
                frame + 1,
                tuner.statistics().states,
                at(0.5),
                at(0.99),
                taken_us,
                1e3 * begun.elapsed().as_secs_f64(),
                bytes as f64 / 1e6
            );
        }
    }
}

fn main() {
    println!(
        "{:24}{:>9}{:>8}{:>10}{:>10}{:>12}{:>10}{:>10}",
        "policy", "trials", "states", "p50 µs", "p99 µs", "locked µs", "pack ms", "MB"
    );
    let random = Policy { search: SearchMethod::Random, ..Policy::default() };
    history("random, nearest", random.clone(), MARKS[2]);
    history("default", Policy::default(), MARKS[2]);
    history("random, least squares", Policy { predictor: PredictorMethod::LeastSquares, ..random }, MARKS[1]);
    history("auto predictor", Policy { predictor: PredictorMethod::Auto, ..Policy::default() }, MARKS[1]);
}
