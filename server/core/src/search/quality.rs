//! The quality of searches in listed numbers and where nothing can be run. Everything is seeded; the bounds
//! leave room for other seeds.

use std::collections::BTreeMap;

use super::*;
use crate::policy::SearchMethod;
use crate::robust::median;
use crate::value::Value;

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
