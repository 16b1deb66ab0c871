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
    let steps = || Domain::Integer { min: 0, max: 3, scale: Scale::Linear };
    let setting = |place: usize| Parameter::new(format!("setting_{place}"), steps(), 2);
    let trees = Domain::Categorical { values: TREES.map(Value::from).to_vec() };
    let tree = Parameter::new("tree", trees, TREES[0]);
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

/// The points of a search by the logarithms of their costs, alone or beside known states: their effects, and
/// further winners.
fn points(
    seed: u64,
    others: Option<(&MainEffects, Vec<Vec<f64>>)>,
    log_cost: impl Fn(&[f64]) -> f64,
) -> Vec<Vec<f64>> {
    let space = space();
    let (start, layout) = (space.encode(space.default_ref()), Layout::of(&space));
    let mut search = ModelSearch::new(SearchSetup::of(&space, seed, 1, TRIALS as u32));
    if let Some((effects, winners)) = others {
        let best = effects.descend(&layout, &start);
        assert_eq!(tree(&layout, &best), BEST_THERE, "what the known states like");
        let beside = |axis: usize| {
            let mut x = best.clone();
            x[axis] = layout.at_rank(axis, 1);
            x
        };
        let first = vec![best.clone(), beside(0), beside(1)];
        search.follow(effects.clone(), first, winners, Vec::new());
    }
    let mut random = ChaCha8Rng::seed_from_u64(100 + seed);
    let trial = |_| {
        let point = search.ask().expect("nothing is out");
        let cost = libm::exp(log_cost(&point.x) + NOISE * standard_normal(&mut random));
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
        point.x
    };
    (0..TRIALS).map(trial).collect()
}

#[test]
fn known_states_lose_their_say_about_the_parameter_on_which_they_are_wrong() {
    let layout = Layout::of(&space());
    let here = |x: &[f64]| log_cost(&layout, x, &HERE);
    let best = |points: &[Vec<f64>]| points.iter().map(|x| here(x)).fold(f64::INFINITY, f64::min);
    for (states, records) in [(1, 80), (3, 80), (30, 21)] {
        let effects = effects(&layout, states, records);
        for seed in 0..2 {
            let beside = points(seed, Some((&effects, Vec::new())), here);
            let alone = points(seed, None, here);
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

#[test]
fn a_winner_of_one_state_to_which_no_step_leads_is_tried() {
    let layout = Layout::of(&space());
    let mut winner = space().encode(space().default_ref());
    for (axis, x) in winner.iter_mut().enumerate() {
        let rank = if axis == SETTINGS { BEST_HERE } else { u32::from(axis < 2) * 3 };
        *x = layout.at_rank(axis, rank);
    }
    // The tree of the winner is good beside its two settings only.
    let here = |x: &[f64]| {
        let likes = (0..2).all(|axis| layout.rank(axis, x[axis]) == 3) && tree(&layout, x) == BEST_HERE;
        log_cost(&layout, x, &THERE) - if likes { 0.36 + 0.35 + 0.08 } else { 0.0 }
    };
    assert!((here(&winner) + 0.08).abs() < 1e-9, "{}", here(&winner));
    let effects = effects(&layout, 1, 80);
    for seed in 0..2 {
        let points = points(seed, Some((&effects, vec![winner.clone()])), here);
        let place = points.iter().position(|x| here(x) < -0.07);
        assert!(place.is_some_and(|place| place < FOUND_BY), "seed {seed}: {place:?}");
    }
}
