//! Judged answers over all cameras: geometric means with intervals, shares, and counts of omissions.
//!
//! A camera is examined in several folds, and its answers there are not independent. So intervals are drawn
//! by resampling whole cameras (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993), from a fixed
//! seed.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use treewright_renderer::{statistics::quantile, tuning::objective::Objective};

use super::judge::{BreakEven, Row, Verdict};
use super::{folds::Split, record::Place};
use crate::converge::bootstrap::{geometric, in_brackets, resampled};

const RESAMPLES: usize = 2000;
const SEED: u64 = 7;

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Mean {
    pub(crate) mean: f64,
    /// 95 %, by resampling cameras; absent for fewer than three.
    pub(crate) interval: Option<[f64; 2]>,
}

impl std::fmt::Display for Mean {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.3}{}", self.mean, in_brackets(self.interval, |end| format!("{end:.3}")))
    }
}

/// An entrant over the cameras of a scene, or of all.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Standing {
    pub(crate) objective: Objective,
    pub(crate) split: Split,
    pub(crate) entrant: String,
    /// Absent for all scenes together.
    pub(crate) scene: Option<String>,
    pub(crate) answers: usize,
    /// The number of different configurations among them: 1 for a predictor that is a constant.
    pub(crate) distinct: usize,
    pub(crate) cameras: usize,
    pub(crate) over_search: Mean,
    pub(crate) of_roofline: Mean,
    pub(crate) of_roofline_least: f64,
    pub(crate) of_roofline_once: Mean,
    pub(crate) over_default: Mean,
    pub(crate) over_fixed: Mean,
    /// Share of the search's overhead that the predictor saves over all answers, where there is any.
    pub(crate) overhead_reduction: Option<f64>,
    pub(crate) break_even: BreakEvens,
}

/// Break-even points, and those that no figure shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct BreakEvens {
    /// Of those that are drawn, in iterations.
    pub(crate) median: Option<f64>,
    /// The prediction is at least as good as the search's best.
    pub(crate) never: usize,
    /// Beyond 10,000 iterations.
    pub(crate) late: usize,
}

impl BreakEvens {
    fn of<'a>(rows: impl Iterator<Item = &'a Row>) -> Self {
        let mut all = Self::default();
        let mut at = Vec::new();
        for row in rows {
            match row.break_even {
                BreakEven::At(iterations) => at.push(iterations),
                BreakEven::Late => all.late += 1,
                BreakEven::Never => all.never += 1,
            }
        }
        at.sort_by(f64::total_cmp);
        all.median = (!at.is_empty()).then(|| quantile(&at, 0.5));
        all
    }
}

/// All standings of a verdict: of each entrant over all scenes, then scene by scene.
pub(crate) fn standings(verdict: &Verdict) -> Vec<Standing> {
    let mut groups: BTreeMap<(Split, &str, Option<&str>), Vec<&Row>> = BTreeMap::new();
    for row in &verdict.rows {
        for scene in [None, Some(row.place.scene.as_str())] {
            groups.entry((row.split, row.entrant.as_str(), scene)).or_default().push(row);
        }
    }
    let standing = |((split, entrant, scene), rows): ((Split, &str, Option<&str>), Vec<&Row>)| {
        let of = |value: fn(&Row) -> f64| mean(&rows, value);
        let cameras: BTreeSet<&Place> = rows.iter().map(|row| &row.place).collect();
        let sum = |value: fn(&Row) -> f64| rows.iter().map(|row| value(row)).sum::<f64>();
        Standing {
            objective: verdict.objective,
            split,
            entrant: entrant.to_owned(),
            scene: scene.map(str::to_owned),
            answers: rows.len(),
            distinct: rows.iter().map(|row| row.answer.as_str()).collect::<BTreeSet<_>>().len(),
            cameras: cameras.len(),
            over_search: of(|row| row.over_search),
            of_roofline: of(|row| row.of_roofline),
            of_roofline_least: rows.iter().map(|row| row.of_roofline).fold(f64::INFINITY, f64::min),
            of_roofline_once: of(|row| row.of_roofline_once),
            over_default: of(|row| row.over_default),
            over_fixed: of(|row| row.over_fixed),
            overhead_reduction: Some(sum(|row| row.search_overhead_ms))
                .filter(|search_ms| *search_ms > 0.0)
                .map(|search_ms| 1.0 - sum(|row| row.prediction_overhead_ms) / search_ms),
            break_even: BreakEvens::of(rows.iter().copied()),
        }
    };
    groups.into_iter().map(standing).collect()
}

/// Geometric mean of the finite values, with the interval by resampling cameras.
pub(super) fn mean(rows: &[&Row], value: fn(&Row) -> f64) -> Mean {
    let mut by_place: BTreeMap<&Place, Vec<f64>> = BTreeMap::new();
    for row in rows {
        let logarithm = value(row).ln();
        if logarithm.is_finite() {
            by_place.entry(&row.place).or_default().push(logarithm);
        }
    }
    let cameras: Vec<(f64, usize)> =
        by_place.into_values().map(|all| (all.iter().sum(), all.len())).collect();
    of_clusters(&cameras)
}

/// Geometric mean and interval of one value a camera.
pub(crate) fn mean_of(values: &[f64]) -> Mean {
    let cameras: Vec<(f64, usize)> =
        values.iter().map(|value| (value.ln(), 1)).filter(|(logarithm, _)| logarithm.is_finite()).collect();
    of_clusters(&cameras)
}

fn of_clusters(cameras: &[(f64, usize)]) -> Mean {
    let of = |drawn: &[usize]| geometric(cameras, drawn);
    let mean = of(&(0..cameras.len()).collect::<Vec<_>>()).unwrap_or(f64::NAN);
    let interval = (cameras.len() >= 3).then(|| resampled(cameras.len(), RESAMPLES, SEED, of));
    Mean { mean, interval: interval.map(|means| [quantile(&means, 0.025), quantile(&means, 0.975)]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_geometric_and_intervals_hold_them() {
        let found = mean_of(&[0.5, 2.0, 1.0, 1.0, f64::NAN]);
        assert!((found.mean - 1.0).abs() < 1e-12);
        let [low, high] = found.interval.expect("four cameras");
        assert!((0.5..1.0).contains(&low) && high > 1.0 && high <= 2.0, "{low} {high}");
        assert_eq!(mean_of(&[2.0, 2.0]).interval, None);
        assert_eq!(found, mean_of(&[0.5, 2.0, 1.0, 1.0, f64::NAN]), "equal each time");
    }
}
