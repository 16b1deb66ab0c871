//! Several objectives: the configurations of which no other is better in every metric, a Pareto front.
//!
//! The service minimises one number. A front is a study whose indicator [`Front::DIRECTION`] says how the
//! metrics are weighed. Every direction is a state with a search of its own. The first directions are the
//! metrics themselves. The others minimise the augmented Chebyshev norm of the logarithms of the metrics over
//! their best values (Knowles, "ParEGO: a hybrid algorithm with on-line landscape approximation for expensive
//! multiobjective optimization problems", 2006). Its exponential is the cost.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use serde::Serialize;
use thiserror::Error;

use crate::assignment::Assignment;
use crate::names::is_name;

/// The weights of the directions, the metrics themselves first. No other weight is 0, so that every metric
/// counts everywhere else.
const TWO: &[&[f64]] = &[
    &[1.0, 0.0],
    &[0.0, 1.0],
    &[0.5, 0.5],
    &[0.25, 0.75],
    &[0.75, 0.25],
    &[0.125, 0.875],
    &[0.875, 0.125],
    &[0.375, 0.625],
    &[0.625, 0.375],
];
const THREE: &[&[f64]] = &[
    &[1.0, 0.0, 0.0],
    &[0.0, 1.0, 0.0],
    &[0.0, 0.0, 1.0],
    &[1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
    &[3.0 / 7.0, 3.0 / 7.0, 1.0 / 7.0],
    &[3.0 / 7.0, 1.0 / 7.0, 3.0 / 7.0],
    &[1.0 / 7.0, 3.0 / 7.0, 3.0 / 7.0],
];
/// Weight of the weighted sum beside the largest part, as in ParEGO.
const AUGMENTATION: f64 = 0.05;
/// Prefix of origins that name a trial of this database.
const OWN: &str = "studies/";
/// The beginning of the display name of a study that is made for a front.
const NAME: &str = "front of ";

/// Two or three metrics of which none is given up for another. All are above 0 in every run; one that is to
/// be large counts by its reciprocal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Front {
    /// Names, and whether they are to be large.
    metrics: Vec<(String, bool)>,
}

/// These are no metrics of a front. The message says why, and what to name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct FrontError(String);

/// A configuration with its measurements.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrontPoint {
    /// The configuration.
    pub configuration: Assignment,
    /// The number of runs that measured it, at least 1.
    pub runs: usize,
    /// The median of each metric over its runs, in the metric's own unit.
    pub metrics: BTreeMap<String, f64>,
    /// These over the default's; `None` where the default was not measured.
    pub ratios: Option<BTreeMap<String, f64>>,
}

/// A front, from the trials of a study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParetoFront {
    /// The names of the metrics.
    pub metrics: Vec<String>,
    /// The metrics among them that are to be large.
    pub maximised: Vec<String>,
    /// Runs that measured all metrics, without the trials that were carried over between directions.
    pub runs: usize,
    /// Different configurations among them.
    pub configurations: usize,
    /// The default, whether or not it is on the front; `None` where it was not measured.
    pub default: Option<FrontPoint>,
    /// Each configuration of the front once, the best of the first metric first.
    pub points: Vec<FrontPoint>,
    /// The share, 0 to 1, of the box between zero and the reference that the front leaves behind. It is
    /// exact. Metrics that are to be large count by their reciprocals. `None` without a reference.
    pub hypervolume: Option<f64>,
    /// All other configurations.
    #[serde(skip)]
    pub dominated: Vec<FrontPoint>,
}

impl Front {
    /// The indicator whose value is the number of the direction, from 0 on.
    pub const DIRECTION: &'static str = "direction";
    /// The measurement that is minimised: what a run costs in its direction.
    pub const COST: &'static str = "front_cost";

    /// A front of two or three metrics, each the name of a measurement, or `1/rate` for one that is to be
    /// large.
    ///
    /// # Errors
    /// [`FrontError`] for another number of metrics, a repeated metric, or an invalid name.
    pub fn new(metrics: &[impl AsRef<str>]) -> Result<Self, FrontError> {
        if !(2..=3).contains(&metrics.len()) {
            return Err(FrontError(format!("{} of them; name two or three", metrics.len())));
        }
        let mut read: Vec<(String, bool)> = Vec::new();
        for metric in metrics {
            let metric = metric.as_ref().trim();
            let name = metric.strip_prefix("1/").unwrap_or(metric);
            if !is_name(name) || name == Self::COST {
                let problem = format!("`{metric}` is not the name of a measurement, or 1/ and a name");
                return Err(FrontError(problem));
            }
            if read.iter().any(|(known, _)| known == name) {
                return Err(FrontError(format!("`{name}` is named twice")));
            }
            read.push((name.to_owned(), name != metric));
        }
        Ok(Self { metrics: read })
    }

    /// The front that a study of this display name is made for; `None` for any other name.
    pub fn of_study(display_name: &str) -> Option<Self> {
        let metrics: Vec<&str> = display_name.strip_prefix(NAME)?.split(", ").collect();
        Self::new(&metrics).ok()
    }

    /// The display name of a study that is made for it, by which it is found again.
    pub fn study_name(&self) -> String {
        let written = |(name, is_maximised): &(String, bool)| match is_maximised {
            true => format!("1/{name}"),
            false => name.clone(),
        };
        format!("{NAME}{}", self.metrics.iter().map(written).collect::<Vec<_>>().join(", "))
    }

    /// The number of the run of this database whose result a trial of this origin repeats, where it is one.
    /// In a study of a front such a trial is no run. It reports a run to another direction.
    pub fn repeated_run(origin: &str) -> Option<u64> {
        origin.strip_prefix(OWN)?.rsplit_once('/')?.1.parse().ok()
    }

    /// The names of the measurements.
    pub fn metrics(&self) -> impl Iterator<Item = &str> {
        self.metrics.iter().map(|(name, _)| name.as_str())
    }

    /// Those of them that are to be large.
    pub fn maximised(&self) -> impl Iterator<Item = &str> {
        self.metrics.iter().filter(|(_, is_maximised)| *is_maximised).map(|(name, _)| name.as_str())
    }

    /// The range of the indicator [`Front::DIRECTION`]; its values are whole numbers.
    pub fn range(&self) -> RangeInclusive<f64> {
        0.0..=(self.directions() - 1) as f64
    }

    /// The number of directions.
    pub fn directions(&self) -> usize {
        self.weights().len()
    }

    fn weights(&self) -> &'static [&'static [f64]] {
        if self.metrics.len() == 2 { TWO } else { THREE }
    }

    /// Whether a metric can be weighed at this value: above 0 and finite, as is its reciprocal.
    pub fn is_usable(value: f64) -> bool {
        value > 0.0 && value.is_finite() && value.recip().is_finite()
    }

    /// The metrics of a run, where all were measured and are above 0.
    fn measured(&self, measured: &BTreeMap<String, f64>) -> Option<Vec<f64>> {
        let usable = |value: &f64| Self::is_usable(*value);
        self.metrics.iter().map(|(name, _)| measured.get(name).copied().filter(usable)).collect()
    }

    /// The metrics as they are minimised.
    fn minimised(&self, metrics: &[f64]) -> Vec<f64> {
        let each = metrics.iter().zip(&self.metrics);
        each.map(|(value, (_, is_maximised))| if *is_maximised { value.recip() } else { *value }).collect()
    }

    /// The metrics of a run as they are minimised, where all were measured and are above 0.
    pub fn values(&self, measured: &BTreeMap<String, f64>) -> Option<Vec<f64>> {
        self.measured(measured).map(|metrics| self.minimised(&metrics))
    }

    /// The cost of a run in a direction: the metric itself in the first directions, else the exponential of
    /// the augmented Chebyshev norm beside the best known of each metric, `ideal`. `minimised` comes from
    /// [`Front::values`]. `None` where an ideal point is needed and missing, and for other directions.
    pub fn cost(&self, direction: usize, minimised: &[f64], ideal: Option<&[f64]>) -> Option<f64> {
        if let Some(metric) = minimised.get(direction) {
            return Some(*metric);
        }
        let weights = self.weights().get(direction)?;
        let parts = minimised.iter().zip(ideal?).zip(*weights);
        let parts: Vec<f64> =
            parts.map(|((value, ideal), weight)| weight * (libm::log(*value) - libm::log(*ideal))).collect();
        let largest = parts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some(libm::exp(largest + AUGMENTATION * parts.iter().sum::<f64>()))
    }

    /// The front of runs of one machine, each with all that it measured; those count that measured every
    /// metric. The hypervolume refers to `reference`, a value of each metric in its own unit, or else to the
    /// default.
    pub fn of<'a>(
        &self,
        runs: impl IntoIterator<Item = (&'a Assignment, &'a BTreeMap<String, f64>)>,
        default: &Assignment,
        reference: Option<&[f64]>,
    ) -> ParetoFront {
        let mut by_name: BTreeMap<String, (&Assignment, Vec<Vec<f64>>)> = BTreeMap::new();
        for (configuration, measured) in runs {
            if let Some(metrics) = self.measured(measured) {
                let name = configuration.to_string();
                by_name.entry(name).or_insert_with(|| (configuration, Vec::new())).1.push(metrics);
            }
        }
        let each = by_name.values();
        let medians: Vec<_> =
            each.map(|(configuration, runs)| (*configuration, runs.len(), medians(runs))).collect();
        let of_default = medians.iter().find(|(one, ..)| *one == default).map(|(.., metrics)| metrics);
        let named = |values: Vec<f64>| -> BTreeMap<String, f64> {
            self.metrics().map(str::to_owned).zip(values).collect()
        };
        let point = |(configuration, runs, metrics): &(&Assignment, usize, Vec<f64>)| FrontPoint {
            configuration: (*configuration).clone(),
            runs: *runs,
            ratios: of_default
                .map(|default| named(metrics.iter().zip(default).map(|(a, b)| a / b).collect())),
            metrics: named(metrics.clone()),
        };
        let values: Vec<_> = medians.iter().map(|(.., metrics)| self.minimised(metrics)).collect();
        let members = non_dominated(&values);
        let is_other = |(index, _): &(usize, _)| !members.contains(index);
        let reference = reference.filter(|metrics| metrics.len() == self.metrics.len());
        let reference = reference.or(of_default.map(Vec::as_slice)).map(|metrics| self.minimised(metrics));
        ParetoFront {
            metrics: self.metrics().map(str::to_owned).collect(),
            maximised: self.maximised().map(str::to_owned).collect(),
            runs: medians.iter().map(|(_, runs, _)| runs).sum(),
            configurations: medians.len(),
            default: medians.iter().find(|(one, ..)| *one == default).map(point),
            points: members.iter().map(|&index| point(&medians[index])).collect(),
            hypervolume: reference.map(|reference| {
                let shares = |index: &usize| {
                    values[*index].iter().zip(&reference).map(|(value, end)| (value / end).min(1.0)).collect()
                };
                let boxes: Vec<Vec<f64>> = members.iter().map(shares).collect();
                hypervolume(&boxes.iter().map(Vec::as_slice).collect::<Vec<_>>(), reference.len())
            }),
            dominated: medians.iter().enumerate().filter(is_other).map(|(_, other)| point(other)).collect(),
        }
    }
}

impl ParetoFront {
    /// A metric with its direction, for axes and tables.
    pub fn title(&self, metric: &str) -> String {
        format!("{metric} ({} is better)", if self.is_maximised(metric) { "higher" } else { "lower" })
    }

    fn is_maximised(&self, metric: &str) -> bool {
        self.maximised.iter().any(|one| one == metric)
    }

    /// The corners of the staircase of reached values, in two of the metrics and their own units, the best of
    /// the first metric first. At a corner no other point is better in both. With two metrics every point is
    /// one.
    pub fn corners(&self, metrics: [&str; 2]) -> Vec<[f64; 2]> {
        let place = |point: &FrontPoint| {
            let value = |metric: &str| point.metrics.get(metric).copied();
            Some([value(metrics[0])?, value(metrics[1])?])
        };
        let signs: [f64; 2] = metrics.map(|metric| if self.is_maximised(metric) { -1.0 } else { 1.0 });
        let order = |a: &[f64; 2], b: &[f64; 2]| {
            let [first, second] =
                [0, 1].map(|axis| (signs[axis] * a[axis]).total_cmp(&(signs[axis] * b[axis])));
            first.then(second)
        };
        let mut corners: Vec<[f64; 2]> = self.points.iter().filter_map(place).collect();
        corners.sort_by(order);
        let mut best = f64::INFINITY;
        corners.retain(|corner| {
            let value = signs[1] * corner[1];
            let is_better = value < best;
            best = best.min(value);
            is_better
        });
        corners
    }
}

fn medians(runs: &[Vec<f64>]) -> Vec<f64> {
    let median = |metric: usize| {
        let mut values: Vec<f64> = runs.iter().map(|run| run[metric]).collect();
        values.sort_by(f64::total_cmp);
        (values[(values.len() - 1) / 2] + values[values.len() / 2]) / 2.0
    };
    (0..runs[0].len()).map(median).collect()
}

/// The places of the points of which no other is as small everywhere and smaller somewhere, sorted by their
/// values. A dominated point is so by one that comes earlier in this order and is itself not dominated.
fn non_dominated(points: &[Vec<f64>]) -> Vec<usize> {
    let order =
        |a: &usize, b: &usize| points[*a].partial_cmp(&points[*b]).unwrap_or(std::cmp::Ordering::Equal);
    let mut places: Vec<usize> = (0..points.len()).collect();
    places.sort_by(order);
    let mut kept: Vec<usize> = Vec::new();
    for place in places {
        let one = &points[place];
        let dominates = |other: &Vec<f64>| other != one && other.iter().zip(one).all(|(a, b)| a <= b);
        // Of two values, the last one that was kept has the least second one.
        let rivals = if one.len() == 2 { kept.len().saturating_sub(1) } else { 0 };
        if !kept[rivals..].iter().any(|&other| dominates(&points[other])) {
            kept.push(place);
        }
    }
    kept
}

/// The volume of the unit cube of `dimensions` dimensions between the points and its far corner, by slices
/// across the last dimension.
fn hypervolume(points: &[&[f64]], dimensions: usize) -> f64 {
    let last = dimensions - 1;
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[last].total_cmp(&b[last]));
    let mut least: f64 = 1.0;
    let slice = |index: usize| {
        let end = sorted.get(index + 1).map_or(1.0, |next| next[last]);
        least = least.min(sorted[index][0]);
        let behind = if last == 1 { 1.0 - least } else { hypervolume(&sorted[..=index], last) };
        behind * (end - sorted[index][last])
    };
    (0..sorted.len()).map(slice).sum()
}

#[cfg(test)]
mod tests;
