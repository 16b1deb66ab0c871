//! Histories of a front that are interrupted, and the runs that count.

use treewright_proto::v1;

use super::*;
use crate::wire::trial_from_wire;

fn front() -> Front {
    Front::new(&["time_ms", "1/rate"]).expect("good metrics")
}

/// A trial of a program whose time falls and whose rate falls with the level.
fn trial(number: usize, direction: usize, level: i64, measured: &Measurements, origin: &str) -> TrialRecord {
    let level = v1::Value { kind: Some(v1::value::Kind::Integer(level)) };
    let wire = v1::Trial {
        name: format!("studies/toy@0123456789abcdef/trials/{number}"),
        client_id: "tester".into(),
        indicators: [(Front::DIRECTION.to_owned(), direction as f64)].into(),
        configuration: Some(v1::Configuration { values: [("level".to_owned(), level)].into() }),
        measurements: measured.0.clone(),
        outcome: Some(v1::Outcome { kind: Some(v1::outcome::Kind::Ok(v1::Ok {})) }),
        origin: origin.to_owned(),
        ..v1::Trial::default()
    };
    trial_from_wire(wire).expect("a good trial")
}

fn measured(level: i64) -> Measurements {
    Measurements::from([("time_ms", 100.0 / level as f64), ("rate", 1000.0 / (level * level) as f64)])
}

/// Runs as a program does until the history has `runs` runs. Carrying results over may be interrupted.
fn go_on(history: &mut FrontHistory, runs: usize, interrupted: bool) {
    while history.runs().count() < runs {
        let direction = history.next_direction().expect("nothing is over");
        let (number, level) = (history.trials.len() + 1, 1 + (history.runs().count() as i64 * 7) % 10);
        let open = trial(number, direction, level, &Measurements::new(), "");
        let with_cost = history.with_cost(&open, measured(level)).expect("good measurements");
        history.push(trial(number, direction, level, &with_cost, ""));
        let owed = history.owed();
        let carried = if interrupted && history.runs().count() == runs { owed.len() / 2 } else { owed.len() };
        carry(history, owed, carried);
    }
}

fn carry(history: &mut FrontHistory, owed: Vec<(Question, Measurements, Outcome)>, count: usize) {
    for (question, measured, outcome) in owed.into_iter().take(count) {
        assert_eq!(outcome, Outcome::Ok);
        let direction = question.indicators.get(Front::DIRECTION).expect("a direction") as usize;
        let level = match question.wanted.expect("a configuration").get("level") {
            Some(crate::Value::Integer(level)) => *level,
            other => panic!("{other:?}"),
        };
        let origin = question.origin.expect("an origin");
        history.push(trial(history.trials.len() + 1, direction, level, &measured, &origin));
    }
}

#[test]
fn a_program_that_is_started_again_goes_on_with_the_same_numbers() {
    let mut whole = FrontHistory::new(front(), Vec::new(), 40);
    go_on(&mut whole, 40, false);
    let ran = |direction: usize| whole.runs().filter(|run| whole.direction(run) == Some(direction)).count();
    let counts: Vec<usize> = (0..9).map(ran).collect();
    // The metrics themselves have the first quarter alone.
    assert!(counts.iter().all(|count| (4..=5).contains(count)) && counts[..2] == [5, 5], "{counts:?}");
    assert_eq!(whole.trials.len(), 9 * 40, "every direction knows of every run");
    let first: Vec<_> = whole.runs().take(10).filter_map(|run| whole.direction(run)).collect();
    assert!(first.iter().all(|direction| *direction < 2), "the metrics themselves first: {first:?}");
    for stop in [3, 9, 10, 11, 25] {
        let mut begun = FrontHistory::new(front(), Vec::new(), 40);
        go_on(&mut begun, stop, true);
        // Once the ideal point is fixed, another number of planned runs does not move it.
        let planned = if stop < 10 { 40 } else { 400 };
        let mut again = FrontHistory::new(front(), begun.trials, planned);
        let owed = again.owed();
        carry(&mut again, owed, usize::MAX);
        go_on(&mut again, 40, false);
        let sorted = |history: &FrontHistory| {
            let printed = |trial: &TrialRecord| {
                format!("{:?} {} {:?}", trial.indicators, trial.configuration, trial.measurements)
            };
            let mut all: Vec<_> = history.trials.iter().map(printed).collect();
            all.sort();
            all
        };
        assert_eq!(sorted(&again), sorted(&whole), "stopped after {stop}");
        assert!(again.owed().is_empty());
    }
}

#[test]
fn a_front_counts_each_run_once() {
    let run = |number: usize, level: i64, origin: &str| trial(number, 0, level, &measured(level), origin);
    let mut trials = [
        run(1, 1, ""),
        run(2, 2, "elsewhere/studies/toy@0123456789abcdef/trials/2"),
        run(3, 3, ""),
        run(4, 2, "studies/toy@0123456789abcdef/trials/2"),
    ];
    trials[2].outcome = Some(OpenEnum::Known(Outcome::infeasible("too large")));
    let default = trials[0].configuration.clone();
    let found = front().of(trials.iter().filter_map(TrialRecord::measured_run), &default, None);
    assert_eq!((found.runs, found.configurations, found.points.len()), (2, 2, 2));
    assert!(trials.iter().map(TrialRecord::repeats_a_run).eq([false, false, false, true]));
    // Where there are no directions, it was carried over from another study of the database.
    trials[3].indicators = Indicators::from([("triangles", 5.0)]);
    assert!(trials[3].measured_run().is_some());
}

#[test]
fn a_history_leaves_out_what_is_excluded_with_its_repetitions_and_cheaper_levels() {
    let run = |number: usize, level: i64, origin: &str| trial(number, 0, level, &measured(level), origin);
    let mut trials = vec![
        run(1, 1, ""),
        run(2, 2, ""),
        run(3, 3, ""),
        run(4, 1, "studies/toy@0123456789abcdef/trials/1"),
        run(5, 2, "studies/toy@0123456789abcdef/trials/2"),
    ];
    trials[0].exclusion = Some("the machine was busy".to_owned());
    trials[2].fidelity = Some("small".to_owned());
    let history = FrontHistory::new(front(), trials, 8);
    let numbers: Vec<_> = history.trials().iter().filter_map(TrialRecord::number).collect();
    assert_eq!(numbers, [2, 5]);
    let told = history.owed();
    assert_eq!(told.len(), 1, "the second metric's direction of the one run that counts: {told:?}");
}

#[test]
fn a_repeat_that_was_excluded_by_itself_is_not_made_again() {
    let mut trials = vec![
        trial(1, 0, 1, &measured(1), ""),
        trial(2, 1, 1, &measured(1), "studies/toy@0123456789abcdef/trials/1"),
    ];
    trials[1].exclusion = Some("it ran while the machine was busy".to_owned());
    let history = FrontHistory::new(front(), trials.clone(), 80);
    assert_eq!((history.runs().count(), history.owed().len()), (1, 0));
    trials.truncate(1);
    assert_eq!(FrontHistory::new(front(), trials, 80).owed().len(), 1, "one that is missing is made");
}

#[test]
fn a_metric_that_cannot_be_weighed_is_named() {
    let history = FrontHistory::new(front(), Vec::new(), 8);
    let open = trial(1, 0, 1, &Measurements::new(), "");
    let least = f64::from_bits(1);
    for rate in [None, Some(0.0), Some(f64::INFINITY), Some(f64::NAN), Some(least)] {
        let mut measured = Measurements::from([("time_ms", 1.0)]);
        measured.0.extend(rate.map(|rate| ("rate".to_owned(), rate)));
        let error = history.with_cost(&open, measured).expect_err("it cannot be weighed").to_string();
        assert!(error.contains("`rate`") && error.contains("finite and above 0"), "{rate:?}: {error}");
    }
}
