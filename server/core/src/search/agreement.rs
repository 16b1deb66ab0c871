//! Searches beside known states that are right about most parameters and wrong about one.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::randomness::standard_normal;
use crate::space::{Domain, Parameter, Scale, Space};
use crate::value::Value;

/// Settings of packets, whose lowest value serves every state best, and kinds of trees.
const SETTINGS: usize = 8;
const TREES: [&str; 6] = ["a", "b", "c", "d", "e", "f"];
/// The logarithm of the cost of a step of a setting, and that of each kind of tree in the known states and
/// here.
const STEP: f64 = 0.06;
const THERE: [f64; 6] = [0.0, 0.35, 0.35, 0.35, 0.35, 0.35];
const HERE: [f64; 6] = [0.0, 0.03, 0.03, 0.03, 0.03, -0.1];
/// The best kind of tree in the known states, and here.
const BEST_THERE: u32 = 0;
const BEST_HERE: u32 = 5;
const NOISE: f64 = 0.02;
const TRIALS: usize = 60;
/// Trials until which the best tree is tried, and the number of the first and of the last that are compared.
const FOUND_BY: usize = 45;
const COMPARED: usize = 15;

fn space() -> Space {
    let setting = |place: usize| Parameter {
        name: format!("setting_{place}"),
        domain: Domain::Integer { min: 0, max: 3, scale: Scale::Linear },
        default: Value::Integer(2),
        active_if: None,
    };
    let tree = Parameter {
        name: "tree".into(),
        domain: Domain::Categorical { values: TREES.map(|name| Value::Text(name.into())).to_vec() },
        default: Value::Text(TREES[0].into()),
        active_if: None,
    };
    Space::new((0..SETTINGS).map(setting).chain([tree]).collect(), Vec::new()).expect("a valid space")
}

fn tree(layout: &Layout, x: &[f64]) -> u32 {
    layout.rank(SETTINGS, x[SETTINGS])
}

/// The logarithm of the cost of a point where the trees cost this.
fn log_cost(layout: &Layout, x: &[f64], trees: &[f64; 6]) -> f64 {
    let steps: u32 = (0..SETTINGS).map(|axis| layout.rank(axis, x[axis])).sum();
    STEP * f64::from(steps) + trees[tree(layout, x) as usize]
}

/// The effects in a number of states, `records` measurements of each. The last of many wants the opposite.
fn effects(layout: &Layout, states: usize, records: usize) -> MainEffects {
    let mut random = ChaCha8Rng::seed_from_u64(states as u64);
    let mut measured = Vec::new();
    for state in 0..states {
        let sign = if state + 1 == states && states > 3 { -1.0 } else { 1.0 };
        for _ in 0..records {
            let x: Vec<f64> = (0..layout.dimension()).map(|_| random.random()).collect();
            let log_cost = sign * log_cost(layout, &x, &THERE) + NOISE * standard_normal(&mut random);
            measured.push(SourceMeasurement { state, x, log_cost });
        }
    }
    MainEffects::fit(layout, &measured).expect("costs differ")
}

/// The points of a search, beside known states of these effects or alone.
fn points(seed: u64, others: Option<&MainEffects>) -> Vec<Vec<f64>> {
    let space = space();
    let (start, layout) = (space.encode(space.default_ref()), Layout::of(&space));
    let setup = SearchSetup {
        seed,
        state_id: 1,
        start: start.clone(),
        budget: TRIALS as u32,
        levels: levels(&space),
        layout: layout.clone(),
    };
    let mut search = ModelSearch::new(setup);
    if let Some(others) = others {
        let best = others.descend(&layout, &start);
        assert_eq!(tree(&layout, &best), BEST_THERE, "what the known states like");
        let beside = |axis: usize| {
            let mut x = best.clone();
            x[axis] = layout.at_rank(axis, 1);
            x
        };
        search.follow(others.clone(), vec![best.clone(), beside(0), beside(1)], Vec::new());
    }
    let mut random = ChaCha8Rng::seed_from_u64(100 + seed);
    let trial = |_| {
        let point = search.ask().expect("nothing is out");
        let noise = NOISE * standard_normal(&mut random);
        let cost = libm::exp(log_cost(&layout, &point.x, &HERE) + noise);
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
        point.x
    };
    (0..TRIALS).map(trial).collect()
}

#[test]
fn known_states_lose_their_say_about_the_parameter_on_which_they_are_wrong() {
    let layout = Layout::of(&space());
    let best = |points: &[Vec<f64>]| {
        points.iter().map(|x| log_cost(&layout, x, &HERE)).fold(f64::INFINITY, f64::min)
    };
    for (states, records) in [(1, 80), (3, 80), (30, 21)] {
        let effects = effects(&layout, states, records);
        for seed in 0..2 {
            let (beside, alone) = (points(seed, Some(&effects)), points(seed, None));
            let trees: Vec<u32> = beside.iter().map(|x| tree(&layout, x)).collect();
            let found = trees.iter().position(|&tree| tree == BEST_HERE);
            assert!(found.is_some_and(|found| found < FOUND_BY), "{states} states, seed {seed}: {trees:?}");
            let theirs = |trees: &[u32]| trees.iter().filter(|&&tree| tree == BEST_THERE).count();
            let (first, last) = (theirs(&trees[..COMPARED]), theirs(&trees[TRIALS - COMPARED..]));
            assert!(2 * last < first, "{states} states, seed {seed}: {trees:?}");
            let (own, reference) = (best(&beside), best(&alone));
            assert!(own < reference + 0.03, "{states} states, seed {seed}: {own} beside, {reference} alone");
        }
    }
}
