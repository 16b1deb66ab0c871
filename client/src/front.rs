//! Several objectives: the configurations of which no other is better in every metric, a Pareto front.
//!
//! The service minimises one number. A front is a study whose indicator [`Front::DIRECTION`] says how the
//! metrics are weighed: every direction is a state with a search of its own. The first directions are the
//! metrics themselves. The others minimise the augmented Chebyshev norm of the logarithms of the metrics over
//! their best values (Knowles, "ParEGO: a hybrid algorithm with on-line landscape approximation for expensive
//! multiobjective optimization problems", 2006); its exponential is the cost. Each run is reported for all
//! directions: for the others as a trial that is carried over, with the run's name as its origin.
//!
//! Everything follows from stored trials, so a program that is started again goes on with the same numbers.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use serde::Serialize;

use crate::{ClientError, Configuration, Measurements, OpenEnum, Outcome, Question, TrialRecord};

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
/// One run in this number minimises a metric itself.
const FIRST_PART: u32 = 4;
/// Runs that a direction may have beyond its share of the planned ones.
const SPARE: usize = 8;
/// Prefix of origins that name a trial of the same database.
const OWN: &str = "studies/";
/// Most characters that are kept of a client's name in that of its carried trials.
const CLIENT_CHARACTERS: usize = 120;

/// Two or three metrics of which none is given up for another. All are above 0 in every run; one that is to
/// be large counts by its reciprocal.
///
/// ```no_run
/// # use treewright_client::{blocking::Client, ClientError, Front, FrontHistory, Indicators, Measurements};
/// # use treewright_client::{Outcome, Question, Scale, SessionPolicy, Space, StudySpec, TrialQuery};
/// # fn run() -> Measurements { Measurements::from([("time_ms", 1.0), ("memory_mb", 1.0)]) }
/// # fn tune(client: &Client, space: Space) -> Result<(), ClientError> {
/// let front = Front::new(&["time_ms", "memory_mb"])?;
/// let spec = StudySpec::builder(space)
///     .indicator(Front::DIRECTION, front.range(), Scale::Linear)
///     .minimise(Front::COST, 1.0);
/// let study = client.create_study("lists", &spec.build().expect("a good study"))?.identified_name();
/// let known = client.trials(&study, TrialQuery::all()).collect::<Result<_, _>>()?;
/// let mut history = FrontHistory::new(front, known, 60);
/// for _ in 0..60 {
///     let Some(direction) = history.next_direction() else { break };
///     let indicators = Indicators::from([(Front::DIRECTION, direction as f64)]);
///     let trials_per_state = Some(history.runs_each());
///     let session_policy = SessionPolicy { epsilon: Some(1.0), trials_per_state, ..Default::default() };
///     let trial = client.ask(&study, &Question { indicators, session_policy, ..Question::default() })?;
///     let measured = history.with_cost(&trial, run())?;
///     history.push(client.tell(&trial.name, &measured, &Outcome::Ok)?.0);
///     for (question, measured, outcome) in history.owed() {
///         let carried = client.ask(&study, &question)?;
///         history.push(client.tell(&carried.name, &measured, &outcome)?.0);
///     }
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Front {
    /// Names, and whether they are to be large.
    metrics: Vec<(String, bool)>,
}

/// A configuration with its measurements.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrontPoint {
    /// The configuration.
    pub configuration: Configuration,
    /// The number of runs that measured it, at least 1.
    pub runs: usize,
    /// The median of each metric over its runs, in the metric's own unit.
    pub metrics: Measurements,
    /// These over the default's; `None` where the default was not measured.
    pub ratios: Option<Measurements>,
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
    /// The share, 0 to 1, of the box between zero and the reference that the front leaves behind: exact, with
    /// metrics that are to be large by their reciprocals. `None` without a reference.
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
    /// [`ClientError::Invalid`] for another number of metrics, a repeated metric, or an invalid name.
    pub fn new(metrics: &[impl AsRef<str>]) -> Result<Self, ClientError> {
        let wrong = |problem: String| Err(ClientError::invalid("metrics of a front", problem));
        if !(2..=3).contains(&metrics.len()) {
            return wrong(format!("{} of them; name two or three", metrics.len()));
        }
        let mut read: Vec<(String, bool)> = Vec::new();
        for metric in metrics {
            let metric = metric.as_ref().trim();
            let name = metric.strip_prefix("1/").unwrap_or(metric);
            if !Measurements::is_name(name) || name == Self::COST {
                return wrong(format!("`{metric}` is not the name of a measurement, or 1/ and a name"));
            }
            if read.iter().any(|(known, _)| known == name) {
                return wrong(format!("`{name}` is named twice"));
            }
            read.push((name.to_owned(), name != metric));
        }
        Ok(Self { metrics: read })
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
    #[must_use]
    pub fn range(&self) -> RangeInclusive<f64> {
        0.0..=(self.weights().len() - 1) as f64
    }

    fn weights(&self) -> &'static [&'static [f64]] {
        if self.metrics.len() == 2 { TWO } else { THREE }
    }

    fn direction(&self, trial: &TrialRecord) -> Option<usize> {
        let direction = trial.indicators.get(Self::DIRECTION)?.round();
        self.range().contains(&direction).then_some(direction as usize)
    }

    /// The metrics of a run, where all were measured and are above 0.
    fn measured(&self, measured: &Measurements) -> Option<Vec<f64>> {
        let usable = |value: &f64| *value > 0.0 && value.is_finite() && value.recip().is_finite();
        self.metrics.iter().map(|(name, _)| measured.get(name).filter(usable)).collect()
    }

    /// The metrics as they are minimised.
    fn minimised(&self, metrics: &[f64]) -> Vec<f64> {
        let each = metrics.iter().zip(&self.metrics);
        each.map(|(value, (_, is_maximised))| if *is_maximised { value.recip() } else { *value }).collect()
    }

    /// The cost of a run in a direction: the metric itself in the first directions, else the exponential of
    /// the augmented Chebyshev norm, in which the default's values cancel out.
    fn cost(&self, direction: usize, minimised: &[f64], ideal: Option<&[f64]>) -> Option<f64> {
        if let Some(metric) = minimised.get(direction) {
            return Some(*metric);
        }
        let weights = self.weights().get(direction)?;
        let parts: Vec<f64> = minimised
            .iter()
            .zip(ideal?)
            .zip(*weights)
            .map(|((value, ideal), weight)| weight * (value.ln() - ideal.ln()))
            .collect();
        let largest = parts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some((largest + AUGMENTATION * parts.iter().sum::<f64>()).exp())
    }

    /// Whether a trial repeats the result of a run of its study for another direction. It is no run, and
    /// needs not be kept: [`FrontHistory::owed`] makes it again.
    #[must_use]
    pub fn is_repeated(trial: &TrialRecord) -> bool {
        trial.indicators.get(Self::DIRECTION).is_some() && carried_from(trial).is_some()
    }

    /// The front of trials of one machine, of which those count that measured every metric. The hypervolume
    /// is told beside `reference`, a value of each metric in its own unit, or else beside the default.
    #[must_use]
    pub fn of(
        &self,
        trials: &[TrialRecord],
        default: &Configuration,
        reference: Option<&[f64]>,
    ) -> ParetoFront {
        let mut runs: BTreeMap<String, (&Configuration, Vec<Vec<f64>>)> = BTreeMap::new();
        for run in trials.iter().filter(|trial| is_measured(trial) && carried_from(trial).is_none()) {
            if let Some(metrics) = self.measured(&run.measurements) {
                let name = run.configuration.to_string();
                runs.entry(name).or_insert_with(|| (&run.configuration, Vec::new())).1.push(metrics);
            }
        }
        let medians: Vec<_> =
            runs.values().map(|(configuration, runs)| (*configuration, runs.len(), medians(runs))).collect();
        let of_default = medians.iter().find(|(one, ..)| *one == default).map(|(.., metrics)| metrics);
        let named = |values: Vec<f64>| -> Measurements { self.metrics().zip(values).collect() };
        let point = |(configuration, runs, metrics): &(&Configuration, usize, Vec<f64>)| FrontPoint {
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
            maximised: self
                .metrics
                .iter()
                .filter(|(_, large)| *large)
                .map(|(name, _)| name.clone())
                .collect(),
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

/// The trials of a front so far, and what follows from them. One program at a time adds to a front.
#[derive(Debug, Clone)]
pub struct FrontHistory {
    front: Front,
    /// Only completed ones.
    trials: Vec<TrialRecord>,
    planned: u32,
    /// Number of runs at the beginning.
    before: usize,
    over: BTreeSet<usize>,
}

impl FrontHistory {
    /// Goes on from the stored trials of one input and one machine, of which those that are excluded do not
    /// count, nor what repeats them. In the first quarter of the `planned`
    /// runs only the metrics themselves are minimised, unless that was over before.
    #[must_use]
    pub fn new(front: Front, trials: Vec<TrialRecord>, planned: u32) -> Self {
        let excluded = trials.iter().filter(|trial| trial.exclusion.is_some());
        let excluded: BTreeSet<u64> = excluded.filter_map(TrialRecord::number).collect();
        let is_excluded = |number: Option<u64>| number.is_some_and(|number| excluded.contains(&number));
        let counts = |trial: &TrialRecord| {
            trial.outcome.is_some() && !is_excluded(trial.number()) && !is_excluded(carried_from(trial))
        };
        let trials: Vec<_> = trials.into_iter().filter(counts).collect();
        let before = trials.iter().filter(|trial| carried_from(trial).is_none()).count();
        Self { front, trials, planned, before, over: BTreeSet::new() }
    }

    /// The trials.
    #[must_use]
    pub fn trials(&self) -> &[TrialRecord] {
        &self.trials
    }

    /// The metrics of the front.
    #[must_use]
    pub fn front(&self) -> &Front {
        &self.front
    }

    /// The budget of each direction's search, for [`crate::SessionPolicy::trials_per_state`]: its share of
    /// the planned runs, and some more, so that all runs are done where a direction ends early. Trials that
    /// are carried over do not count.
    #[must_use]
    pub fn runs_each(&self) -> u32 {
        let all = self.before + self.planned as usize;
        u32::try_from(all.div_ceil(self.front.weights().len()) + SPARE).unwrap_or(u32::MAX)
    }

    /// Adds a trial as the service has stored it.
    pub fn push(&mut self, trial: TrialRecord) {
        self.trials.push(trial);
    }

    /// Nothing more is to be tried in a direction.
    pub fn end(&mut self, direction: usize) {
        self.over.insert(direction);
    }

    /// The direction of the next run: the one that had the fewest. `None` once all are over.
    #[must_use]
    pub fn next_direction(&self) -> Option<usize> {
        let count =
            if self.ideal().is_some() { self.front.weights().len() } else { self.front.metrics.len() };
        let runs =
            |direction: usize| self.runs().filter(|run| self.front.direction(run) == Some(direction)).count();
        (0..count).filter(|direction| !self.over.contains(direction)).min_by_key(|&direction| runs(direction))
    }

    /// The measurements of a run with its cost in the direction of its trial.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] where a metric is missing or not above 0, and for trials without a direction.
    pub fn with_cost(
        &self,
        trial: &TrialRecord,
        measured: Measurements,
    ) -> Result<Measurements, ClientError> {
        let missing = self.front.metrics().find(|name| measured.get(name).is_none_or(|value| value <= 0.0));
        let costs = || {
            let minimised = self.front.minimised(&self.front.measured(&measured)?);
            self.front.cost(self.front.direction(trial)?, &minimised, self.ideal().as_deref())
        };
        match (missing, costs()) {
            (None, Some(cost)) => Ok(measured.with(Front::COST, cost)),
            (Some(name), _) => Err(ClientError::invalid(
                format!("measurement `{name}`"),
                "a front needs it in every run, above 0",
            )),
            (None, None) => Err(ClientError::invalid("trial", "it has no direction of this front")),
        }
    }

    /// The results to carry over, so that every direction knows of every run: questions for
    /// [`crate::Client::ask`], each with its report. These trials are not run.
    #[must_use]
    pub fn owed(&self) -> Vec<(Question, Measurements, Outcome)> {
        let carried = |trial: &TrialRecord| Some((carried_from(trial)?, self.front.direction(trial)?));
        let known: BTreeSet<(u64, usize)> = self.trials.iter().filter_map(carried).collect();
        let ideal = self.ideal();
        let count = if ideal.is_some() { self.front.weights().len() } else { self.front.metrics.len() };
        let mut owed = Vec::new();
        for run in self.runs() {
            let (Some(number), Some(own)) = (run.number(), self.front.direction(run)) else { continue };
            for direction in (0..count).filter(|&other| other != own && !known.contains(&(number, other))) {
                let (outcome, measured) = match &run.outcome {
                    Some(OpenEnum::Known(outcome @ Outcome::Infeasible { .. })) => {
                        (outcome.clone(), run.measurements.clone())
                    }
                    Some(OpenEnum::Known(Outcome::Ok)) => {
                        let Some(metrics) = self.front.measured(&run.measurements) else { continue };
                        let minimised = self.front.minimised(&metrics);
                        let Some(cost) = self.front.cost(direction, &minimised, ideal.as_deref()) else {
                            continue;
                        };
                        (Outcome::Ok, run.measurements.clone().with(Front::COST, cost))
                    }
                    // Such a result says nothing of the configuration.
                    _ => continue,
                };
                let client_id: String = run.client_id.chars().take(CLIENT_CHARACTERS).collect();
                let question = Question {
                    indicators: run.indicators.clone().with(Front::DIRECTION, direction as f64),
                    // Not the client that runs, whose visits stay as they are.
                    client_id: Some(format!("{client_id}/front")),
                    fingerprint: run.fingerprint.clone(),
                    wanted: Some(run.configuration.clone()),
                    origin: Some(run.name.clone()),
                    ..Question::default()
                };
                owed.push((question, measured, outcome));
            }
        }
        owed
    }

    fn runs(&self) -> impl Iterator<Item = &TrialRecord> {
        self.trials.iter().filter(|trial| carried_from(trial).is_none())
    }

    /// The best of each metric in the runs before the first trial that needed it; `None` while only the
    /// metrics themselves are minimised.
    fn ideal(&self) -> Option<Vec<f64>> {
        let extremes = self.front.metrics.len();
        let needs_it = |trial: &&TrialRecord| self.front.direction(trial).is_some_and(|one| one >= extremes);
        let first = self.trials.iter().filter(needs_it).filter_map(TrialRecord::number).min();
        let wanted = (self.planned / FIRST_PART).max(2) as usize;
        let is_due =
            || self.runs().count() >= wanted || (0..extremes).all(|direction| self.over.contains(&direction));
        if first.is_none() && !is_due() {
            return None;
        }
        let before =
            self.runs().filter(|run| is_measured(run) && first.is_none_or(|end| run.number() < Some(end)));
        let measured = before.filter_map(|run| self.front.measured(&run.measurements));
        measured
            .map(|metrics| self.front.minimised(&metrics))
            .reduce(|best, one| best.iter().zip(&one).map(|(a, b)| a.min(*b)).collect())
    }
}

fn is_measured(trial: &TrialRecord) -> bool {
    trial.outcome == Some(OpenEnum::Known(Outcome::Ok))
        && trial.fidelity.is_none()
        && trial.exclusion.is_none()
}

/// The number of the run whose result a trial of this study repeats for its own direction.
fn carried_from(trial: &TrialRecord) -> Option<u64> {
    let own = trial.origin.as_ref()?.strip_prefix(OWN)?;
    own.rsplit_once('/')?.1.parse().ok()
}

/// The median of each metric.
fn medians(runs: &[Vec<f64>]) -> Vec<f64> {
    let median = |metric: usize| {
        let mut values: Vec<f64> = runs.iter().map(|run| run[metric]).collect();
        values.sort_by(f64::total_cmp);
        (values[(values.len() - 1) / 2] + values[values.len() / 2]) / 2.0
    };
    (0..runs[0].len()).map(median).collect()
}

/// The places of the points of which no other is as small everywhere and smaller somewhere, sorted by their
/// values. Who is dominated is so by one that comes earlier in this order and is itself not dominated.
fn non_dominated(points: &[Vec<f64>]) -> Vec<usize> {
    let order =
        |a: &usize, b: &usize| points[*a].partial_cmp(&points[*b]).unwrap_or(std::cmp::Ordering::Equal);
    let mut places: Vec<usize> = (0..points.len()).collect();
    places.sort_by(order);
    let mut kept: Vec<usize> = Vec::new();
    for place in places {
        let one = &points[place];
        let dominates = |other: &Vec<f64>| other != one && other.iter().zip(one).all(|(a, b)| a <= b);
        if !kept.iter().any(|&other| dominates(&points[other])) {
            kept.push(place);
        }
    }
    kept
}

/// The volume of the unit cube of `dimensions` dimensions between the points and its far corner, by slices
/// across the last dimension.
fn hypervolume(points: &[&[f64]], dimensions: usize) -> f64 {
    let last = dimensions - 1;
    if last == 0 {
        return points.iter().map(|point| 1.0 - point[0]).fold(0.0, f64::max);
    }
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[last].total_cmp(&b[last]));
    let slice = |index: usize| {
        let end = sorted.get(index + 1).map_or(1.0, |next| next[last]);
        hypervolume(&sorted[..=index], last) * (end - sorted[index][last])
    };
    (0..sorted.len()).map(slice).sum()
}

#[cfg(test)]
mod tests;
