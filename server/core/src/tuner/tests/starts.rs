//! Clients that begin with their own defaults, their starts.

use super::*;
use crate::configuration::RawConfiguration;
use crate::policy::Operation;
use crate::tuner::replay_tests::Rows;

/// The default with other values.
fn own(values: &[(&str, Value)]) -> Configuration {
    let space = spec(Policy::default()).space;
    let mut raw: RawConfiguration = space.default_configuration().into();
    raw.extend(values.iter().map(|(name, value)| ((*name).to_owned(), value.clone())));
    space.configuration(raw).expect("it fits")
}

/// The cheapest configuration at `x` 0.5, which costs 12.75.
fn good() -> Configuration {
    let (width, leaf, cost) = (Value::Integer(8), Value::Integer(1), Value::Float(5.0));
    own(&[("width", width), ("max_leaf_size", leaf), ("travel_cost", cost)])
}

/// A configuration that costs 34 there, and the default 30.25.
fn bad() -> Configuration {
    own(&[("min_leaf_size", Value::Integer(16))])
}

fn begins_with(client: &str, start: &Configuration) -> Ask {
    Ask { start: Some(start.to_raw()), ..ask(client, 0.5, 0.5) }
}

fn frame(tuner: &mut Tuner, ask: &Ask) -> Trial {
    let trial = tuner.suggest(ask, 0).expect("valid").0;
    finish(tuner, &trial, Outcome::Ok)
}

#[test]
fn a_start_is_measured_first_and_once_and_the_search_knows_it() {
    let (mut tuner, start) = (tuner(explore_always()), good());
    let held = tuner.suggest(&begins_with("a", &start), 0).expect("valid").0;
    assert_eq!((&held.configuration, held.mode()), (&start, Mode::Default));
    assert_eq!(held.reason().source, "start");
    let again = tuner.suggest(&begins_with("a", &start), 0).expect("valid").0;
    assert_eq!(again.number, held.number);
    let beside = tuner.suggest(&begins_with("b", &start), 0).expect("valid").0;
    assert_eq!(beside.configuration, *tuner.spec().space.default_ref(), "a measures the start");
    finish(&mut tuner, &held, Outcome::Ok);
    finish(&mut tuner, &beside, Outcome::Ok);
    for _ in 0..8 {
        let trial = frame(&mut tuner, &begins_with("a", &start));
        assert!(trial.configuration != start, "what is known is not measured again");
    }
    // What fails is not tried for ever.
    let mut failing = seeded(1, explore_always());
    let first = failing.suggest(&begins_with("a", &start), 0).expect("valid").0;
    finish(&mut failing, &first, infeasible());
    assert_ne!(frame(&mut failing, &begins_with("a", &start)).configuration, start);
}

#[test]
fn the_default_is_no_start_and_what_does_not_fit_is_refused() {
    let default = spec(Policy::default()).space.default_configuration();
    let run = |ask: &Ask| {
        let mut tuner = tuner(Policy { trials_per_state: 8, ..Policy::default() });
        (0..20).map(|_| frame(&mut tuner, ask)).collect::<Vec<_>>()
    };
    assert_eq!(run(&begins_with("a", &default)), run(&ask("a", 0.5, 0.5)));
    let mut unknown = default.to_raw();
    unknown.insert("colour".into(), Value::Boolean(true));
    let ask = Ask { start: Some(unknown), ..ask("a", 0.5, 0.5) };
    let refused = tuner(Policy::default()).suggest(&ask, 0).expect_err("no such parameter");
    assert!(matches!(refused, TunerError::Start(_)), "{refused}");
}

#[test]
fn answers_are_what_is_better_than_the_start_and_are_told_over_it() {
    let mut tuner = tuner(Policy { trials_per_state: 8, ..explore_always() });
    run(&mut tuner, "a", 0.5, 0.5, 8);
    // The search has ended, and nobody has measured the starts.
    for _ in 0..4 {
        let trial = frame(&mut tuner, &begins_with("b", &good()));
        assert_eq!((trial.configuration.clone(), trial.mode()), (good(), Mode::Default), "{trial:?}");
    }
    assert_eq!(frame(&mut tuner, &begins_with("c", &bad())).configuration, bad());
    for _ in 0..3 {
        let trial = frame(&mut tuner, &begins_with("c", &bad()));
        assert!(trial.configuration != bad() && trial.mode() == Mode::Exploit, "{trial:?}");
    }
    let said = frame(&mut tuner, &begins_with("c", &bad())).reason().summary;
    assert!(said.contains("less than the client's own default"), "{said}");
    let indicators = ask("d", 0.5, 0.5).indicators;
    let mut best = |start: Option<Configuration>| {
        let start = start.map(RawConfiguration::from);
        let mut plan = None;
        loop {
            match tuner.best_step(Some(&indicators), None, start.as_ref(), plan).expect("valid") {
                DecisionStep::Need(request) => plan = Some(request.compute()),
                DecisionStep::Done(best) => break best.expect("measured"),
            }
        }
    };
    let (plain, of_good, of_bad) = (best(None), best(Some(good())), best(Some(bad())));
    let is_about = |cost: Option<f64>, about: f64| cost.is_some_and(|cost| (cost - about).abs() < 1e-6);
    assert!(is_about(plain.default_cost, 30.25), "{plain:?}");
    assert!(is_about(of_good.default_cost, 12.75) && of_good.configuration == good(), "{of_good:?}");
    assert!(of_good.standing.nothing_better, "{of_good:?}");
    assert!(is_about(of_bad.default_cost, 34.0) && !of_bad.standing.nothing_better, "{of_bad:?}");
    assert!(of_bad.standing.gain.and_then(|gain| gain.low).is_some_and(|low| low > 0.0), "{of_bad:?}");
}

#[test]
fn who_explores_nothing_gets_its_start_until_something_is_known() {
    let shadow = Policy { operation: Operation::Shadow, ..explore_always() };
    for policy in [exploit_always(), shadow] {
        let mut tuner = tuner(policy);
        for _ in 0..4 {
            let trial = frame(&mut tuner, &begins_with("a", &good()));
            assert_eq!((trial.configuration.clone(), trial.mode()), (good(), Mode::Default), "{trial:?}");
        }
    }
}

#[test]
fn a_start_is_the_reference_of_a_budget() {
    let policy = Policy { regret_budget: Some(0.5), abort_above: Some(1.5), ..explore_always() };
    let mut tuner = tuner(policy);
    let question = Ask { can_abort: true, ..begins_with("a", &good()) };
    let trials: Vec<Trial> = (0..40).map(|_| frame(&mut tuner, &question)).collect();
    assert_eq!(trials[0].configuration, good());
    assert!(trials.iter().any(|trial| trial.decision.explores()), "the budget is earned beside it");
}

#[test]
fn runs_of_starts_take_nothing_of_a_search() {
    let (mut tuner, state) = (tuner(exploit_always()), StateId(1));
    let start = |number: u8| own(&[("travel_cost", Value::Float(0.5 + 0.9 * f64::from(number)))]);
    assert_eq!(frame(&mut tuner, &begins_with("0", &start(0))).configuration, start(0));
    assert!(!tuner.set_policy(Policy { trials_per_state: 8, ..explore_always() }).expect("valid"));
    for number in 1..10 {
        let trial = frame(&mut tuner, &begins_with(&number.to_string(), &start(number)));
        assert!(trial.configuration == start(number) && !trial.decision.is_run_of_search(), "{trial:?}");
    }
    let results = tuner.knowledge.states.results(state);
    assert_eq!((results.tried(), results.runs(), results.searched()), (10, 0, 0));
    let trials = run(&mut tuner, "x", 0.5, 0.5, 20);
    let searched = trials.iter().filter(|trial| trial.decision.is_run_of_search()).count();
    assert!((6..=8).contains(&searched), "{searched} of 8");
}

/// A study whose only state has its verdict, and its rows.
fn settled() -> (Tuner, Rows) {
    let policy = Policy { epsilon: 1.0, trials_per_state: 12, ..Policy::default() };
    let (mut tuner, mut rows) = (tuner(policy), Rows::default());
    for number in 0..100 {
        let (trial, handed) = tuner.suggest(&ask("a", 0.5, 0.5), 0).expect("valid");
        rows.write(&handed);
        let noise = 1.0 + 0.01 * f64::from(number % 3);
        let report = tuner.report(&trial, measured(noise * cost(&trial)), Outcome::Ok, 1);
        rows.write(&report.expect("valid").1);
    }
    assert!(tuner.standings().is_settled(StateId(1)));
    (tuner, rows)
}

#[test]
fn a_verdict_stands_unless_a_start_beats_it_also_after_a_restart() {
    let ((mut tuner, mut rows), state, mut now_ms) = (settled(), StateId(1), 1);
    let verdict = tuner.best(None, None).expect("valid").expect("measured").configuration;
    let measure = |tuner: &mut Tuner, rows: &mut Rows, start: &Configuration, share: f64| {
        let (trial, handed) = tuner.suggest(&begins_with("b", start), 1).expect("valid");
        assert_eq!(&trial.configuration, start, "{trial:?}");
        rows.write(&handed);
        let report = tuner.report(&trial, measured(share * cost(&trial)), Outcome::Ok, 1);
        rows.write(&report.expect("valid").1);
    };
    for leaves in [16, 14] {
        let worse = own(&[("min_leaf_size", Value::Integer(leaves)), ("travel_cost", Value::Float(0.3))]);
        measure(&mut tuner, &mut rows, &worse, 1.0);
        assert!(tuner.standings().is_settled(state), "a worse start is no reason");
        assert_eq!(tuner.best(None, None).expect("valid").expect("measured").configuration, verdict);
    }
    let lost = own(&[("travel_cost", Value::Float(0.7))]);
    for client in ["c", "d"] {
        let (trial, handed) = tuner.suggest(&begins_with(client, &lost), now_ms).expect("valid");
        assert!(trial.decision.measures_start(), "{trial:?}");
        rows.write(&handed);
        now_ms = trial.lease_expire_ms + 1;
        rows.write(&tuner.expire(now_ms));
    }
    let saved = tuner.knowledge.learnt(tuner.spec()).checkpoint().expect("a small study");
    let next = |tuner: &Tuner| tuner.clone().suggest(&begins_with("e", &lost), now_ms).expect("valid").0;
    assert!(!next(&tuner).decision.measures_start(), "it is left");
    for checkpoint in [None, Some(&saved)] {
        let restored = rows.restore(&tuner, checkpoint);
        assert!(restored.standings().is_settled(state));
        assert_eq!(next(&restored), next(&tuner));
    }
    let better = own(&[("width", Value::Integer(8)), ("travel_cost", Value::Float(4.97))]);
    measure(&mut tuner, &mut rows, &better, 0.2);
    assert!(!tuner.standings().is_settled(state), "a better one is a reason");
}

#[test]
fn a_lost_start_goes_to_the_next_client_and_is_left_in_the_end() {
    let (start, state) = (bad(), StateId(1));
    let (mut tuner, mut now_ms) = (seeded(1, explore_always()), 0);
    for client in ["a", "b", "c"] {
        let trial = tuner.suggest(&begins_with(client, &start), now_ms).expect("valid").0;
        assert_eq!(trial.configuration == start, client != "c", "{trial:?}");
        now_ms = trial.lease_expire_ms + 1;
        assert_eq!(tuner.expire(now_ms).trials.len(), 1);
    }
    assert!(tuner.knowledge.states.results(state).record(&start).is_none(), "it has not failed");
    // A client that is restarted again and again gets the default in the end where it explores.
    for (policy, is_left) in [(explore_always(), true), (exploit_always(), false)] {
        let mut tuner = seeded(1, policy);
        let asked = |session: u64| Ask { session, ..begins_with("a", &start) };
        let trials = [1, 2, 3].map(|session| tuner.suggest(&asked(session), 0).expect("valid").0);
        assert_eq!((trials[0].number, &trials[0].configuration), (trials[1].number, &start));
        assert_eq!(trials[2].configuration != start, is_left, "{trials:?}");
        assert!(tuner.knowledge.states.results(state).record(&start).is_none(), "it has not failed");
    }
}

#[test]
fn a_start_stays_the_answer_where_nothing_was_assessed_until_something_beats_it() {
    let (mut tuner, start, state) = (tuner(explore_always()), good(), StateId(1));
    frame(&mut tuner, &begins_with("a", &start));
    let measure = |tuner: &mut Tuner, wanted: &Configuration, render_ms: f64| {
        let trial = tuner.suggest_wanted(&ask("b", 0.5, 0.5), wanted.to_raw(), None, 0).expect("valid").0;
        assert!(tuner.report(&trial, measured(render_ms), Outcome::Ok, 1).is_ok());
    };
    let other = |number: u8| own(&[("travel_cost", Value::Float(0.1 + 0.2 * f64::from(number)))]);
    for number in 0..20 {
        measure(&mut tuner, &other(number), 12.7);
    }
    let answer = |tuner: &Tuner| {
        let hurried = Planned::Ahead(Box::default());
        tuner.exploiting(&hurried).best_known(state, Some(&start)).expect("measured")
    };
    let (configuration, source) = (answer(&tuner).configuration, answer(&tuner).source);
    assert_eq!(configuration, start, "12.7 is hardly less than 12.75");
    assert!(matches!(source, ExploitSource::Incumbent { beside_start: true, .. }), "{source:?}");
    measure(&mut tuner, &other(30), 6.0);
    measure(&mut tuner, &other(30), 6.0);
    assert_eq!(answer(&tuner).configuration, other(30));
}

#[test]
fn a_start_that_fails_gives_way_to_the_default_for_good() {
    let default = spec(Policy::default()).space.default_configuration();
    let start = own(&[("min_leaf_size", Value::Integer(16)), ("travel_cost", Value::Float(3.3))]);
    let shadow = Policy { operation: Operation::Shadow, ..explore_always() };
    for policy in [explore_always(), exploit_always(), shadow] {
        for outcome in [infeasible(), Outcome::Failed { reason: "crash".into() }] {
            let mut tuner = seeded(1, policy.clone());
            let first = tuner.suggest(&begins_with("a", &start), 0).expect("valid").0;
            assert_eq!(first.configuration, start);
            finish(&mut tuner, &first, outcome);
            assert_eq!(frame(&mut tuner, &begins_with("a", &start)).configuration, default);
            for client in ["a", "b"].repeat(6) {
                let trial = frame(&mut tuner, &begins_with(client, &start));
                assert_ne!(trial.configuration, start, "{trial:?}");
            }
        }
    }
}
