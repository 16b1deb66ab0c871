//! The regret budget from the client's side; whether it is kept is judged in `tests/regret_budget.rs`.

use super::*;

#[test]
fn who_cannot_stop_explores_only_once_the_worst_case_is_earned() {
    let policy = Policy { regret_budget: Some(0.1), worst_factor: 20.0, ..explore_always() };
    let mut tuner = tuner(policy);
    let modes: Vec<Mode> = run(&mut tuner, "a", 0.5, 0.5, 260).iter().map(|trial| trial.mode).collect();
    // 200 frames earn 20.
    let first = modes.iter().position(|mode| *mode == Mode::Explore).expect("at last");
    assert!((200..=202).contains(&first), "{first}");
}

#[test]
fn answers_explain_the_budget_and_sessions_begin_anew() {
    let policy = Policy { regret_budget: Some(0.1), abort_above: Some(1.5), ..explore_always() };
    let mut tuner = tuner(policy);
    let question = |session| Ask { session, can_abort: true, ..ask("a", 0.5, 0.5) };
    let mut trials = Vec::new();
    for _ in 0..40 {
        let trial = tuner.suggest(&question(1), 0).expect("valid").0;
        trials.push(finish(&mut tuner, &trial, Outcome::Ok));
    }
    assert_eq!(trials[0].mode, Mode::Default);
    assert_eq!(trials[0].reason.explanation.rule, Some(Rule::Budget));
    let first = trials.iter().find(|trial| trial.mode == Mode::Explore).expect("fifteen frames earn a cap");
    let explanation = &first.reason.explanation;
    assert_eq!(explanation.rule, Some(Rule::Explore));
    let reference = explanation.reference_cost.expect("measured");
    assert_eq!(explanation.abort_above, Some(1.5 * reference));
    assert_eq!(explanation.set_aside, explanation.abort_above);
    assert!(explanation.budget_left >= explanation.set_aside);
    let next = tuner.suggest(&question(2), 0).expect("valid").0;
    assert_ne!(next.mode, Mode::Explore);
    assert_eq!(next.reason.explanation.budget_left, Some(0.0));
}

#[test]
fn an_infeasible_default_leaves_nothing_but_exploring() {
    let mut tuner = tuner(Policy { regret_budget: Some(0.05), ..explore_always() });
    let first = suggest(&mut tuner, "a", 0.5, 0.5);
    finish(&mut tuner, &first, infeasible());
    assert_eq!(suggest(&mut tuner, "a", 0.5, 0.5).mode, Mode::Explore);
}
