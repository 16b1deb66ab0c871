//! A state that is unlike all known ones is looked at in the branches of the space that those speak against.

use super::*;
use crate::search::Step;
use crate::tuner::plan::Planned;

const KNOWN: [f64; 4] = [0.1, 0.3, 0.5, 0.7];
/// The new state.
const HERE: f64 = 0.95;
/// Trials of the new state within which every branch has had its look.
const LOOKED_BY: usize = 12;

/// Two back ends; the ready one has a budget where it builds with high care.
fn space() -> Space {
    let space = Space::builder().categorical("backend", ["own", "ready"]).default("own");
    let space = space.integer("level", 1..=9).default(2).active_if("backend", ["own"]);
    let space = space.categorical("care", ["low", "high"]).default("low").active_if("backend", ["ready"]);
    let space = space.float("budget", 0.0..=1.0).default(0.2).active_if("care", ["high"]);
    space.build().expect("a valid space")
}

/// A cost where high care costs this multiple.
fn cost(configuration: &Configuration, high: f64) -> f64 {
    let number = |name: &str| configuration.get(name).and_then(Value::as_number);
    match (number("level"), number("budget")) {
        (_, Some(budget)) => high * (22.0 - 4.0 * budget),
        (Some(level), None) => 20.0 + (level - 5.0) * (level - 5.0),
        (None, None) => 24.0,
    }
}

fn frames(tuner: &mut Tuner, x: f64, high: f64, count: usize) -> Vec<Trial> {
    let one = |_| {
        let trial = suggest(tuner, "a", x, 0.5);
        let cost = cost(&trial.configuration, high);
        tuner.report(&trial, measured(cost), Outcome::Ok, 1).expect("a valid report").0
    };
    (0..count).map(one).collect()
}

/// A tuner that knows states in which high care costs this multiple.
fn knowing(high: f64) -> Tuner {
    let policy = Policy { trials_per_state: 40, ..explore_always() };
    let mut tuner = Tuner::new(Arc::new(spec_of(space(), policy))).expect("valid");
    let wanted = space().decode(&[0.75, 0.5, 0.75, 0.5]);
    assert!(wanted.get("budget").is_some(), "{wanted:?}");
    for x in KNOWN {
        frames(&mut tuner, x, high, 10);
        for _ in 0..3 {
            let trial = tuner.suggest_wanted(&ask("w", x, 0.5), wanted.to_raw(), None, 0).expect("valid").0;
            let cost = cost(&trial.configuration, high);
            assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
        }
    }
    assert_eq!(tuner.knowledge.states.len(), KNOWN.len(), "each place is a state of its own");
    tuner
}

#[test]
fn a_branch_that_pays_here_alone_is_found_soon() {
    let explored = || frames(&mut knowing(3.0), HERE, 0.4, LOOKED_BY);
    let trials = explored();
    let found = trials.iter().position(|trial| trial.configuration.get("budget").is_some());
    assert!(found.is_some(), "{trials:#?}");
    let configurations = |trials: &[Trial]| -> Vec<Configuration> {
        trials.iter().map(|trial| trial.configuration.clone()).collect()
    };
    assert_eq!(configurations(&trials), configurations(&explored()), "by the seed alone");
}

#[test]
fn a_branch_that_did_very_badly_in_all_known_states_gets_no_look() {
    for (high, count) in [(3.0, 1), (30.0, 0)] {
        let mut tuner = knowing(high);
        let here = StateId(suggest(&mut tuner, "b", HERE, 0.5).state_id);
        let evidence = tuner.exploiting(&Planned::AtOnce).transfer.evidence(here);
        let looks = evidence.beginning(&space()).expect("states are known").looks;
        let opens = |x: &&Vec<f64>| space().decode(x).get("budget").is_some();
        assert_eq!(looks.iter().filter(opens).count(), count, "{high} times as dear: {looks:?}");
    }
}

#[test]
fn the_first_search_of_a_study_looks_at_nothing() {
    let mut tuner = Tuner::new(Arc::new(spec_of(space(), explore_always()))).expect("valid");
    let trials = frames(&mut tuner, HERE, 1.0, 20);
    let is_look = |trial: &Trial| trial.decision.search_step() == Some(Step::Elsewhere);
    assert!(!trials.iter().any(is_look), "{trials:#?}");
}
