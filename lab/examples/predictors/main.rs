//! Times and errors of the predictors, as JSON lines.
//!
//! - `nearest`: an answer of the nearest neighbours over so many states, four indicators on a curved surface
//!   among seventeen; goal for a million: p99 of 1 ms.
//! - `features`: one update and one answer of the radial basis models with the paper's eleven parameters and
//!   seventeen indicators; goal: 20 µs each.
//! - `errors`: the prequential error of each predictor on streams of trials, and that of `auto` over the
//!   least of them; goal: 1.05.
//!
//! `cargo run --release -p treewright-lab --example predictors -- [STATES]`; a million unless told otherwise.

mod streams;

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use treewright_core::ids::{MachineId, StateId};
use treewright_core::machines::{Machines, Origin};
use treewright_core::policy::{Policy, PredictorMethod};
use treewright_core::predict::{
    LeastSquares, Lesson, Nearest, Predictor, Query, Rbf, Shape, StateIndex, Weighted,
};
use treewright_core::results::{KnownState, ResultTable};
use treewright_core::search::Verdict;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};

use streams::{Stream, study};

const PARAMETERS: usize = 11;
const INDICATORS: usize = 17;
const QUESTIONS: usize = 2000;

/// A state as scenes give them: seventeen numbers that follow from four.
fn scene(random: &mut ChaCha8Rng) -> Vec<f64> {
    let hidden: [f64; 4] = std::array::from_fn(|_| random.random());
    let bend =
        |axis: usize| (hidden[axis % 4] * (1.0 + axis as f64 / 5.0) + hidden[(axis / 4) % 4]).sin().abs();
    (0..INDICATORS).map(|axis| bend(axis) + 0.01 * random.random::<f64>()).collect()
}

/// Microseconds of each call.
fn times(count: usize, mut call: impl FnMut()) -> serde_json::Value {
    let mut times: Vec<f64> = (0..count)
        .map(|_| {
            let begin = Instant::now();
            call();
            begin.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    json!({ "p50_us": times[count / 2], "p99_us": times[count * 99 / 100] })
}

fn nearest(count: usize) {
    let spec = Arc::new(study(PARAMETERS, INDICATORS, Policy::default(), 1));
    let mut random = ChaCha8Rng::seed_from_u64(1);
    // Tables that states share, or a million of them would be a test of memory.
    let mut tuner = Tuner::new(Arc::clone(&spec)).expect("a valid study");
    let ask = Ask {
        client_id: "a".into(),
        indicators: (0..INDICATORS).map(|axis| (format!("i{axis}"), 0.5)).collect(),
        ..Ask::default()
    };
    let trial: Trial = tuner.suggest(&ask, 0).expect("a valid question").0;
    let measurements = BTreeMap::from([("cost".to_owned(), 1.0)]);
    let trial = tuner.report(&trial, measurements, Outcome::Ok, 1).expect("a valid report").0;
    let mut results = ResultTable::default();
    results.learn(&trial, &spec.space.default_configuration());
    let (results, mut machines, mut state_index) =
        (Arc::new(results), Machines::default(), StateIndex::new(INDICATORS));
    machines.note_founder(None);
    let known: Vec<KnownState> = (0..count as u64)
        .map(|place| KnownState {
            id: StateId(place + 1),
            anchor: scene(&mut random),
            machine: MachineId(0),
            explored: place % 4 == 0,
            results: Arc::clone(&results),
        })
        .collect();
    known.iter().for_each(|state| state_index.note(state));
    for (name, predictor) in
        [("nearest_neighbour", &Nearest as &dyn Predictor), ("weighted_neighbours", &Weighted)]
    {
        let mut asked = ChaCha8Rng::seed_from_u64(2);
        let spent = times(QUESTIONS, || {
            let state = scene(&mut asked);
            let (known, state_index, space, machines) = (&known[..], &state_index, &spec.space, &machines);
            let query = Query {
                state: &state,
                here: None,
                known,
                state_index,
                space,
                machines,
                machine: MachineId(0),
                rival: None,
            };
            std::hint::black_box(predictor.predict(&query));
        });
        println!("{}", json!({ "nearest": name, "states": count, "answer": spent }));
    }
}

fn features() {
    let spec = study(PARAMETERS, INDICATORS, Policy::default(), 1);
    let (state_index, machines) = (StateIndex::new(INDICATORS), Machines::default());
    let models: [(&str, Box<dyn Predictor>); 3] = [
        ("rbf_greedy_gq", Box::new(Rbf::new(Shape::Printed, PARAMETERS, INDICATORS, 1, &[]))),
        ("gaussian_greedy_gq", Box::new(Rbf::new(Shape::Gaussian, PARAMETERS, INDICATORS, 1, &[]))),
        ("least_squares", Box::new(LeastSquares::new(PARAMETERS, INDICATORS, 1, &[]))),
    ];
    for (name, mut model) in models {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut lesson = |model: &mut Box<dyn Predictor>| {
            let state = scene(&mut random);
            let point: Vec<f64> = (0..PARAMETERS).map(|_| random.random()).collect();
            let configuration = spec.space.decode(&point);
            let cost = 1.0 + state.iter().zip(&point).map(|(s, p)| (s - p) * (s - p)).sum::<f64>();
            let begin = Instant::now();
            model.learn(&Lesson {
                state: &state,
                configuration: &configuration,
                point: &point,
                verdict: Verdict::Cost(cost),
                default_cost: Some(2.0),
                origin: Origin { group: 0, node: 0 },
            });
            begin.elapsed().as_secs_f64() * 1e6
        };
        for _ in 0..200 {
            lesson(&mut model);
        }
        let mut updates: Vec<f64> = (0..QUESTIONS).map(|_| lesson(&mut model)).collect();
        updates.sort_by(f64::total_cmp);
        let mut asked = ChaCha8Rng::seed_from_u64(4);
        let state = scene(&mut asked);
        let space = &spec.space;
        let query = Query {
            state: &state,
            here: None,
            known: &[],
            state_index: &state_index,
            space,
            machines: &machines,
            machine: MachineId(0),
            rival: None,
        };
        let answers = times(QUESTIONS, || drop(std::hint::black_box(model.predict(&query))));
        let update = json!({ "p50_us": updates[QUESTIONS / 2], "p99_us": updates[QUESTIONS * 99 / 100] });
        println!("{}", json!({ "features": name, "update": update, "answer": answers }));
    }
}

/// Errors of each predictor and of `auto` on a stream, a run a seed, and how far `auto` is above the least:
/// of the means over the seeds, and in the worst run.
fn errors(which: &str, streams: &[Stream], seeds: std::ops::Range<u64>) -> Vec<f64> {
    let mut ratios = Vec::new();
    for stream in streams {
        let mut sums: BTreeMap<PredictorMethod, f64> = BTreeMap::new();
        let mut worst = 0.0f64;
        for seed in seeds.clone() {
            let errors = stream.run(seed, |_, _| {}).predictor_errors();
            let mean = |auto: bool| {
                let chosen =
                    errors.iter().filter(move |(method, _)| (*method == PredictorMethod::Auto) == auto);
                chosen.map(|(_, interval)| interval.mean).fold(f64::INFINITY, f64::min)
            };
            worst = worst.max(mean(true) / mean(false));
            for (method, interval) in errors {
                *sums.entry(method).or_default() += interval.mean / (seeds.end - seeds.start) as f64;
            }
        }
        let auto = sums.remove(&PredictorMethod::Auto).unwrap_or(f64::NAN);
        let (best, least) =
            sums.iter().min_by(|a, b| a.1.total_cmp(b.1)).map_or(("none", f64::NAN), |(m, e)| (m.name(), *e));
        ratios.push(auto / least);
        let each: BTreeMap<&str, f64> = sums.iter().map(|(method, error)| (method.name(), *error)).collect();
        let found = json!({
            "errors": stream.name, "streams": which, "auto": auto, "best": best, "auto_over_best": auto / least,
            "worst_run": worst, "each": each,
        });
        println!("{found}");
    }
    let (most, above) =
        (ratios.iter().copied().fold(0.0, f64::max), ratios.iter().filter(|&&r| r > 1.05).count());
    println!(
        "{}",
        json!({ "streams": which, "auto_over_best_at_most": most, "above_1.05": above, "of": ratios.len() })
    );
    ratios
}

fn main() -> ExitCode {
    let states = match std::env::args().nth(1) {
        Some(text) => text.parse().ok().filter(|&count: &usize| count > 0),
        None => Some(1_000_000),
    };
    let Some(states) = states else {
        println!("usage: predictors [STATES], a count of at least 1; a million unless given");
        let is_help = std::env::args().skip(1).any(|text| text == "--help" || text == "-h");
        return if is_help { ExitCode::SUCCESS } else { ExitCode::from(2) };
    };
    features();
    errors("known", &streams::known(), 0..4);
    errors("unseen", &streams::unseen(), 100..104);
    nearest(states);
    ExitCode::SUCCESS
}
