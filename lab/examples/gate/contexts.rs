//! Worlds in which the optimum moves with the context.
//!
//! Four parameters, whose best values move with two indicators; 5 % of noise; the policy's defaults. Regret
//! is the true cost over the least in that context, less one. The best fixed configuration has 0.57.

use std::{collections::BTreeMap, f64::consts::PI, sync::Arc};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::trial::{Fingerprint, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::{policy::Policy, space::Space, value::Value};
use treewright_lab::simulated::{mean, normal, report, share, study};

use crate::Figures;

const ROUNDS: usize = 160;
/// The first round and the first visit that count, and the first round of the last quarter.
const ROUNDS_FROM: usize = 80;
const LAST_FROM: usize = 120;
const VISITS_FROM: usize = 2;
const STATES: usize = 10;
const FRAMES: usize = 15;
const VISITS: usize = 8;
const NOISE: f64 = 0.05;
/// Gives the best fixed configuration a mean regret of 0.57.
const STEEPNESS: f64 = 1.8;

fn tuner(indicators: usize, seed: u64) -> Tuner {
    let space = Space::new((0..4).map(|axis| share(format!("p{axis}"))).collect(), vec![]);
    let names = (0..indicators).map(|place| format!("i{place}"));
    let spec = study(space.expect("a valid space"), names, Policy::default(), seed);
    Tuner::new(Arc::new(spec)).expect("a valid study")
}

/// The regret of a trial's configuration; `opposite` machines have their optimum on the other side.
fn regret(trial: &Trial, [u, v]: [f64; 2], opposite: bool) -> f64 {
    let sine = |x: f64| 0.5 + 0.4 * (PI * x).sin();
    let best = [sine(u - 0.5), sine(2.0 * v - 0.5), sine(u + v), sine(u - v)];
    let one = |(axis, best): (usize, f64)| {
        let best = if opposite { 1.0 - best } else { best };
        let x = trial.configuration.get(&format!("p{axis}")).and_then(Value::as_number).unwrap_or(0.5);
        (x - best) * (x - best)
    };
    STEEPNESS * best.into_iter().enumerate().map(one).sum::<f64>()
}

/// One frame; indicators are the context, then the others.
fn frame(
    tuner: &mut Tuner,
    random: &mut ChaCha8Rng,
    context: [f64; 2],
    others: &[f64],
    machine: Option<u32>,
) -> f64 {
    let values = context.iter().chain(others).enumerate();
    let indicators = values.map(|(place, value)| (format!("i{place}"), *value)).collect();
    let fingerprint = machine.map(|number| Fingerprint {
        cpu_model: format!("cpu {number}"),
        isa: "avx2".into(),
        threads: number + 1,
        software: BTreeMap::new(),
    });
    let client_id = format!("client {}", machine.unwrap_or(0));
    let ask = Ask { client_id, indicators, fingerprint, ..Ask::default() };
    let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
    let regret = regret(&trial, context, machine == Some(1));
    report(tuner, &trial, Some((1.0 + regret) * (1.0 + NOISE * normal(random)).max(0.01)));
    regret
}

/// Every round brings another context, alone and beside indicators that say nothing.
pub(crate) fn fresh(seed: u64) -> Figures {
    let session = |irrelevant: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut tuner = tuner(2 + irrelevant, seed);
        let mut round = |_| {
            let context = [random.random(), random.random()];
            let others: Vec<f64> = (0..irrelevant).map(|_| random.random()).collect();
            frame(&mut tuner, &mut random, context, &others, None)
        };
        let regrets: Vec<f64> = (0..ROUNDS).map(&mut round).collect();
        [ROUNDS_FROM, LAST_FROM].map(|from| -mean(&regrets[from..]))
    };
    let ([alone, at_last], [beside, _]) = (session(0), session(20));
    vec![("alone".to_owned(), alone), ("alone at last".to_owned(), at_last), ("beside 20".to_owned(), beside)]
}

pub(crate) fn turns(seed: u64) -> Figures {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let states: Vec<[f64; 2]> = (0..STATES).map(|_| [random.random(), random.random()]).collect();
    let mut tuner = tuner(2, seed);
    let mut regrets = Vec::new();
    for _ in 0..VISITS {
        for state in &states {
            regrets.extend((0..FRAMES).map(|_| frame(&mut tuner, &mut random, *state, &[], None)));
        }
    }
    vec![("from the third visit".to_owned(), -mean(&regrets[VISITS_FROM * STATES * FRAMES..]))]
}

/// Two machines that want the opposite: in one study, and in studies of their own. At last each machine of
/// the one study has met as many contexts as the one of `fresh` at last.
pub(crate) fn machines(seed: u64) -> Figures {
    let session = |apart: bool, rounds: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut tuners = [tuner(2, seed), tuner(2, 1000 + seed)];
        let mut round = |round: usize| {
            let machine = round % 2;
            let context = [random.random(), random.random()];
            let tuner = &mut tuners[if apart { machine } else { 0 }];
            frame(tuner, &mut random, context, &[], Some(machine as u32))
        };
        (0..rounds).map(&mut round).collect::<Vec<f64>>()
    };
    let (together, apart) = (session(false, 2 * ROUNDS), session(true, ROUNDS));
    vec![
        ("together".to_owned(), -mean(&together[ROUNDS_FROM..ROUNDS])),
        ("apart".to_owned(), -mean(&apart[ROUNDS_FROM..])),
        ("together at last".to_owned(), -mean(&together[2 * LAST_FROM..])),
    ]
}
