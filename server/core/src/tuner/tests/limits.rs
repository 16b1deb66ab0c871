//! Limits on measurements: a trial beyond one keeps its measurements and is learnt as infeasible.

use super::*;
use crate::objective::MeasurementLimit;

/// Memory that grows with the width, 10 to 40.
fn memory_mb(trial: &Trial) -> f64 {
    10.0 * trial.configuration.get("width").and_then(Value::as_number).unwrap_or(0.0) / 2.0
}

fn limited(at_most: f64) -> Tuner {
    let mut spec = spec(explore_always());
    let limit = MeasurementLimit { metric: "memory_mb".into(), at_least: None, at_most: Some(at_most) };
    spec.objective = spec.objective.with_limits(vec![limit]).expect("valid");
    Tuner::new(Arc::new(spec)).expect("a valid specification")
}

fn report(tuner: &mut Tuner, trial: &Trial) -> Trial {
    let mut measured = measured(cost(trial));
    measured.insert("memory_mb".into(), memory_mb(trial));
    tuner.report(trial, measured, Outcome::Ok, 1).expect("a valid report").0
}

#[test]
fn what_is_beyond_a_limit_is_infeasible_and_keeps_its_measurements() {
    let mut tuner = limited(15.0);
    let (mut within, mut beyond) = (0, 0);
    for _ in 0..30 {
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        let done = report(&mut tuner, &trial);
        assert_eq!(done.measurements["memory_mb"], memory_mb(&trial));
        match done.outcome.expect("it is done") {
            Outcome::Ok => {
                within += 1;
                assert!(memory_mb(&trial) <= 15.0 && done.cost.is_some());
            }
            Outcome::Infeasible { reason } => {
                beyond += 1;
                assert!(memory_mb(&trial) > 15.0 && done.cost.is_none());
                assert!(reason.contains("memory_mb <= 15"), "{reason}");
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(within > 15 && beyond > 0, "{within} within, {beyond} beyond: the search learns what is allowed");
    // Without the limit the widest is the best.
    let answer = suggest(&mut tuner, "b", 0.5, 0.5);
    assert_eq!(answer.mode(), Mode::Exploit);
    assert!(memory_mb(&answer) <= 15.0);
}

#[test]
fn a_report_without_what_is_limited_is_refused_unless_it_has_no_cost() {
    let mut tuner = limited(15.0);
    let trial = suggest(&mut tuner, "a", 0.5, 0.5);
    let refused = tuner.report(&trial, measured(3.0), Outcome::Ok, 1).expect_err("memory is missing");
    assert!(refused.to_string().contains("\"memory_mb\" is missing"), "{refused}");
    drop(tuner.report(&trial, BTreeMap::new(), infeasible(), 1).expect("nothing was measured"));
    let trial = suggest(&mut tuner, "a", 0.5, 0.5);
    drop(tuner.report(&trial, BTreeMap::new(), Outcome::Aborted { lower_bound: 9.0 }, 1).expect("a bound"));
}
