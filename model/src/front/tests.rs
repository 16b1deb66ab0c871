//! Fronts against brute force.

use super::*;

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

fn numbers(values: &[(&str, f64)]) -> BTreeMap<String, f64> {
    values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

#[test]
fn metrics_are_names_or_reciprocals() {
    assert_eq!(
        Front::new(&["time_ms", "1/rate"]).expect("good metrics").metrics().collect::<Vec<_>>(),
        ["time_ms", "rate"]
    );
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
fn a_study_of_a_front_is_known_by_its_name() {
    let front = Front::new(&["time_ms", "1/rate"]).expect("good metrics");
    assert_eq!(front.study_name(), "front of time_ms, 1/rate");
    assert_eq!(Front::of_study(&front.study_name()), Some(front));
    for other in ["", "front of", "front of a", "front of the house, its back", "Front of a, b"] {
        assert_eq!(Front::of_study(other), None, "{other:?}");
    }
    assert_eq!(Front::repeated_run("studies/toy@0123456789abcdef/trials/17"), Some(17));
    for other in ["", "elsewhere/studies/toy/trials/17", "studies/toy/trials/x"] {
        assert_eq!(Front::repeated_run(other), None, "{other:?}");
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

/// In quadratic time this does not end.
#[test]
fn a_large_front_is_measured_at_once() {
    let count = 100_000_u32;
    let points: Vec<Vec<f64>> =
        (1..=count).map(|each| vec![f64::from(each) / f64::from(count), 1.0 / f64::from(each)]).collect();
    assert_eq!(non_dominated(&points).len(), points.len());
    let borrowed: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
    let staircase: f64 = (1..count).map(|each| (1.0 - 1.0 / f64::from(each)) / f64::from(count)).sum();
    assert!((hypervolume(&borrowed, 2) - staircase).abs() < 1e-9);
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
fn a_front_stands_beside_the_default_and_has_a_staircase() {
    let front = Front::new(&["time_ms", "1/rate"]).expect("good metrics");
    let levels: Vec<Assignment> = (1..=5).map(|level| Assignment::new().with("level", level)).collect();
    let measured: Vec<_> = [(4.0, 10.0), (1.0, 5.0), (3.0, 7.0), (2.0, 20.0), (1.5, 0.0)]
        .map(|(time_ms, rate)| numbers(&[("time_ms", time_ms), ("rate", rate)]))
        .into();
    // The second level ran twice; the last run measured no rate above 0.
    let ran = [(0, 0), (1, 1), (1, 2), (2, 3), (3, 4)].map(|(level, run)| (&levels[level], &measured[run]));
    let found = front.of(ran, &levels[0], None);
    // Its medians are 2 and 6, so that the third level dominates it and the default.
    assert_eq!((found.runs, found.configurations, found.points.len(), found.dominated.len()), (4, 3, 1, 2));
    let best = &found.points[0];
    assert_eq!((best.runs, &best.configuration), (1, &levels[2]));
    assert_eq!(best.ratios, Some(numbers(&[("time_ms", 0.5), ("rate", 2.0)])));
    assert_eq!(found.hypervolume, Some(0.25));
    assert_eq!(front.of(ran, &levels[0], Some(&[8.0, 5.0])).hypervolume, Some(0.75 * 0.75));
    let without = front.of(ran, &levels[4], None);
    assert_eq!((&without.default, without.hypervolume, &without.points[0].ratios), (&None, None, &None));

    let single = front.of([0, 1, 2, 3].map(|run| (&levels[run], &measured[run])), &levels[0], None);
    let corners = single.corners(["time_ms", "rate"]);
    assert_eq!(corners, [[1.0, 5.0], [2.0, 20.0]], "the fast first, then the one of the higher rate");
    assert_eq!(single.corners(["rate", "time_ms"]), [[20.0, 2.0], [5.0, 1.0]]);
    assert_eq!(single.title("rate"), "rate (higher is better)");
    assert_eq!(single.title("time_ms"), "time_ms (lower is better)");
}

#[test]
fn of_three_metrics_two_have_a_staircase_of_fewer_points() {
    let front = Front::new(&["a", "b", "c"]).expect("good metrics");
    let levels: Vec<Assignment> = (1..=3).map(|level| Assignment::new().with("level", level)).collect();
    let measured: Vec<_> = [[1.0, 3.0, 3.0], [2.0, 4.0, 1.0], [3.0, 1.0, 2.0]]
        .map(|[a, b, c]| numbers(&[("a", a), ("b", b), ("c", c)]))
        .into();
    let found = front.of(levels.iter().zip(&measured), &levels[0], None);
    assert_eq!(found.points.len(), 3);
    assert_eq!(found.corners(["a", "b"]), [[1.0, 3.0], [3.0, 1.0]]);
    assert_eq!(found.corners(["a", "c"]), [[1.0, 3.0], [2.0, 1.0]]);
}
