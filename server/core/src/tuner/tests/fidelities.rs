//! Cheaper levels: which trials run at them, and that no answer rests on them.

use proptest::prelude::*;

use super::*;
use crate::objective::MeasurementLimit;
use crate::tuner::plan::Planned;

fn climber(policy: Policy) -> Tuner {
    Tuner::new(Arc::new(with_levels(spec(policy)))).expect("valid")
}

fn knowing() -> Ask {
    Ask { fidelities: true, ..ask("a", 0.5, 0.5) }
}

/// Runs until the search ends. At a cheaper level a trial measures what `cheap` makes of its full cost.
fn searched(tuner: &mut Tuner, cheap: impl Fn(f64) -> f64) -> Vec<Trial> {
    let mut trials = Vec::new();
    for _ in 0..300 {
        let trial = tuner.suggest(&knowing(), 0).expect("valid").0;
        if trial.mode() == Mode::Exploit {
            break;
        }
        let full = cost(&trial);
        let ms = if trial.decision.fidelity.is_some() { cheap(full) } else { full };
        trials.push(tuner.report(&trial, measured(ms), Outcome::Ok, 1).expect("valid").0);
    }
    trials
}

fn is_cheap(trial: &&Trial) -> bool {
    trial.decision.fidelity.is_some()
}

#[test]
fn trials_at_levels_cost_their_share_and_answers_rest_on_full_trials() {
    let mut tuner = climber(Policy { trials_per_state: 14, ..explore_always() });
    let trials = searched(&mut tuner, |full| 0.1 * full);
    let level = |trial: &Trial| trial.decision.fidelity.clone();
    assert!(level(&trials[0]).is_none() && trials[0].mode() == Mode::Default);
    // The default ties each level to full trials.
    assert_eq!([&trials[1], &trials[2]].map(level), [Some("16".to_owned()), Some("64".to_owned())]);
    assert!(trials[..3].iter().all(|trial| trial.configuration == trials[0].configuration));
    for trial in trials.iter().filter(is_cheap) {
        assert_eq!((trial.cost, &trial.outcome), (None, &Some(Outcome::Ok)));
        assert!(trial.measurements.contains_key("render_ms"));
        assert!(trial.reason().summary.contains("at the level"), "{}", trial.reason().summary);
    }
    let levels = tuner.spec().objective.fidelities();
    let share = |trial: &Trial| {
        let level = levels.iter().find(|level| Some(&level.name) == trial.decision.fidelity.as_ref());
        level.map_or(1.0, |level| level.cost)
    };
    let spent: f64 = trials.iter().map(share).sum();
    assert!((12.0..15.5).contains(&spent), "a budget of 14, and {spent}");
    let (cheap, full): (Vec<&Trial>, Vec<&Trial>) = trials.iter().partition(is_cheap);
    let in_full: BTreeSet<&Configuration> = full.iter().map(|trial| &trial.configuration).collect();
    let only_cheap = cheap.iter().filter(|trial| !in_full.contains(&trial.configuration)).count();
    assert!(only_cheap >= 1, "not all ran in full");
    let best = tuner.best(None, None).expect("valid").expect("measured");
    let own = full.iter().filter(|trial| trial.configuration == best.configuration).count();
    assert_eq!(best.measurements, own as u64);
}

#[test]
fn a_level_knows_no_limits_and_its_crashes_are_not_tried_in_full() {
    let spec = with_levels(spec(explore_always()));
    let limit = MeasurementLimit { metric: "render_ms".into(), at_least: None, at_most: Some(1e6) };
    let objective = spec.objective.clone().with_limits(vec![limit]).expect("valid");
    let mut tuner = Tuner::new(Arc::new(StudySpec { objective, ..spec })).expect("valid");
    let default = tuner.suggest(&knowing(), 0).expect("valid").0;
    finish(&mut tuner, &default, Outcome::Ok);
    let first = tuner.suggest(&knowing(), 0).expect("valid").0;
    assert_eq!(first.decision.fidelity.as_deref(), Some("16"));
    let beyond = tuner.report(&first, measured(1e7), Outcome::Ok, 1).expect("valid").0;
    assert_eq!(beyond.outcome, Some(Outcome::Ok), "limits are those of full trials");
    assert!(tuner.report(&first, measured(1.0), Outcome::Ok, 1).is_err(), "only once");
    let second = tuner.suggest(&knowing(), 0).expect("valid").0;
    assert_eq!(
        (&second.configuration, second.decision.fidelity.as_deref()),
        (&first.configuration, Some("64"))
    );
    finish(&mut tuner, &second, Outcome::Ok);
    let crashes = tuner.suggest(&knowing(), 0).expect("valid").0;
    assert_eq!(crashes.decision.fidelity.as_deref(), Some("16"));
    assert!(tuner.report(&crashes, BTreeMap::new(), infeasible(), 1).is_ok());
    for _ in 0..20 {
        let trial = tuner.suggest(&knowing(), 0).expect("valid").0;
        assert_ne!(trial.configuration, crashes.configuration);
        finish(&mut tuner, &trial, Outcome::Ok);
    }
}

#[test]
fn what_crashed_beside_the_search_does_not_run_at_a_level() {
    let begun = || {
        let mut tuner = climber(explore_always());
        for _ in 0..3 {
            let trial = tuner.suggest(&knowing(), 0).expect("valid").0;
            finish(&mut tuner, &trial, Outcome::Ok);
        }
        tuner
    };
    let next = |tuner: &mut Tuner| tuner.suggest(&knowing(), 0).expect("valid").0;
    let (mut plain, mut tuner) = (begun(), begun());
    let design = next(&mut plain);
    assert_eq!(design.decision.fidelity.as_deref(), Some("16"));
    let wanted = design.configuration.to_raw();
    let crashes = tuner.suggest_wanted(&ask("b", 0.5, 0.5), wanted, None, 0).expect("valid").0;
    assert!(tuner.report(&crashes, BTreeMap::new(), infeasible(), 1).is_ok());
    assert_ne!(next(&mut tuner).configuration, design.configuration);
}

#[test]
fn a_client_that_knows_levels_no_more_gets_a_full_trial() {
    let mut tuner = climber(explore_always());
    let default = tuner.suggest(&knowing(), 0).expect("valid").0;
    finish(&mut tuner, &default, Outcome::Ok);
    let probe = tuner.suggest(&knowing(), 0).expect("valid").0;
    assert_eq!(probe.decision.fidelity.as_deref(), Some("16"));
    let other = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_ne!(other.configuration, probe.configuration, "it is measured in full");
    assert_eq!(other.decision.fidelity, None);
    finish(&mut tuner, &other, Outcome::Ok);
    for level in ["16", "64"] {
        let probe = tuner.suggest(&knowing(), 0).expect("valid").0;
        assert_eq!(probe.decision.fidelity.as_deref(), Some(level));
        finish(&mut tuner, &probe, Outcome::Ok);
    }
    let cheap = tuner.suggest(&knowing(), 0).expect("valid").0;
    assert_eq!(cheap.decision.fidelity.as_deref(), Some("16"));
    assert_eq!(tuner.suggest(&knowing(), 0).expect("valid").0.number, cheap.number, "its answer was lost");
    let full = suggest(&mut tuner, "a", 0.5, 0.5);
    assert_eq!((&full.configuration, &full.decision.fidelity), (&cheap.configuration, &None));
    assert_ne!(full.number, cheap.number);
    // In a changed space a trial is read as wanted.
    let decision = Choice::Wanted.decided();
    let adopted = Decision { fidelity: cheap.decision.fidelity.clone(), ..decision.clone() };
    let configuration = full.configuration.clone();
    let wanted =
        Prediction { configuration, predicted_cost: None, decision: decision.clone(), insight: None };
    let (ask, visits) = (knowing(), &tuner.clients.visits);
    let at_once = Planned::AtOnce;
    let wishes = tuner.exploiting(&at_once).wishes(&ask.session_policy);
    let fits =
        |decision| wishes.still_wants(&ask, &Trial { decision, ..full.clone() }, Some(&wanted), visits);
    assert_eq!([fits(decision), fits(adopted)], [true, false]);
}

proptest! {
    #![proptest_config(crate::testing::cases(32))]

    #[test]
    fn without_levels_or_clients_that_know_them_nothing_changes(
        seed: u64, places in prop::collection::vec(0usize..3, 1..60),
    ) {
        let policy = Policy { epsilon: 0.7, trials_per_state: 12, ..Policy::default() };
        let run = |has_levels: bool, fidelities: bool| {
            let spec = StudySpec { seed, ..spec(policy.clone()) };
            let spec = if has_levels { with_levels(spec) } else { spec };
            let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
            let mut answers = Vec::new();
            for place in &places {
                let ask = Ask { fidelities, ..ask("a", 0.3 * *place as f64, 0.5) };
                let (trial, handed) = tuner.suggest(&ask, 0).expect("valid");
                let report = tuner.report(&trial, measured(cost(&trial)), Outcome::Ok, 1).expect("valid");
                answers.push((report.0, handed.states, report.1.states));
            }
            answers
        };
        let plain = run(false, false);
        prop_assert!(run(false, true) == plain, "the study has no levels");
        prop_assert!(run(true, false) == plain, "the client knows none");
    }
}
