//! Exploring that pays, stops, and is shared among workers; and the first configurations of a new state.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::policy::PolicySettings;
use crate::randomness::standard_normal;
use crate::session::SessionPolicy;

/// Frames of one client in a state: how many of them explored.
fn explored(
    tuner: &mut Tuner,
    client: &str,
    x: f64,
    frames: usize,
    cost: impl FnMut(&Trial) -> f64,
) -> usize {
    let mut cost = cost;
    let mut explored = 0;
    for _ in 0..frames {
        let trial = suggest(tuner, client, x, 0.5);
        explored += usize::from(trial.mode() == Mode::Explore);
        let _ = tuner.report(&trial, measured(cost(&trial)), Outcome::Ok, 1).expect("a valid report");
    }
    explored
}

/// A policy without the trials of a confirmation, which these tests do not count.
fn unconfirmed() -> Policy {
    Policy { confirm_rounds: 0, track_speed: false, ..Policy::default() }
}

#[test]
fn where_nothing_can_be_gained_exploring_ends_after_few_frames() {
    let mut all = Vec::new();
    for seed in 3..7 {
        let mut tuner = tuner(Policy { weigh_gain: true, ..unconfirmed() });
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for state in 0..4 {
            let flat = |_: &Trial| 10.0 * (1.0 + 0.07 * standard_normal(&mut random));
            all.push(explored(&mut tuner, "a", 0.25 * f64::from(state), 300, flat));
        }
    }
    // Of 300 frames each; octaves end at 8, 16, 32 and 64, and luck wins one or two of them now and then.
    assert!(all.iter().all(|&explored| explored <= 72), "{all:?}");
    assert!(all.iter().sum::<usize>() <= 32 * all.len(), "{all:?}");
}

#[test]
fn who_wants_a_longer_search_is_told_what_that_is_expected_to_gain() {
    let mut tuner = tuner(Policy { trials_per_state: 16, epsilon: 1.0, ..unconfirmed() });
    let prospect_of = |tuner: &Tuner| {
        let prediction = tuner.predict(&[("x".to_owned(), 0.5), ("y".to_owned(), 0.5)].into(), None);
        prediction.expect("an answer").insight.expect("a known state").prospect
    };
    run(&mut tuner, "a", 0.5, 0.5, 16);
    assert_eq!(prospect_of(&tuner), None, "the study's search is over");
    let wishes = SessionPolicy { trials_per_state: Some(64), ..SessionPolicy::default() };
    let asked = Ask { session_policy: wishes, ..ask("b", 0.5, 0.5) };
    let (trial, _) = tuner.suggest(&asked, 1).expect("a trial");
    assert_eq!(trial.mode(), Mode::Explore);
    let prospect = prospect_of(&tuner).expect("the longer search has an outlook");
    assert!(prospect.gain > 0.0, "{prospect:?}");
    // Its wish ends with it: neither the session that ends its search nor a client without wishes hears of
    // one.
    let ends = SessionPolicy { trials_per_state: Some(1), ..wishes };
    let _ = tuner.suggest(&Ask { session_policy: ends, ..ask("b", 0.5, 0.5) }, 2).expect("a trial");
    assert_eq!(prospect_of(&tuner), None);
    let _ = tuner.suggest(&asked, 3).expect("a trial");
    assert!(prospect_of(&tuner).is_some());
    run(&mut tuner, "c", 0.5, 0.5, 1);
    assert_eq!(prospect_of(&tuner), None);
}

#[test]
fn where_much_can_be_gained_it_goes_on() {
    let mut tuner = tuner(Policy { weigh_gain: true, ..Policy::default() });
    let first = explored(&mut tuner, "a", 0.0, 600, cost);
    let second = explored(&mut tuner, "a", 0.9, 600, cost);
    assert!(first >= 8 && second >= 4, "{first} {second}");
}

#[test]
fn what_the_budget_ended_is_confirmed_where_gains_are_weighed() {
    let policy = Policy { confirm_rounds: 10, ..explore_always() };
    let mut tuner = tuner(policy.clone());
    run(&mut tuner, "a", 0.5, 0.5, 30);
    assert!(tuner.standings().is_to_be_confirmed(StateId(1)), "the search is over");
    tuner.set_policy(Policy { weigh_gain: true, ..policy }).expect("valid");
    let trials = run(&mut tuner, "b", 0.5, 0.5, 80);
    let confirms = |trial: &Trial| trial.decision.rule() == Some(Rule::Confirming);
    assert!(trials.iter().any(confirms), "nobody would ever confirm it");
    assert!(!tuner.standings().is_to_be_confirmed(StateId(1)));
    assert_eq!(trials[79].decision.rule(), Some(Rule::Finished));
}

#[test]
fn who_stays_is_not_left_at_what_the_dice_gave_first() {
    let mut tuner = tuner(Policy { epsilon: 0.2, ..Policy::default() });
    run(&mut tuner, "first", 0.5, 0.5, 20);
    for client in 0..12 {
        let explored = explored(&mut tuner, &format!("client {client}"), 0.5, 40, cost);
        if tuner.standings().is_finished(StateId(1)) {
            return;
        }
        assert!(explored > 0, "client {client}");
    }
}

#[test]
fn dice_that_are_thrown_once_stand_as_long_as_a_client_stays() {
    let policy = Policy { dice_once: true, trials_per_state: 100_000, ..unconfirmed() };
    let mut tuner = tuner(Policy { epsilon: 0.2, track_speed: false, ..policy });
    run(&mut tuner, "first", 0.5, 0.5, 20);
    let of_client = |client: usize| explored(&mut tuner, &format!("client {client}"), 0.5, 60, cost);
    let explored: Vec<usize> = (0..40).map(of_client).collect();
    assert!(explored.iter().all(|&frames| frames == 0 || frames == 60), "{explored:?}");
    let explorers = explored.iter().filter(|&&frames| frames > 0).count();
    assert!((2..=18).contains(&explorers), "{explorers} of 40 clients explore where 8 are expected");
}

#[test]
fn the_policy_of_the_paper_runs_no_configuration_twice() {
    let said = PolicySettings::paper().epsilon(1.0).decide().expect("known words");
    let space = spec(Policy::default()).space;
    let mut tuner = tuner(said.check(&space).expect("in range"));
    let trials = run(&mut tuner, "a", 0.5, 0.5, 100);
    let (searched, after) = trials.split_at(80);
    for trial in searched {
        assert_ne!(trial.mode(), Mode::Exploit, "{trial:?}");
    }
    let different: BTreeSet<_> = searched.iter().map(|trial| &trial.configuration).collect();
    assert_eq!(different.len(), 80);
    assert!(after.iter().all(|trial| trial.mode() == Mode::Exploit), "nothing is confirmed");
}

#[test]
fn every_worker_of_an_offline_study_explores_until_the_search_has_ended() {
    let mut without_indicators = spec(Policy { trials_per_state: 30, ..unconfirmed() });
    without_indicators.indicators = IndicatorSchema::default();
    let offline = spec(Policy { offline: true, trials_per_state: 30, ..unconfirmed() });
    for spec in [without_indicators, offline] {
        let has_indicators = !spec.indicators.indicators().is_empty();
        let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
        let mut distinct = BTreeSet::new();
        let mut last = None;
        for frame in 0..48 {
            let client = format!("worker {}", frame % 6);
            let question = match has_indicators {
                true => ask(&client, 0.5, 0.5),
                false => Ask { client_id: client, ..Ask::default() },
            };
            let trial = tuner.suggest(&question, 0).expect("valid").0;
            distinct.insert(trial.configuration.clone());
            let render_ms =
                10.0 + trial.configuration.get("min_leaf_size").and_then(Value::as_number).unwrap_or(0.0);
            let _ = tuner.report(&trial, measured(render_ms), Outcome::Ok, 1).expect("valid");
            last = Some(trial);
        }
        assert!((26..=30).contains(&distinct.len()), "{} distinct", distinct.len());
        assert_ne!(last.map(|trial| trial.mode()), Some(Mode::Explore), "it has ended");
    }
}

#[test]
fn a_state_that_nobody_met_is_answered_with_what_serves_the_others_best() {
    let mut tuner = tuner(explore_always());
    for place in 0..3 {
        run(&mut tuner, "a", 0.3 * f64::from(place), 0.5, 30);
    }
    let asked = ask("z", 0.95, 0.9).indicators;
    let predicted = tuner.predict(&asked, None).expect("valid");
    let answer = tuner.exploiting(&Planned::AtOnce).measured_answer(&[0.95, 0.9], None).asked();
    assert_eq!((answer.reason().source.as_str(), answer.mode()), ("portfolio", Mode::Exploit));
    assert!(!answer.reason().neighbours.is_empty());
    // A client that explores begins with it, and then runs the default.
    let first = suggest(&mut tuner, "b", 0.95, 0.9);
    assert_eq!((&first.configuration, first.reason().step.as_str()), (&answer.configuration, "elsewhere"));
    finish(&mut tuner, &first, Outcome::Ok);
    assert_eq!(suggest(&mut tuner, "b", 0.95, 0.9).mode(), Mode::Default);
    // And it is better there than the default is.
    let at = |configuration: &Configuration| cost_at(configuration, 0.95);
    assert!(at(&answer.configuration) < at(&tuner.spec().space.default_configuration()));
    // A prediction takes its place only where it is better still.
    assert!(at(&predicted.configuration) <= at(&answer.configuration), "{}", predicted.reason().summary);
}

#[test]
fn what_clients_brought_along_serves_the_next_state() {
    let mut tuner = tuner(explore_always());
    let by_hand = |leaf: i64| {
        let mut wanted = tuner.spec().space.default_configuration().to_raw();
        wanted.insert("min_leaf_size".into(), Value::Integer(leaf));
        wanted
    };
    let wanted: Vec<_> = (1..=7).map(by_hand).collect();
    // Four states agree that one configuration is much better than the default: then it is where a fifth
    // begins.
    let best = wanted[4].clone();
    for place in 0..4 {
        for configuration in &wanted {
            let ask = ask("a", 0.2 * f64::from(place), 0.5);
            let trial = tuner.suggest_wanted(&ask, configuration.clone(), None, 0).expect("valid").0;
            let render_ms = if *configuration == best { 6.0 } else { 10.0 };
            let _ = tuner.report(&trial, measured(render_ms), Outcome::Ok, 1).expect("valid");
        }
    }
    let answer = tuner.predict(&ask("z", 0.95, 0.9).indicators, None).expect("valid");
    assert_eq!((answer.reason().source.as_str(), answer.configuration.to_raw()), ("portfolio", best.clone()));
    let first = suggest(&mut tuner, "b", 0.95, 0.9);
    assert_eq!(first.configuration.get("min_leaf_size"), Some(&Value::Integer(5)));
    assert_eq!(
        *tuner.standings().incumbent(StateId(first.state_id)),
        first.configuration,
        "proven elsewhere"
    );
}

#[test]
fn forty_concurrent_questions_get_many_configurations() {
    let mut tuner = tuner(Policy { offline: true, trials_per_state: 80, ..Policy::default() });
    run(&mut tuner, "a", 0.5, 0.5, 16);
    // Only one plans; all others have to be answered at once.
    let mut distinct = BTreeSet::new();
    for worker in 0..40 {
        let ask = ask(&format!("worker {worker}"), 0.5, 0.5);
        let question = tuner.question(&ask).expect("valid");
        let plan = tuner.plan(&question, |_| worker == 0).map(PlanRequest::compute).unwrap_or_default();
        distinct.insert(with_plan(&mut tuner, &ask, plan).configuration);
    }
    assert!(distinct.len() >= 38, "{} of 40", distinct.len());
}

#[test]
fn what_was_taken_back_is_no_trouble_for_what_is_expected() {
    let mut tuner = tuner(explore_always());
    let trials = run(&mut tuner, "a", 0.5, 0.5, 3);
    for trial in &trials {
        tuner
            .knowledge
            .states
            .amend(StateId(trial.state_id), |results| results.restate(&trial.configuration, &[]));
    }
    let results = tuner.knowledge.states.results(StateId(trials[0].state_id));
    assert!(results.tried() < results.searched(), "{} and {}", results.tried(), results.searched());
    let insight = tuner.predict(&ask("a", 0.5, 0.5).indicators, None).expect("valid").insight;
    assert!(insight.is_some());
}
