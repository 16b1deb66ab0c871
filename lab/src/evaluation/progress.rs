//! Error of the tuner against iterations and run time: how far above the roofline the best configuration so
//! far costs, by the median over all cameras; and what the paper's two predictors answer before the first
//! iteration.
//!
//! The best so far is told by single measurements, as a search sees them, and so is what it is held against:
//! the least of all iterations. Both hold luck, so that the curve ends at 1 by definition; its shape is what
//! it says.

use serde::Serialize;
use treewright_renderer::statistics::quantile;

use super::record::{Clock, Iteration, Search};
use treewright_renderer::frame::FrameTimes;
use treewright_renderer::tuning::objective::Objective;

/// Quartiles over cameras at one moment of the searches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Moment {
    /// Iterations, or seconds of building and rendering.
    pub(crate) at: f64,
    /// Cost of the best so far over that of the best of all: lower quartile, median, upper quartile.
    pub(crate) quartiles: [f64; 3],
    /// Cameras that have a best so far.
    pub(crate) cameras: usize,
}

/// One search: after each iteration the seconds spent, and the best so far over the best of all.
fn curve(search: &Search, objective: Objective, clock: Clock) -> Option<Vec<[f64; 2]>> {
    let cost = |times: &FrameTimes| clock.cost(objective, times);
    let all = search.iterations.iter().filter_map(|one| cost(one.times.as_ref()?));
    let least = all.min_by(f64::total_cmp)?;
    let (mut spent_s, mut best) = (0.0, f64::INFINITY);
    let step = |one: &Iteration| {
        if let Some(times) = &one.times {
            spent_s += (times.build_ms + times.render_ms) / 1000.0;
            best = best.min(cost(times).unwrap_or(f64::INFINITY));
        }
        [spent_s, best / least]
    };
    Some(search.iterations.iter().map(step).collect())
}

fn moment(at: f64, mut ratios: Vec<f64>) -> Option<Moment> {
    ratios.retain(|ratio| ratio.is_finite());
    ratios.sort_by(f64::total_cmp);
    let quartiles = [0.25, 0.5, 0.75].map(|share| quantile(&ratios, share));
    (!ratios.is_empty()).then_some(Moment { at, quartiles, cameras: ratios.len() })
}

/// After each iteration.
pub(crate) fn over_iterations(searches: &[&Search], objective: Objective, clock: Clock) -> Vec<Moment> {
    let curves: Vec<_> = searches.iter().filter_map(|search| curve(search, objective, clock)).collect();
    let longest = curves.iter().map(Vec::len).max().unwrap_or(0);
    let at = |number: usize| {
        moment((number + 1) as f64, curves.iter().filter_map(|curve| Some(curve.get(number)?[1])).collect())
    };
    (0..longest).filter_map(at).collect()
}

/// After so many seconds of building and rendering, in even factors; a search that has ended stays where it
/// is.
pub(crate) fn over_seconds(searches: &[&Search], objective: Objective, clock: Clock) -> Vec<Moment> {
    const MOMENTS: usize = 60;
    let curves: Vec<_> = searches.iter().filter_map(|search| curve(search, objective, clock)).collect();
    let first = curves.iter().filter_map(|curve| curve.iter().find(|[s, _]| *s > 0.0).map(|[s, _]| *s));
    let first_s = first.fold(0.0_f64, f64::max);
    let last_s = curves.iter().filter_map(|curve| Some(curve.last()?[0])).fold(0.0_f64, f64::max);
    if first_s <= 0.0 || last_s <= first_s {
        return Vec::new();
    }
    let at = |number: usize| {
        let at_s = first_s * (last_s / first_s).powf(number as f64 / (MOMENTS - 1) as f64);
        let so_far = |curve: &Vec<[f64; 2]>| {
            curve.iter().take_while(|[s, _]| *s <= at_s * (1.0 + 1e-12)).last().map(|[_, ratio]| *ratio)
        };
        moment(at_s, curves.iter().filter_map(so_far).collect())
    };
    (0..MOMENTS).filter_map(at).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use treewright_client::{Configuration, Outcome};

    use super::*;
    use crate::evaluation::record::Place;

    fn search(render_ms: &[Option<f64>]) -> Search {
        let iteration = |ms: &Option<f64>| Iteration {
            configuration: Configuration::new(),
            step: "initial".to_owned(),
            outcome: Outcome::Ok,
            times: ms.map(|ms| FrameTimes::of(500.0, ms)),
        };
        Search {
            objective: "render".to_owned(),
            method: "nelder_mead".to_owned(),
            place: Place { scene: "hall".to_owned(), camera: 0 },
            state: BTreeMap::new(),
            iterations: render_ms.iter().map(iteration).collect(),
            other_cores: None,
            provenance: None,
        }
    }

    #[test]
    fn the_best_so_far_falls_to_the_roofline_and_failures_cost_nothing() {
        let (a, b) = (search(&[Some(500.0), None, Some(1000.0), Some(250.0)]), search(&[Some(100.0); 4]));
        let moments = over_iterations(&[&a, &b], Objective::Render, Clock::Wall);
        let medians: Vec<f64> = moments.iter().map(|moment| moment.quartiles[1]).collect();
        assert_eq!(medians, [1.5, 1.5, 1.5, 1.0]);
        let moments = over_seconds(&[&a], Objective::Render, Clock::Wall);
        assert_eq!(moments.first().map(|moment| (moment.at, moment.quartiles[1])), Some((1.0, 2.0)));
        let last = moments.last().expect("there are some");
        assert!((last.at - 3.25).abs() < 1e-9 && last.quartiles[1] == 1.0, "{last:?}");
        assert!(over_seconds(&[], Objective::Render, Clock::Wall).is_empty());
    }
}
