//! The climb to the highest score.

use super::super::local_search::{
    AxisSweeps, Leaders, Moves, Neighbourhood, NormalSteps, Radii, RandomAxes, ScoredPoint, best, climb,
};
use super::*;

const RADII: Radii = Radii { first: 0.3, last: 0.01 };

/// A cube whose axes are all continuous.
struct Cube;

impl Neighbourhood for Cube {
    fn moved(&self, _axis: usize, x: f64, radius: f64, random: &mut ChaCha8Rng) -> f64 {
        (x + radius * (2.0 * random.random::<f64>() - 1.0)).clamp(0.0, 1.0)
    }
}

fn judged(x: Vec<f64>) -> ScoredPoint<()> {
    let score = -x.iter().enumerate().map(|(axis, x)| (x - 0.2 * (axis + 1) as f64).powi(2)).sum::<f64>();
    ScoredPoint { x, score, detail: () }
}

#[test]
fn all_moves_lead_up_to_the_top() {
    let (mut a, mut b, mut c) = (random(1), random(2), random(3));
    let from = || judged(vec![0.9, 0.9, 0.1]);
    let judge = |x: Vec<f64>, _floor: f64| Some(judged(x));
    let tops = [
        climb(from(), 400, &mut AxisSweeps::new(&Cube, 3, RADII, &mut a), judge),
        climb(from(), 400, &mut RandomAxes::new(&Cube, RADII, &mut b), judge),
        climb(from(), 400, &mut NormalSteps::new(0.3, &mut c), judge),
    ];
    for top in tops {
        assert!(top.score > -1e-3, "{top:?}");
    }
}

#[test]
fn what_is_refused_is_never_reached_and_scores_only_rise() {
    let mut random = random(4);
    let mut moves = AxisSweeps::new(&Cube, 3, RADII, &mut random);
    let mut floors = Vec::new();
    let top = climb(judged(vec![0.9, 0.9, 0.1]), 300, &mut moves, |x, floor| {
        floors.push(floor);
        (x[0] > 0.5).then(|| judged(x))
    });
    assert!(top.x[0] > 0.5 && (top.x[1] - 0.4).abs() < 0.05, "{top:?}");
    assert!(floors.len() == 300 && floors.windows(2).all(|pair| pair[1] >= pair[0]));
    let nothing = climb(ScoredPoint { x: Vec::new(), score: 1.0, detail: () }, 5, &mut moves, |_, _| None);
    assert_eq!(nothing.score, 1.0, "a point without axes stays where it is");
}

#[test]
fn the_leaders_are_the_best_of_all_and_the_first_of_equals() {
    let mut leaders = Leaders::new(2);
    assert_eq!(leaders.floor(), f64::NEG_INFINITY);
    for (score, name) in [(1.0, "a"), (3.0, "b"), (3.0, "c"), (2.0, "d"), (3.0, "e")] {
        leaders.offer(ScoredPoint { x: vec![score], score, detail: name });
    }
    assert!(leaders.floor() == 3.0 && leaders.contains(&[3.0]) && !leaders.contains(&[1.0]));
    let names: Vec<&str> = leaders.into_candidates().iter().map(|candidate| candidate.detail).collect();
    assert_eq!(names, ["b", "c"]);
    let of = |score| ScoredPoint { x: Vec::new(), score, detail: () };
    assert_eq!(best([of(1.0), of(4.0), of(2.0)]).expect("some are finite").score, 4.0);
    assert!(best([of(f64::NEG_INFINITY), of(f64::NAN)]).is_none());
}

#[test]
fn a_change_that_scores_the_same_is_not_kept() {
    let (mut random, mut kept) = (random(7), Vec::new());
    struct Counted<'a, M>(M, &'a mut Vec<bool>);
    impl<M: Moves> Moves for Counted<'_, M> {
        fn change(&mut self, x: &[f64], progress: f64) -> Vec<f64> {
            self.0.change(x, progress)
        }
        fn kept(&mut self, kept: bool) {
            self.1.push(kept);
        }
    }
    let moves = &mut Counted(AxisSweeps::new(&Cube, 2, RADII, &mut random), &mut kept);
    let from = ScoredPoint { x: vec![0.5; 2], score: 1.0, detail: () };
    let top = climb(from, 8, moves, |x, floor| Some(ScoredPoint { x, score: floor, detail: () }));
    assert_eq!((top.x, kept), (vec![0.5; 2], vec![false; 8]));
}

/// Says along which radius it was asked.
struct Echo;

impl Neighbourhood for Echo {
    fn moved(&self, _axis: usize, _x: f64, radius: f64, _random: &mut ChaCha8Rng) -> f64 {
        radius
    }
}

#[test]
fn radii_shrink_geometrically_from_the_first_to_the_last() {
    let mut random = random(8);
    let mut moves = AxisSweeps::new(&Echo, 1, Radii { first: 0.4, last: 0.1 }, &mut random);
    for (progress, radius) in [(0.0, 0.4), (0.5, 0.2), (1.0, 0.1)] {
        assert!((moves.change(&[0.0], progress)[0] - radius).abs() < 1e-12, "{progress}");
    }
}

#[test]
fn a_climb_begins_with_a_sweep_of_its_own_and_each_changes_every_axis_once() {
    let mut random = random(9);
    let mut moves = AxisSweeps::new(&Echo, 6, RADII, &mut random);
    for begun in 0..20 {
        (0..begun % 6).for_each(|_| drop(moves.change(&[0.0; 6], 0.0)));
        moves.begin();
        for _ in 0..2 {
            let changes: Vec<Vec<f64>> = (0..6).map(|_| moves.change(&[0.0; 6], 0.0)).collect();
            let all = (0..6).all(|axis| changes.iter().filter(|changed| changed[axis] != 0.0).count() == 1);
            assert!(all, "{changes:?}");
        }
    }
}

#[test]
fn random_axes_are_one_and_two_in_turn() {
    let mut generator = random(10);
    let mut moves = RandomAxes::new(&Echo, RADII, &mut generator);
    let mut pairs = std::collections::BTreeSet::new();
    for _ in 0..200 {
        let mut changed = || {
            let x = moves.change(&[0.0; 4], 0.0);
            assert_eq!(x.len(), 4);
            (0..4).filter(|axis| x[*axis] != 0.0).collect::<Vec<usize>>()
        };
        assert_eq!(changed().len(), 1);
        let pair = changed();
        assert_eq!(pair.len(), 2, "{pair:?}");
        pairs.insert(pair);
        // A climb always begins with one axis.
        assert_eq!(changed().len(), 1);
        moves.begin();
    }
    assert_eq!(pairs.len(), 6, "{pairs:?}");
    let mut other = random(11);
    let mut alone = RandomAxes::new(&Echo, RADII, &mut other);
    assert!((0..4).all(|_| alone.change(&[0.0], 0.0) == [0.3]), "one axis has no other");
}

#[test]
fn normal_steps_are_normal_and_now_and_then_along_one_axis() {
    let mut random = random(12);
    let mut moves = NormalSteps::new(0.25, &mut random);
    let (mut single, mut steps) = (0, Vec::new());
    for _ in 0..20_000 {
        let moved: Vec<f64> =
            moves.change(&[1.0; 3], 0.0).iter().map(|x| x - 1.0).filter(|x| *x != 0.0).collect();
        assert!([1, 3].contains(&moved.len()));
        single += usize::from(moved.len() == 1);
        steps.extend(moved);
    }
    assert!((5_700..6_300).contains(&single), "{single} of 20,000");
    let deviation = (steps.iter().map(|step| step * step).sum::<f64>() / steps.len() as f64).sqrt();
    assert!((deviation / 0.25 - 1.0).abs() < 0.02, "{deviation}");
    let most = |moves: &mut NormalSteps<'_>| {
        (0..100).flat_map(|_| moves.change(&[0.0; 3], 0.0)).fold(0.0, |most: f64, x| most.max(x.abs()))
    };
    (0..10).for_each(|_| moves.kept(true));
    assert!(most(&mut moves) > 10.0, "they grow with success");
    moves.begin();
    let first = most(&mut moves);
    assert!(first < 2.0, "a climb begins with the first step again: {first}");
    (0..20).for_each(|_| moves.kept(false));
    assert!(most(&mut moves) < 0.5 * first, "and shrink without");
}
