//! The regret budget from the client's side; whether it is kept is judged in `tests/regret_budget.rs`.

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::randomness::standard_normal;
use crate::session::SessionPolicy;
use crate::testing::cases;

#[test]
fn who_cannot_stop_explores_only_once_the_worst_case_is_earned() {
    let policy = Policy { regret_budget: Some(0.1), worst_factor: 20.0, ..explore_always() };
    let mut tuner = tuner(policy);
    let modes: Vec<Mode> = run(&mut tuner, "a", 0.5, 0.5, 260).iter().map(|trial| trial.mode()).collect();
    // 200 frames earn 20.
    let first = modes.iter().position(|mode| *mode == Mode::Explore).expect("at last");
    assert!((200..=202).contains(&first), "{first}");
}

#[test]
fn who_can_stop_is_told_when_also_where_no_budget_is_kept() {
    let mut tuner = tuner(explore_always());
    let question = |session_policy| Ask { can_abort: true, session_policy, ..ask("a", 0.5, 0.5) };
    let first = tuner.suggest(&question(SessionPolicy::default()), 0).expect("valid").0;
    assert_eq!(first.decision.abort_above(), None, "there is nothing to compare with");
    finish(&mut tuner, &first, Outcome::Ok);
    let wishes = SessionPolicy { abort_above: Some(2.0), ..SessionPolicy::default() };
    for (factor, session_policy) in [(4.0, SessionPolicy::default()), (2.0, wishes)] {
        let trial = tuner.suggest(&question(session_policy), 0).expect("valid").0;
        assert_eq!(trial.mode(), Mode::Explore);
        let explanation = trial.reason().explanation;
        let reference = explanation.reference_cost.expect("it was measured");
        assert_eq!(explanation.abort_above, Some(factor * reference));
        assert!((reference / cost(&first) - 1.0).abs() < 1e-9, "{reference} is the only cost");
        assert!(tuner.abandon(&trial).is_ok());
    }
    let other = suggest(&mut tuner, "b", 0.5, 0.5);
    assert_eq!((other.mode(), other.decision.abort_above()), (Mode::Explore, None), "it cannot stop");
}

#[test]
fn who_stops_is_told_later_on_a_machine_that_became_slower() {
    let mut tuner = tuner(Policy { track_speed: true, trials_per_state: 80, ..explore_always() });
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut caps = Vec::new();
    for number in 0..60 {
        let question = Ask { can_abort: true, ..ask("a", 0.5, 0.5) };
        let trial = tuner.suggest(&question, 0).expect("valid").0;
        caps.extend(trial.decision.abort_above().map(|cap| (number, cap)));
        let slowness = if number < 15 { 1.0 } else { 3.0 };
        let seen = cost(&trial) * slowness * (1.0 + 0.02 * standard_normal(&mut random));
        let _ = tuner.report(&trial, measured(seen), Outcome::Ok, 1).expect("valid");
    }
    let least = |from: usize, to: usize| {
        let own = caps.iter().filter(|(number, _)| (from..to).contains(number));
        own.map(|(_, cap)| *cap).fold(f64::INFINITY, f64::min)
    };
    let (before, after) = (least(0, 15), least(40, 60));
    assert!(before.is_finite() && after.is_finite(), "{caps:?}");
    // The best becomes better meanwhile, by less than that.
    assert!(after > before, "{after} after {before}");
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
    assert_eq!(trials[0].mode(), Mode::Default);
    assert_eq!(trials[0].reason().explanation.rule, Some(Rule::Budget));
    let first = trials.iter().find(|trial| trial.mode() == Mode::Explore).expect("fifteen frames earn a cap");
    let explanation = first.reason().explanation;
    assert_eq!(explanation.rule, Some(Rule::Explore));
    let reference = explanation.reference_cost.expect("measured");
    assert_eq!(explanation.abort_above, Some(1.5 * reference));
    assert_eq!(explanation.set_aside, explanation.abort_above);
    assert!(explanation.budget_left >= explanation.set_aside);
    let next = tuner.suggest(&question(2), 0).expect("valid").0;
    assert_ne!(next.mode(), Mode::Explore);
    assert_eq!(next.reason().explanation.budget_left, Some(0.0));
}

#[test]
fn a_trial_that_its_client_never_hears_of_is_not_charged() {
    let policy = Policy { regret_budget: Some(0.1), abort_above: Some(1.5), ..explore_always() };
    let mut tuner = tuner(policy);
    let question = Ask { can_abort: true, ..ask("a", 0.5, 0.5) };
    let trial = loop {
        let trial = tuner.suggest(&question, 0).expect("valid").0;
        if trial.decision.explores() {
            break trial;
        }
        finish(&mut tuner, &trial, Outcome::Ok);
    };
    let left = trial.reason().explanation.budget_left.expect("it has a budget");
    let now_left = |tuner: &Tuner| tuner.clients.visits.account("a").expect("it has a budget").left(0.1);
    assert!(now_left(&tuner) < left, "it is set aside");
    tuner.clients.forgo(&trial);
    let default = tuner.spec.space.default_configuration();
    let (instead, change) = tuner.suggest_wanted(&question, default.to_raw(), None, 0).expect("valid");
    assert!(change.trials.iter().any(|one| one.number == trial.number && one.state != TrialState::Open));
    assert!(instead.number > trial.number && change.visits.len() == 1);
    assert!((now_left(&tuner) - left).abs() < 1e-9, "{} of {left} are left", now_left(&tuner));
}

#[test]
fn an_infeasible_default_leaves_nothing_but_exploring() {
    let mut tuner = tuner(Policy { regret_budget: Some(0.05), ..explore_always() });
    let first = suggest(&mut tuner, "a", 0.5, 0.5);
    finish(&mut tuner, &first, infeasible());
    assert_eq!(suggest(&mut tuner, "a", 0.5, 0.5).mode(), Mode::Explore);
}

/// A race of some frames on a budget of 0.5, in which everything costs 10 and the incumbent, which is not the
/// default, 30, or in its runs what `cost_of` says. `look` sees each trial, and whether it is such a run.
fn race(frames: u32, cost_of: impl Fn(u32) -> f64, mut look: impl FnMut(&Trial, bool)) {
    use crate::tuner::knowledge::Stored;
    let policy =
        Policy { regret_budget: Some(0.5), abort_above: Some(2.0), confirm_rounds: 10, ..explore_always() };
    let mut tuner = tuner(Policy { trials_per_state: 8, ..policy });
    let question = Ask { can_abort: true, ..ask("a", 0.5, 0.5) };
    let (mut incumbent, mut runs) = (None, 0);
    for frame in 0..frames {
        let trial = tuner.suggest(&question, 0).expect("valid").0;
        let is_dear = incumbent.as_ref() == Some(&trial.configuration);
        let is_run = is_dear && trial.reason().explanation.rule == Some(Rule::Confirming);
        look(&trial, is_run);
        if incumbent.is_none() && trial.mode() == Mode::Explore {
            // As if it were the best of other states.
            incumbent = Some(trial.configuration.clone());
            let own = tuner.searches.change(StateId(1)).expect("a search was begun");
            own.confirmed = incumbent.clone().map(Stored);
            for _ in 0..2 {
                let wanted = trial.configuration.to_raw();
                let wanted = tuner.suggest_wanted(&ask("w", 0.5, 0.5), wanted, None, 0).expect("valid").0;
                assert!(tuner.report(&wanted, measured(30.0), Outcome::Ok, 1).is_ok());
            }
        }
        let is_dear = incumbent.as_ref() == Some(&trial.configuration);
        let usual = match is_dear {
            true if is_run => cost_of(runs),
            true => 30.0,
            false => 10.0,
        };
        runs += u32::from(is_run);
        let render_ms = usual * (1.0 + 0.01 * f64::from(frame % 3));
        assert!(tuner.report(&trial, measured(render_ms), Outcome::Ok, 1).is_ok());
    }
}

#[test]
fn runs_of_an_incumbent_that_does_clearly_worse_are_charged() {
    let (mut runs, mut charged) = (0, 0);
    race(
        400,
        |_| 30.0,
        |trial, is_run| {
            if is_run {
                let explanation = trial.reason().explanation;
                runs += 1;
                charged += u32::from(explanation.set_aside.is_some());
                assert_eq!(explanation.abort_above, None, "a race runs it to its end");
            }
        },
    );
    assert!(runs > 0 && charged == runs, "{charged} of {runs}");
}

proptest! {
    #![proptest_config(cases(12))]

    /// The worst factor is 100, and a frame of 10 earns 5: a run is made up for after 200 frames, and four
    /// more earn the next cap of 20.
    #[test]
    fn no_run_of_an_incumbent_stops_exploring_for_ever(stalled in 0..3_u32, factor in 1.0..1e12) {
        let (mut runs, mut pause, mut longest) = (0, 0, 0);
        race(500, |run| if run == stalled { 30.0 * factor } else { 30.0 }, |trial, is_run| {
            let waits = trial.reason().explanation.rule == Some(Rule::Budget);
            pause = if waits { pause + 1 } else { 0 };
            longest = longest.max(pause);
            runs += u32::from(is_run);
        });
        prop_assert!(runs > 0 && longest <= 210, "{longest} frames after {runs} runs");
    }
}

proptest! {
    #![proptest_config(cases(24))]

    /// A client that stops trials reads one frame of its reference wrongly, in its first state or in the
    /// second. More than ten frames later trials are compared with what the reference costs, they go on, and
    /// exploring has cost no more than its share of frames of which that one counts as ten.
    #[test]
    fn one_absurd_frame_of_the_reference_decides_for_no_more_than_ten(
        from in 0..100_usize,
        wild in prop::sample::select(vec![0.0, 1e-300, 1e-9, 1e9, 1.7e15, f64::MAX]),
    ) {
        let policy = Policy { regret_budget: Some(0.1), abort_above: Some(2.0), ..explore_always() };
        let mut tuner = tuner(policy);
        let default = tuner.spec().space.default_configuration();
        let (mut wild_at, mut later, mut regret, mut paid) = (None, 0, 0.0, 0.0);
        for frame in 0..240 {
            let x = if frame < 60 { 0.5 } else { 0.9 };
            let question = Ask { can_abort: true, ..ask("a", x, 0.5) };
            let trial = tuner.suggest(&question, 0).expect("valid").0;
            let is_later = wild_at.is_some_and(|at| frame > at + 10);
            if let Some(reference) = trial.reason().explanation.reference_cost.filter(|_| is_later) {
                // The optimum costs 12.75 and the default up to 34.25.
                prop_assert!((12.0..=35.0).contains(&reference), "{reference:e} in frame {frame}, {wild_at:?}");
            }
            // The client looks at its clock once in a millisecond.
            let cap = trial.decision.abort_above().map_or(f64::INFINITY, |cap| cap.max(1.0));
            let spent = cost(&trial).min(cap);
            paid += spent;
            let explores = trial.mode() == Mode::Explore;
            if explores {
                regret += spent - cost_at(&default, x);
                later += u32::from(is_later);
            }
            let is_wild = wild_at.is_none() && frame >= from && !explores;
            wild_at = if is_wild { Some(frame) } else { wild_at };
            let lower_bound = spent;
            let outcome = if cap < cost(&trial) { Outcome::Aborted { lower_bound } } else { Outcome::Ok };
            let reported = measured(if is_wild { wild } else { spent });
            prop_assert!(tuner.report(&trial, reported, outcome, 1).is_ok());
        }
        prop_assert!(later >= 2, "{later} trials later than {wild_at:?}");
        prop_assert!(regret <= 0.1 * (paid + 10.0 * 34.25), "{regret} of {paid}");
    }
}

/// The longest run of frames in which the budget does not allow the client to explore, where the cost of one
/// exploring trial is read as `wild`: the one after `before` others.
fn longest_wait(policy: Policy, can_abort: bool, before: usize, wild: f64) -> usize {
    let mut tuner = tuner(policy);
    let (mut explored, mut waited, mut longest) = (0, 0, 0);
    for _ in 0..400 {
        let question = Ask { can_abort, ..ask("a", 0.5, 0.5) };
        let trial = tuner.suggest(&question, 0).expect("valid").0;
        let waits = trial.reason().explanation.rule == Some(Rule::Budget);
        waited = if waits { waited + 1 } else { 0 };
        longest = longest.max(waited);
        let cap = trial.decision.abort_above().filter(|_| can_abort).unwrap_or(f64::INFINITY);
        let explores = trial.mode() == Mode::Explore;
        let is_wild = explores && explored == before;
        explored += usize::from(explores);
        let spent = if is_wild { wild } else { cost(&trial).min(cap) };
        let is_stopped = cost(&trial) > cap;
        let outcome = if is_stopped { Outcome::Aborted { lower_bound: spent } } else { Outcome::Ok };
        assert!(tuner.report(&trial, measured(spent), outcome, 1).is_ok());
    }
    assert!(explored > before + 3, "{explored} trials");
    longest
}

/// Who stops trials makes up for a charge of two references, of which one comes back, within ten frames, and
/// earns the next cap within twenty. Who does not is charged twenty, and a frame earns half of one. The
/// reference falls to less than half meanwhile, and so does what a frame earns.
#[test]
fn one_absurd_exploring_trial_uses_up_no_budget() {
    let stops = Policy { regret_budget: Some(0.1), abort_above: Some(2.0), ..explore_always() };
    let runs_on = Policy { regret_budget: Some(0.5), worst_factor: 20.0, ..explore_always() };
    for wild in [1e9, 1.7e15, f64::MAX] {
        for before in [0, 1, 4] {
            let waits = longest_wait(stops.clone(), true, before, wild);
            assert!(waits <= 60, "{waits} frames after {wild:e}, the trial after {before} others");
            let waits = longest_wait(runs_on.clone(), false, before, wild);
            assert!(waits <= 150, "{waits} frames after {wild:e}, the trial after {before} others");
        }
    }
}

#[test]
fn a_trial_that_is_handed_out_again_is_charged_again() {
    let policy = Policy { regret_budget: Some(0.1), abort_above: Some(1.5), ..exploit_always() };
    let mut tuner = tuner(policy);
    let question = Ask { can_abort: true, ..ask("a", 0.9, 0.5) };
    let left = |tuner: &Tuner| {
        let account = tuner.clients.visits.account("a").expect("there is a budget");
        account.left(0.1)
    };
    // Eighty frames of the default elsewhere earn more than four runs.
    run(&mut tuner, "a", 0.5, 0.5, 80);
    assert_eq!(tuner.set_policy(Policy { epsilon: 1.0, ..tuner.spec().policy.clone() }), Ok(false));
    let first = tuner.suggest(&question, 0).expect("valid").0;
    assert_eq!(finish(&mut tuner, &first, Outcome::Ok).mode(), Mode::Default);
    let explored = tuner.suggest(&question, 0).expect("valid").0;
    assert_eq!(explored.mode(), Mode::Explore);
    let worst = explored.reason().explanation.set_aside.expect("there is a budget");
    let mut before = left(&tuner);
    // The report never comes; the client asks again, runs it again, and so on.
    let mut runs = 1;
    loop {
        let again = tuner.suggest(&question, 0).expect("valid").0;
        if again.number != explored.number {
            assert_ne!(again.mode(), Mode::Explore, "nothing is left to explore with");
            break;
        }
        runs += 1;
        assert!((left(&tuner) - (before - worst)).abs() < 1e-9, "charged for the run before");
        before = left(&tuner);
    }
    assert!(runs >= 2 && before < worst, "{runs} runs, {before} left of {worst}");
    assert!((left(&tuner) - before).abs() < 1e-9, "what was set aside last stays charged");
}
