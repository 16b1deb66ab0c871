//! The quality of the simplex search: against random sampling, under noise, on plateaus and among infeasible
//! regions. Everything is seeded; the bounds leave room for other seeds.

use std::collections::BTreeMap;

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::policy::SearchMethod;
use crate::robust::median;
use crate::space::{Constraint, Domain, Parameter, Scale, Space};
use crate::value::Value;

/// Best noise-free cost among `budget` points, where each measurement is off by up to 5 %.
fn best_on_quadratic(method: SearchMethod, seed: u64, dimension: usize, budget: u32) -> f64 {
    let setup = SearchSetup {
        seed,
        state_id: 1,
        start: vec![0.9; dimension],
        budget,
        levels: Vec::new(),
        layout: Layout::default(),
    };
    let mut search = AnySearch::new(method, setup);
    let mut noise = ChaCha8Rng::seed_from_u64(seed);
    // A bowl 10 high at its bottom, off the centre and with axes of unequal weight.
    let truth = |x: &[f64]| {
        let term = |(axis, x): (usize, &f64)| (1.0 + axis as f64) * (x - 0.2 - 0.05 * axis as f64).powi(2);
        10.0 + 40.0 * x.iter().enumerate().map(term).sum::<f64>()
    };
    let mut best = (f64::INFINITY, f64::INFINITY);
    for _ in 0..budget {
        let point = search.ask().expect("nothing is out");
        let cost = truth(&point.x);
        let measured = cost * (0.95 + 0.1 * noise.random::<f64>());
        if measured < best.0 {
            best = (measured, cost);
        }
        search.tell(point.id, Feedback { verdict: Verdict::Cost(measured), fresh: true });
    }
    best.1 - 10.0
}

#[test]
fn eighty_noisy_trials_come_far_closer_than_random_sampling() {
    for (dimension, ratio) in [(3, 4.0), (5, 8.0), (8, 5.0), (11, 4.0)] {
        let excess = |method| {
            median(
                &mut (0..31).map(|seed| best_on_quadratic(method, seed, dimension, 80)).collect::<Vec<_>>(),
            )
        };
        let (simplex, random) = (excess(SearchMethod::NelderMead), excess(SearchMethod::Random));
        assert!(simplex * ratio < random, "{dimension}: simplex {simplex}, random {random}");
    }
}

/// A space like the paper's Table 1: integers, floats, choices and switches.
fn tree_space() -> Space {
    let integer = |name: &str, min, max, default| Parameter {
        name: name.into(),
        domain: Domain::Integer { min, max, scale: Scale::Linear },
        default: Value::Integer(default),
        active_if: None,
    };
    let float = |name: &str| Parameter {
        name: name.into(),
        domain: Domain::Float { min: 0.0, max: 10.0, scale: Scale::Linear },
        default: Value::Float(1.0),
        active_if: None,
    };
    let boolean = |name: &str| Parameter {
        name: name.into(),
        domain: Domain::Boolean,
        default: Value::Boolean(false),
        active_if: None,
    };
    let widths = vec![Value::Integer(2), Value::Integer(4), Value::Integer(8)];
    let parameters = vec![
        integer("quality", 1, 3, 2),
        Parameter {
            name: "branching_factor".into(),
            domain: Domain::Categorical { values: widths },
            default: Value::Integer(2),
            active_if: None,
        },
        integer("min_leaf_size", 1, 32, 1),
        integer("max_leaf_size", 1, 32, 32),
        float("intersection_cost"),
        boolean("robust"),
        boolean("static"),
    ];
    let order = Constraint::order("min_leaf_size", "max_leaf_size");
    Space::new(parameters, vec![order]).expect("a valid space")
}

fn tree_cost(configuration: &crate::configuration::Configuration) -> Option<f64> {
    let number = |name: &str| configuration.get(name).and_then(Value::as_number).expect("a number");
    let is = |name: &str| configuration.get(name) == Some(&Value::Boolean(true));
    // A quarter of the space cannot be built, the neighbourhood of the optimum included in part.
    if number("max_leaf_size") < 3.0 || (number("intersection_cost") > 7.5) {
        return None;
    }
    let mut cost = 100.0 - 15.0 * (number("quality") - 1.0) - 5.0 * number("branching_factor").log2();
    cost += 0.6 * (number("max_leaf_size") - 5.0).abs() + 0.4 * (number("min_leaf_size") - 2.0).abs();
    cost += 1.5 * (number("intersection_cost") - 6.0).abs();
    cost += if is("robust") { 8.0 } else { 0.0 } - if is("static") { 6.0 } else { 0.0 };
    Some(cost)
}

/// Runs a search the way the tuner does: known configurations are answered from the table. Returns the
/// best cost, and the most known answers in a row.
fn tune_tree(method: SearchMethod, seed: u64, budget: u32) -> (f64, usize) {
    let space = tree_space();
    let start = space.encode(&space.default_configuration());
    let mut search = AnySearch::new(
        method,
        SearchSetup { seed, state_id: 1, start, budget, levels: levels(&space), layout: Layout::of(&space) },
    );
    let mut known = BTreeMap::new();
    let (mut best, mut in_a_row, mut most) = (f64::INFINITY, 0, 0);
    while known.len() < budget as usize {
        let point = search.ask().expect("nothing is out");
        let configuration = space.decode(&point.x);
        let fresh = !known.contains_key(&configuration);
        let cost = *known.entry(configuration).or_insert_with_key(tree_cost);
        in_a_row = if fresh { 0 } else { in_a_row + 1 };
        most = most.max(in_a_row);
        assert!(in_a_row < 1000, "the search stalls");
        best = best.min(cost.unwrap_or(f64::INFINITY));
        search.tell(point.id, Feedback { verdict: cost.map_or(Verdict::Infeasible, Verdict::Cost), fresh });
    }
    (best, most)
}

#[test]
fn plateaus_and_infeasible_regions_do_not_stall_the_simplex() {
    let runs: Vec<_> = (0..31).map(|seed| tune_tree(SearchMethod::NelderMead, seed, 80)).collect();
    let random: Vec<_> = (0..31).map(|seed| tune_tree(SearchMethod::Random, seed, 80)).collect();
    let most = runs.iter().map(|run| run.1).max();
    let simplex = median(&mut runs.iter().map(|run| run.0).collect::<Vec<_>>());
    let random = median(&mut random.iter().map(|run| run.0).collect::<Vec<_>>());
    assert!(most < Some(crate::limits::KNOWN_POINTS_PER_SUGGESTION_MAX), "{most:?} known points in a row");
    // The optimum is 49; the default costs 107.5.
    assert!(simplex < random - 2.0, "simplex {simplex}, random {random}");
    assert!(simplex < 56.0, "simplex {simplex}");
}

/// The trials until a search has met the best of 16 values beside 16 others, where more is better, from the
/// lowest.
fn trials_to_the_highest(seed: u64, value: fn(i64) -> Value) -> f64 {
    let choice = |name: &str| Parameter {
        name: name.into(),
        domain: Domain::Categorical { values: (0..16).map(|power| value(1 << power)).collect() },
        default: value(1),
        active_if: None,
    };
    let space = Space::new(vec![choice("block"), choice("tile")], Vec::new()).expect("a valid space");
    let (start, layout) = (space.encode(&space.default_configuration()), Layout::of(&space));
    let setup = SearchSetup { seed, state_id: 1, start, budget: 80, levels: levels(&space), layout };
    let mut search = AnySearch::new(SearchMethod::Model, setup);
    let mut known = BTreeMap::new();
    while known.len() < 80 {
        let point = search.ask().expect("nothing is out");
        // Both list their values from the lowest on.
        let cell = |axis: usize| (16.0 * point.x[axis]).floor().min(15.0);
        let cost = 40.0 - cell(0) - cell(1);
        let fresh = known.insert(space.decode(&point.x), cost).is_none();
        if cost == 10.0 {
            break;
        }
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh });
    }
    known.len() as f64
}

#[test]
fn listed_numbers_are_searched_in_their_order() {
    let trials = |value: fn(i64) -> Value| {
        median(&mut (0..11).map(|seed| trials_to_the_highest(seed, value)).collect::<Vec<_>>())
    };
    let numbers = trials(Value::Integer);
    let words = trials(|number: i64| Value::Text(number.to_string()));
    assert!(1.3 * numbers < words, "{numbers} trials with numbers, {words} with words");
}

#[test]
fn a_search_that_only_meets_infeasible_points_looks_everywhere() {
    let setup = SearchSetup {
        seed: 5,
        state_id: 1,
        start: vec![0.5; 4],
        budget: 80,
        levels: Vec::new(),
        layout: Layout::default(),
    };
    let mut search = AnySearch::new(SearchMethod::NelderMead, setup);
    let mut reached = [[false; 4]; 4];
    for _ in 0..120 {
        let point = search.ask().expect("nothing is out");
        for (axis, x) in point.x.iter().enumerate() {
            reached[axis][((x * 4.0) as usize).min(3)] = true;
        }
        search.tell(point.id, Feedback { verdict: Verdict::Infeasible, fresh: true });
    }
    assert_eq!(reached, [[true; 4]; 4]);
}
