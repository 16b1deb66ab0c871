//! What the state machine promises its clients, one promise a test.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::*;
use crate::configuration::Configuration;
use crate::indicator::{Indicator, IndicatorSchema};
use crate::objective::{Objective, ObjectiveTerm};
use crate::policy::{Policy, PredictorMethod, SearchMethod};
use crate::space::{Constraint, Domain, Parameter, Scale, Space};
use crate::study::StudySpec;
use crate::trial::{Mode, Outcome, Trial, TrialState};
use crate::value::Value;

fn parameter(name: &str, domain: Domain, default: Value) -> Parameter {
    Parameter {
        name: name.into(),
        domain,
        default,
        active_if: None,
    }
}

/// A study with four parameters (1280 configurations and a float) and two indicators.
pub(super) fn spec(policy: Policy) -> StudySpec {
    let leaf = || Domain::Integer {
        min: 1,
        max: 16,
        scale: Scale::Linear,
    };
    let widths = Domain::Categorical {
        values: [2, 4, 8].map(Value::Integer).to_vec(),
    };
    let cost = Domain::Float {
        min: 0.0,
        max: 10.0,
        scale: Scale::Linear,
    };
    let space = Space::new(
        vec![
            parameter("width", widths, Value::Integer(2)),
            parameter("min_leaf_size", leaf(), Value::Integer(1)),
            parameter("max_leaf_size", leaf(), Value::Integer(16)),
            parameter("travel_cost", cost, Value::Float(1.0)),
        ],
        vec![Constraint {
            lesser: "min_leaf_size".into(),
            greater: "max_leaf_size".into(),
        }],
    );
    spec_of(space.expect("a valid space"), policy)
}

pub(super) fn spec_of(space: Space, policy: Policy) -> StudySpec {
    let indicator = |name: &str| Indicator {
        name: name.into(),
        min: 0.0,
        max: 1.0,
        scale: Scale::Linear,
    };
    let terms = vec![ObjectiveTerm {
        metric: "render_ms".into(),
        weight: 1.0,
    }];
    StudySpec {
        display_name: "test".into(),
        space,
        indicators: IndicatorSchema::new(vec![indicator("x"), indicator("y")]).expect("valid"),
        objective: Objective::new(terms).expect("valid"),
        state_tolerance: 0.05,
        policy,
        seed: 42,
    }
}

fn tuner(policy: Policy) -> Tuner {
    Tuner::new(Arc::new(spec(policy))).expect("a valid specification")
}

pub(super) fn ask(client: &str, x: f64, y: f64) -> Ask {
    let indicators = BTreeMap::from([("x".to_owned(), x), ("y".to_owned(), y)]);
    Ask {
        client_id: client.into(),
        indicators,
        fingerprint: None,
    }
}

pub(super) fn measured(render_ms: f64) -> BTreeMap<String, f64> {
    BTreeMap::from([("render_ms".to_owned(), render_ms)])
}

/// A cost that wants wide nodes, small leaves and a travel cost that follows `x`.
pub(super) fn cost(trial: &Trial) -> f64 {
    let number = |name: &str| {
        trial
            .configuration
            .get(name)
            .and_then(Value::as_number)
            .unwrap_or(0.0)
    };
    20.0 - number("width")
        + number("max_leaf_size") * 0.5
        + number("min_leaf_size") * 0.25
        + (number("travel_cost") - 10.0 * trial.indicators["x"]).abs()
}

fn suggest(tuner: &mut Tuner, client: &str, x: f64, y: f64) -> Trial {
    tuner
        .suggest(&ask(client, x, y), 0)
        .expect("a valid question")
        .0
}

fn finish(tuner: &mut Tuner, trial: &Trial, outcome: Outcome) -> Trial {
    tuner
        .report(trial, measured(cost(trial)), outcome, 1)
        .expect("a valid report")
        .0
}

fn infeasible() -> Outcome {
    Outcome::Infeasible {
        reason: "depth limit reached".into(),
    }
}

fn run(tuner: &mut Tuner, client: &str, x: f64, y: f64, trials: usize) -> Vec<Trial> {
    let one = |_| {
        let trial = suggest(tuner, client, x, y);
        finish(tuner, &trial, Outcome::Ok)
    };
    (0..trials).map(one).collect()
}

fn explore_always() -> Policy {
    Policy {
        epsilon: 1.0,
        trials_per_state: 30,
        ..Policy::default()
    }
}

fn exploit_always() -> Policy {
    Policy {
        epsilon: 0.0,
        ..explore_always()
    }
}

#[test]
fn exploring_begins_with_the_default_and_never_samples_a_pair_twice() {
    for search in [
        SearchMethod::NelderMead,
        SearchMethod::LatinHypercube,
        SearchMethod::Random,
    ] {
        let mut tuner = tuner(Policy {
            search,
            ..explore_always()
        });
        let trials = run(&mut tuner, "a", 0.5, 0.5, 30);
        assert_eq!(trials[0].mode, Mode::Default);
        assert_eq!(
            trials[0].configuration,
            tuner.spec().space.default_configuration()
        );
        assert!(trials[1..].iter().all(|trial| trial.mode == Mode::Explore));
        let distinct: BTreeSet<&Configuration> =
            trials.iter().map(|trial| &trial.configuration).collect();
        assert_eq!(distinct.len(), 30, "{search:?}");
        // The budget is spent: the best known is exploited from now on.
        let best = trials
            .iter()
            .min_by(|a, b| a.cost.partial_cmp(&b.cost).expect("finite"))
            .expect("some");
        let next = suggest(&mut tuner, "a", 0.5, 0.5);
        assert_eq!(
            (next.mode, &next.configuration),
            (Mode::Exploit, &best.configuration)
        );
        assert_eq!(next.predicted_cost, best.cost);
    }
}

#[test]
fn replicates_measure_each_configuration_as_often_as_asked() {
    let mut tuner = tuner(Policy {
        replicates: 3,
        trials_per_state: 10,
        ..explore_always()
    });
    let trials = run(&mut tuner, "a", 0.5, 0.5, 30);
    let mut counts = BTreeMap::new();
    for trial in &trials {
        *counts.entry(&trial.configuration).or_insert(0) += 1;
    }
    assert_eq!(counts.len(), 10);
    assert!(counts.values().all(|&count| count == 3));
    assert_eq!(
        tuner
            .best(None)
            .expect("valid")
            .expect("measured")
            .measurements,
        3
    );
}

#[test]
fn an_exploited_configuration_is_kept_until_the_state_changes() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.2, 0.2, 30);
    run(&mut tuner, "a", 0.8, 0.8, 30);
    tuner.set_policy(exploit_always()).expect("valid");
    let near_first = run(&mut tuner, "b", 0.3, 0.3, 5);
    let near_second = run(&mut tuner, "b", 0.7, 0.7, 5);
    for (trials, state) in [(&near_first, 1), (&near_second, 2)] {
        assert!(trials.iter().all(|trial| trial.mode == Mode::Exploit));
        assert!(
            trials
                .iter()
                .all(|trial| trial.configuration == trials[0].configuration)
        );
        let neighbours: Vec<u64> = trials[0]
            .reason
            .neighbours
            .iter()
            .map(|n| n.state_id)
            .collect();
        assert_eq!(
            neighbours[0], state,
            "the nearest explored state comes first"
        );
        assert_eq!(trials[0].reason.source, "nearest_neighbour");
    }
    assert_ne!(near_first[0].configuration, near_second[0].configuration);
}

#[test]
fn nothing_known_and_no_exploring_leaves_the_default() {
    let mut tuner = tuner(exploit_always());
    let trials = run(&mut tuner, "a", 0.5, 0.5, 3);
    assert!(
        trials
            .iter()
            .all(|trial| trial.mode == Mode::Default && trial.reason.source == "default")
    );
    // The default was measured, so another client may rely on it.
    assert_eq!(suggest(&mut tuner, "b", 0.9, 0.5).mode, Mode::Exploit);
}

#[test]
fn nothing_known_is_explored_whatever_the_dice_say() {
    let mut tuner = tuner(Policy {
        epsilon: 1e-12,
        ..explore_always()
    });
    let trials = run(&mut tuner, "a", 0.5, 0.5, 3);
    assert_eq!(
        trials.iter().map(|trial| trial.mode).collect::<Vec<_>>(),
        [Mode::Default, Mode::Explore, Mode::Explore]
    );
}

#[test]
fn the_share_of_explored_visits_is_epsilon() {
    let mut tuner = tuner(Policy {
        epsilon: 0.3,
        trials_per_state: 100_000,
        ..Policy::default()
    });
    run(&mut tuner, "a", 0.05, 0.05, 2);
    let mut explored = 0;
    for index in 0..1000 {
        // Two states by turns: every suggestion begins a visit.
        let trial = suggest(
            &mut tuner,
            "b",
            if index % 2 == 0 { 0.05 } else { 0.9 },
            0.05,
        );
        explored += usize::from(tuner.visits["b"].decision == Decision::Explore);
        finish(&mut tuner, &trial, Outcome::Ok);
    }
    // Five standard deviations are 72.
    assert!((228..=372).contains(&explored), "{explored} of 1000");
}

#[test]
fn a_lost_answer_is_given_again_with_a_fresh_lease() {
    let mut tuner = tuner(explore_always());
    let first = tuner.suggest(&ask("a", 0.5, 0.5), 1_000).expect("valid").0;
    let (again, change) = tuner.suggest(&ask("a", 0.52, 0.5), 5_000).expect("valid");
    assert_eq!(
        again,
        Trial {
            lease_expire_ms: 65_000,
            ..first.clone()
        }
    );
    assert_eq!(change.trials, [again]);
    assert!(change.states.is_empty() && change.visits.is_empty());
    assert_eq!(tuner.statistics().open_trials, 1);
}

#[test]
fn clients_share_a_search_without_sharing_a_point_and_nobody_waits() {
    let mut tuner = tuner(explore_always());
    let mut seen = BTreeSet::new();
    for round in 0..40 {
        let trials: Vec<Trial> = (0..5)
            .map(|c| suggest(&mut tuner, &format!("c{c}"), 0.5, 0.5))
            .collect();
        for trial in &trials {
            let explores = matches!(trial.mode, Mode::Explore | Mode::Default);
            if explores && trial.reason.source != "default" {
                assert!(
                    seen.insert(trial.configuration.clone()),
                    "round {round} hands out a pair twice"
                );
            } else {
                assert_eq!(trial.mode, Mode::Exploit);
            }
        }
        for trial in trials {
            finish(&mut tuner, &trial, Outcome::Ok);
        }
    }
    assert_eq!(seen.len(), 30);
}

#[test]
fn points_of_abandoned_and_expired_trials_are_handed_out_again() {
    let mut tuner = tuner(explore_always());
    let first = suggest(&mut tuner, "a", 0.5, 0.5);
    let (given_back, change) = tuner.abandon(&first).expect("open");
    assert_eq!(
        (given_back.state, change.states.len()),
        (TrialState::Abandoned, 1)
    );
    assert_eq!(
        tuner.abandon(&given_back).expect("idempotent").0,
        given_back
    );
    let second = suggest(&mut tuner, "b", 0.5, 0.5);
    assert_eq!(
        (second.number, &second.configuration),
        (2, &first.configuration)
    );
    assert!(matches!(
        tuner.report(&given_back, measured(1.0), Outcome::Ok, 1),
        Err(TunerError::Abandoned { number: 1 })
    ));

    assert_eq!(tuner.next_expiry_ms(), Some(60_000));
    assert!(
        tuner.expire(60_000).is_empty(),
        "the last millisecond still counts"
    );
    let change = tuner.expire(60_001);
    assert_eq!(change.trials.len(), 1);
    let expired = change.trials[0].clone();
    assert_eq!(
        (expired.state, change.states.len()),
        (TrialState::Expired, 1)
    );
    let third = suggest(&mut tuner, "c", 0.5, 0.5);
    assert_eq!(third.configuration, first.configuration);
    // The late report counts, and the third need not be repeated for it.
    let late = tuner
        .report(&expired, measured(9.0), Outcome::Ok, 70_000)
        .expect("late")
        .0;
    assert!(late.late && late.state == TrialState::Completed);
    assert!(matches!(
        tuner.extend_lease(&late, 1),
        Err(TunerError::NotOpen { .. })
    ));
    let extended = tuner.extend_lease(&third, 100_000).expect("open").0;
    assert_eq!(extended.lease_expire_ms, 160_000);
    let reported = finish(&mut tuner, &third, Outcome::Ok);
    assert!(!reported.late);
    assert!(matches!(
        tuner.report(&reported, measured(9.0), Outcome::Ok, 1),
        Err(TunerError::AlreadyCompleted { number: 3 })
    ));
    let counts = tuner.statistics();
    assert_eq!(
        (counts.trials, counts.completed_trials, counts.open_trials),
        (3, 2, 0)
    );
}

#[test]
fn infeasible_configurations_are_never_exploited() {
    let mut tuner = tuner(explore_always());
    run(&mut tuner, "a", 0.5, 0.5, 30);
    tuner.set_policy(exploit_always()).expect("valid");
    let kept = suggest(&mut tuner, "b", 0.7, 0.5);
    finish(&mut tuner, &kept, infeasible());
    let other = suggest(&mut tuner, "b", 0.7, 0.5);
    assert_eq!(other.mode, Mode::Exploit);
    assert_ne!(other.configuration, kept.configuration);
    // A fresh state may still try it.
    assert_eq!(
        suggest(&mut tuner, "c", 0.3, 0.5).configuration,
        kept.configuration
    );
}

#[test]
fn an_infeasible_default_is_explored_away_from_even_without_dice() {
    let mut tuner = tuner(exploit_always());
    let first = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_eq!(first.mode, Mode::Default);
    finish(&mut tuner, &first, infeasible());
    let second = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_eq!(second.mode, Mode::Explore);
    assert_ne!(second.configuration, first.configuration);
}

#[test]
fn a_failure_is_tried_again_but_not_for_ever() {
    let mut tuner = tuner(explore_always());
    let failed = || Outcome::Failed {
        reason: "out of memory elsewhere".into(),
    };
    for _ in 0..crate::limits::FAILURES_PER_CONFIGURATION_MAX {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        assert_eq!(trial.mode, Mode::Default);
        assert_eq!(finish(&mut tuner, &trial, failed()).cost, None);
    }
    assert_eq!(suggest(&mut tuner, "a", 0.5, 0.5).mode, Mode::Explore);
}

#[test]
fn an_aborted_trial_carries_its_bound_and_is_not_the_best() {
    let mut tuner = tuner(explore_always());
    let trials = run(&mut tuner, "a", 0.5, 0.5, 1);
    let slow = suggest(&mut tuner, "a", 0.5, 0.5);
    let stopped = finish(&mut tuner, &slow, Outcome::Aborted { lower_bound: 0.5 });
    assert_eq!(stopped.cost, Some(0.5));
    let best = tuner.best(None).expect("valid").expect("measured");
    assert_eq!(
        (best.configuration, best.trial),
        (trials[0].configuration.clone(), 1)
    );
    assert_ne!(
        suggest(&mut tuner, "a", 0.5, 0.5).configuration,
        slow.configuration
    );
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
    assert_eq!(
        suggest(&mut tuner, "b", 0.535, 0.5).state_id,
        2,
        "a newcomer gets the nearest"
    );
}

#[test]
fn a_search_goes_on_where_it_stood_when_its_state_is_met_again() {
    let mut straight = tuner(explore_always());
    let expected = run(&mut straight, "a", 0.5, 0.5, 20);
    let mut interrupted = tuner(explore_always());
    let mut trials = run(&mut interrupted, "a", 0.5, 0.5, 12);
    run(&mut interrupted, "a", 0.1, 0.9, 7);
    trials.extend(run(&mut interrupted, "a", 0.5, 0.5, 8));
    let configurations = |trials: &[Trial]| {
        trials
            .iter()
            .map(|t| t.configuration.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(configurations(&trials), configurations(&expected));
}

#[test]
fn a_pinned_configuration_goes_to_everyone_until_it_is_cleared() {
    let mut tuner = tuner(explore_always());
    let before = suggest(&mut tuner, "a", 0.5, 0.5);
    let pinned = tuner.spec().space.decode(&[0.9, 0.1, 0.2, 0.3]);
    let policy = Policy {
        pinned: Some(pinned.clone()),
        ..explore_always()
    };
    tuner.set_policy(policy).expect("valid");
    let (trial, change) = tuner.suggest(&ask("a", 0.5, 0.5), 0).expect("valid");
    assert_eq!((trial.mode, &trial.configuration), (Mode::Pinned, &pinned));
    let rows: Vec<(u64, TrialState)> = change.trials.iter().map(|t| (t.number, t.state)).collect();
    assert_eq!(
        rows,
        [
            (before.number, TrialState::Abandoned),
            (trial.number, TrialState::Open)
        ]
    );
    assert_eq!(suggest(&mut tuner, "b", 0.1, 0.1).mode, Mode::Pinned);
    assert_eq!(
        tuner
            .predict(&ask("z", 0.9, 0.9).indicators)
            .expect("valid")
            .mode,
        Mode::Pinned
    );
    tuner.set_policy(explore_always()).expect("valid");
    let after = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_eq!(
        (after.mode, after.configuration),
        (before.mode, before.configuration)
    );
}

#[test]
fn prediction_changes_nothing_and_agrees_with_exploitation() {
    for predictor in [
        PredictorMethod::NearestNeighbour,
        PredictorMethod::RbfGreedyGq,
    ] {
        let mut tuner = tuner(Policy {
            predictor,
            ..explore_always()
        });
        let indicators = ask("a", 0.6, 0.5).indicators;
        assert_eq!(
            tuner.predict(&indicators).expect("valid").mode,
            Mode::Default
        );
        run(&mut tuner, "a", 0.5, 0.5, 20);
        run(&mut tuner, "a", 0.9, 0.1, 20);
        tuner
            .set_policy(Policy {
                predictor,
                ..exploit_always()
            })
            .expect("valid");
        let counts = tuner.statistics();
        let prediction = tuner.predict(&indicators).expect("valid");
        assert_eq!(tuner.statistics(), counts);
        assert_eq!(prediction.mode, Mode::Exploit);
        assert_eq!(prediction.reason.source, predictor.name());
        let trial = suggest(&mut tuner, "b", 0.6, 0.5);
        assert_eq!(
            (trial.configuration, trial.predicted_cost, trial.reason),
            (
                prediction.configuration,
                prediction.predicted_cost,
                prediction.reason
            )
        );
    }
}

#[test]
fn the_best_of_a_state_is_told_with_its_baseline() {
    let mut tuner = tuner(explore_always());
    assert_eq!(tuner.best(None), Ok(None));
    let trials = run(&mut tuner, "a", 0.5, 0.5, 25);
    let best = trials
        .iter()
        .min_by(|a, b| a.cost.partial_cmp(&b.cost).expect("finite"))
        .expect("some");
    let told = tuner
        .best(Some(&ask("a", 0.5, 0.5).indicators))
        .expect("valid")
        .expect("measured");
    assert_eq!(told.configuration, best.configuration);
    assert_eq!(
        (Some(told.cost), told.default_cost),
        (best.cost, trials[0].cost)
    );
    assert_eq!(
        (told.trial, told.state_id, told.measurements),
        (best.number, 1, 1)
    );
    assert_eq!(tuner.best(Some(&ask("a", 0.9, 0.5).indicators)), Ok(None));
}

#[test]
fn a_space_that_is_used_up_ends_the_search_early() {
    let parameters = ["p", "q"].map(|name| parameter(name, Domain::Boolean, Value::Boolean(false)));
    let space = Space::new(parameters.to_vec(), vec![]).expect("valid");
    let mut tuner = Tuner::new(Arc::new(spec_of(space, explore_always()))).expect("valid");
    let mut seen = BTreeSet::new();
    for _ in 0..4 {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        assert!(matches!(trial.mode, Mode::Default | Mode::Explore));
        assert!(seen.insert(trial.configuration.clone()));
        let later = measured(trial.number as f64);
        let reported = tuner.report(&trial, later, Outcome::Ok, 1);
        assert!(reported.is_ok());
    }
    let after = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_eq!(
        (after.mode, after.predicted_cost),
        (Mode::Exploit, Some(1.0))
    );
}

#[test]
fn a_study_without_indicators_has_one_state() {
    let mut spec = spec(explore_always());
    spec.indicators = IndicatorSchema::default();
    let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
    for client in ["a", "b"] {
        let ask = Ask {
            client_id: client.into(),
            indicators: BTreeMap::new(),
            fingerprint: None,
        };
        assert_eq!(tuner.suggest(&ask, 0).expect("valid").0.state_id, 1);
    }
}

#[test]
fn malformed_questions_and_reports_change_nothing() {
    let mut tuner = tuner(explore_always());
    for client in ["", "tab\there", &"c".repeat(129)] {
        assert_eq!(
            tuner.suggest(&ask(client, 0.5, 0.5), 0),
            Err(TunerError::ClientId)
        );
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
        (
            measured(1.0),
            Outcome::Aborted {
                lower_bound: f64::NAN,
            },
        ),
        (measured(1.0), Outcome::Failed { reason: long }),
        (
            (0..65).map(|i| (format!("m{i}"), 1.0)).collect(),
            infeasible(),
        ),
    ];
    let before = tuner.open_trial(1).cloned();
    for (measurements, outcome) in bad {
        assert!(tuner.report(&trial, measurements, outcome, 1).is_err());
    }
    assert_eq!(tuner.open_trial(1).cloned(), before);
    let stranger = Trial {
        number: 99,
        ..trial
    };
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
    assert_eq!(
        suggest(&mut tuner, "a", 3.0, 0.0).number,
        4,
        "one that it holds is given again"
    );
    suggest(&mut tuner, "b", limit as f64, 0.0);
}

#[test]
fn exploring_pays_off() {
    let mut costs = vec![];
    for search in [SearchMethod::NelderMead, SearchMethod::Random] {
        let mut all: Vec<f64> = (0..31)
            .map(|seed| {
                let policy = Policy {
                    search,
                    trials_per_state: 80,
                    ..explore_always()
                };
                let spec = StudySpec {
                    seed,
                    ..spec(policy)
                };
                let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
                let trials = run(&mut tuner, "a", 0.5, 0.5, 80);
                // The default costs 30.25; the optimum is 12.75.
                assert_eq!(trials[0].cost, Some(30.25));
                tuner.best(None).expect("valid").expect("measured").cost
            })
            .collect();
        all.sort_by(f64::total_cmp);
        costs.push(all[15]);
    }
    assert!(
        costs[0] < 13.5 && costs[0] + 1.0 < costs[1],
        "medians {costs:?}"
    );
}
