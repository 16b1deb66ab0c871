//! Chang's method once more, slow and plain, as the oracle of the search that can be stored and resumed.
//!
//! One function with loops in the order of the publication's steps, which calls the cost where the search
//! waits for a result.

use proptest::prelude::*;
use rand::RngExt;

use super::latin_hypercube::design;
use super::*;
use crate::randomness::{Purpose, stream};

/// A vertex: a point and its cost.
type Vertex = (Vec<f64>, f64);

/// The points that the method measures, in order, `budget` of them.
fn chang(seed: u64, start: &[f64], budget: usize, cost: impl Fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
    let n = start.len();
    let mut asked: Vec<Vec<f64>> = Vec::new();
    let mut draws = 0;
    let mut random = || {
        draws += 1;
        stream(seed, Purpose::Search, 1, draws)
    };
    let mut measure = |x: Vec<f64>| -> Vertex {
        let c = cost(&x);
        asked.push(x.clone());
        (x, c)
    };
    let mut simplex: Vec<Vertex> = vec![measure(start.to_vec())];
    simplex.extend(design(n, n, &mut random()).into_iter().map(&mut measure));
    let mut radius = 0.25_f64;
    let mut count = n + 1;
    while count < budget {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let worst = simplex[n].clone();
        let mut centroid = vec![0.0; n];
        for (axis, c) in centroid.iter_mut().enumerate() {
            *c = simplex[..n].iter().map(|vertex| vertex.0[axis]).sum::<f64>() / n as f64;
        }
        let along = |through: &[f64], t: f64| -> Vec<f64> {
            centroid.iter().zip(through).map(|(c, x)| (c + t * (x - c)).clamp(0.0, 1.0)).collect()
        };
        let is_small =
            |vertex: &Vertex| vertex.0.iter().zip(&simplex[0].0).all(|(a, b)| (a - b).abs() < 1e-3);
        let mut chosen = None;
        if !simplex.iter().all(is_small) {
            let reflected = measure(along(&worst.0, -1.0));
            count += 1;
            if reflected.1 < simplex[0].1 {
                let expanded = measure(along(&worst.0, -2.0));
                count += 1;
                chosen = Some(if expanded.1 < reflected.1 { expanded } else { reflected });
            } else if reflected.1 < simplex[n - 1].1 {
                chosen = Some(reflected);
            } else {
                let outside = reflected.1 < worst.1;
                let contracted = measure(along(if outside { &reflected.0 } else { &worst.0 }, 0.5));
                count += 1;
                if contracted.1 < if outside { reflected.1 } else { worst.1 } {
                    chosen = Some(contracted);
                }
            }
        }
        while chosen.is_none() && count < budget {
            let mut dice = random();
            let best = &simplex[0];
            let is_global = dice.random::<f64>() < 0.1;
            let x = if is_global {
                (0..n).map(|_| dice.random()).collect()
            } else {
                let always = dice.random_range(0..n);
                let mut x = best.0.clone();
                for (axis, x) in x.iter_mut().enumerate() {
                    let [change, whole, at]: [f64; 3] = std::array::from_fn(|_| dice.random());
                    if axis == always || change <= 1.0 / 3.0 {
                        let near = (*x + radius * (2.0 * at - 1.0)).clamp(0.0, 1.0);
                        *x = if whole < 0.1 { at } else { near };
                    }
                }
                x
            };
            let found = measure(x);
            count += 1;
            radius = (radius * if found.1 < best.1 { 1.3 } else { 0.85 }).clamp(0.02, 0.5);
            if found.1 < worst.1 {
                chosen = Some(found);
            }
        }
        if let Some(chosen) = chosen {
            simplex[n] = chosen;
        }
    }
    asked.truncate(budget);
    asked
}

/// The points that the search asks for.
fn asked(seed: u64, start: &[f64], budget: usize, cost: impl Fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
    let mut search = NelderMead::new(SearchSetup::plain(seed, start.to_vec(), budget as u32, Vec::new()));
    let mut points = Vec::new();
    for _ in 0..budget {
        let point = search.ask().expect("nothing is out");
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost(&point.x)), fresh: true });
        points.push(point.x);
    }
    points
}

/// A bumpy valley over the cube: Rosenbrock's in each pair of neighbouring axes, with noise that depends on
/// the point alone.
fn valley(x: &[f64]) -> f64 {
    let at = |x: f64| 4.0 * x - 2.0;
    let pair =
        |pair: &[f64]| 100.0 * (at(pair[1]) - at(pair[0]).powi(2)).powi(2) + (1.0 - at(pair[0])).powi(2);
    let bumps: f64 = x.iter().map(|x| libm::sin(1000.0 * x)).sum();
    1.0 + x.windows(2).map(pair).sum::<f64>() + (at(x[0]) - 1.0).powi(2) + 0.3 * bumps.abs()
}

proptest! {
    #![proptest_config(crate::testing::cases(64))]

    #[test]
    fn the_search_asks_for_what_the_plain_method_measures(seed: u64, n in 1usize..12, extra in 0usize..150) {
        let budget = (2 * n + 2).max(6) + extra;
        let start = vec![0.25; n];
        prop_assert_eq!(asked(seed, &start, budget, valley), chang(seed, &start, budget, valley));
    }
}

#[test]
fn the_valley_of_rosenbrock_is_followed_to_its_end() {
    // Two axes, 400 measurements: the optimum lies at 1, 1, which is 0.75, 0.75 in the cube.
    let quiet =
        |x: &[f64]| valley(x) - 0.3 * x.iter().map(|x| libm::sin(1000.0 * x)).sum::<f64>().abs() - 1.0;
    for seed in 0..20 {
        let points = asked(seed, &[0.1, 0.9], 400, quiet);
        let best = points.iter().map(|x| quiet(x)).fold(f64::INFINITY, f64::min);
        assert!(best < 1e-2, "{seed}: {best}");
    }
}
