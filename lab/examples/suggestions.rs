//! Every suggestion of fixed sessions, so that two versions of the program can be compared line by line.
//!
//! `cargo run -p treewright-lab --example suggestions [-- TRIALS] > suggestions.txt`. Each search and each predictor runs
//! over a conditional space with choices and over a continuous one; costs, failures, stopped trials, and the number of
//! trials that are open at a time follow from the number of the trial alone. A change that is meant to leave answers as
//! they are leaves the output as it is; the expected cost is printed to nine digits.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::{Policy, PredictorMethod, SearchMethod};
use treewright_core::space::{Condition, Constraint, Domain, Parameter, Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;

const SEARCHES: [SearchMethod; 5] = [
    SearchMethod::Auto,
    SearchMethod::NelderMead,
    SearchMethod::LatinHypercube,
    SearchMethod::Random,
    SearchMethod::Model,
];
const PREDICTORS: [PredictorMethod; 7] = [
    PredictorMethod::Auto,
    PredictorMethod::NearestNeighbour,
    PredictorMethod::WeightedNeighbours,
    PredictorMethod::RbfGreedyGq,
    PredictorMethod::GaussianGreedyGq,
    PredictorMethod::LeastSquares,
    PredictorMethod::Contextual,
];

fn parameter(name: &str, domain: Domain, default: Value, active_if: Option<(&str, Value)>) -> Parameter {
    let active_if =
        active_if.map(|(parameter, value)| Condition { parameter: parameter.into(), any_of: vec![value] });
    Parameter { name: name.into(), domain, default, active_if }
}

fn conditional() -> Space {
    let texts = |values: &[&str]| values.iter().map(|value| Value::Text((*value).into())).collect::<Vec<_>>();
    let custom = || Some(("backend", Value::Text("custom".into())));
    let integer = |min, max, scale| Domain::Integer { min, max, scale };
    let parameters = vec![
        parameter(
            "backend",
            Domain::Categorical { values: texts(&["embree", "custom", "native"]) },
            Value::Text("embree".into()),
            None,
        ),
        parameter("quality", integer(1, 3, Scale::Linear), Value::Integer(2), custom()),
        parameter("depth", integer(9, 64, Scale::Linear), Value::Integer(32), custom()),
        parameter("least", integer(1, 32, Scale::Log), Value::Integer(1), custom()),
        parameter("most", integer(1, 32, Scale::Log), Value::Integer(32), custom()),
        parameter(
            "cost",
            Domain::Float { min: 0.1, max: 10.0, scale: Scale::Log },
            Value::Float(1.0),
            Some(("quality", Value::Integer(3))),
        ),
        parameter(
            "width",
            Domain::Categorical { values: [8, 2, 4].map(Value::Integer).to_vec() },
            Value::Integer(2),
            None,
        ),
        parameter("robust", Domain::Boolean, Value::Boolean(false), None),
    ];
    let order = Constraint { lesser: "least".into(), greater: "most".into() };
    Space::new(parameters, vec![order]).expect("a valid space")
}

fn continuous() -> Space {
    let axis = |index: usize| {
        let domain = Domain::Float { min: -1.0, max: 2.0, scale: Scale::Linear };
        parameter(&format!("x{index}"), domain, Value::Float(1.5), None)
    };
    Space::new((0..5).map(axis).collect(), Vec::new()).expect("a valid space")
}

fn spec(space: Space, policy: Policy) -> StudySpec {
    let indicator = |name: &str| Indicator { name: name.into(), min: 0.0, max: 1.0, scale: Scale::Linear };
    let terms = vec![ObjectiveTerm { metric: "ms".into(), weight: 1.0 }];
    StudySpec {
        display_name: "suggestions".into(),
        space,
        indicators: IndicatorSchema::new(vec![indicator("a"), indicator("b")]).expect("valid"),
        objective: Objective::new(terms).expect("valid"),
        state_tolerance: 0.02,
        policy,
        seed: 17,
    }
}

/// What came of a trial: a bowl in the encoded coordinates whose bottom moves with the indicators, two per cent of
/// noise, a tenth that cannot be run and a tenth that is stopped.
fn outcome(space: &Space, trial: &Trial, indicators: [f64; 2]) -> (BTreeMap<String, f64>, Outcome) {
    let x = space.encode(&trial.configuration);
    let term = |(axis, x): (usize, &f64)| {
        let bottom = 0.2 + 0.5 * indicators[axis % 2] + 0.03 * axis as f64;
        (1.0 + axis as f64) * (x - bottom) * (x - bottom)
    };
    let bowl: f64 = x.iter().enumerate().map(term).sum();
    let noise = 1.0 + 0.04 * ((trial.number * 7919 % 101) as f64 / 101.0 - 0.5);
    let cost = (10.0 + 20.0 * bowl) * noise;
    match trial.number % 10 {
        4 if x[0] > 0.4 => (BTreeMap::new(), Outcome::Infeasible { reason: "cannot be run".into() }),
        7 if bowl > 0.5 => (BTreeMap::new(), Outcome::Aborted { lower_bound: cost }),
        _ => (BTreeMap::from([("ms".to_owned(), cost)]), Outcome::Ok),
    }
}

/// Runs a study with so many clients, each of which reports before it asks again, and prints every answer.
fn session(name: &str, space: Space, policy: Policy, trials: u64, clients: u64, places: u64) {
    println!("# {name}");
    let mut tuner = Tuner::new(Arc::new(spec(space.clone(), policy))).expect("a valid study");
    let mut open = VecDeque::new();
    for frame in 0..trials {
        // A walk over some places, none of which is met quite the same again.
        let place = frame * 5 / trials.max(1) * places / 5 + frame % places;
        let at = |step: u64| (place * step % 11) as f64 / 11.0 + 0.0005 * (frame % 7) as f64;
        let indicators = [at(3), at(7)];
        let named = BTreeMap::from([("a".to_owned(), indicators[0]), ("b".to_owned(), indicators[1])]);
        let client_id = format!("client {}", frame % clients);
        let ask = Ask { client_id, indicators: named, ..Ask::default() };
        let now_ms = frame as i64;
        let (trial, _change) = tuner.suggest(&ask, now_ms).expect("a valid question");
        let values: Vec<String> =
            trial.configuration.values().iter().map(|(name, value)| format!("{name}={value:?}")).collect();
        let expected = trial.predicted_cost.map_or("-".to_owned(), |cost| format!("{cost:.8e}"));
        println!("{} {} {expected} {}", trial.number, trial.reason.step, values.join(" "));
        open.push_back((trial, indicators));
        if open.len() as u64 >= clients {
            let (trial, indicators) = open.pop_front().expect("not empty");
            let (measurements, outcome) = outcome(&space, &trial, indicators);
            let _change = tuner.report(&trial, measurements, outcome, now_ms).expect("a valid report");
        }
    }
}

fn main() {
    let trials = std::env::args().nth(1).map_or(60, |text| text.parse().expect("a number of trials"));
    for (kind, space) in [("conditional", conditional()), ("continuous", continuous())] {
        for search in SEARCHES {
            let policy = Policy { epsilon: 1.0, search, trials_per_state: 60, ..Policy::default() };
            for (clients, places) in [(1, 1), (4, 1), (1, 2)] {
                let name = format!("{kind} {} {clients} {places}", search.name());
                session(&name, space.clone(), policy.clone(), trials * places, clients, places);
            }
        }
        for predictor in PREDICTORS {
            let policy = Policy { epsilon: 0.3, predictor, ..Policy::default() };
            session(&format!("{kind} {}", predictor.name()), space.clone(), policy, trials, 1, 6);
        }
    }
}
