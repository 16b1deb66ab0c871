//! States, leases and refusals.

use super::*;
use crate::tuner::replay_tests::Rows;

#[test]
fn a_lost_answer_is_given_again_with_a_fresh_lease() {
    let mut tuner = tuner(explore_always());
    let first = tuner.suggest(&ask("a", 0.5, 0.5), 1_000).expect("valid").0;
    let (again, change) = tuner.suggest(&ask("a", 0.52, 0.5), 5_000).expect("valid");
    assert_eq!(again, Trial { lease_expire_ms: 65_000, ..first.clone() });
    assert_eq!(change.trials, [again]);
    assert!(change.states.is_empty() && change.visits.is_empty());
    assert_eq!(tuner.statistics().open_trials, 1);
}

#[test]
fn a_lost_answer_is_given_again_only_while_its_session_explores() {
    use crate::session::SessionPolicy;
    let ends = SessionPolicy { explore_until_ms: Some(2_000), ..SessionPolicy::default() };
    for (is_by_policy, is_run) in [(true, false), (true, true), (false, false), (false, true)] {
        let mut tuner = tuner(explore_always());
        let asked = Ask {
            session_policy: if is_by_policy { Default::default() } else { ends },
            ..ask("a", 0.5, 0.5)
        };
        for _ in 0..3 {
            let trial = tuner.suggest(&asked, 1_000).expect("valid").0;
            finish(&mut tuner, &trial, Outcome::Ok);
        }
        let held = tuner.suggest(&asked, 1_000).expect("valid").0;
        assert_eq!(held.mode(), Mode::Explore);
        assert_eq!(tuner.suggest(&asked, 1_000).expect("valid").0.number, held.number);
        if is_run {
            assert!(tuner.extend_lease(&held, 1_000).is_ok());
        }
        if is_by_policy {
            tuner.set_policy(exploit_always()).expect("valid");
        }
        let (next, change) = tuner.suggest(&asked.at(2_000), 2_000).expect("valid");
        let is_given_back =
            |trial: &Trial| (trial.number, trial.state) == (held.number, TrialState::Abandoned);
        assert_eq!(change.trials.iter().any(is_given_back), !is_run, "{is_by_policy}");
        assert_eq!((next.number == held.number, next.mode() == Mode::Explore), (is_run, is_run));
    }
}

#[test]
fn points_of_abandoned_and_expired_trials_are_handed_out_again() {
    let mut tuner = tuner(explore_always());
    let first = suggest(&mut tuner, "a", 0.5, 0.5);
    let (given_back, change) = tuner.abandon(&first).expect("open");
    assert_eq!((given_back.state, change.states.len()), (TrialState::Abandoned, 1));
    assert_eq!(tuner.abandon(&given_back).expect("idempotent").0, given_back);
    let second = suggest(&mut tuner, "b", 0.5, 0.5);
    assert_eq!((second.number, &second.configuration), (2, &first.configuration));
    assert!(matches!(
        tuner.report(&given_back, measured(1.0), Outcome::Ok, 1),
        Err(TunerError::Abandoned(1))
    ));

    assert_eq!(tuner.clients.next_expiry_ms(), Some(60_000));
    assert!(tuner.expire(60_000).is_empty(), "the last millisecond still counts");
    let change = tuner.expire(60_001);
    assert_eq!(change.trials.len(), 1);
    let expired = change.trials[0].clone();
    assert_eq!((expired.state, change.states.len()), (TrialState::Expired, 1));
    let third = suggest(&mut tuner, "c", 0.5, 0.5);
    assert_eq!(third.configuration, first.configuration);
    // The late report counts, and the third need not be repeated for it.
    let late = tuner.report(&expired, measured(9.0), Outcome::Ok, 70_000).expect("late").0;
    assert!(late.late && late.state == TrialState::Completed);
    assert!(matches!(tuner.extend_lease(&late, 1), Err(TunerError::NotOpen { .. })));
    let extended = tuner.extend_lease(&third, 100_000).expect("open").0;
    assert_eq!(extended.lease_expire_ms, 160_000);
    let reported = finish(&mut tuner, &third, Outcome::Ok);
    assert!(!reported.late);
    assert!(matches!(
        tuner.report(&reported, measured(9.0), Outcome::Ok, 1),
        Err(TunerError::AlreadyCompleted(3))
    ));
    let counts = tuner.statistics();
    assert_eq!((counts.trials, counts.completed_trials, counts.open_trials), (3, 2, 0));
}

#[test]
fn a_drifting_client_keeps_its_state_while_the_anchor_matches() {
    let mut tuner = tuner(explore_always());
    let states: Vec<u64> = [0.50, 0.53, 0.545, 0.56, 0.54, 0.52, 0.505, 0.53]
        .iter()
        .map(|&x| suggest(&mut tuner, "a", x, 0.5).state_id)
        .collect();
    // 0.56 leaves the first anchor (0.50) and founds the second. On the way back the second is kept until it
    // no longer matches. Then the first is kept.
    assert_eq!(states, [1, 1, 1, 2, 2, 2, 1, 1]);
    assert_eq!(suggest(&mut tuner, "b", 0.535, 0.5).state_id, 2, "a newcomer gets the nearest");
}

#[test]
fn malformed_questions_and_reports_change_nothing() {
    let mut tuner = tuner(explore_always());
    for client in ["", "tab\there", &"c".repeat(129)] {
        assert_eq!(tuner.suggest(&ask(client, 0.5, 0.5), 0), Err(TunerError::ClientId));
    }
    let refused = tuner.suggest(&ask("a", f64::NAN, 0.5), 0).expect_err("NaN");
    assert!(refused.to_string().contains("\"x\" is NaN"));
    assert_eq!(tuner.statistics(), StudyCounts::default());
    let trial = suggest(&mut tuner, "a", 0.5, 0.5);
    let long = "r".repeat(1001);
    let bad: [(BTreeMap<String, f64>, Outcome); 7] = [
        (BTreeMap::new(), Outcome::Ok),
        (measured(f64::INFINITY), Outcome::Ok),
        (measured(-1.0), Outcome::Ok),
        (BTreeMap::from([("Bad".to_owned(), 1.0)]), infeasible()),
        (measured(1.0), Outcome::Aborted { lower_bound: f64::NAN }),
        (measured(1.0), Outcome::Failed { reason: long }),
        ((0..65).map(|i| (format!("m{i}"), 1.0)).collect(), infeasible()),
    ];
    let before = tuner.clients.open_trial(1).cloned();
    for (measurements, outcome) in bad {
        assert!(tuner.report(&trial, measurements, outcome, 1).is_err());
    }
    for (name, error) in [("render_ms", -0.1), ("render_ms", f64::NAN), ("build_ms", 0.1)] {
        let errors = BTreeMap::from([(name.to_owned(), error)]);
        assert!(tuner.report_estimates(&trial, measured(1.0), errors, Outcome::Ok, 1).is_err());
    }
    assert_eq!(tuner.clients.open_trial(1).cloned(), before);
    let stranger = Trial { number: 99, ..trial };
    assert_eq!(tuner.report(&stranger, measured(1.0), Outcome::Ok, 1), Err(TunerError::UnknownTrial(99)));
}

#[test]
fn a_client_cannot_hoard_trials() {
    let mut tuner = tuner(exploit_always());
    let limit = crate::limits::OPEN_TRIALS_PER_CLIENT_MAX;
    for index in 0..limit {
        suggest(&mut tuner, "a", index as f64, 0.0);
    }
    let refused = tuner.suggest(&ask("a", limit as f64, 0.0), 0);
    assert!(matches!(refused, Err(TunerError::TooManyOpenTrials(_))));
    assert_eq!(suggest(&mut tuner, "a", 3.0, 0.0).number, 4, "one that it holds is given again");
    suggest(&mut tuner, "b", limit as f64, 0.0);
}

/// A client is handed a trial, shows that it lives, and never comes back.
fn crash(tuner: &mut Tuner, client: &str, now_ms: &mut i64) -> (Trial, Change) {
    let trial = tuner.suggest(&ask(client, 0.5, 0.5), *now_ms).expect("valid").0;
    assert!(tuner.extend_lease(&trial, *now_ms).is_ok());
    *now_ms += 60_001;
    (trial, tuner.expire(*now_ms))
}

#[test]
fn the_silence_of_a_client_that_never_showed_that_it_lives_outlaws_nothing() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 3);
    let mut now_ms = 1_000;
    let first = tuner.suggest(&ask("shell", 0.5, 0.5), now_ms).expect("valid").0;
    for interrupted in 0..6 {
        now_ms += 60_001;
        let change = tuner.expire(now_ms);
        assert!(change.trials.iter().all(|trial| trial.state == TrialState::Expired), "{interrupted}");
        let again = tuner.suggest(&ask("shell", 0.5, 0.5), now_ms).expect("valid").0;
        assert_eq!(again.configuration, first.configuration, "it is still worth a try");
    }
    // A session alone is no sign of life, and who gives a trial back has said goodbye.
    let session = Ask { session: 7, ..ask("program", 0.5, 0.5) };
    for (lives, is_lost) in [(false, true), (false, true), (true, false), (false, true), (true, true)] {
        let trial = tuner.suggest(&session, now_ms).expect("valid").0;
        let before = tuner.searches.lost(StateId(1), &trial.configuration);
        if lives {
            assert!(tuner.extend_lease(&trial, now_ms).is_ok());
        }
        let _ = if is_lost { tuner.expire(now_ms + 60_001) } else { tuner.abandon(&trial).expect("open").1 };
        now_ms += 60_001;
        let count = tuner.searches.lost(StateId(1), &trial.configuration);
        assert_eq!(count, before + u32::from(lives && is_lost), "{lives}, {is_lost}");
        assert!(!tuner.knowledge.states.results(StateId(1)).is_infeasible(&trial.configuration));
    }
}

#[test]
fn a_crash_after_a_success_is_a_failure_and_many_are_not() {
    let mut tuner = tuner(Policy { epsilon: 1.0, trials_per_state: 30, ..Policy::default() });
    let state = StateId(1);
    let trials = run(&mut tuner, "a", 0.5, 0.5, 12);
    let best = trials.iter().min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("some").configuration.clone();
    let wanted = |tuner: &mut Tuner, outcome: Outcome| {
        let trial = tuner.suggest_wanted(&ask("w", 0.5, 0.5), best.to_raw(), None, 0).expect("valid").0;
        finish(tuner, &trial, outcome);
    };
    wanted(&mut tuner, Outcome::Ok);
    wanted(&mut tuner, infeasible());
    wanted(&mut tuner, infeasible());
    assert!(!tuner.knowledge.states.results(state).is_infeasible(&best), "it ran twice");
    assert_eq!(tuner.best(None, None).expect("valid").expect("measured").configuration, best);
    wanted(&mut tuner, infeasible());
    assert!(tuner.knowledge.states.results(state).is_infeasible(&best), "it crashes more often than it runs");
    wanted(&mut tuner, Outcome::Ok);
    wanted(&mut tuner, Outcome::Ok);
    assert!(
        !tuner.knowledge.states.results(state).is_infeasible(&best),
        "it runs more often than it crashes"
    );
}

#[test]
fn a_crash_counts_once_no_measurement_is_left() {
    let mut tuner = tuner(explore_always());
    let (state, configuration) = (StateId(1), run(&mut tuner, "a", 0.5, 0.5, 2)[1].configuration.clone());
    let wanted = |tuner: &mut Tuner, outcome: Outcome| {
        let trial =
            tuner.suggest_wanted(&ask("w", 0.5, 0.5), configuration.to_raw(), None, 0).expect("valid").0;
        finish(tuner, &trial, outcome);
        tuner.knowledge.states.results(state).is_infeasible(&configuration)
    };
    assert!(!wanted(&mut tuner, infeasible()), "it ran once");
    tuner.knowledge.states.amend(state, |results| results.restate(&configuration, &[]));
    assert!(
        tuner.knowledge.states.results(state).is_infeasible(&configuration),
        "it never ran, as far as is believed"
    );
    assert_eq!(tuner.knowledge.states.results(state).tried(), 2);
    assert!(!wanted(&mut tuner, Outcome::Ok), "it runs again");
}

#[test]
fn a_configuration_whose_lease_is_lost_twice_counts_as_infeasible_and_says_why() {
    for search in [SearchMethod::Auto, SearchMethod::NelderMead] {
        let mut tuner = tuner(Policy { search, ..explore_always() });
        run(&mut tuner, "a", 0.5, 0.5, 3);
        let mut now_ms = 1_000;
        let (first, change) = crash(&mut tuner, "a", &mut now_ms);
        assert_eq!(change.trials[0].state, TrialState::Expired);
        let (second, change) = crash(&mut tuner, "b", &mut now_ms);
        assert_eq!(second.configuration, first.configuration, "one lost lease is no proof");
        assert_eq!((first.decision.lost_leases, second.decision.lost_leases), (0, 1));
        assert!(second.reason().summary.contains("A lease of it was lost"), "{}", second.reason().summary);
        let given_up = &change.trials[0];
        assert_eq!(given_up.state, TrialState::Completed);
        let Some(Outcome::Infeasible { reason }) = &given_up.outcome else {
            panic!("{:?}", given_up.outcome)
        };
        assert!(reason.contains("2 leases"), "{reason}");
        let real = tuner.report(given_up, measured(5.0), Outcome::Ok, now_ms);
        assert_eq!(real, Err(TunerError::GivenUp(second.number)), "nobody takes it for stored");
        assert_eq!(change.states.len(), 1, "the search heard of it");
        let results = tuner.knowledge.states.results(StateId(1));
        assert!(results.is_infeasible(&first.configuration));
        for _ in 0..6 {
            let (trial, _) = crash(&mut tuner, "c", &mut now_ms);
            assert_ne!(trial.configuration, first.configuration);
        }
        // In another state it may work.
        assert!(!tuner.knowledge.states.contains(StateId(2)));
    }
}

#[test]
fn what_was_measured_once_is_not_given_up_for_lost_leases() {
    let mut tuner = tuner(exploit_always());
    run(&mut tuner, "a", 0.5, 0.5, 1);
    let mut now_ms = 1_000;
    for _ in 0..4 {
        let (trial, change) = crash(&mut tuner, "a", &mut now_ms);
        assert_eq!(trial.configuration, tuner.spec().space.default_configuration());
        assert_eq!((change.trials[0].state, trial.decision.lost_leases), (TrialState::Expired, 0));
    }
}

#[test]
fn the_default_is_not_given_up_for_lost_leases() {
    let mut tuner = tuner(Policy { regret_budget: Some(0.05), ..explore_always() });
    let mut now_ms = 1_000;
    for client in ["a", "b", "c", "d"] {
        let (trial, change) = crash(&mut tuner, client, &mut now_ms);
        assert_eq!(trial.configuration, tuner.spec().space.default_configuration());
        assert_eq!(change.trials[0].state, TrialState::Expired);
    }
}

#[test]
fn leases_that_ended_while_nobody_was_there_do_not_count_as_lost() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 2);
    let mut now_ms = 1_000;
    for client in ["a", "b", "c"] {
        let ends_ms = now_ms + 60_000;
        tuner.clients.pardon_leases(ends_ms);
        tuner.clients.pardon_leases(0);
        let (trial, change) = crash(&mut tuner, client, &mut now_ms);
        assert_eq!(change.trials[0].state, TrialState::Expired);
        assert_eq!(tuner.searches.lost(StateId(1), &trial.configuration), 0);
    }
    // One that ended later does.
    tuner.clients.pardon_leases(now_ms + 59_999);
    let (first, _) = crash(&mut tuner, "a", &mut now_ms);
    assert_eq!(tuner.searches.lost(StateId(1), &first.configuration), 1);
}

#[test]
fn a_report_forgives_a_lost_lease() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 2);
    let mut now_ms = 1_000;
    let (first, change) = crash(&mut tuner, "a", &mut now_ms);
    let expired = change.trials[0].clone();
    let _change = tuner.report(&expired, measured(5.0), Outcome::Ok, now_ms).expect("late");
    assert_eq!(tuner.searches.lost(StateId(1), &first.configuration), 0);
}

#[test]
fn a_client_that_was_started_anew_has_lost_its_lease() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 2);
    let session = |tuner: &mut Tuner, session: u64| {
        tuner.suggest(&Ask { session, ..ask("a", 0.5, 0.5) }, 10).expect("valid")
    };
    let (first, _) = session(&mut tuner, 7);
    let (again, _) = session(&mut tuner, 7);
    assert_eq!((again.number, again.decision.lost_leases), (first.number, 0), "its answer was lost");
    assert!(tuner.extend_lease(&first, 10).is_ok(), "it runs it");
    let (restarted, change) = session(&mut tuner, 8);
    assert_eq!((restarted.number, restarted.decision.lost_leases), (first.number, 1));
    assert_eq!(change.states.len(), 1, "a restart of the daemon does not forget it");
    let (other, change) = session(&mut tuner, 9);
    assert_ne!(other.configuration, first.configuration);
    let own = |change: &Change| change.trials.iter().find(|trial| trial.number == first.number).cloned();
    let aside = own(&change).expect("it changed");
    assert!(aside.state == TrialState::Open && aside.decision.put_aside, "{aside:?}");
    let given_up = own(&tuner.expire(60_011)).expect("its lease has ended");
    assert!(matches!(given_up.outcome, Some(Outcome::Infeasible { .. })), "{given_up:?}");
}

#[test]
fn two_programs_that_share_a_client_id_outlaw_nothing() {
    for lives in [false, true] {
        let mut tuner = tuner(explore_always());
        run(&mut tuner, "a", 0.5, 0.5, 2);
        let begin = |tuner: &mut Tuner, session: u64| {
            tuner.suggest(&Ask { session, ..ask("a", 0.5, 0.5) }, 10).expect("valid").0
        };
        let first = begin(&mut tuner, 7);
        assert!(!lives || tuner.extend_lease(&first, 10).is_ok());
        for session in [8, 7, 8, 7, 8, 7, 8] {
            assert_eq!(begin(&mut tuner, session).number, first.number, "session {session}");
        }
        assert_eq!(tuner.searches.lost(StateId(1), &first.configuration), 0, "{lives}");
        let held = tuner.clients.open_trial(first.number).expect("it is open");
        assert_eq!((held.decision.lost_leases, held.decision.put_aside), (0, false));
        let change = tuner.expire(60_011);
        assert_eq!(change.trials[0].state, TrialState::Expired);
        assert_eq!(tuner.searches.lost(StateId(1), &first.configuration), 0, "one was silent");
    }
}

#[test]
fn what_many_programs_of_a_client_id_left_behind_is_infeasible_unless_one_reports_it() {
    let begin = |tuner: &mut Tuner, rows: &mut Rows, session: u64| {
        let asked = Ask { session, ..ask("farm", 0.5, 0.5) };
        let (trial, change) = tuner.suggest(&asked, 10).expect("valid");
        rows.write(&change);
        trial
    };
    let report = |tuner: &mut Tuner, rows: &mut Rows, trial: &Trial| {
        let reported = tuner.report(trial, measured(cost(trial)), Outcome::Ok, 20).expect("it is open");
        rows.write(&reported.1);
    };
    for is_reported in [true, false] {
        let (mut tuner, mut rows) = (tuner(explore_always()), Rows::default());
        for _ in 0..2 {
            let trial = begin(&mut tuner, &mut rows, 1);
            report(&mut tuner, &mut rows, &trial);
        }
        let trials: Vec<Trial> = (1..=5).map(|session| begin(&mut tuner, &mut rows, session)).collect();
        let (first, state) = (&trials[0], StateId(1));
        let further: Vec<u64> = trials.iter().map(|trial| trial.number - first.number).collect();
        assert_eq!(further, [0, 0, 0, 1, 1], "three may have crashed");
        assert_ne!(trials[3].configuration, first.configuration);
        // A daemon that starts again knows both.
        let mut tuner = rows.restore(&tuner, None);
        let aside = tuner.clients.open_trial(first.number).expect("it is open");
        assert!(aside.decision.put_aside && aside.decision.earlier_sessions == [1, 2], "{aside:?}");
        assert!(!tuner.knowledge.states.results(state).is_infeasible(&first.configuration));
        assert_eq!(begin(&mut tuner, &mut rows, 5), trials[4]);
        if is_reported {
            report(&mut tuner, &mut rows, first);
            assert_eq!(tuner.searches.lost(state, &first.configuration), 0);
            assert!(tuner.knowledge.states.results(state).ran(&first.configuration).is_some());
        }
        let change = tuner.expire(60_011);
        let ended = change.trials.iter().find(|trial| trial.number == first.number);
        let is_given_up = ended.is_some_and(gave_up);
        assert_eq!(is_given_up, !is_reported, "{ended:?}");
        let is_infeasible = tuner.knowledge.states.results(state).is_infeasible(&first.configuration);
        assert_eq!(is_infeasible, !is_reported);
    }
}

#[test]
fn what_is_put_aside_and_reported_to_fail_was_not_given_up() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 2);
    let trials = [1, 2, 3, 4]
        .map(|session| tuner.suggest(&Ask { session, ..ask("a", 0.5, 0.5) }, 10).expect("valid").0);
    assert_ne!(trials[3].number, trials[0].number);
    let fails = |tuner: &mut Tuner, trial: &Trial| tuner.report(trial, BTreeMap::new(), infeasible(), 20);
    let failed = fails(&mut tuner, &trials[0]).expect("it is open").0;
    assert!(!gave_up(&failed), "{failed:?}");
    assert_eq!(fails(&mut tuner, &failed), Err(TunerError::AlreadyCompleted(failed.number)));
}

#[test]
fn a_program_that_is_interrupted_twice_outlaws_nothing_and_a_crash_goes_on_for_few_starts() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 2);
    let begin = |tuner: &mut Tuner, session: u64| {
        tuner.suggest(&Ask { session, ..ask("a", 0.5, 0.5) }, 10).expect("valid").0
    };
    let first = begin(&mut tuner, 1);
    let lost: Vec<u32> = [2, 3]
        .map(|session| begin(&mut tuner, session))
        .iter()
        .map(|again| {
            assert_eq!(again.number, first.number, "who was interrupted gets it again");
            again.decision.lost_leases
        })
        .collect();
    assert_eq!(lost, [0, 1], "the first says nothing");
    assert!(!tuner.knowledge.states.results(StateId(1)).is_infeasible(&first.configuration));
    let other = begin(&mut tuner, 4);
    assert_ne!(other.configuration, first.configuration, "three programs did not come back from it");
    let is_infeasible =
        |tuner: &Tuner| tuner.knowledge.states.results(StateId(1)).is_infeasible(&first.configuration);
    assert!(!is_infeasible(&tuner), "each of them may live");
    assert!(!tuner.expire(60_011).trials.is_empty());
    assert!(is_infeasible(&tuner));
}

#[test]
fn an_answer_that_was_never_measured_is_not_given_to_crash_after_crash() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 8);
    tuner.set_policy(exploit_always()).expect("valid");
    let begin = |tuner: &mut Tuner, session: u64| {
        tuner.suggest(&Ask { session, ..ask("b", 0.6, 0.5) }, 10).expect("valid").0
    };
    let first = begin(&mut tuner, 1);
    assert_ne!(first.configuration, tuner.spec().space.default_configuration());
    (2..4).for_each(|session| assert_eq!(begin(&mut tuner, session).number, first.number));
    assert_ne!(begin(&mut tuner, 4).configuration, first.configuration);
    assert!(tuner.knowledge.states.results(StateId(2)).is_infeasible(&first.configuration));
}

#[test]
fn a_program_that_crashes_at_once_and_is_started_after_its_lease_gets_on_as_well() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 2);
    let mut now_ms = 1_000;
    let mut crash = |tuner: &mut Tuner, session: u64| {
        let ask = Ask { session, ..ask("a", 0.5, 0.5) };
        let trial = tuner.suggest(&ask, now_ms).expect("valid").0;
        now_ms += 60_001;
        (trial, tuner.expire(now_ms))
    };
    let (first, _) = crash(&mut tuner, 1);
    // A configuration that cannot be run has no count.
    for (session, lost) in [(2, 1), (3, 0)] {
        let (again, change) = crash(&mut tuner, session);
        assert_eq!(again.configuration, first.configuration, "session {session} begins with it again");
        assert_eq!(tuner.searches.lost(StateId(1), &first.configuration), lost);
        assert_eq!(change.states.len(), 1, "a restart of the daemon does not forget it");
    }
    assert!(tuner.knowledge.states.results(StateId(1)).is_infeasible(&first.configuration));
    assert_ne!(crash(&mut tuner, 4).0.configuration, first.configuration);
}

#[test]
fn what_clients_want_themselves_does_not_eat_the_budget_of_the_search() {
    let mut tuner = tuner(Policy { search: SearchMethod::Random, ..explore_always() });
    let space = tuner.spec().space.clone();
    for number in 0..29 {
        let mut x = space.encode(&space.default_configuration());
        x[3] = f64::from(number) / 30.0;
        let wanted = space.decode(&x).to_raw();
        let trial = tuner.suggest_wanted(&ask("a", 0.5, 0.5), wanted, None, 0).expect("valid").0;
        finish(&mut tuner, &trial, Outcome::Ok);
    }
    let explored = run(&mut tuner, "a", 0.5, 0.5, 40);
    let explored = explored.iter().filter(|trial| trial.decision.search_step().is_some()).count();
    // One of them was the default, which the search need not measure again.
    assert!((29..=30).contains(&explored), "{explored} trials of thirty");
}

#[test]
fn a_search_that_has_spent_its_budget_on_repeats_is_finished() {
    let mut tuner = tuner(Policy { search: SearchMethod::Auto, ..explore_always() });
    for _ in 0..200 {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        finish(&mut tuner, &trial, Outcome::Ok);
        let own = tuner.searches.of(StateId(1)).expect("explored");
        let spent = crate::tuner::exploring::is_spent(
            own,
            tuner.knowledge.states.results(StateId(1)),
            &tuner.spec().policy,
            30,
        );
        assert_eq!(tuner.standings().is_finished(StateId(1)), spent);
    }
    assert!(tuner.standings().is_finished(StateId(1)));
}
