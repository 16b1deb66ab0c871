//! The objective, a scalar to minimise: a weighted sum of named measurements.
//!
//! Measurements are kept raw, so that they can be weighed differently later. Render time alone is one term
//! `render_ms`; build and render together are two (paper sections 3.3 and 7).

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::cost_view::CostView;
use crate::fidelity::{self, Fidelity};
use crate::limits::{
    AUXILIARY_METRICS_MAX, EPISODE_FRAMES_MAX, MEASUREMENT_LIMITS_MAX, MEASUREMENTS_MAX, OBJECTIVE_TERMS_MAX,
};
use crate::names::{NAME_RULE, is_name};

/// A weighted metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectiveTerm {
    /// Name of a measurement, spelt like a parameter.
    pub metric: String,
    /// Finite, greater than 0.
    pub weight: f64,
}

/// The least and the most that a measurement may be, or one of these. A configuration beyond is infeasible.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasurementLimit {
    /// Name of a measurement. It may be minimised, too.
    pub metric: String,
    /// Finite; `None` for no lower end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    /// Finite; `None` for no upper end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
}

impl MeasurementLimit {
    /// Whether a measurement is within it.
    pub fn allows(&self, value: f64) -> bool {
        self.at_least.is_none_or(|low| value >= low) && self.at_most.is_none_or(|high| value <= high)
    }
}

impl fmt::Display for MeasurementLimit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { metric, at_least, at_most } = self;
        match (at_least, at_most) {
            (Some(low), Some(high)) => write!(formatter, "{low} <= {metric} <= {high}"),
            (Some(low), None) => write!(formatter, "{metric} >= {low}"),
            (None, Some(high)) => write!(formatter, "{metric} <= {high}"),
            (None, None) => write!(formatter, "{metric}"),
        }
    }
}

/// The objective of a study: 1 to 16 terms with distinct metrics, each minimised or maximised. It has at most
/// 8 auxiliary metrics that are none of them, at most 16 limits on distinct measurements, 1 to 64 frames a
/// trial, and at most 4 cheaper levels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct Objective {
    pub(crate) terms: Vec<ObjectiveTerm>,
    pub(crate) auxiliary: Vec<String>,
    pub(crate) limits: Vec<MeasurementLimit>,
    pub(crate) maximised: Vec<String>,
    pub(crate) episode_frames: u32,
    pub(crate) fidelities: Vec<Fidelity>,
}

/// The stored form of an objective: the list of its terms where it has no other parts.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Stored {
    Terms(Vec<ObjectiveTerm>),
    Whole {
        terms: Vec<ObjectiveTerm>,
        auxiliary: Vec<String>,
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        limits: Vec<MeasurementLimit>,
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        maximised: Vec<String>,
    },
    /// Its terms have a name that earlier versions do not read, because those would minimise them all, take a
    /// frame for a trial, and a trial at a cheaper level for a full one.
    Directed {
        directed_terms: Vec<ObjectiveTerm>,
        auxiliary: Vec<String>,
        limits: Vec<MeasurementLimit>,
        maximised: Vec<String>,
        #[serde(default = "one_frame", skip_serializing_if = "is_one_frame")]
        episode_frames: u32,
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        fidelities: Vec<Fidelity>,
    },
}

fn one_frame() -> u32 {
    1
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde hands over a reference
fn is_one_frame(frames: &u32) -> bool {
    *frames == 1
}

/// Why an objective is refused, or cannot be computed: names the metric, the mistake and its remedy.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{0}")]
pub struct ObjectiveError(String);

fn refuse<T>(problem: impl Into<String>) -> Result<T, ObjectiveError> {
    Err(ObjectiveError(problem.into()))
}

/// Checks the measurements of a report, and their standard errors.
///
/// # Errors
/// [`ObjectiveError`] with the first that is misspelt, not finite or negative, with a standard error of no
/// measurement, or with the number of too many.
pub fn check_report(
    measurements: &BTreeMap<String, f64>,
    standard_errors: &BTreeMap<String, f64>,
) -> Result<(), ObjectiveError> {
    let count = measurements.len();
    if count > MEASUREMENTS_MAX {
        return refuse(format!("{count} measurements; at most {MEASUREMENTS_MAX} are allowed"));
    }
    for (metric, &value) in measurements {
        if !is_name(metric) {
            return refuse(format!("measurement {metric:?} is not a name; use {NAME_RULE}"));
        }
        check_measurement(metric, value)?;
    }
    for (metric, &error) in standard_errors {
        if !measurements.contains_key(metric) {
            return refuse(format!(
                "standard error of {metric:?}: the report has no such measurement; leave it out"
            ));
        }
        if !error.is_finite() || error < 0.0 {
            return refuse(format!(
                "standard error of {metric:?} is {error}; it must be finite and not negative"
            ));
        }
    }
    Ok(())
}

/// Checks a measurement, which must be finite and not negative.
fn check_measurement(metric: &str, value: f64) -> Result<(), ObjectiveError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    refuse(format!("measurement {metric:?} is {value}; it must be finite and not negative"))
}

impl Objective {
    /// Checks and takes the terms.
    pub fn new(terms: Vec<ObjectiveTerm>) -> Result<Self, ObjectiveError> {
        if terms.is_empty() || terms.len() > OBJECTIVE_TERMS_MAX {
            let count = terms.len();
            return refuse(format!("the objective has {count} terms; give 1 to {OBJECTIVE_TERMS_MAX}"));
        }
        let mut seen = BTreeSet::new();
        for ObjectiveTerm { metric, weight } in &terms {
            if !is_name(metric) {
                return refuse(format!("objective metric {metric:?} is not a name; use {NAME_RULE}"));
            }
            if !seen.insert(metric) {
                return refuse(format!(
                    "objective metric {metric:?} is listed twice; join the two terms by adding their weights"
                ));
            }
            if !weight.is_finite() || *weight <= 0.0 {
                return refuse(format!(
                    "objective metric {metric:?} has weight {weight}; it must be finite and greater than 0"
                ));
            }
        }
        Ok(Objective { terms, ..Objective::empty() })
    }

    /// Without any part, to which parts are added that are [checked](Objective::checked) together.
    pub(crate) fn empty() -> Self {
        let (terms, auxiliary, limits, maximised) = Default::default();
        Objective { terms, auxiliary, limits, maximised, episode_frames: 1, fidelities: Vec::new() }
    }

    pub(crate) fn checked(self) -> Result<Self, ObjectiveError> {
        let Objective { terms, auxiliary, limits, maximised, episode_frames, fidelities } = self;
        let objective = Objective::new(terms)?.with_auxiliary(auxiliary)?.with_limits(limits)?;
        let objective = objective.with_maximised(maximised)?.with_episode_frames(episode_frames)?;
        objective.with_fidelities(fidelities)
    }

    /// This objective with metrics that explain costs without being part of them; see
    /// [`Objective::auxiliary`].
    pub fn with_auxiliary(self, auxiliary: Vec<String>) -> Result<Self, ObjectiveError> {
        if auxiliary.len() > AUXILIARY_METRICS_MAX {
            let count = auxiliary.len();
            return refuse(format!(
                "the objective has {count} auxiliary metrics; give at most {AUXILIARY_METRICS_MAX}"
            ));
        }
        let mut seen: BTreeSet<&String> = self.terms.iter().map(|term| &term.metric).collect();
        for metric in &auxiliary {
            if !is_name(metric) {
                return refuse(format!("auxiliary metric {metric:?} is not a name; use {NAME_RULE}"));
            }
            if !seen.insert(metric) {
                return refuse(format!(
                    "auxiliary metric {metric:?} is listed already; leave it out, its measurements are known"
                ));
            }
        }
        Ok(Objective { auxiliary, ..self })
    }

    /// This objective with limits on measurements.
    pub fn with_limits(self, limits: Vec<MeasurementLimit>) -> Result<Self, ObjectiveError> {
        if limits.len() > MEASUREMENT_LIMITS_MAX {
            let count = limits.len();
            return refuse(format!(
                "the objective has {count} limits; give at most {MEASUREMENT_LIMITS_MAX}"
            ));
        }
        let mut seen = BTreeSet::new();
        for limit in &limits {
            let MeasurementLimit { metric, at_least, at_most } = limit;
            let finite = [at_least, at_most].into_iter().flatten().all(|end| end.is_finite());
            let some = at_least.is_some() || at_most.is_some();
            let ordered = at_least.zip(*at_most).is_none_or(|(low, high)| low <= high);
            if !(is_name(metric) && seen.insert(metric) && finite && some && ordered) {
                let limit = limit.to_string();
                return refuse(format!(
                    "limit {limit:?} is not one; give a measurement's name ({NAME_RULE}), once, and a finite at_least, \
                     at_most or both, the first not above the second"
                ));
            }
        }
        Ok(Objective { limits, ..self })
    }

    /// This objective with maximised metrics among its terms. Such a term counts with its weight over the
    /// measurement: a thousand over frames a second is the milliseconds of a frame. Their order means
    /// nothing, and becomes that of the terms.
    pub fn with_maximised(self, maximised: Vec<String>) -> Result<Self, ObjectiveError> {
        let mut seen = BTreeSet::new();
        for metric in &maximised {
            if !(self.terms.iter().any(|term| term.metric == *metric) && seen.insert(metric)) {
                return refuse(format!(
                    "{metric:?} is to be maximised; name it once, and as a term of the objective"
                ));
            }
        }
        let metrics = self.terms.iter().map(|term| &term.metric);
        let maximised = metrics.filter(|metric| seen.contains(metric)).cloned().collect();
        Ok(Objective { maximised, ..self })
    }

    /// This objective with trials of several frames; see [`Objective::episode_frames`].
    pub fn with_episode_frames(self, frames: u32) -> Result<Self, ObjectiveError> {
        if !(1..=EPISODE_FRAMES_MAX).contains(&frames) {
            return refuse(format!("episode_frames is {frames}; give 1 to {EPISODE_FRAMES_MAX}"));
        }
        Ok(Objective { episode_frames: frames, ..self })
    }

    /// The number of frames of a trial, 1 to 64. Their mean is the trial's measurement, which shows what a
    /// single frame does not: costs that rise or fall while a configuration is in use.
    pub fn episode_frames(&self) -> u32 {
        self.episode_frames
    }

    /// This objective with cheaper levels at which it can be measured, the cheapest first.
    pub fn with_fidelities(self, fidelities: Vec<Fidelity>) -> Result<Self, ObjectiveError> {
        match fidelity::problem(&fidelities) {
            Some(problem) => refuse(format!("fidelities: {problem}")),
            None => Ok(Objective { fidelities, ..self }),
        }
    }

    /// The levels below the full one, the cheapest first.
    pub fn fidelities(&self) -> &[Fidelity] {
        &self.fidelities
    }

    /// The metrics that are maximised, in the order of the terms.
    pub fn maximised(&self) -> &[String] {
        &self.maximised
    }

    /// The view of costs: the metric, where one is maximised and nothing else counts.
    pub fn view(&self) -> CostView {
        match (self.terms.as_slice(), self.maximised.as_slice()) {
            ([term], [_]) => CostView::maximising(&term.metric, term.weight),
            _ => CostView::default(),
        }
    }

    /// The limits on measurements, in the order in which they were given.
    pub fn limits(&self) -> &[MeasurementLimit] {
        &self.limits
    }

    /// The first limit that measurements exceed, in words.
    ///
    /// # Errors
    /// [`ObjectiveError`] where one is missing.
    pub fn beyond(&self, measurements: &BTreeMap<String, f64>) -> Result<Option<String>, ObjectiveError> {
        for limit in &self.limits {
            let metric = &limit.metric;
            let Some(&value) = measurements.get(metric) else {
                return refuse(format!(
                    "measurement {metric:?} is missing; the study limits it ({limit}): measure it, or report \
                     another outcome"
                ));
            };
            if !limit.allows(value) {
                return Ok(Some(format!("{metric} is {value}, and the study asks for {limit}")));
            }
        }
        Ok(None)
    }

    /// Metrics that reports may carry beside those of the terms, in the order in which they were given:
    /// quantities that explain a cost, such as the processor time of a frame. The explained noise of a cost
    /// is removed before costs are compared.
    pub fn auxiliary(&self) -> &[String] {
        &self.auxiliary
    }

    /// The auxiliary measurements of a report, in the order of [`Objective::auxiliary`]; `None` where there
    /// are none, or one is missing or 0.
    pub fn auxiliary_of(&self, measurements: &BTreeMap<String, f64>) -> Option<Vec<f64>> {
        let values = self.auxiliary.iter().map(|metric| measurements.get(metric).copied());
        let values: Vec<f64> = values.collect::<Option<_>>()?;
        let usable = !values.is_empty() && values.iter().all(|&value| value > 0.0 && value.is_finite());
        usable.then_some(values)
    }

    /// The terms, in the order in which they were given.
    pub fn terms(&self) -> &[ObjectiveTerm] {
        &self.terms
    }

    /// The weighted sum, in the unit of the metrics: finite, at least 0. A maximised metric counts by its
    /// reciprocal.
    pub fn cost(&self, measurements: &BTreeMap<String, f64>) -> Result<f64, ObjectiveError> {
        let mut cost = 0.0;
        for ObjectiveTerm { metric, weight } in &self.terms {
            let Some(&value) = measurements.get(metric) else {
                return refuse(format!(
                    "measurement {metric:?} is missing; the objective needs it: measure it, or report another \
                     outcome"
                ));
            };
            check_measurement(metric, value)?;
            if self.maximised.contains(metric) {
                if !(weight / value).is_finite() {
                    return refuse(format!(
                        "measurement {metric:?} is {value}; what is maximised must be above 0, since its reciprocal \
                         is the cost"
                    ));
                }
                cost += weight / value;
            } else {
                cost += weight * value;
            }
        }
        if cost.is_finite() {
            return Ok(cost + 0.0);
        }
        refuse("the weighted sum of the measurements is not finite; use smaller measurements or weights")
    }

    /// The standard error of the cost of measurements, as a share of that cost, from independent standard
    /// errors of measurements. It is finite. It is 0 where none of a term is known, or the cost is 0 or none.
    pub fn relative_error(
        &self,
        measurements: &BTreeMap<String, f64>,
        standard_errors: &BTreeMap<String, f64>,
    ) -> f64 {
        if standard_errors.is_empty() {
            return 0.0;
        }
        let Some(cost) = self.cost(measurements).ok().filter(|cost| *cost > 0.0) else { return 0.0 };
        let square = |ObjectiveTerm { metric, weight }: &ObjectiveTerm| {
            let (value, error) = (measurements.get(metric)?, standard_errors.get(metric)?);
            // To first order the relative errors of a measurement and of its reciprocal are equal.
            let of_cost = match self.maximised.contains(metric) {
                true => weight / value * (error / value),
                false => weight * error,
            };
            Some((of_cost / cost) * (of_cost / cost))
        };
        // What leaves the range of a double is as good as unknown.
        self.terms.iter().filter_map(square).sum::<f64>().sqrt().min(f64::MAX)
    }
}

/// `minimises 0.5 × build_ms + 1000 / fps`, or `maximises fps` where nothing else counts; with `, the mean of
/// 24 frames` where trials have several.
impl fmt::Display for Objective {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let view = self.view();
        if view.is_maximised() {
            write!(formatter, "maximises {}", view.name())?;
        } else {
            for (index, ObjectiveTerm { metric, weight }) in self.terms.iter().enumerate() {
                let before = if index == 0 { "minimises" } else { " +" };
                let sign = if self.maximised.contains(metric) { '/' } else { '×' };
                write!(formatter, "{before} {weight} {sign} {metric}")?;
            }
        }
        match self.episode_frames {
            1 => Ok(()),
            frames => write!(formatter, ", the mean of {frames} frames"),
        }
    }
}

impl TryFrom<Stored> for Objective {
    type Error = ObjectiveError;

    fn try_from(stored: Stored) -> Result<Self, ObjectiveError> {
        match stored {
            Stored::Terms(terms) => Objective::new(terms),
            Stored::Whole { terms, auxiliary, limits, maximised } => {
                Objective { terms, auxiliary, limits, maximised, ..Objective::empty() }.checked()
            }
            Stored::Directed { directed_terms, auxiliary, limits, maximised, episode_frames, fidelities } => {
                let terms = directed_terms;
                Objective { terms, auxiliary, limits, maximised, episode_frames, fidelities }.checked()
            }
        }
    }
}

impl From<Objective> for Stored {
    fn from(objective: Objective) -> Self {
        let Objective { terms, auxiliary, limits, maximised, episode_frames, fidelities } = objective;
        let is_directed = !maximised.is_empty() || episode_frames != 1 || !fidelities.is_empty();
        match (is_directed, auxiliary.is_empty() && limits.is_empty()) {
            (false, true) => Stored::Terms(terms),
            (false, false) => Stored::Whole { terms, auxiliary, limits, maximised },
            (true, _) => Stored::Directed {
                directed_terms: terms,
                auxiliary,
                limits,
                maximised,
                episode_frames,
                fidelities,
            },
        }
    }
}

#[cfg(test)]
mod tests;
