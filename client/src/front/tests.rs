//! Fronts against brute force, and histories that are interrupted.

use treewright_proto::v1;

use super::*;
use crate::wire::trial_from_wire;

/// Evenly distributed numbers, 0 to 1 (Vigna's SplitMix64).
struct Dice(u64);

impl Dice {
    fn throw(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Few different values, so that ties are met.
    fn points(&mut self, count: usize, dimensions: usize) -> Vec<Vec<f64>> {
        let mut value = || (1.0 + 7.0 * self.throw()).floor() / 8.0;
        (0..count).map(|_| (0..dimensions).map(|_| value()).collect()).collect()
    }
}

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
fn metrics_are_names_or_reciprocals() {
    assert_eq!(front().metrics().collect::<Vec<_>>(), ["time_ms", "rate"]);
    for wrong in [&["a"][..], &["a", "b", "c", "d"], &["a", "1/a"], &["a", "2/b"], &["a", Front::COST]] {
        assert!(Front::new(wrong).is_err(), "{wrong:?}");
    }
    for metrics in [&["a", "b"][..], &["a", "b", "c"]] {
        let front = Front::new(metrics).expect("good metrics");
        for (direction, weights) in front.weights().iter().enumerate() {
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && weights.len() == metrics.len());
            assert!(direction < metrics.len() || weights.iter().all(|weight| *weight > 0.0));
        }
        assert_eq!(front.range(), 0.0..=if metrics.len() == 2 { 8.0 } else { 6.0 });
    }
}

#[test]
fn non_dominated_points_are_those_of_brute_force() {
    let mut dice = Dice(1);
    for round in 0..300 {
        let points = dice.points(1 + round % 40, 2 + round % 2);
        let dominates = |a: &Vec<f64>, b: &Vec<f64>| a != b && a.iter().zip(b).all(|(a, b)| a <= b);
        let is_best = |index: &usize| !points.iter().any(|other| dominates(other, &points[*index]));
        let mut found = non_dominated(&points);
        assert!(found.windows(2).all(|pair| points[pair[0]] <= points[pair[1]]), "sorted");
        found.sort_unstable();
        assert_eq!(found, (0..points.len()).filter(is_best).collect::<Vec<_>>(), "{points:?}");
    }
}

#[test]
fn the_hypervolume_is_that_of_inclusion_and_exclusion() {
    let mut dice = Dice(2);
    for round in 0..200 {
        let dimensions = 2 + round % 2;
        let points = dice.points(1 + round % 8, dimensions);
        // Boxes from each point to the far corner: what several share begins at their largest values.
        let union: f64 = (1..1_usize << points.len())
            .map(|some| {
                let chosen = || (0..points.len()).filter(|index| some >> index & 1 == 1);
                let begin = |axis: usize| chosen().map(|index| points[index][axis]).fold(0.0, f64::max);
                let volume: f64 = (0..dimensions).map(|axis| 1.0 - begin(axis)).product();
                if chosen().count() % 2 == 1 { volume } else { -volume }
            })
            .sum();
        let borrowed: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
        let exact = hypervolume(&borrowed, dimensions);
        assert!((exact - union).abs() < 1e-12, "{exact} and {union}: {points:?}");
    }
}

#[test]
fn costs_are_positive_and_rise_with_every_metric() {
    let (front, mut dice) = (Front::new(&["a", "b", "c"]).expect("good metrics"), Dice(3));
    for _ in 0..200 {
        let mut metric = || (20.0 * dice.throw() - 10.0).exp();
        let (one, ideal) = ([metric(), metric(), metric()], [metric(), metric(), metric()]);
        for direction in 0..7 {
            let cost = front.cost(direction, &one, Some(&ideal)).expect("a direction");
            assert!(cost > 0.0 && cost.is_finite());
            for axis in 0..3 {
                let mut worse = one;
                worse[axis] *= 1.5;
                let dearer = front.cost(direction, &worse, Some(&ideal)).expect("a direction");
                let counts = direction >= 3 || direction == axis;
                assert!(
                    if counts { dearer > cost } else { dearer == cost },
                    "{direction} {axis}: {dearer} {cost}"
                );
            }
        }
        assert_eq!(front.cost(9, &one, Some(&ideal)), None);
        assert_eq!(front.cost(3, &one, None), None, "an ideal point is needed there");
    }
}

#[test]
fn a_program_that_is_started_again_goes_on_with_the_same_numbers() {
    let mut whole = FrontHistory::new(front(), Vec::new(), 40);
    go_on(&mut whole, 40, false);
    let ran = |direction: usize| whole.runs().filter(|run| front().direction(run) == Some(direction)).count();
    let counts: Vec<usize> = (0..9).map(ran).collect();
    // The metrics themselves have the first quarter alone.
    assert!(counts.iter().all(|count| (4..=5).contains(count)) && counts[..2] == [5, 5], "{counts:?}");
    assert_eq!(whole.trials.len(), 9 * 40, "every direction knows of every run");
    let first: Vec<_> = whole.runs().take(10).filter_map(|run| front().direction(run)).collect();
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
fn a_front_counts_runs_once_and_stands_beside_the_default() {
    let run = |number: usize, level: i64, time_ms: f64, rate: f64, origin: &str| {
        trial(number, 0, level, &Measurements::from([("time_ms", time_ms), ("rate", rate)]), origin)
    };
    let mut trials = vec![
        run(1, 1, 4.0, 10.0, ""),
        run(2, 2, 1.0, 5.0, ""),
        run(3, 2, 3.0, 7.0, "elsewhere/studies/toy@0123456789abcdef/trials/2"),
        run(4, 3, 2.0, 20.0, ""),
        run(5, 4, 3.0, 19.0, ""),
        run(6, 3, 2.0, 20.0, "studies/toy@0123456789abcdef/trials/4"),
    ];
    trials[4].outcome = Some(OpenEnum::Known(Outcome::infeasible("too large")));
    let default = trials[0].configuration.clone();
    let found = front().of(&trials, &default, None);
    // Level 2 has the medians 2 and 6, so level 3 dominates it and the default.
    assert_eq!((found.runs, found.configurations, found.points.len(), found.dominated.len()), (4, 3, 1, 2));
    let best = &found.points[0];
    assert_eq!((best.runs, &best.configuration), (1, &trials[3].configuration));
    let ratios = best.ratios.as_ref().expect("the default was measured");
    assert_eq!((ratios.get("time_ms"), ratios.get("rate")), (Some(0.5), Some(2.0)));
    assert_eq!(found.hypervolume, Some(0.25));
    assert_eq!(found.dominated.iter().map(|point| point.runs).sum::<usize>(), 3);
    let far = front().of(&trials, &default, Some(&[8.0, 5.0]));
    assert_eq!(far.hypervolume, Some(0.75 * 0.75));
    let without = front().of(&trials[1..], &default, None);
    assert_eq!((without.default, without.hypervolume), (None, None));
    assert!(without.points[0].ratios.is_none());
}
