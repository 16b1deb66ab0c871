//! The tuner's parts for themselves: searches and their counted changes, models and their deferred updates, transfer and
//! its questions to other states.

use super::*;
use crate::search::{AnySearch, Layout, SearchSetup};
use crate::tuner::plan::Planned;
use crate::tuner::searches::Searches;

fn search(state: u64) -> AnySearch {
    let space = spec(Policy::default()).space;
    let setup = SearchSetup {
        seed: 42,
        state_id: state,
        start: vec![0.5; 4],
        budget: 20,
        levels: Vec::new(),
        layout: Layout::of(&space),
    };
    AnySearch::new(SearchMethod::Random, setup)
}

#[test]
fn whatever_may_change_a_search_is_counted_and_a_look_is_not() {
    let mut searches = Searches::default();
    let (first, second) = (StateId(1), StateId(2));
    searches.found(None);
    searches.found(None);
    assert!(searches.of(first).is_none() && searches.change(first).is_none());
    assert_eq!(searches.changes(first), 0, "there was nothing to change");
    searches.begin(second, search(2), None);
    assert_eq!((searches.changes(first), searches.changes(second)), (0, 1));
    assert!(searches.of(second).is_some_and(|own| own.search.is_some()));
    assert_eq!(searches.changes(second), 1, "it was only looked at");
    searches.change(second).expect("begun").end();
    assert_eq!(searches.changes(second), 2);
    assert!(searches.of(second).is_some_and(|own| own.search.is_none()), "an ended search is still known");
    searches.begin(second, search(2), None);
    assert!(searches.of(second).is_some_and(|own| own.search.is_some()) && searches.changes(second) == 3);
    assert_eq!(searches.all_mut().count(), 1);
}

#[test]
fn updates_of_which_somebody_was_faster_are_dropped() {
    let mut tuner = tuner(Policy { predictor: PredictorMethod::Contextual, ..explore_always() });
    tuner.defer_updates();
    for number in 0..12 {
        run(&mut tuner, "a", 0.1 * f64::from(number % 9), 0.5, 1);
    }
    assert!(tuner.has_deferred_updates());
    let space = tuner.spec().space.clone();
    let (slow, fast) = (tuner.deferred_updates().expect("some"), tuner.deferred_updates().expect("some"));
    tuner.apply_updates(fast.compute(&space));
    assert!(!tuner.has_deferred_updates() && tuner.deferred_updates().is_none());
    let after = tuner.models.predictors().clone();
    tuner.apply_updates(slow.compute(&space));
    assert_eq!(tuner.models.predictors(), &after);
}

#[test]
fn a_state_is_untouched_until_something_runs_in_it() {
    let mut tuner = tuner(Policy { predictor: PredictorMethod::Contextual, ..explore_always() });
    run(&mut tuner, "a", 0.1, 0.5, 12);
    let trial = suggest(&mut tuner, "b", 0.9, 0.5);
    let (here, there) = (StateId(trial.state_id), StateId(1));
    assert_ne!(here, there);
    assert!(!tuner.transfer().is_untouched(here), "it is being measured in");
    assert!(!tuner.transfer().is_untouched(there));
    // Where something is known, nothing is proposed to begin with.
    assert!(tuner.transfer().first(there, 99, &[0.1, 0.5], &Planned::AtOnce).is_none());
    let (answer, method) =
        tuner.transfer().answer(&[0.9, 0.5], Some(here), &Planned::AtOnce).expect("another state is known");
    assert_eq!(method, PredictorMethod::Contextual);
    assert!(answer.neighbours.iter().any(|neighbour| neighbour.state_id == there.get()), "{answer:?}");
}

#[test]
fn exploiting_asks_a_predictor_until_the_states_own_search_is_over() {
    let mut tuner = tuner(Policy { trials_per_state: 6, ..explore_always() });
    assert!(tuner.transfer().needs_predictor(None), "a state that nobody has met");
    run(&mut tuner, "a", 0.1, 0.5, 3);
    assert!(tuner.transfer().needs_predictor(Some(StateId(1))));
    run(&mut tuner, "a", 0.1, 0.5, 12);
    assert!(tuner.states.results(StateId(1)).tried() >= 6);
    assert!(!tuner.transfer().needs_predictor(Some(StateId(1))));
}
