//! Spaces of few configurations, which are exhausted: they are repeated, confirmed and ended, and budgets
//! count runs.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::policy::PolicySettings;
use crate::randomness::standard_normal as normal;

/// A study without indicators, over levels from 1 on.
fn levels(count: i64, default: i64, seed: u64, policy: Policy) -> Tuner {
    let space = Space::builder().integer("level", 1..=count).default(default).build();
    let indicators = IndicatorSchema::default();
    let spec = StudySpec { seed, indicators, ..spec_of(space.expect("valid"), policy) };
    Tuner::new(Arc::new(spec)).expect("valid")
}

fn level(trial: &Trial) -> f64 {
    trial.configuration.get("level").and_then(Value::as_number).expect("a level")
}

/// Runs as one program after the other would, until the search is over or `most` runs are made. Returns the
/// number of runs.
fn tuned(tuner: &mut Tuner, truth: impl Fn(f64) -> f64, noise: f64, most: usize) -> usize {
    let mut random = ChaCha8Rng::seed_from_u64(tuner.spec().seed);
    let session_policy = crate::session::SessionPolicy { epsilon: Some(1.0), ..Default::default() };
    let ask = Ask { client_id: "exec".into(), session_policy, ..Ask::default() };
    for run in 0..most {
        let trial = tuner.suggest(&ask, 0).expect("valid").0;
        if trial.reason().explanation.rule == Some(Rule::Finished) {
            return run;
        }
        let cost = truth(level(&trial)) * f64::exp(noise * normal(&mut random));
        assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
    }
    most
}

fn answer(tuner: &Tuner) -> (i64, Best) {
    let best = tuner.best(None, None).expect("valid").expect("measured");
    let level = best.configuration.get("level").and_then(Value::as_number).expect("a level");
    (level as i64, best)
}

#[test]
fn a_factor_of_two_among_three_values_is_always_found() {
    let worlds = 1_000;
    let mut found = 0;
    for seed in 0..worlds {
        let noise = [0.02, 0.1, 0.2][seed as usize % 3];
        let (default, best) = (1 + seed as i64 % 3, 1 + (seed as i64 / 3) % 3);
        if default == best {
            found += 1;
            continue;
        }
        let mut tuner = levels(3, default, seed, Policy::default());
        // As a user would who gives it twenty runs.
        let runs = tuned(&mut tuner, |level| if level == best as f64 { 1.0 } else { 2.0 }, noise, 20);
        assert!(runs >= 9 || noise < 0.15, "it ended after {runs} runs");
        found += u64::from(answer(&tuner).0 == best);
    }
    assert_eq!(found, worlds);
}

#[test]
fn a_space_of_nineteen_levels_is_raced_confirmed_and_ended_in_the_runs_that_are_expected() {
    let space = levels(19, 3, 0, Policy::default()).spec().space.clone();
    let expected = PolicySettings::default().few(&space).expect("few").runs as f64;
    let (mut all, mut most) = (0, 0);
    for seed in 0..24u64 {
        let mut tuner = levels(19, 3, seed, Policy::default());
        let noise = [0.02, 0.05, 0.1][seed as usize % 3];
        // As compressing costs, which is dearer with each level, and has nothing to win; or with a valley.
        let truth = |level: f64| match seed % 2 {
            0 => 100.0 * f64::exp(0.15 * level),
            _ => 100.0 + 3.0 * (level - 11.0) * (level - 11.0),
        };
        let runs = tuned(&mut tuner, truth, noise, 1_000);
        let (level, best) = answer(&tuner);
        let optimum = if seed % 2 == 0 { 1.0 } else { 11.0 };
        assert!(truth(level as f64) <= 1.1 * truth(optimum), "seed {seed}: level {level}");
        assert!(best.standing.confirmation.is_over(), "seed {seed}: {:?}", best.standing.confirmation);
        (all, most) = (all + runs, most.max(runs));
    }
    let mean = all as f64 / 24.0;
    println!("{mean:.1} runs in the mean, {most} at the most, {expected} expected");
    assert!(most <= 130 && (0.6..1.5).contains(&(mean / expected)), "{mean} {most} {expected}");
}

#[test]
fn a_space_of_which_few_configurations_fulfil_the_constraints_is_tried_whole() {
    let space = Space::builder().integer("level", 1..=64).default(1).log();
    let space = space.integer("rest", 1..=64).default(48).log().constraint("level * rest == 48");
    let space = space.build().expect("valid");
    let spec = StudySpec { indicators: IndicatorSchema::default(), ..spec_of(space, Policy::default()) };
    let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
    // Ten of 4096 combinations.
    let runs = tuned(&mut tuner, |level| 10.0 + (level - 12.0).abs(), 0.01, 1_000);
    assert!((10..120).contains(&runs), "{runs}");
    assert_eq!(answer(&tuner).0, 12);
}

#[test]
fn a_space_that_is_flat_ends_and_says_that_nothing_is_better() {
    let (mut wrong, mut most) = (0, 0.0_f64);
    for seed in 0..30 {
        let mut tuner = levels(5, 2, seed, Policy::default());
        let runs = tuned(&mut tuner, |_| 10.0, 0.05, 1_000);
        assert!(runs < 140, "{runs}");
        let (level, best) = answer(&tuner);
        if level != 2 {
            wrong += 1;
            continue;
        }
        // The answer says how much may be missed, and so does its reason.
        let at_most = best.standing.gain_at_most.expect("an assessment tells it");
        let reason = tuner.predict(&BTreeMap::new(), None).expect("valid").reason().summary;
        let told = format!("more than {} %", crate::cost_view::CostView::default().percent(at_most));
        assert!(reason.contains(&told), "{told}: {reason}");
        most = most.max(at_most);
    }
    assert!(wrong <= 3, "{wrong} of 30 have found what is not there");
    assert!(most > 0.001, "five noisy levels leave something open: {most}");
}

#[test]
fn one_configuration_needs_no_search() {
    let mut tuner = levels(1, 1, 0, Policy::default());
    assert!(tuned(&mut tuner, |_| 10.0, 0.05, 100) <= 3);
}

#[test]
fn exact_costs_are_not_measured_again_and_again() {
    let mut tuner = levels(7, 2, 0, Policy::default());
    let runs = tuned(&mut tuner, |level| 100.0 - level, 0.0, 1_000);
    assert_eq!(answer(&tuner).0, 7);
    assert!(runs <= 7 + 3 + 15, "{runs} runs for seven configurations");
}

#[test]
fn a_budget_counts_runs() {
    for seed in 0..4 {
        let mut tuner = seeded(seed, Policy { epsilon: 1.0, trials_per_state: 30, ..Policy::default() });
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut searched = 0;
        for _ in 0..200 {
            let trial = suggest(&mut tuner, "a", 0.5, 0.5);
            let rule = trial.reason().explanation.rule;
            if matches!(rule, Some(Rule::Finished | Rule::Confirming)) {
                break;
            }
            searched += 1;
            let metrics = measured(cost(&trial) * f64::exp(0.05 * normal(&mut random)));
            assert!(tuner.report(&trial, metrics, Outcome::Ok, 1).is_ok());
        }
        assert_eq!(searched, 30, "repeats and the default among them");
        assert!(tuner.knowledge.states.results(StateId(1)).tried() < 30);
    }
}

#[test]
fn a_search_that_meets_only_what_is_known_keeps_to_its_budget() {
    let policy =
        Policy { search: SearchMethod::Random, epsilon: 1.0, track_speed: false, ..Policy::default() };
    let mut tuner = levels(1_000, 3, 0, policy);
    let report = |tuner: &mut Tuner, trial: &Trial| {
        assert!(tuner.report(trial, measured(10.0 + level(trial)), Outcome::Ok, 1).is_ok());
    };
    // The program has measured all but four itself, and wants a single trial of the search.
    let session_policy = crate::session::SessionPolicy { trials_per_state: Some(1), ..Default::default() };
    let ask = Ask { client_id: "exec".into(), session_policy, ..Ask::default() };
    for known in 1..=996 {
        let mut wanted = tuner.spec().space.default_configuration().to_raw();
        wanted.insert("level".into(), Value::Integer(known));
        let trial = tuner.suggest_wanted(&ask, wanted, None, 0).expect("valid").0;
        report(&mut tuner, &trial);
    }
    let first = tuner.suggest(&ask, 0).expect("valid").0;
    assert!(level(&first) > 996.0, "{first:?}");
    report(&mut tuner, &first);
    let mut confirms = false;
    for _ in 0..12 {
        let trial = tuner.suggest(&ask, 0).expect("valid").0;
        assert!(level(&trial) <= 996.0 || trial.configuration == first.configuration, "{trial:?}");
        confirms |= trial.reason().explanation.rule == Some(Rule::Confirming);
        report(&mut tuner, &trial);
    }
    assert!(confirms, "what the budget ended is confirmed");
}

#[test]
fn what_was_forgotten_and_is_met_again_is_not_counted_twice() {
    let mut tuner = levels(10, 2, 0, Policy::default());
    let (ask, state) = (Ask { client_id: "exec".into(), ..Ask::default() }, StateId(1));
    let default = tuner.spec().space.default_configuration();
    for round in 0..4 {
        for level in 1..=6 {
            let mut wanted = default.to_raw();
            wanted.insert("level".into(), Value::Integer(level));
            let trial = tuner.suggest_wanted(&ask, wanted, None, 0).expect("valid").0;
            assert!(tuner.report(&trial, measured(10.0), Outcome::Ok, 1).is_ok());
        }
        let results = tuner.knowledge.states.results(state);
        assert_eq!((results.tried(), results.searched(), results.remembered()), (6, 0, 6), "round {round}");
        assert!(!tuner.searches.few().is_exhausted(results), "four were never tried");
        tuner.knowledge.states.amend(state, |results| results.forget(2, &default, true));
        assert_eq!(tuner.knowledge.states.results(state).remembered(), 2);
        assert_eq!(tuner.knowledge.states.results(state).tried(), 6, "they have been tried");
    }
}

#[test]
fn several_programs_share_a_small_space() {
    let mut tuner = levels(6, 2, 3, Policy::default());
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut open: Vec<Trial> = Vec::new();
    let (mut runs, mut ended) = (0, 0);
    while ended < 4 && runs < 400 {
        let client = format!("client {}", runs % 4);
        let session_policy = crate::session::SessionPolicy { epsilon: Some(1.0), ..Default::default() };
        let ask = Ask { client_id: client.clone(), session_policy, ..Ask::default() };
        if let Some(place) = open.iter().position(|trial| trial.client_id == client) {
            let trial = open.remove(place);
            let cost = (5.0 + level(&trial)) * f64::exp(0.03 * normal(&mut random));
            assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
        }
        let trial = tuner.suggest(&ask, 0).expect("valid").0;
        ended = if trial.reason().explanation.rule == Some(Rule::Finished) { ended + 1 } else { 0 };
        open.push(trial);
        runs += 1;
    }
    assert!(ended >= 4, "nobody waits for ever: {runs} runs");
    assert_eq!(answer(&tuner).0, 1);
}
