//! The tuner's parts for themselves: searches and their counted changes, models and their deferred updates,
//! transfer and its questions to other states.

use super::*;
use crate::limits::DEFERRED_UPDATES_MAX;
use crate::search::{AnySearch, SearchSetup};
use crate::trial::Fingerprint;
use crate::tuner::exploring::Searches;
use crate::tuner::plan::Planned;

fn search(state: u64) -> AnySearch {
    let space = spec(Policy::default()).space;
    AnySearch::new(SearchMethod::Random, SearchSetup::of(&space, 42, state, 20))
}

#[test]
fn whatever_may_change_a_search_is_counted_and_a_look_is_not() {
    let mut searches = Searches::new(&spec(Policy::default()).space);
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
    tuner.knowledge.defer_updates();
    for number in 0..12 {
        run(&mut tuner, "a", 0.1 * f64::from(number % 9), 0.5, 1);
    }
    assert!(tuner.knowledge.has_deferred_updates());
    let space = tuner.spec().space.clone();
    let (slow, fast) = (
        tuner.knowledge.deferred_updates().expect("some"),
        tuner.knowledge.deferred_updates().expect("some"),
    );
    tuner.knowledge.apply_updates(fast.compute(&space));
    assert!(!tuner.knowledge.has_deferred_updates() && tuner.knowledge.deferred_updates().is_none());
    let after = tuner.knowledge.models.predictors.clone();
    tuner.knowledge.apply_updates(slow.compute(&space));
    assert_eq!(tuner.knowledge.models.predictors, after);
}

#[test]
fn a_state_is_untouched_until_something_runs_in_it() {
    let mut tuner = tuner(Policy { predictor: PredictorMethod::Contextual, ..explore_always() });
    run(&mut tuner, "a", 0.1, 0.5, 12);
    let trial = suggest(&mut tuner, "b", 0.9, 0.5);
    let (here, there) = (StateId(trial.state_id), StateId(1));
    assert_ne!(here, there);
    assert!(!tuner.exploiting(&Planned::AtOnce).transfer.is_untouched(here), "it is being measured in");
    assert!(!tuner.exploiting(&Planned::AtOnce).transfer.is_untouched(there));
    // Where something is known, nothing is proposed to begin with.
    assert!(
        tuner.exploiting(&Planned::AtOnce).transfer.first(there, 99, &[0.1, 0.5], &Planned::AtOnce).is_none()
    );
    let query = tuner.knowledge.states.query(&tuner.spec.space, &[0.9, 0.5], Some(here));
    let answer = tuner.knowledge.models.predictors.predict(PredictorMethod::Contextual, &query);
    let (answer, method) = answer.expect("another state is known");
    assert_eq!(method, PredictorMethod::Contextual);
    assert!(answer.neighbours.iter().any(|neighbour| neighbour.state_id == there.get()), "{answer:?}");
}

#[test]
fn exploiting_asks_a_predictor_until_the_states_own_search_is_over() {
    let mut tuner = tuner(Policy { trials_per_state: 6, ..explore_always() });
    assert!(tuner.exploiting(&Planned::AtOnce).transfer.needs_predictor(None), "a state that nobody has met");
    run(&mut tuner, "a", 0.1, 0.5, 3);
    assert!(tuner.exploiting(&Planned::AtOnce).transfer.needs_predictor(Some(StateId(1))));
    run(&mut tuner, "a", 0.1, 0.5, 12);
    assert!(tuner.knowledge.states.results(StateId(1)).tried() >= 6);
    assert!(!tuner.exploiting(&Planned::AtOnce).transfer.needs_predictor(Some(StateId(1))));
}

#[test]
fn lost_leases_are_remembered_through_a_new_search_until_something_is_known() {
    let space = spec(Policy::default()).space;
    let (here, lost, other) = (StateId(1), space.default_configuration(), space.decode(&[0.9; 4]));
    let mut searches = Searches::new(&spec(Policy::default()).space);
    searches.found(None);
    assert_eq!((searches.note_lost(here, &lost), searches.note_lost(here, &lost)), (1, 2));
    assert!(searches.of(here).is_none() && searches.record(here).is_some(), "no search was begun by that");
    searches.begin(here, search(1), Some(other.clone()));
    assert_eq!((searches.lost(here, &lost), searches.lost(here, &other), searches.changes(here)), (2, 0, 3));
    assert_eq!(searches.of(here).and_then(|own| own.confirmed.as_ref()).map(|own| &own.0), Some(&other));
    searches.begin(here, search(1), Some(lost.clone()));
    let incumbent = searches.of(here).and_then(|own| own.confirmed.as_ref()).map(|own| &own.0);
    assert_eq!(incumbent, Some(&other), "what was there first stays");
    searches.forgive(here, &other);
    assert_eq!(searches.changes(here), 4, "there was nothing to forgive");
    searches.forgive(here, &lost);
    assert_eq!((searches.lost(here, &lost), searches.changes(here)), (0, 5));
}

#[test]
fn updates_that_nobody_computes_are_not_put_off_without_end() {
    let mut tuner = tuner(Policy { predictor: PredictorMethod::Contextual, ..explore_always() });
    tuner.knowledge.defer_updates();
    let mut put_off = Vec::new();
    for number in 0..4 * DEFERRED_UPDATES_MAX {
        run(&mut tuner, "a", 0.01 * (number % 97) as f64, 0.5, 1);
        put_off.push(tuner.knowledge.models.predictors.deferred_count());
    }
    let most = put_off.iter().copied().max();
    assert!(most.is_some_and(|most| most > 1 && most <= DEFERRED_UPDATES_MAX), "{put_off:?}");
    assert!(put_off.windows(2).any(|pair| pair[1] < pair[0]), "they were never caught up: {put_off:?}");
}

#[test]
fn models_learn_what_a_trial_would_have_cost_on_the_first_machine() {
    let machine = |threads| Fingerprint { cpu_model: "cpu".into(), threads, ..Fingerprint::default() };
    let mut tuner = tuner(Policy { predictor: PredictorMethod::Contextual, ..explore_always() });
    let mut frame = |threads: u32, factor: f64, x: f64| {
        let client = format!("client {threads}");
        let ask = Ask { fingerprint: Some(machine(threads)), ..ask(&client, x, 0.5) };
        let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
        let taken = tuner.report(&trial, measured(10.0 * factor), Outcome::Ok, 1);
        assert!(taken.is_ok(), "{taken:?}");
    };
    // Both measure one input, by which the machines' factor is known; the second alone goes on.
    (0..3).for_each(|_| frame(1, 1.0, 0.1));
    (0..3).for_each(|_| frame(2, 3.0, 0.1));
    for step in 0..12 {
        frame(2, 3.0, 0.3 + 0.05 * f64::from(step));
    }
    let query = tuner.knowledge.states.query(&tuner.spec.space, &[0.6, 0.5], None);
    let answer = tuner.knowledge.models.predictors.predict(PredictorMethod::Contextual, &query);
    let (answer, _) = answer.expect("states are known");
    let cost = answer.expected.cost;
    assert!((8.0..13.0).contains(&cost), "{cost}, where the second machine measured 30");
}

#[test]
fn a_portfolio_begins_where_most_states_near_by_were_searched() {
    let mut tuner = tuner(Policy { search: SearchMethod::Model, ..explore_always() });
    assert!(
        !tuner.exploiting(&Planned::AtOnce).transfer.begins_with_portfolio(&[0.5, 0.5], None),
        "nothing is near by"
    );
    run(&mut tuner, "a", 0.1, 0.5, 8);
    assert!(tuner.exploiting(&Planned::AtOnce).transfer.begins_with_portfolio(&[0.5, 0.5], None));
    assert!(
        !tuner.exploiting(&Planned::AtOnce).transfer.begins_with_portfolio(&[0.1, 0.5], Some(StateId(1))),
        "itself does not count"
    );
    run(&mut tuner, "b", 0.6, 0.5, 1);
    assert!(
        !tuner.exploiting(&Planned::AtOnce).transfer.begins_with_portfolio(&[0.5, 0.5], None),
        "one of two is no majority"
    );
    let neighbours = tuner.exploiting(&Planned::AtOnce).transfer.neighbours(StateId(2));
    assert_eq!(neighbours.iter().map(|near| near.state_id).collect::<Vec<_>>(), [1], "not its own neighbour");
    let mut hears_nobody = super::tuner(Policy { search: SearchMethod::Random, ..explore_always() });
    run(&mut hears_nobody, "a", 0.1, 0.5, 8);
    let deaf = hears_nobody.exploiting(&Planned::AtOnce);
    assert!(!deaf.transfer.begins_with_portfolio(&[0.5, 0.5], None), "a search that hears nobody");
}

/// Another client reports from the state whenever an assessment of it is made.
#[test]
fn a_race_begins_and_ends_where_the_table_never_rests() {
    let mut tuner = tuner(Policy { epsilon: 1.0, trials_per_state: 40, ..Policy::default() });
    run(&mut tuner, "a", 0.5, 0.5, 40);
    assert!(tuner.standings().is_to_be_confirmed(StateId(1)), "the search is over");
    let (own, beside) = (ask("a", 0.5, 0.5), ask("b", 0.5, 0.5));
    let default = tuner.spec().space.default_configuration().to_raw();
    let mut rules = Vec::new();
    while rules.len() < 300 && rules.last() != Some(&Rule::Finished) {
        let busy = tuner.suggest_wanted(&beside, default.clone(), None, 0).expect("it fits").0;
        let question = tuner.question(&own).expect("valid");
        let plan = tuner.plan(&question, |_| true).map(PlanRequest::compute).unwrap_or_default();
        finish(&mut tuner, &busy, Outcome::Ok);
        let trial = with_plan(&mut tuner, &own, plan);
        rules.push(trial.decision.rule().expect("a trial has a rule"));
        finish(&mut tuner, &trial, Outcome::Ok);
    }
    assert!(rules.contains(&Rule::Confirming) && rules.last() == Some(&Rule::Finished), "{rules:?}");
}
