//! Worlds in which the optimum moves with the context.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::{STATE_TOLERANCE_DEFAULT, StudySpec};
use treewright_core::trial::{Fingerprint, Mode, Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;

const ROUNDS: usize = 160;
const STATES: usize = 10;
const FRAMES: usize = 15;
const VISITS: usize = 16;
const NOISE: f64 = 0.05;
/// Gives the best fixed configuration a mean regret of 0.57.
const STEEPNESS: f64 = 1.8;

#[derive(Clone, Copy, Debug)]
pub(crate) enum Kind {
    Fresh { irrelevant: usize },
    Machines,
    Own,
    Indicator,
}

/// One frame.
pub(crate) struct Frame {
    pub(crate) regret: f64,
    pub(crate) explored: bool,
}

pub(crate) fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
    (-2.0 * u.ln()).sqrt() * (2.0 * PI * v).cos()
}

fn optimum(u: f64, v: f64) -> [f64; 4] {
    let sine = |x: f64| 0.5 + 0.4 * (PI * x).sin();
    [sine(u - 0.5), sine(2.0 * v - 0.5), sine(u + v), sine(u - v)]
}

/// The regret of a trial's configuration; `opposite` machines have their optimum on the other side.
fn regret(trial: &Trial, [u, v]: [f64; 2], opposite: bool) -> f64 {
    let one = |(axis, best): (usize, f64)| {
        let best = if opposite { 1.0 - best } else { best };
        let x = trial.configuration.get(&format!("p{axis}")).and_then(Value::as_number).unwrap_or(0.5);
        (x - best) * (x - best)
    };
    STEEPNESS * optimum(u, v).into_iter().enumerate().map(one).sum::<f64>()
}

fn study(indicators: usize, seed: u64) -> Tuner {
    let parameter = |axis: usize| Parameter {
        name: format!("p{axis}"),
        domain: Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear },
        default: Value::Float(0.5),
        active_if: None,
    };
    let indicator =
        |place: usize| Indicator { name: format!("i{place}"), min: 0.0, max: 1.0, scale: Scale::Linear };
    let term = ObjectiveTerm { metric: "cost".into(), weight: 1.0 };
    let spec = StudySpec {
        display_name: "contexts".into(),
        space: Space::new((0..4).map(parameter).collect(), vec![]).expect("a valid space"),
        indicators: IndicatorSchema::new((0..indicators).map(indicator).collect()).expect("valid"),
        objective: Objective::new(vec![term]).expect("a valid objective"),
        state_tolerance: STATE_TOLERANCE_DEFAULT,
        policy: Policy::default(),
        seed,
    };
    Tuner::new(Arc::new(spec)).expect("a valid study")
}

fn machine(number: u32) -> Fingerprint {
    Fingerprint {
        cpu_model: format!("cpu {number}"),
        isa: "avx2".into(),
        threads: number + 1,
        software: BTreeMap::new(),
    }
}

/// One frame of a client; indicators are the context, then the others.
fn frame(
    tuner: &mut Tuner,
    random: &mut ChaCha8Rng,
    context: [f64; 2],
    others: &[f64],
    machine: Option<Fingerprint>,
    opposite: bool,
) -> Frame {
    let values = context.iter().chain(others).enumerate();
    let indicators = values.map(|(place, value)| (format!("i{place}"), *value)).collect();
    let client_id = machine.as_ref().map_or("a".to_owned(), |machine| machine.cpu_model.clone());
    let ask = Ask { client_id, indicators, fingerprint: machine, ..Ask::default() };
    let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
    let regret = regret(&trial, context, opposite);
    let cost = (1.0 + regret) * (1.0 + NOISE * normal(random)).max(0.01);
    let measurements = BTreeMap::from([("cost".to_owned(), cost)]);
    let _change = tuner.report(&trial, measurements, Outcome::Ok, 1).expect("a valid report");
    Frame { regret, explored: trial.mode() == Mode::Explore }
}

/// A session in which every round brings another context.
pub(crate) fn rounds(seed: u64, kind: Kind) -> Vec<Frame> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let count = match kind {
        Kind::Fresh { irrelevant } => irrelevant,
        Kind::Indicator => 1,
        Kind::Machines | Kind::Own => 0,
    };
    let mut tuners = [study(2 + count, seed), study(2 + count, 1000 + seed)];
    let one = |round: usize| {
        let context = [random.random(), random.random()];
        let opposite = !matches!(kind, Kind::Fresh { .. }) && round % 2 == 1;
        let others: Vec<f64> = match kind {
            Kind::Indicator => vec![f64::from(u8::from(opposite))],
            _ => (0..count).map(|_| random.random()).collect(),
        };
        let fingerprint = matches!(kind, Kind::Machines).then(|| machine(u32::from(opposite)));
        let tuner = &mut tuners[usize::from(opposite && matches!(kind, Kind::Own))];
        frame(tuner, &mut random, context, &others, fingerprint, opposite)
    };
    (0..ROUNDS).map(one).collect()
}

/// The frames of a session in ten states in turn.
pub(crate) fn turns(seed: u64) -> Vec<Frame> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let states: Vec<[f64; 2]> = (0..STATES).map(|_| [random.random(), random.random()]).collect();
    let mut tuner = study(2, seed);
    let mut frames = Vec::new();
    for _ in 0..VISITS {
        for state in &states {
            for _ in 0..FRAMES {
                frames.push(frame(&mut tuner, &mut random, *state, &[], None, false));
            }
        }
    }
    frames
}
