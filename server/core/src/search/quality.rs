//! The quality of searches: against random sampling under noise, in listed numbers and where nothing can be
//! run. Everything is seeded; the bounds leave room for other seeds.

use std::collections::BTreeMap;

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::policy::SearchMethod;
use crate::robust::median;
use crate::value::Value;

/// Best noise-free cost among `budget` points, where each measurement is off by up to 5 %.
fn best_on_quadratic(method: SearchMethod, seed: u64, dimension: usize, budget: u32) -> f64 {
    let mut search =
        AnySearch::new(method, SearchSetup::plain(seed, vec![0.9; dimension], budget, Vec::new()));
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

/// The trials until a search has met the best of 16 values beside 16 others, where more is better, from the
/// lowest.
fn trials_to_the_highest(seed: u64, value: fn(i64) -> Value) -> f64 {
    let values = || (0..16).map(move |power| value(1 << power));
    let space = Space::builder().categorical("block", values()).default(value(1));
    let space = space.categorical("tile", values()).default(value(1)).build().expect("a valid space");
    let mut search = AnySearch::new(SearchMethod::Model, SearchSetup::of(&space, seed, 1, 80));
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
    let setup = SearchSetup::plain(5, vec![0.5; 4], 80, Vec::new());
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
