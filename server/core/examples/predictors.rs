//! Times and errors of the predictors, as JSON lines.
//!
//! - `nearest`: an answer of the nearest neighbours over so many states, four indicators on a curved surface among
//!   seventeen; goal for a million: p99 of 1 ms.
//! - `features`: one update and one answer of the radial basis models with the paper's eleven parameters and seventeen
//!   indicators; goal: 20 µs each.
//! - `errors`: the prequential error of each predictor on streams of trials, and that of `auto` over the least of
//!   them; goal: 1.05.
//!
//! `cargo run --release -p treewright-core --example predictors -- [STATES]`; a million unless told otherwise.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use treewright_core::fleet::Fleet;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::knowledge::{Knowledge, KnownState};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::{Policy, PredictorMethod, SearchMethod};
use treewright_core::predict::{
    Atlas, LeastSquares, Lesson, Nearest, Origin, Predictor, Query, Rbf, Shape, Weighted,
};
use treewright_core::search::Verdict;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};

const PARAMETERS: usize = 11;
const INDICATORS: usize = 17;
const QUESTIONS: usize = 2000;

fn study(parameters: usize, indicators: usize, policy: Policy, seed: u64) -> StudySpec {
    let parameter = |index: usize| Parameter {
        name: format!("p{index}"),
        domain: Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear },
        default: treewright_core::value::Value::Float(0.5),
        active_if: None,
    };
    let indicator =
        |index: usize| Indicator { name: format!("i{index}"), min: 0.0, max: 1.0, scale: Scale::Linear };
    let term = ObjectiveTerm { metric: "cost".into(), weight: 1.0 };
    StudySpec {
        display_name: "predictors".into(),
        space: Space::new((0..parameters).map(parameter).collect(), vec![]).expect("a valid space"),
        indicators: IndicatorSchema::new((0..indicators).map(indicator).collect()).expect("valid"),
        objective: Objective::new(vec![term]).expect("a valid objective"),
        state_tolerance: 1e-3,
        policy,
        seed,
    }
}

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
    let mut knowledge = Knowledge::default();
    knowledge.learn(&trial, &spec.space.default_configuration());
    let (knowledge, mut fleet, mut atlas) = (Arc::new(knowledge), Fleet::default(), Atlas::new(INDICATORS));
    fleet.found(None);
    let known: Vec<KnownState> = (0..count as u64)
        .map(|place| KnownState {
            id: place + 1,
            anchor: scene(&mut random),
            machine: 0,
            explored: place % 4 == 0,
            knowledge: Arc::clone(&knowledge),
        })
        .collect();
    known.iter().for_each(|state| atlas.note(state));
    for (name, predictor) in
        [("nearest_neighbour", &Nearest as &dyn Predictor), ("weighted_neighbours", &Weighted)]
    {
        let mut asked = ChaCha8Rng::seed_from_u64(2);
        let spent = times(QUESTIONS, || {
            let state = scene(&mut asked);
            let (known, atlas, space, fleet) = (&known[..], &atlas, &spec.space, &fleet);
            let query = Query { state: &state, here: None, known, atlas, space, fleet, machine: 0 };
            std::hint::black_box(predictor.predict(&query));
        });
        println!("{}", json!({ "nearest": name, "states": count, "answer": spent }));
    }
}

fn features() {
    let spec = study(PARAMETERS, INDICATORS, Policy::default(), 1);
    let (atlas, fleet) = (Atlas::new(INDICATORS), Fleet::default());
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
        let query =
            Query { state: &state, here: None, known: &[], atlas: &atlas, space, fleet: &fleet, machine: 0 };
        let answers = times(QUESTIONS, || drop(std::hint::black_box(model.predict(&query))));
        let update = json!({ "p50_us": updates[QUESTIONS / 2], "p99_us": updates[QUESTIONS * 99 / 100] });
        println!("{}", json!({ "features": name, "update": update, "answer": answers }));
    }
}

/// A stream of trials: over how many states, how much of the time a predictor decides, and what a configuration costs.
struct Stream {
    states: usize,
    epsilon: f64,
    cost: fn(&[f64], &[f64], usize) -> f64,
}

fn bowl(state: &[f64], point: &[f64], _: usize) -> f64 {
    1.0 + point.iter().zip(state.iter().cycle()).map(|(p, s)| 3.0 * (p - s) * (p - s)).sum::<f64>()
}

fn level(state: &[f64], point: &[f64], frame: usize) -> f64 {
    libm::exp(3.0 * state[0]) * bowl(&state[1..], point, frame)
}

fn cliff(state: &[f64], point: &[f64], frame: usize) -> f64 {
    bowl(state, point, frame) * if point[0] > state[0] { 5.0 } else { 1.0 }
}

fn drift(state: &[f64], point: &[f64], frame: usize) -> f64 {
    bowl(state, point, frame) * (1.0 + frame as f64 / 400.0)
}

fn flat(state: &[f64], _: &[f64], _: usize) -> f64 {
    1.0 + state[0]
}

fn errors() {
    let mut streams = Vec::new();
    for (states, epsilon, how) in [(400, 0.2, "fresh"), (12, 1.0, "searched"), (12, 0.2, "visited")] {
        for (kind, cost) in [
            ("bowl", bowl as fn(&[f64], &[f64], usize) -> f64),
            ("level", level),
            ("cliff", cliff),
            ("drift", drift),
            ("flat", flat),
        ] {
            streams.push((format!("{kind}, {how}"), Stream { states, epsilon, cost }));
        }
    }
    let mut most = 0.0f64;
    for (name, Stream { states, epsilon, cost }) in streams {
        let mut sums: BTreeMap<PredictorMethod, f64> = BTreeMap::new();
        for seed in 0..4 {
            let policy = Policy {
                predictor: PredictorMethod::Auto,
                search: SearchMethod::Random,
                epsilon,
                trials_per_state: 60,
                ..Policy::default()
            };
            let mut tuner = Tuner::new(Arc::new(study(4, 3, policy, seed))).expect("a valid study");
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let places: Vec<[f64; 3]> =
                (0..states).map(|_| std::array::from_fn(|_| random.random())).collect();
            for frame in 0..400 {
                let state = &places[if states == 400 { frame } else { (frame / 5) % states }];
                let indicators = (0..3).map(|axis| (format!("i{axis}"), state[axis])).collect();
                let ask = Ask { client_id: "a".into(), indicators, ..Ask::default() };
                let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
                let point: Vec<f64> = (0..4)
                    .map(|axis| {
                        trial
                            .configuration
                            .get(&format!("p{axis}"))
                            .and_then(|x| x.as_number())
                            .unwrap_or(0.5)
                    })
                    .collect();
                let noise = 1.0 + 0.1 * (random.random::<f64>() - random.random::<f64>());
                let measurements = BTreeMap::from([("cost".to_owned(), noise * cost(state, &point, frame))]);
                let _stored = tuner.report(&trial, measurements, Outcome::Ok, 1).expect("a valid report");
            }
            for (method, interval) in tuner.predictor_errors() {
                *sums.entry(method).or_default() += interval.mean / 4.0;
            }
        }
        let auto = sums.remove(&PredictorMethod::Auto).unwrap_or(f64::NAN);
        let (best, least) =
            sums.iter().min_by(|a, b| a.1.total_cmp(b.1)).map_or(("none", f64::NAN), |(m, e)| (m.name(), *e));
        most = most.max(auto / least);
        let each: BTreeMap<&str, f64> = sums.iter().map(|(method, error)| (method.name(), *error)).collect();
        println!(
            "{}",
            json!({ "errors": name, "auto": auto, "best": best, "auto_over_best": auto / least, "each": each })
        );
    }
    println!("{}", json!({ "auto_over_best_at_most": most }));
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
    errors();
    nearest(states);
    ExitCode::SUCCESS
}
