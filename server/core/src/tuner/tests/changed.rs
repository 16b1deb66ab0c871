//! A finished state is searched again where it costs something else, and not where the machine does.

use proptest::prelude::*;
use rand::RngExt;

use super::*;
use crate::policy::Operation;
use crate::randomness::{Purpose, stream};
use crate::session::SessionPolicy;
use crate::testing::cases;

/// A search of 20 trials in each state, and its confirmation.
fn finishes() -> Policy {
    Policy { epsilon: 1.0, trials_per_state: 20, ..Policy::default() }
}

/// Runs a frame whose cost is `factor` times that of the trial, with noise of 2 %.
fn frame(tuner: &mut Tuner, seed: u64, factor: impl Fn(&Trial) -> f64) -> Trial {
    frame_of(tuner, &ask("a", 0.5, 0.5), seed, factor)
}

/// The same of the client that asks.
fn frame_of(tuner: &mut Tuner, ask: &Ask, seed: u64, factor: impl Fn(&Trial) -> f64) -> Trial {
    let trial = tuner.suggest(ask, 0).expect("a valid question").0;
    let mut random = stream(seed, Purpose::Decision, 0, trial.number);
    let noise: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    let cost = cost(&trial) * factor(&trial) * (1.0 + 0.02 * noise);
    tuner.report(&trial, measured(cost), Outcome::Ok, 1).expect("a valid report").0
}

/// Frames until the state is finished.
fn finish_search(tuner: &mut Tuner, seed: u64) -> Configuration {
    for _ in 0..200 {
        let trial = frame(tuner, seed, |_| 1.0);
        if trial.decision.rule() == Some(Rule::Finished) {
            return trial.configuration;
        }
    }
    panic!("a search of 20 trials ends");
}

#[test]
fn a_state_that_costs_something_else_is_searched_again() {
    for seed in 0..8 {
        let mut tuner = tuner(finishes());
        let before = finish_search(&mut tuner, seed);
        (0..50).for_each(|_| drop(frame(&mut tuner, seed, |_| 1.0)));
        // Wide nodes become bad, which no indicator shows.
        let width = before.get("width").cloned();
        let dear = |trial: &Trial| if trial.configuration.get("width") == width.as_ref() { 2.0 } else { 1.0 };
        let after: Vec<Trial> = (0..150).map(|_| frame(&mut tuner, seed, dear)).collect();
        let explores = |trial: &Trial| trial.decision.explores() && trial.configuration != before;
        let default = tuner.spec().space.default_configuration();
        let first = after.iter().position(|one| explores(one) && one.configuration != default);
        assert!(first.is_some_and(|frames| frames <= 14), "seed {seed}: {first:?}");
        let last = &after[after.len() - 1];
        assert!(
            last.configuration != before && cost(last) * dear(last) < 0.8 * 2.0 * cost(&after[0]),
            "{last:?}"
        );
    }
}

#[test]
fn a_state_that_is_to_be_searched_again_counts_as_unexplored_until_then() {
    for seed in 0..4 {
        let mut tuner = tuner(finishes());
        let before = finish_search(&mut tuner, seed);
        (0..50).for_each(|_| drop(frame(&mut tuner, seed, |_| 1.0)));
        let width = before.get("width").cloned();
        let dear = |trial: &Trial| if trial.configuration.get("width") == width.as_ref() { 2.0 } else { 1.0 };
        let state = StateId(1);
        assert!(tuner.knowledge.states[state].explored && tuner.knowledge.history.gained(state).len() >= 3);
        let forgets = (0..150).any(|_| {
            frame(&mut tuner, seed, dear);
            tuner.searches.of(state).is_none()
        });
        assert!(forgets && !tuner.knowledge.states[state].explored, "seed {seed}: as after a restart");
        assert!(tuner.knowledge.history.gained(state).is_empty(), "what was gained before");
        frame(&mut tuner, seed, dear);
        assert!(tuner.knowledge.states[state].explored, "another search was begun");
    }
}

#[test]
fn an_answer_that_becomes_a_tenth_dearer_is_noticed_within_ten_frames() {
    let is_noticed = |&seed: &u64| {
        let mut tuner = tuner(finishes());
        let before = finish_search(&mut tuner, seed);
        (0..50).for_each(|_| drop(frame(&mut tuner, seed, |_| 1.0)));
        let dear = |trial: &Trial| if trial.configuration == before { 1.1 } else { 1.0 };
        (0..10).any(|_| {
            frame(&mut tuner, seed, dear);
            tuner.searches.of(StateId(1)).is_none()
        })
    };
    let noticed = (0..16).filter(is_noticed).count();
    assert!(noticed >= 13, "{noticed} of 16");
}

#[test]
fn a_machine_that_changes_its_speed_is_no_reason() {
    for (seed, factor) in [(1, 1.6), (2, 3.0), (3, 0.5), (4, 1.3)] {
        let mut tuner = tuner(finishes());
        let before = finish_search(&mut tuner, seed);
        (0..30).for_each(|_| drop(frame(&mut tuner, seed, |_| 1.0)));
        let after: Vec<Trial> = (0..100).map(|_| frame(&mut tuner, seed, |_| factor)).collect();
        let default = tuner.spec().space.default_configuration();
        let others = after.iter().filter(|one| one.configuration != before).count();
        assert!(after.iter().all(|one| one.configuration == before || one.configuration == default));
        // A recheck waits for six ratios at most.
        assert!((1..=6).contains(&others), "factor {factor}: the default ran {others} times beside it");
        assert_eq!(after[99].configuration, before);
    }
}

#[test]
fn who_wants_no_exploring_is_not_used_for_rechecks() {
    let mut tuner = tuner(finishes());
    let before = finish_search(&mut tuner, 5);
    (0..30).for_each(|_| drop(frame(&mut tuner, 5, |_| 1.0)));
    tuner.set_policy(Policy { operation: Operation::Freeze, ..finishes() }).expect("a valid policy");
    assert!((0..60).all(|_| frame(&mut tuner, 5, |_| 2.0).configuration == before));
}

/// The rounds of these clients until a finished state is forgotten whose answer becomes twice as dear.
fn rounds_until_forgotten(clients: &[Ask], seed: u64) -> Option<usize> {
    let mut tuner = tuner(finishes());
    let before = finish_search(&mut tuner, seed);
    let dear = |trial: &Trial| if trial.configuration == before { 2.0 } else { 1.0 };
    for _ in 0..10 {
        clients.iter().for_each(|ask| drop(frame_of(&mut tuner, ask, seed, |_| 1.0)));
    }
    (0..20).find(|_| {
        clients.iter().any(|ask| {
            frame_of(&mut tuner, ask, seed, dear);
            tuner.searches.of(StateId(1)).is_none()
        })
    })
}

#[test]
fn many_clients_in_turns_do_not_hide_a_change() {
    let clients: Vec<Ask> = (0..20).map(|client| ask(&format!("client {client}"), 0.5, 0.5)).collect();
    for seed in 0..4 {
        let rounds = rounds_until_forgotten(&clients, seed);
        assert!(rounds.is_some_and(|rounds| rounds <= 14), "seed {seed}: {rounds:?}");
    }
}

#[test]
fn who_wants_no_exploring_does_not_keep_others_from_finding_a_change() {
    let session_policy = SessionPolicy { epsilon: Some(0.0), ..SessionPolicy::default() };
    let rests = Ask { session: 1, session_policy, ..ask("rests", 0.5, 0.5) };
    for seed in 0..4 {
        let clients = [rests.clone(), ask("tunes", 0.5, 0.5)];
        let rounds = rounds_until_forgotten(&clients, seed);
        assert!(rounds.is_some_and(|rounds| rounds <= 14), "seed {seed}: {rounds:?}");
        assert_eq!(rounds_until_forgotten(&clients[..1], seed), None, "it is asked for nothing");
    }
}

#[test]
fn what_cannot_be_run_any_more_is_not_asked_for_again_and_again() {
    for seed in 0..4 {
        let mut tuner = tuner(finishes());
        finish_search(&mut tuner, seed);
        (0..50).for_each(|_| drop(frame(&mut tuner, seed, |_| 1.0)));
        let default = tuner.spec().space.default_configuration();
        let mut failed = 0;
        for _ in 0..60 {
            let trial = suggest(&mut tuner, "a", 0.5, 0.5);
            let fails = trial.configuration == default;
            failed += usize::from(fails);
            let outcome = if fails { infeasible() } else { Outcome::Ok };
            let cost = 2.0 * cost(&trial);
            assert!(tuner.report(&trial, measured(cost), outcome, 1).is_ok());
        }
        assert!((1..=2).contains(&failed), "seed {seed}: the default was asked for {failed} times");
    }
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn a_machine_whose_speed_comes_and_goes_never_makes_a_state_forget(
        seed in 0u64..1000, lengths in prop::collection::vec((3usize..40, 0usize..3), 12..20),
    ) {
        let mut tuner = tuner(finishes());
        finish_search(&mut tuner, seed);
        let tried = tuner.knowledge.states.results(StateId(1)).tried();
        for (frames, busy) in lengths {
            let factor = [1.0, 1.4, 1.9][busy];
            (0..frames).for_each(|_| drop(frame(&mut tuner, seed, |_| factor)));
            prop_assert!(tuner.knowledge.states.results(StateId(1)).tried() >= tried);
        }
    }
}
