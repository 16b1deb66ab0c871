//! States, leases and what is refused.

use super::*;

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
        Err(TunerError::Abandoned { number: 1 })
    ));

    assert_eq!(tuner.next_expiry_ms(), Some(60_000));
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
        Err(TunerError::AlreadyCompleted { number: 3 })
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
    // 0.56 leaves the first anchor (0.50) and founds the second; on the way back the second is kept until
    // it no longer matches, and then the first is kept.
    assert_eq!(states, [1, 1, 1, 2, 2, 2, 1, 1]);
    assert_eq!(suggest(&mut tuner, "b", 0.535, 0.5).state_id, 2, "a newcomer gets the nearest");
}

#[test]
fn a_study_without_indicators_has_one_state() {
    let mut spec = spec(explore_always());
    spec.indicators = IndicatorSchema::default();
    let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
    for client in ["a", "b"] {
        let ask = Ask { client_id: client.into(), ..Ask::default() };
        assert_eq!(tuner.suggest(&ask, 0).expect("valid").0.state_id, 1);
    }
}

#[test]
fn malformed_questions_and_reports_change_nothing() {
    let mut tuner = tuner(explore_always());
    for client in ["", "tab\there", &"c".repeat(129)] {
        assert_eq!(tuner.suggest(&ask(client, 0.5, 0.5), 0), Err(TunerError::ClientId));
    }
    let refused = tuner.suggest(&ask("a", f64::NAN, 0.5), 0).expect_err("NaN");
    assert!(refused.to_string().contains("\"x\" is NaN"));
    assert_eq!(tuner.statistics(), Statistics::default());
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
    let before = tuner.open_trial(1).cloned();
    for (measurements, outcome) in bad {
        assert!(tuner.report(&trial, measurements, outcome, 1).is_err());
    }
    assert_eq!(tuner.open_trial(1).cloned(), before);
    let stranger = Trial { number: 99, ..trial };
    assert_eq!(
        tuner.report(&stranger, measured(1.0), Outcome::Ok, 1),
        Err(TunerError::UnknownTrial { number: 99 })
    );
}

#[test]
fn a_client_cannot_hoard_trials() {
    let mut tuner = tuner(exploit_always());
    let limit = crate::limits::OPEN_TRIALS_PER_CLIENT_MAX;
    for index in 0..limit {
        suggest(&mut tuner, "a", index as f64, 0.0);
    }
    let refused = tuner.suggest(&ask("a", limit as f64, 0.0), 0);
    assert!(matches!(refused, Err(TunerError::TooManyOpenTrials { .. })));
    assert_eq!(suggest(&mut tuner, "a", 3.0, 0.0).number, 4, "one that it holds is given again");
    suggest(&mut tuner, "b", limit as f64, 0.0);
}
