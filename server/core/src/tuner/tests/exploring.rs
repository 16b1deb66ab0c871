//! The exploring of states: the measured configurations, their repeats, and the progress.

use super::*;

#[test]
fn exploring_begins_with_the_default_and_never_samples_a_pair_twice() {
    for search in [SearchMethod::NelderMead, SearchMethod::LatinHypercube, SearchMethod::Random] {
        let mut tuner = tuner(Policy { search, ..explore_always() });
        let trials = run(&mut tuner, "a", 0.5, 0.5, 30);
        assert_eq!(trials[0].mode(), Mode::Default);
        assert_eq!(trials[0].configuration, tuner.spec().space.default_configuration());
        assert!(trials[1..].iter().all(|trial| trial.mode() == Mode::Explore));
        let distinct: BTreeSet<&Configuration> = trials.iter().map(|trial| &trial.configuration).collect();
        assert_eq!(distinct.len(), 30, "{search:?}");
        // The budget is spent: the best known is exploited from now on.
        let best = trials.iter().min_by(|a, b| a.cost.partial_cmp(&b.cost).expect("finite")).expect("some");
        let next = suggest(&mut tuner, "a", 0.5, 0.5);
        // As far as single measurements show, some of which may be wrong by some percent.
        let (least, predicted) = (best.cost.expect("measured"), next.predicted_cost.expect("measured"));
        assert_eq!(next.mode(), Mode::Exploit);
        assert!(
            cost(&next) <= 1.1 * least && (predicted / least - 1.0).abs() < 0.1,
            "{predicted} and {least}"
        );
    }
}

#[test]
fn a_search_may_measure_its_best_again_within_the_budget() {
    let mut tuner = tuner(Policy { search: SearchMethod::Auto, ..explore_always() });
    let mut known = BTreeSet::new();
    let mut repeats = 0;
    for number in 0..30u32 {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        let again = !known.insert(trial.configuration.clone());
        assert_eq!(again, trial.reason().step == "replicate", "{trial:?}");
        repeats += u32::from(again);
        // Noise of a fifth, so that rivals are close.
        let cost = cost(&trial) * (0.9 + 0.2 * f64::from(number * 7 % 11) / 10.0);
        let (reported, _) = tuner.report(&trial, measured(cost), Outcome::Ok, 1).expect("a valid report");
        assert_eq!(reported.state, TrialState::Completed);
    }
    assert!((1..=5).contains(&repeats), "{repeats} repeats");
    let best = tuner.best(None, None).expect("valid").expect("measured");
    let next = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_eq!((next.mode(), &next.configuration), (Mode::Exploit, &best.configuration));
}

#[test]
fn replicates_measure_each_configuration_as_often_as_asked() {
    let mut tuner = tuner(Policy { replicates: 3, trials_per_state: 10, ..explore_always() });
    let trials = run(&mut tuner, "a", 0.5, 0.5, 30);
    let mut counts = BTreeMap::new();
    for trial in &trials {
        *counts.entry(&trial.configuration).or_insert(0) += 1;
    }
    assert_eq!(counts.len(), 10);
    assert!(counts.values().all(|&count| count == 3));
    assert_eq!(tuner.best(None, None).expect("valid").expect("measured").measurements, 3);
}

#[test]
fn clients_share_a_search_without_sharing_a_point_and_nobody_waits() {
    let mut tuner = tuner(explore_always());
    let (mut seen, mut repeats) = (BTreeSet::new(), 0);
    for round in 0..40 {
        let trials: Vec<Trial> = (0..5).map(|c| suggest(&mut tuner, &format!("c{c}"), 0.5, 0.5)).collect();
        for trial in &trials {
            let explores = matches!(trial.mode(), Mode::Explore | Mode::Default);
            if trial.reason().step == "replicate" {
                assert!(seen.contains(&trial.configuration), "round {round}");
                repeats += 1;
            } else if explores && !["default", "incumbent"].contains(&trial.reason().source.as_str()) {
                assert!(seen.insert(trial.configuration.clone()), "round {round} hands out a pair twice");
            } else {
                assert_ne!(trial.mode(), Mode::Explore);
            }
        }
        for trial in trials {
            finish(&mut tuner, &trial, Outcome::Ok);
        }
    }
    assert_eq!(seen.len() + repeats, 30, "{repeats} repeats");
}

#[test]
fn a_failure_is_tried_again_but_not_for_ever() {
    let mut tuner = tuner(explore_always());
    let failed = || Outcome::Failed { reason: "out of memory elsewhere".into() };
    for _ in 0..crate::limits::FAILURES_PER_CONFIGURATION_MAX {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        assert_eq!(trial.mode(), Mode::Default);
        assert_eq!(finish(&mut tuner, &trial, failed()).cost, None);
    }
    assert_eq!(suggest(&mut tuner, "a", 0.5, 0.5).mode(), Mode::Explore);
}

#[test]
fn an_aborted_trial_carries_its_bound_and_is_not_the_best() {
    let mut tuner = tuner(explore_always());
    let trials = run(&mut tuner, "a", 0.5, 0.5, 1);
    let slow = suggest(&mut tuner, "a", 0.5, 0.5);
    let stopped = finish(&mut tuner, &slow, Outcome::Aborted { lower_bound: 0.5 });
    assert_eq!(stopped.cost, Some(0.5));
    let best = tuner.best(None, None).expect("valid").expect("measured");
    assert_eq!((best.configuration, best.trial), (trials[0].configuration.clone(), 1));
    assert_ne!(suggest(&mut tuner, "a", 0.5, 0.5).configuration, slow.configuration);
}

#[test]
fn a_search_goes_on_where_it_stood_when_its_state_is_met_again() {
    let mut straight = tuner(explore_always());
    let expected = run(&mut straight, "a", 0.5, 0.5, 20);
    let mut interrupted = tuner(explore_always());
    let mut trials = run(&mut interrupted, "a", 0.5, 0.5, 12);
    run(&mut interrupted, "a", 0.1, 0.9, 7);
    trials.extend(run(&mut interrupted, "a", 0.5, 0.5, 8));
    let configurations =
        |trials: &[Trial]| trials.iter().map(|t| t.configuration.clone()).collect::<Vec<_>>();
    assert_eq!(configurations(&trials), configurations(&expected));
}

#[test]
fn a_space_that_is_used_up_ends_the_search_early() {
    let space = Space::builder().boolean("p").default(false).boolean("q").default(false);
    let space = space.build().expect("valid");
    let mut tuner = Tuner::new(Arc::new(spec_of(space, explore_always()))).expect("valid");
    let mut seen = BTreeSet::new();
    for _ in 0..4 {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        assert!(matches!(trial.mode(), Mode::Default | Mode::Explore));
        assert!(seen.insert(trial.configuration.clone()));
        let later = measured(trial.number as f64);
        let reported = tuner.report(&trial, later, Outcome::Ok, 1);
        assert!(reported.is_ok());
    }
    let after = suggest(&mut tuner, "a", 0.5, 0.5);
    // The default is the best of the four.
    assert_eq!((after.mode(), after.reason().source.as_str()), (Mode::Default, "incumbent"));
    assert!(after.predicted_cost.is_some_and(|cost| cost < 1.5), "{:?}", after.predicted_cost);
}

#[test]
fn exploring_pays_off() {
    let mut costs = vec![];
    for search in [SearchMethod::Auto, SearchMethod::NelderMead, SearchMethod::Random] {
        let mut all: Vec<f64> = (0..31)
            .map(|seed| {
                let policy = Policy { search, trials_per_state: 80, ..explore_always() };
                let mut tuner = seeded(seed, policy);
                let trials = run(&mut tuner, "a", 0.5, 0.5, 80);
                // The default costs 30.25; the optimum is 12.75.
                assert_eq!(trials[0].cost, Some(30.25));
                tuner.best(None, None).expect("valid").expect("measured").cost
            })
            .collect();
        all.sort_by(f64::total_cmp);
        costs.push(all[15]);
    }
    let random = costs[2];
    assert!(costs[..2].iter().all(|cost| *cost < 13.5 && cost + 1.0 < random), "medians {costs:?}");
}

#[test]
fn a_search_is_dropped_once_its_budget_is_spent_and_goes_on_from_the_table_when_it_is_raised() {
    for search in [SearchMethod::Auto, SearchMethod::Random] {
        let mut tuner = tuner(Policy { search, trials_per_state: 12, ..explore_always() });
        let before = run(&mut tuner, "a", 0.5, 0.5, 40);
        let exploration = tuner.searches.of(StateId(1)).expect("explored");
        assert!(exploration.search.is_none(), "{search:?}");
        assert!(exploration.pack().len() < 64, "{}", exploration.pack().len());
        let tried = tuner.knowledge.states.results(StateId(1)).tried() as u64;
        assert!(tried + exploration.repeats() >= 12);
        // Later changes write no search any more.
        let (trial, change) = tuner.suggest(&ask("a", 0.5, 0.5), 0).expect("valid");
        assert_eq!(change.states, []);
        finish(&mut tuner, &trial, Outcome::Ok);

        assert_eq!(tuner.set_policy(Policy { search, trials_per_state: 20, ..explore_always() }), Ok(false));
        let after = run(&mut tuner, "a", 0.5, 0.5, 30);
        let different = |trials: &[Trial]| -> BTreeSet<Configuration> {
            trials.iter().map(|trial| trial.configuration.clone()).collect()
        };
        let fresh = different(&after).difference(&different(&before)).count();
        assert!((1..=9).contains(&fresh), "{search:?}: {fresh} of the eight more");
        assert!(after.iter().all(|trial| trial.reason().step != "latin_hypercube"), "{search:?}");
        assert!(tuner.searches.of(StateId(1)).is_some_and(|exploration| exploration.search.is_none()));
    }
}

#[test]
fn a_study_remembers_a_bounded_number_of_configurations() {
    let policy = Policy { search: SearchMethod::Random, trials_per_state: 100, ..explore_always() };
    let mut tuner = tuner(policy);
    let mut best_of_first = None;
    for place in 0..20 {
        run(&mut tuner, "a", 0.2 * f64::from(place % 5), 0.25 * f64::from(place / 5), 100);
        let remembered: usize =
            tuner.knowledge.states.known().iter().map(|state| state.results.remembered()).sum();
        assert_eq!(remembered, tuner.knowledge.states.remembered());
        assert!(remembered <= crate::limits::RECORDS_PER_STUDY_MAX, "{remembered} configurations");
        // The best and the default stay, and that others were tried is not forgotten.
        let best = tuner.knowledge.states.results(StateId(1)).best().map(|best| best.mean_cost);
        assert_eq!(best, *best_of_first.get_or_insert(best));
        assert!(tuner.knowledge.states.results(StateId(1)).tried() >= 90);
        assert!(tuner.knowledge.states.default_cost(StateId(1)).is_some());
    }
    assert_eq!(tuner.knowledge.states.len(), 20);
    assert!(tuner.knowledge.states.results(StateId(1)).remembered() < 90);
}

#[test]
fn a_search_is_stored_in_few_bytes() {
    for (search, most) in [(SearchMethod::Auto, 3_500), (SearchMethod::Random, 500)] {
        let mut tuner = tuner(Policy { search, trials_per_state: 80, ..explore_always() });
        run(&mut tuner, "a", 0.5, 0.5, 75);
        let exploration = tuner.searches.of(StateId(1)).expect("explored");
        assert!(exploration.search.is_some());
        let (packed, text) = (exploration.pack(), serde_json::to_string(exploration).expect("plain data"));
        println!("{search:?}: {} bytes packed, {} as text", packed.len(), text.len());
        assert!(packed.len() <= most && packed.len() < text.len(), "{}", packed.len());
        assert_eq!(Exploration::unpack(&packed).as_ref(), Ok(exploration));
    }
}

#[test]
fn a_new_state_begins_with_what_did_best_in_others_and_then_with_the_default() {
    for (search, follows) in [(SearchMethod::Auto, true), (SearchMethod::NelderMead, false)] {
        let mut tuner =
            tuner(Policy { search, predictor: PredictorMethod::NearestNeighbour, ..explore_always() });
        let first = run(&mut tuner, "a", 0.5, 0.5, 30);
        assert!(first.iter().all(|trial| trial.reason().step != "elsewhere"), "nothing is known of others");
        let best = first.iter().min_by(|a, b| a.cost.partial_cmp(&b.cost).expect("finite")).expect("some");
        let second = run(&mut tuner, "a", 0.7, 0.5, 30);
        let begins = second.iter().position(|trial| trial.mode() == Mode::Default).expect("the default");
        let is_transferred = |trial: &&Trial| trial.reason().step == "elsewhere";
        let transferred: Vec<&Trial> = second.iter().filter(is_transferred).collect();
        assert_eq!(begins, usize::from(follows), "{search:?}: the default is the first or the second");
        assert_eq!(!transferred.is_empty(), follows, "{search:?}");
        for trial in &transferred {
            assert_eq!(trial.mode(), Mode::Explore);
            assert!(trial.reason().summary.contains("other states"), "{}", trial.reason().summary);
            assert_eq!(trial.reason().neighbours[0].state_id, 1);
            assert_eq!(Some(trial.reason().neighbours[0].best_cost), best.cost);
        }
        let own = second.iter().map(|trial| &trial.configuration).take(6);
        assert_eq!(own.clone().any(|configuration| *configuration == best.configuration), follows);
    }
}

#[test]
fn what_others_know_is_planned_apart() {
    let policy = Policy {
        search: SearchMethod::Auto,
        predictor: PredictorMethod::NearestNeighbour,
        ..explore_always()
    };
    let mut alone = tuner(policy);
    run(&mut alone, "a", 0.5, 0.5, 30);
    let mut shared = alone.clone();
    for frame in 0..12 {
        let ask = ask("a", 0.7, 0.5);
        let question = shared.question(&ask).expect("a valid question");
        let request = shared.plan(&question, |_| true);
        assert!(frame > 0 || request.is_some(), "a guide is no lookup");
        let plan = request.map(PlanRequest::compute).unwrap_or_default();
        let (one, _) = alone.suggest(&ask, 0).expect("a valid question");
        let other = with_plan(&mut shared, &ask, plan);
        assert_eq!(one, other);
        for tuner in [&mut alone, &mut shared] {
            let _change = tuner.report(&one, measured(cost(&one)), Outcome::Ok, 1).expect("a valid report");
        }
    }
}
