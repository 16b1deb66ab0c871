//! One suite that every search passes.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::registry::METHODS;
use super::*;
use crate::policy::{Method as _, SearchMethod};

/// `auto` is one of these, see below.
fn method(index: usize) -> SearchMethod {
    METHODS[index % METHODS.len()]
}

fn setup(seed: u64, dimension: usize, budget: u32) -> SearchSetup {
    // Choices among other axes, so that both kinds of step are met; the last axis is none.
    let levels = [2, 0, 0, 3].into_iter().cycle().take(dimension - 1).collect();
    SearchSetup { state_id: 7, ..SearchSetup::plain(seed, vec![0.25; dimension], budget, levels) }
}

fn bowl(x: &[f64]) -> f64 {
    x.iter().enumerate().map(|(axis, x)| (x - 0.1 * axis as f64).powi(2)).sum()
}

fn answer(point: &Point, scale: f64) -> Feedback {
    let cost = bowl(&point.x) * scale;
    let verdict = match point.id % 7 {
        5 => Verdict::Infeasible,
        6 => Verdict::AtLeast(cost),
        _ => Verdict::Cost(cost),
    };
    Feedback { verdict, fresh: !point.id.is_multiple_of(5) }
}

fn run(search: &mut AnySearch, steps: usize, scale: f64) -> Vec<Point> {
    let mut points = Vec::new();
    for _ in 0..steps {
        let point = search.ask().expect("nothing is out");
        search.tell(point.id, answer(&point, scale));
        points.push(point);
    }
    points
}

proptest! {
    #![proptest_config(crate::testing::cases(24))]

    #[test]
    fn points_lie_in_the_cube_and_begin_with_the_default(
        seed: u64, dimension in 1usize..40, budget in 1u32..200, index in 0usize..8,
    ) {
        let mut search = AnySearch::new(method(index), setup(seed, dimension, budget));
        let points = run(&mut search, 150, 1.0);
        prop_assert_eq!(&points[0].x, &vec![0.25; dimension]);
        prop_assert_eq!(points[0].step, Step::Default);
        let ids: BTreeSet<u64> = points.iter().map(|point| point.id).collect();
        prop_assert_eq!(ids.len(), points.len());
        for point in points {
            prop_assert_eq!(point.x.len(), dimension);
            prop_assert!(point.x.iter().all(|x| (0.0..=1.0).contains(x)));
        }
    }

    #[test]
    fn a_stored_search_goes_on_as_if_it_had_never_stopped(seed: u64, stop in 0usize..100, index in 0usize..8) {
        let mut search = AnySearch::new(method(index), setup(seed, 5, 60));
        run(&mut search, stop, 1.0);
        let out = search.ask();
        let text = serde_json::to_string(&search).expect("plain data");
        let mut copy: AnySearch = serde_json::from_str(&text).expect("own output");
        prop_assert_eq!(&copy, &search);
        if let Some(point) = out {
            search.tell(point.id, answer(&point, 1.0));
            copy.tell(point.id, answer(&point, 1.0));
        }
        prop_assert_eq!(run(&mut copy, 40, 1.0), run(&mut search, 40, 1.0));
    }

    #[test]
    fn a_copy_thinks_of_the_same_point(
        seed: u64, steps in 0usize..60, out in 0usize..4, index in 0usize..8,
    ) {
        let mut search = AnySearch::new(method(index), setup(seed, 4, 60));
        run(&mut search, steps, 1.0);
        (0..out).for_each(|_| drop(search.ask()));
        let mut helped = search.clone();
        match search.is_ready() {
            true => prop_assert!(search.clone().ask().is_some() || method(index) == SearchMethod::NelderMead),
            false => helped.adopt(search.plan(0).expect("something to think about")),
        }
        prop_assert!(helped.is_ready());
        prop_assert_eq!(helped.ask(), search.ask());
        prop_assert_eq!(helped, search);
    }

    #[test]
    fn an_old_thought_is_no_measurement_twice(seed: u64, steps in 10usize..40, late in 1usize..8) {
        let mut search = AnySearch::new(SearchMethod::Model, setup(seed, 4, 60));
        run(&mut search, steps, 1.0);
        let plan = search.plan(0).expect("something to think about");
        let measured = run(&mut search, late, 1.0);
        search.adopt(plan);
        let point = search.ask().expect("nothing is out");
        prop_assert!(point.step == Step::Replicate || measured.iter().all(|before| before.x != point.x));
    }

    #[test]
    fn points_do_not_depend_on_the_unit_of_the_cost(seed: u64, scale in 1e-3f64..1e3, index in 0usize..8) {
        let mut plain = AnySearch::new(method(index), setup(seed, 4, 80));
        let mut scaled = plain.clone();
        prop_assert_eq!(run(&mut plain, 100, 1.0), run(&mut scaled, 100, scale));
    }
}

#[test]
fn a_withdrawn_point_is_asked_again_and_answers_count_once() {
    for &method in METHODS {
        let mut search = AnySearch::new(method, setup(3, 3, 40));
        let first = search.ask().expect("the first point");
        let second = search.ask().expect("designs are asked together");
        search.withdraw(first.id);
        assert_eq!(search.ask().as_ref(), Some(&first), "{method:?}");
        search.tell(first.id, answer(&first, 1.0));
        let expected = search.clone();
        search.tell(first.id, answer(&first, 1.0));
        search.withdraw(first.id);
        assert_eq!(search, expected, "{method:?}");
        search.tell(second.id, answer(&second, 1.0));
        run(&mut search, 50, 1.0);
    }
}

#[test]
fn a_point_without_a_level_that_was_measured_at_one_is_asked_again() {
    for &method in METHODS {
        let mut search = AnySearch::new(method, setup(3, 3, 40));
        let first = search.ask().expect("the first point");
        search.tell_cheaper(first.id, Some(Verdict::Cost(1.0)));
        assert_eq!(search.ask(), Some(first), "{method:?}");
    }
}

#[test]
fn states_and_seeds_draw_different_points() {
    for &method in METHODS {
        let points = |setup| run(&mut AnySearch::new(method, setup), 5, 1.0);
        let base = points(setup(1, 3, 40));
        assert_ne!(base, points(setup(2, 3, 40)), "{method:?}");
        assert_ne!(base, points(SearchSetup { state_id: 8, ..setup(1, 3, 40) }), "{method:?}");
    }
}

#[test]
fn a_search_that_was_stored_as_auto_is_the_one_it_stood_for() {
    let mut search = AnySearch::new(SearchMethod::Auto, setup(4, 3, 40));
    run(&mut search, 12, 1.0);
    assert_eq!(search.method(), resolved(SearchMethod::Auto));
    assert_ne!(search.method(), SearchMethod::Auto);
    let auto = &SearchMethod::REGISTERED[0];
    assert!(auto.about().ends_with(&format!("today `{}`.", search.method())), "{}", auto.about());
    let AnySearch::Model(model) = &search else { panic!("{search:?}") };
    let stored = format!("{{\"auto\":{{\"model\":{}}}}}", serde_json::to_string(model).expect("plain data"));
    let mut read: AnySearch = serde_json::from_str(&stored).expect("a row of an earlier version");
    assert_eq!(read, search);
    assert_eq!(run(&mut read, 10, 1.0), run(&mut search, 10, 1.0));
}

#[test]
fn stored_searches_go_by_the_names_of_their_methods() {
    for &method in METHODS {
        let search = AnySearch::new(method, setup(4, 3, 40));
        let stored = serde_json::to_value(&search).expect("plain data");
        let names: Vec<&String> = stored.as_object().expect("tagged").keys().collect();
        assert_eq!(names, [method.name()]);
    }
}
