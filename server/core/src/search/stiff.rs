//! Stiff and extreme problems: every search goes on, stays inside the cube, and makes progress where it can.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::registry::METHODS;
use super::*;
use crate::policy::SearchMethod;
use crate::robust::median;

fn setup(dimension: usize, budget: u32, levels: Vec<u32>) -> SearchSetup {
    SearchSetup::plain(11, vec![0.75; dimension], budget, levels)
}

/// Asks and tells, checks every point, and gives back the best cost of a measured point.
fn run(method: SearchMethod, setup: SearchSetup, mut cost: impl FnMut(&[f64]) -> Verdict) -> f64 {
    let (dimension, budget) = (setup.dimension(), setup.budget);
    let mut search = AnySearch::new(method, setup);
    let mut best = f64::INFINITY;
    for _ in 0..budget {
        let point = search.ask().expect("nothing is out");
        assert_eq!(point.x.len(), dimension);
        assert!(point.x.iter().all(|x| (0.0..=1.0).contains(x)), "{method:?}: {:?}", point.x);
        let verdict = cost(&point.x);
        if let Verdict::Cost(cost) = verdict {
            best = best.min(cost);
        }
        search.tell(point.id, Feedback { verdict, fresh: true });
    }
    best
}

fn ellipsoid(x: &[f64], condition: f64) -> f64 {
    let last = (x.len() - 1) as f64;
    let term = |(axis, x): (usize, &f64)| condition.powf(axis as f64 / last) * (x - 0.4).powi(2);
    x.iter().enumerate().map(term).sum()
}

/// McKinnon's function, on which the plain simplex method contracts to a point that is no minimum (SIAM
/// Journal on Optimization 9, 1998), over -1.5 to 1.5. Its minimum is -0.25.
fn mckinnon(x: &[f64]) -> f64 {
    let (a, b) = (3.0 * x[0] - 1.5, 3.0 * x[1] - 1.5);
    let weight = if a <= 0.0 { 360.0 } else { 6.0 };
    weight * a * a + b + b * b
}

#[test]
fn where_nothing_can_be_run_every_search_goes_on() {
    for &method in METHODS {
        assert_eq!(run(method, setup(6, 60, vec![2, 0, 5]), |_| Verdict::Infeasible), f64::INFINITY);
    }
}

#[test]
fn a_search_that_only_meets_infeasible_points_looks_everywhere() {
    let mut reached = [[false; 4]; 4];
    run(SearchMethod::NelderMead, SearchSetup::plain(5, vec![0.5; 4], 120, Vec::new()), |x| {
        for (axis, x) in x.iter().enumerate() {
            reached[axis][((x * 4.0) as usize).min(3)] = true;
        }
        Verdict::Infeasible
    });
    assert_eq!(reached, [[true; 4]; 4]);
}

#[test]
fn spaces_of_one_point_and_of_a_few_are_asked_again_and_again() {
    for &method in METHODS {
        assert_eq!(run(method, setup(1, 30, vec![1]), |_| Verdict::Cost(2.0)), 2.0);
        let cost = |x: &[f64]| Verdict::Cost(f64::from(u8::from(x[0] < 0.5) + u8::from(x[1] < 0.5)));
        assert_eq!(run(method, setup(2, 30, vec![2, 2]), cost), 0.0, "{method:?}");
    }
}

#[test]
fn plateaus_and_extreme_costs_leave_every_point_in_the_cube() {
    for &method in METHODS {
        for cost in [0.0, f64::MIN_POSITIVE / 4.0, 1e-300, -3.0, 1e300, f64::MAX] {
            run(method, setup(3, 40, Vec::new()), |_| Verdict::Cost(cost));
        }
        // From a billionth to a million, with the largest doubles among them, and of either sign.
        let spanning = |x: &[f64]| match x[0] {
            x if x > 0.99 => Verdict::Cost(f64::MAX),
            x if x < 0.01 => Verdict::AtLeast(f64::MAX / 2.0),
            x => Verdict::Cost(1e-9 * 1e15f64.powf(x)),
        };
        assert!(run(method, setup(2, 60, Vec::new()), spanning) < 1e-3, "{method:?}");
        let signed = |x: &[f64]| Verdict::Cost(if x[0] > 0.5 { f64::MAX } else { -f64::MAX * x[1] });
        run(method, setup(2, 60, Vec::new()), signed);
    }
}

#[test]
fn directions_that_do_not_matter_and_a_hundred_dimensions_do_no_harm() {
    for method in [SearchMethod::Model, SearchMethod::NelderMead] {
        let two = |x: &[f64]| Verdict::Cost(1.0 + (x[3] - 0.3).powi(2) + (x[7] - 0.6).powi(2));
        assert!(run(method, setup(10, 80, Vec::new()), two) < 1.05, "{method:?}");
        let bowl = |x: &[f64]| Verdict::Cost(ellipsoid(x, 1.0));
        let default = ellipsoid(&[0.75; 100], 1.0);
        assert!(run(method, setup(100, 40, Vec::new()), bowl) <= default, "{method:?}");
    }
}

#[test]
fn the_model_finds_its_way_where_a_plain_simplex_stalls() {
    let run =
        |setup, cost: &dyn Fn(&[f64]) -> f64| run(SearchMethod::Model, setup, |x| Verdict::Cost(cost(x)));
    let stall = run(setup(2, 80, Vec::new()), &mckinnon);
    assert!(stall < -0.15, "{stall}");
    let rosenbrock = |x: &[f64]| {
        let (a, b) = (4.0 * x[0] - 2.5, 4.0 * x[1] - 2.5);
        100.0 * (a * a - b).powi(2) + (1.0 - a).powi(2)
    };
    let valley = run(setup(2, 80, Vec::new()), &rosenbrock);
    assert!(valley < 1.0, "{valley}");
    let narrow = run(setup(5, 80, Vec::new()), &|x| ellipsoid(x, 1e12));
    assert!(narrow < 1e-3 * ellipsoid(&[0.75; 5], 1e12), "{narrow}");
}

#[test]
fn noise_as_large_as_the_signal_does_not_mislead_for_ever() {
    let end = |seed| {
        let mut noise = ChaCha8Rng::seed_from_u64(seed);
        let mut search =
            AnySearch::new(SearchMethod::Model, SearchSetup { seed, ..setup(3, 80, Vec::new()) });
        let mut tail = 0.0;
        for trial in 0..80 {
            let point = search.ask().expect("nothing is out");
            let truth = 1.0 + ellipsoid(&point.x, 1.0);
            tail += if trial >= 60 { truth / 20.0 } else { 0.0 };
            let cost = truth * (0.5 + noise.random::<f64>());
            search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
        }
        tail
    };
    let mut ends: Vec<f64> = (0..9).map(end).collect();
    // The default costs 1.37, a random point 1.28 on average.
    assert!(median(&mut ends) < 1.25, "{ends:?}");
}

#[test]
fn the_kept_state_of_a_model_is_bounded() {
    let mut search = AnySearch::new(SearchMethod::Model, setup(2, 10_000, vec![0, 3]));
    let mut sizes = Vec::new();
    for trial in 0..640 {
        // Points come from the tail of a cheap search: only the stored state counts here.
        let point = search.ask().expect("nothing is out");
        let cost = 1.0 + (trial % 17) as f64;
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
        if trial % 20 == 19 {
            sizes.push(serde_json::to_string(&search).expect("plain data").len());
        }
    }
    assert!(sizes[31] < sizes[26] + sizes[26] / 20, "{sizes:?}");
}

#[test]
fn cliffs_and_regions_that_cannot_be_measured_are_gone_around() {
    // A cliff a thousand times as high runs beside the optimum, and a band across the way has no value.
    let cost = |x: &[f64]| match x {
        [a, b, ..] if (a - b).abs() > 0.25 && (a - b).abs() < 0.3 => Verdict::Infeasible,
        [a, ..] if *a < 0.35 => Verdict::Cost(1000.0 + a),
        _ => Verdict::Cost(1.0 + ellipsoid(x, 10.0)),
    };
    for method in [SearchMethod::Model, SearchMethod::NelderMead] {
        let found = run(method, setup(3, 80, Vec::new()), cost);
        let limit = if method == SearchMethod::NelderMead { 1.3 } else { 1.02 };
        assert!(found < limit, "{method:?}: {found}");
    }
}

#[test]
fn equal_costs_and_collapsed_simplices_do_not_end_the_search() {
    for &method in METHODS {
        let mut trial = 0;
        let mut late = Vec::new();
        // Sixty measurements that are all alike, then a bowl along one axis alone.
        let found = run(method, setup(4, 140, Vec::new()), |x| {
            trial += 1;
            if trial > 60 {
                late.push(x.to_vec());
            }
            Verdict::Cost(if trial <= 60 { 2.0 } else { 1.0 + (x[2] - 0.2).powi(2) })
        });
        assert!(found < 1.05, "{method:?}: {found}");
        for axis in 0..4 {
            let (low, high) =
                late.iter().fold((1.0f64, 0.0f64), |(low, high), x| (low.min(x[axis]), high.max(x[axis])));
            assert!(high - low > 0.01, "{method:?} is flat along axis {axis}: {low} to {high}");
        }
    }
}

#[test]
fn points_do_not_depend_on_the_unit_of_a_parameter() {
    use crate::space::{Domain, Parameter, Scale, Space};
    let space = |scale: f64, origin: f64| {
        let range = || Domain::Float { min: origin, max: origin + scale, scale: Scale::Linear };
        let one = |index: usize| Parameter::new(format!("x{index}"), range(), origin + 0.75 * scale);
        Space::new((0..3).map(one).collect(), Vec::new()).expect("valid")
    };
    for &method in METHODS {
        let points = |space: &Space| {
            let mut points = Vec::new();
            let layout = Layout::of(space);
            run(method, SearchSetup { layout, ..setup(3, 60, Vec::new()) }, |x| {
                points.push(x.to_vec());
                Verdict::Cost(1.0 + ellipsoid(x, 10.0))
            });
            points
        };
        let plain = points(&space(1.0, 0.0));
        for (scale, origin) in [(1e-9, 5.0e-9), (1e12, -3e11), (2.0, 1024.0)] {
            assert_eq!(plain, points(&space(scale, origin)), "{method:?}: {scale} from {origin}");
        }
    }
}

/// The best gap after eighty measurements of a bowl with `out` points pending, some of which never come back.
fn in_flight(method: SearchMethod, out: usize, seed: u64) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut search = AnySearch::new(method, SearchSetup { seed, ..setup(3, 80, Vec::new()) });
    let (mut flying, mut best, mut measured): (Vec<Point>, f64, u32) = (Vec::new(), f64::INFINITY, 0);
    while measured < 80 {
        while flying.len() < out {
            let Some(point) = search.ask() else { break };
            assert!(flying.iter().all(|other| other.id != point.id && other.x != point.x), "{method:?}");
            flying.push(point);
        }
        assert!(!flying.is_empty(), "{method:?} waits for nobody");
        let point = flying.swap_remove(random.random_range(0..flying.len()));
        if random.random::<f64>() < 0.1 {
            search.withdraw(point.id);
            continue;
        }
        let gap = ellipsoid(&point.x, 30.0);
        best = best.min(gap);
        let cost = (1.0 + gap) * (1.0 + 0.02 * random.random::<f64>());
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
        measured += 1;
    }
    best
}

#[test]
fn four_and_eight_clients_find_what_one_finds() {
    for method in [SearchMethod::Model, SearchMethod::NelderMead] {
        let middle =
            |method, out| median(&mut (0..9).map(|seed| in_flight(method, out, seed)).collect::<Vec<_>>());
        let random = middle(SearchMethod::Random, 8);
        for out in [4, 8] {
            let found = middle(method, out);
            assert!(found < 0.25 * random, "{method:?} with {out}: {found}, random {random}");
        }
    }
}

#[test]
fn bounds_of_trials_that_were_stopped_are_no_news_of_improvement() {
    for &method in METHODS {
        // Every point worse than 1.3 times the best so far is stopped there.
        let mut best = f64::INFINITY;
        let found = run(method, setup(4, 80, Vec::new()), |x| {
            let cost = 1.0 + ellipsoid(x, 10.0);
            let bound = 1.3 * best;
            best = best.min(cost);
            if cost > bound { Verdict::AtLeast(bound) } else { Verdict::Cost(cost) }
        });
        let limit = if method == SearchMethod::Model { 1.02 } else { 1.6 };
        assert!(found < limit, "{method:?}: {found}");
    }
}
