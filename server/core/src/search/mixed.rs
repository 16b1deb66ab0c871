//! The quality of the searches on a space like the paper's Table 1, where choices matter most.
//!
//! The landscape models measurements of Embree on three scenes. The factors of the parameters multiply, and
//! the branching factor weighs most. Shallow trees are slow or cannot be built. Frames vary by 7 %, with a
//! rare outlier. Compact trees, which make all the other parameters meaningless, are left out as the paper
//! does (section 4.1).

use std::collections::BTreeMap;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::configuration::Configuration;
use crate::limits::KNOWN_POINTS_PER_SUGGESTION_MAX;
use crate::policy::SearchMethod;
use crate::randomness::{Purpose, stream};
use crate::robust::median;
use crate::value::Value;

/// The paper's Table 1, with its recommended values as defaults.
fn table_1() -> Space {
    let sah = [2, 3];
    let space = Space::builder().boolean("robust").default(false).integer("quality", 1..=3).default(2);
    let space = space.categorical("branching_factor", [2, 4, 8]).default(2);
    let space = space.integer("max_depth", 9..=64).default(32);
    let space = space.categorical("sah_block_size", [1, 2, 4, 8, 16, 32]).default(1);
    let space = space.active_if("quality", sah);
    let space = space.integer("min_leaf_size", 1..=32).default(1);
    let space = space.integer("max_leaf_size", 1..=32).default(32);
    let space = space.float("traversal_cost", 0.0..=10.0).default(1.0).active_if("quality", sah);
    let space = space.float("intersection_cost", 0.1..=10.0).default(1.0).active_if("quality", sah);
    let space = space.boolean("static").default(false).less_or_equal("min_leaf_size", "max_leaf_size");
    space.build().expect("a valid space")
}

/// Render time without noise, 1 at the optimum; `None` where the tree cannot be built. The default takes 2.2.
fn slowdown(configuration: &Configuration) -> Option<f64> {
    let number = |name: &str| configuration.get(name).and_then(Value::as_number);
    let is = |name: &str| configuration.get(name) == Some(&Value::Boolean(true));
    let of = |name: &str| number(name).expect("always active");
    let quality = of("quality");
    let (branching, depth) = (of("branching_factor"), of("max_depth"));
    let morton = quality < 1.5;
    if depth < 11.0 || (branching < 3.0 && (morton || depth < 21.0)) || (morton && depth < 14.0) {
        return None;
    }
    let mut factor = [1.22, 1.05, 1.0][quality as usize - 1];
    factor *= [1.9, 1.25, 1.0][branching.log2() as usize - 1];
    factor *= if is("robust") { 1.08 } else { 1.0 };
    factor *= if depth < 13.0 { 2.2 } else { 1.0 };
    factor *= 1.0 + 0.3 * ((8.0 - of("max_leaf_size")).max(of("max_leaf_size") - 28.0).max(0.0) / 7.0);
    factor *= 1.0 + 0.1 * ((32.0 - depth).max(0.0) / 20.0);
    factor *= 1.0 + 0.3 * ((of("min_leaf_size") - 4.0).max(0.0) / 28.0);
    if let (Some(block), Some(traversal), Some(intersection)) =
        (number("sah_block_size"), number("traversal_cost"), number("intersection_cost"))
    {
        factor *= 1.0 + 0.15 * ((block.log2() - 2.0) / 3.0).abs();
        let ratio = (traversal.max(0.01) / intersection).log2();
        factor *= 1.0 + 0.2 * (ratio / 3.0).powi(2).min(1.0);
    }
    Some(factor)
}

/// A frame: 7 % noise, and now and then an outlier.
fn frame(slowdown: f64, noise: &mut ChaCha8Rng) -> f64 {
    let uniform = || noise.random::<f64>();
    let normal = std::iter::repeat_with(uniform).take(12).sum::<f64>() - 6.0;
    let outlier = if noise.random::<f64>() < 0.03 { 1.3 } else { 1.0 };
    slowdown * (0.07 * normal).exp() * outlier
}

struct Run {
    /// Noise-free slowdown of the configuration that measured best, which the tuner recommends.
    best: f64,
    /// Mean noise-free slowdown of the last ten trials that could be run, over the best.
    end: f64,
    /// Share of the trials that are moves of a simplex.
    moves: f64,
}

/// Runs a search the way the tuner does: configurations that were tried are answered from the table.
fn tune(method: SearchMethod, seed: u64, budget: usize) -> Run {
    let space = table_1();
    let mut search = AnySearch::new(method, SearchSetup::of(&space, seed, 1, budget as u32));
    let mut noise = stream(seed, Purpose::Unseen, 1, 0);
    let mut known: BTreeMap<Configuration, Verdict> = BTreeMap::new();
    let mut best = (f64::INFINITY, f64::INFINITY);
    let (mut ran, mut moves, mut in_a_row) = (Vec::new(), 0, 0);
    while known.len() < budget {
        let point = search.ask().expect("nothing is out");
        let configuration = space.decode(&point.x);
        if let Some(&verdict) = known.get(&configuration) {
            in_a_row += 1;
            assert!(in_a_row < KNOWN_POINTS_PER_SUGGESTION_MAX, "the search stalls");
            search.tell(point.id, Feedback { verdict, fresh: false });
            continue;
        }
        in_a_row = 0;
        moves += usize::from(matches!(point.step, Step::Reflect | Step::Expand | Step::Contract));
        let verdict = match slowdown(&configuration) {
            None => Verdict::Infeasible,
            Some(truth) => {
                ran.push(truth);
                let measured = frame(truth, &mut noise);
                if measured < best.0 {
                    best = (measured, truth);
                }
                Verdict::Cost(measured)
            }
        };
        known.insert(configuration, verdict);
        search.tell(point.id, Feedback { verdict, fresh: true });
    }
    let last = &ran[ran.len() - 10..];
    let end = last.iter().sum::<f64>() / last.len() as f64 / best.1;
    Run { best: best.1, end, moves: moves as f64 / budget as f64 }
}

/// Median and 90th percentile of a figure of many runs.
fn quantiles(runs: &[Run], figure: impl Fn(&Run) -> f64) -> (f64, f64) {
    let mut figures: Vec<f64> = runs.iter().map(figure).collect();
    figures.sort_by(f64::total_cmp);
    (figures[figures.len() / 2], figures[figures.len() * 9 / 10])
}

#[test]
fn the_simplex_of_the_paper_converges_within_its_eighty_trials() {
    let runs = |method| (0..101).map(|seed| tune(method, seed, 80)).collect::<Vec<_>>();
    let (simplex, random) = (runs(SearchMethod::NelderMead), runs(SearchMethod::Random));
    let (best, best_high) = quantiles(&simplex, |run| run.best);
    let (best_random, best_random_high) = quantiles(&random, |run| run.best);
    assert!(best < 1.08 && best_high < 1.25, "{best} {best_high}");
    assert!(best < best_random - 0.05 && best_high < best_random_high, "{best_random} {best_random_high}");
    let (end, end_high) = quantiles(&simplex, |run| run.end);
    assert!(end < 1.1 && end_high < 1.25, "{end} {end_high}");
    let (moves, _) = quantiles(&simplex, |run| run.moves);
    assert!(moves > 0.6, "{moves} of the trials are moves");
}

/// The trials until a search has met the best of 16 values beside 16 others, where more is better, from the
/// lowest.
fn trials_to_the_highest(seed: u64, value: fn(i64) -> Value) -> f64 {
    let values = || (0..16).map(move |power| value(1 << power));
    let space = Space::builder().categorical("block", values()).default(value(1));
    let space = space.categorical("tile", values()).default(value(1)).build().expect("a valid space");
    let mut search = AnySearch::new(SearchMethod::Model, SearchSetup::of(&space, seed, 1, 80));
    let mut known = BTreeMap::new();
    while known.len() < 80 {
        let point = search.ask().expect("nothing is out");
        // Both list their values from the lowest on.
        let cell = |axis: usize| (16.0 * point.x[axis]).floor().min(15.0);
        let cost = 40.0 - cell(0) - cell(1);
        let fresh = known.insert(space.decode(&point.x), cost).is_none();
        if cost == 10.0 {
            break;
        }
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh });
    }
    known.len() as f64
}

#[test]
fn listed_numbers_are_searched_in_their_order() {
    let trials = |value: fn(i64) -> Value| {
        median(&mut (0..11).map(|seed| trials_to_the_highest(seed, value)).collect::<Vec<_>>())
    };
    let numbers = trials(Value::Integer);
    let words = trials(|number: i64| Value::Text(number.to_string()));
    assert!(1.3 * numbers < words, "{numbers} trials with numbers, {words} with words");
}

#[test]
fn a_space_of_choices_alone_is_searched_to_its_best() {
    let start = vec![0.25, 0.25, 1.0 / 6.0];
    let levels = vec![2, 2, 3];
    for seed in 0..20 {
        let setup = SearchSetup::plain(seed, start.clone(), 12, levels.clone());
        let mut search = AnySearch::new(SearchMethod::NelderMead, setup);
        let mut known = BTreeMap::new();
        for _ in 0..200 {
            let point = search.ask().expect("nothing is out");
            let cell = |axis: usize| ((point.x[axis] * f64::from(levels[axis])) as u32).min(levels[axis] - 1);
            let cells = [cell(0), cell(1), cell(2)];
            let cost = f64::from(100 - cells[0] - 2 * cells[1] - 4 * cells[2]);
            let fresh = known.insert(cells, cost).is_none();
            search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh });
        }
        assert!(known.contains_key(&[1, 1, 2]), "{seed}: {known:?}");
    }
}
