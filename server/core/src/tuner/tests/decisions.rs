//! Answers never contradict themselves: over sessions of many clients, mode and rule agree, and so do the
//! words.

use proptest::prelude::*;

use super::*;
use crate::policy::Operation;

fn policies() -> Vec<Policy> {
    let base = Policy { epsilon: 0.5, trials_per_state: 10, ..Policy::default() };
    vec![
        base.clone(),
        Policy { search: SearchMethod::NelderMead, epsilon: 1.0, ..base.clone() },
        Policy { regret_budget: Some(0.5), abort_above: Some(1.2), ..base.clone() },
        Policy { weigh_gain: true, warm_up: 2, ..base.clone() },
        Policy { operation: Operation::Freeze, ..base.clone() },
        Policy { operation: Operation::Shadow, ..base.clone() },
        Policy { epsilon: 0.0, ..base },
    ]
}

/// Whether an answer's mode allows its rule.
fn agree(mode: Mode, rule: Option<Rule>) -> bool {
    use Rule::{
        Budget, Confirming, Exploit, Explore, Finished, Frozen, Gain, Incumbent, NothingKnown, RolledBack,
        Shadow, Waiting,
    };
    let exploits = [Exploit, Finished, Waiting, Budget, Gain, RolledBack, Frozen];
    rule.is_some_and(|rule| match mode {
        Mode::Explore => [Explore, NothingKnown, Confirming].contains(&rule),
        // An incumbent that is not the default is measured again.
        Mode::Exploit => exploits.contains(&rule) || [Confirming, Incumbent].contains(&rule),
        // The baseline of exploring, the fallback where nothing is known, and the answer of shadow operation.
        Mode::Default => {
            [Explore, NothingKnown, Shadow, Confirming, Incumbent].contains(&rule) || exploits.contains(&rule)
        }
        Mode::Pinned => false,
    })
}

proptest! {
    #![proptest_config(crate::testing::cases(48))]

    #[test]
    fn mode_and_rule_agree(
        events in prop::collection::vec((0usize..12, 0usize..3, 0usize..4, 0usize..20), 60..160),
        switches in prop::collection::vec(0usize..7, 3),
    ) {
        let mut tuner = tuner(policies()[switches[0]].clone());
        let mut open: Vec<Trial> = Vec::new();
        for (index, &(client, place, kind, which)) in events.iter().enumerate() {
            if index % 50 == 49 {
                let _ = tuner.set_policy(policies()[switches[index / 50 % 3]].clone()).expect("valid");
            }
            if kind == 0 && !open.is_empty() {
                let trial = open.swap_remove(which % open.len());
                let outcome = if which == 0 { infeasible() } else { Outcome::Ok };
                let _ = tuner.report(&trial, measured(cost(&trial)), outcome, 1);
                continue;
            }
            let client = format!("c{client}");
            let question = Ask { can_abort: kind > 1, ..ask(&client, 0.3 * place as f64, 0.5) };
            let trial = tuner.suggest(&question, 0).expect("a valid question").0;
            let (mode, reason) = (trial.mode(), trial.reason());
            prop_assert!(agree(mode, reason.explanation.rule), "{mode:?} by {:?}", reason.explanation.rule);
            // An explored trial names its search's step, and no other trial does.
            let explored = [Rule::Explore, Rule::NothingKnown, Rule::Confirming, Rule::Incumbent];
            let is_explored = reason.explanation.rule.is_some_and(|rule| explored.contains(&rule));
            prop_assert_eq!(is_explored, !reason.step.is_empty());
            prop_assert!(trial.decision.abort_above().is_none() || mode == Mode::Explore);
            open.push(trial);
        }
    }
}

#[test]
fn who_finds_a_search_waiting_is_told_so() {
    let mut tuner = tuner(Policy { search: SearchMethod::NelderMead, ..explore_always() });
    run(&mut tuner, "a", 0.5, 0.5, 3);
    let trials: Vec<Trial> = (0..32).map(|c| suggest(&mut tuner, &format!("c{c}"), 0.5, 0.5)).collect();
    let is_waiting =
        |trial: &&Trial| matches!(trial.reason().explanation.rule, Some(Rule::Waiting | Rule::Finished));
    let waiting: Vec<&Trial> = trials.iter().filter(is_waiting).collect();
    assert!(!waiting.is_empty(), "the simplex waits for its vertices");
    for trial in waiting {
        // After three measurements nothing need be proven yet.
        let (mode, source) = (trial.mode(), trial.reason().source);
        let stands = (Mode::Exploit, "best_known");
        assert!([stands, (Mode::Default, "incumbent")].contains(&(mode, source.as_str())), "{source}");
    }
}

#[test]
fn who_was_rolled_back_explores_once_the_stay_is_long() {
    let mut tuner = tuner(Policy { epsilon: 0.2, ..explore_always() });
    run(&mut tuner, "a", 0.5, 0.5, 1);
    let default = tuner.spec().space.default_configuration();
    exploits(&mut tuner, "a", default, ExploitSource::Default, ExploitRule::RolledBack);
    let trials = run(&mut tuner, "a", 0.5, 0.5, 40);
    assert!(trials.iter().any(|trial| trial.mode() == Mode::Explore), "it stays at what was not worse");
}

#[test]
fn a_client_that_stays_confirms_the_search_that_others_left() {
    let policy = Policy { confirm_rounds: 10, ..explore_always() };
    let mut tuner = tuner(policy.clone());
    run(&mut tuner, "a", 0.5, 0.5, 30);
    assert!(tuner.standings().is_to_be_confirmed(StateId(1)), "the search is over");
    tuner.set_policy(Policy { epsilon: 0.2, ..policy }).expect("valid");
    run(&mut tuner, "b", 0.5, 0.5, 1);
    // As if the dice had been against it when it came.
    let best = tuner.best(None, None).expect("valid").expect("measured").configuration;
    exploits(&mut tuner, "b", best, ExploitSource::Default, ExploitRule::Finished);
    let trials = run(&mut tuner, "b", 0.5, 0.5, 40);
    let confirms = |trial: &Trial| trial.decision.rule() == Some(Rule::Confirming);
    assert!(trials.iter().any(confirms), "nobody would ever confirm it");
}
