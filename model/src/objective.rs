//! The objective, a scalar to minimise: a weighted sum of named measurements.
//!
//! Measurements are kept raw, so that they can be weighed differently later. Render time alone is one term
//! `render_ms`; build and render together are two (paper sections 3.3 and 7).

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::cost_view::CostView;
use crate::limits::{AUXILIARY_METRICS_MAX, EPISODE_FRAMES_MAX, MEASUREMENT_LIMITS_MAX, OBJECTIVE_TERMS_MAX};
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

/// 1 to 16 terms with distinct metrics, each minimised or maximised, at most 8 auxiliary metrics that are
/// none of them, at most 16 limits on distinct measurements, and 1 to 64 frames a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct Objective {
    terms: Vec<ObjectiveTerm>,
    auxiliary: Vec<String>,
    limits: Vec<MeasurementLimit>,
    maximised: Vec<String>,
    episode_frames: u32,
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
    /// Its terms have a name that earlier versions do not read, because those would minimise them all, and
    /// take a frame for a trial.
    Directed {
        directed_terms: Vec<ObjectiveTerm>,
        auxiliary: Vec<String>,
        limits: Vec<MeasurementLimit>,
        maximised: Vec<String>,
        #[serde(default = "one_frame", skip_serializing_if = "is_one_frame")]
        episode_frames: u32,
    },
}

fn one_frame() -> u32 {
    1
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde hands over a reference
fn is_one_frame(frames: &u32) -> bool {
    *frames == 1
}

/// Why an objective is refused, or cannot be computed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ObjectiveError {
    /// No term, or too many.
    #[error("the objective has {count} terms; give 1 to {OBJECTIVE_TERMS_MAX}")]
    TermCount {
        /// The number that was given.
        count: usize,
    },
    /// A metric is not spelt like a name.
    #[error("objective metric {metric:?} is not a name; use {NAME_RULE}")]
    MetricName {
        /// As given.
        metric: String,
    },
    /// A metric occurs twice.
    #[error("objective metric {metric:?} is listed twice; join the two terms by adding their weights")]
    MetricTwice {
        /// As given.
        metric: String,
    },
    /// A weight is not positive and finite.
    #[error("objective metric {metric:?} has weight {weight}; it must be finite and greater than 0")]
    Weight {
        /// The metric.
        metric: String,
        /// As given.
        weight: f64,
    },
    /// A report lacks a metric.
    #[error("measurement {metric:?} is missing; the objective needs it")]
    MetricMissing {
        /// The missing one.
        metric: String,
    },
    /// A measurement is not usable.
    #[error("measurement {metric:?} is {value}; it must be finite and not negative")]
    MetricValue {
        /// The metric.
        metric: String,
        /// As given.
        value: f64,
    },
    /// Too many auxiliary metrics.
    #[error("the objective has {count} auxiliary metrics; give at most {AUXILIARY_METRICS_MAX}")]
    AuxiliaryCount {
        /// The number that was given.
        count: usize,
    },
    /// An auxiliary metric is not spelt like a name.
    #[error("auxiliary metric {metric:?} is not a name; use {NAME_RULE}")]
    AuxiliaryName {
        /// As given.
        metric: String,
    },
    /// An auxiliary metric occurs twice, or is a term of the objective.
    #[error("auxiliary metric {metric:?} is listed already; leave it out, its measurements are known")]
    AuxiliaryTwice {
        /// As given.
        metric: String,
    },
    /// A maximised metric is no term, or is listed twice.
    #[error("{metric:?} is to be maximised; name it once, and as a term of the objective")]
    Maximised {
        /// As given.
        metric: String,
    },
    /// A maximised measurement is 0 or nearly 0.
    #[error(
        "measurement {metric:?} is {value}; what is maximised must be above 0, since its reciprocal is the cost"
    )]
    MaximisedValue {
        /// The metric.
        metric: String,
        /// As given.
        value: f64,
    },
    /// Too many limits.
    #[error("the objective has {count} limits; give at most {MEASUREMENT_LIMITS_MAX}")]
    LimitCount {
        /// The number that was given.
        count: usize,
    },
    /// A limit is not valid.
    #[error(
        "limit {limit:?} is not one; give a measurement's name ({NAME_RULE}), once, and a finite at_least, at_most or both, \
         the first not above the second"
    )]
    Limit {
        /// As given.
        limit: String,
    },
    /// A report lacks a limited metric.
    #[error("measurement {metric:?} is missing; the study limits it ({limit})")]
    LimitedMissing {
        /// The missing one.
        metric: String,
        /// The limit.
        limit: String,
    },
    /// No frame in a trial, or too many.
    #[error("episode_frames is {frames}; give 1 to {EPISODE_FRAMES_MAX}")]
    EpisodeFrames {
        /// As given.
        frames: u32,
    },
    /// The sum left the range of a double.
    #[error("the weighted sum of the measurements is not finite; use smaller measurements or weights")]
    Overflow,
}

impl Objective {
    /// Checks and takes the terms.
    pub fn new(terms: Vec<ObjectiveTerm>) -> Result<Self, ObjectiveError> {
        if terms.is_empty() || terms.len() > OBJECTIVE_TERMS_MAX {
            return Err(ObjectiveError::TermCount { count: terms.len() });
        }
        let mut seen = BTreeSet::new();
        for ObjectiveTerm { metric, weight } in &terms {
            if !is_name(metric) {
                return Err(ObjectiveError::MetricName { metric: metric.clone() });
            }
            if !seen.insert(metric) {
                return Err(ObjectiveError::MetricTwice { metric: metric.clone() });
            }
            if !weight.is_finite() || *weight <= 0.0 {
                return Err(ObjectiveError::Weight { metric: metric.clone(), weight: *weight });
            }
        }
        let (auxiliary, limits, maximised) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Objective { terms, auxiliary, limits, maximised, episode_frames: 1 })
    }

    /// This objective with metrics that explain costs without being part of them; see
    /// [`Objective::auxiliary`].
    pub fn with_auxiliary(self, auxiliary: Vec<String>) -> Result<Self, ObjectiveError> {
        if auxiliary.len() > AUXILIARY_METRICS_MAX {
            return Err(ObjectiveError::AuxiliaryCount { count: auxiliary.len() });
        }
        let mut seen: BTreeSet<&String> = self.terms.iter().map(|term| &term.metric).collect();
        for metric in &auxiliary {
            if !is_name(metric) {
                return Err(ObjectiveError::AuxiliaryName { metric: metric.clone() });
            }
            if !seen.insert(metric) {
                return Err(ObjectiveError::AuxiliaryTwice { metric: metric.clone() });
            }
        }
        Ok(Objective { auxiliary, ..self })
    }

    /// This objective with limits on measurements.
    pub fn with_limits(self, limits: Vec<MeasurementLimit>) -> Result<Self, ObjectiveError> {
        if limits.len() > MEASUREMENT_LIMITS_MAX {
            return Err(ObjectiveError::LimitCount { count: limits.len() });
        }
        let mut seen = BTreeSet::new();
        for limit in &limits {
            let MeasurementLimit { metric, at_least, at_most } = limit;
            let finite = [at_least, at_most].into_iter().flatten().all(|end| end.is_finite());
            let some = at_least.is_some() || at_most.is_some();
            let ordered = at_least.zip(*at_most).is_none_or(|(low, high)| low <= high);
            if !(is_name(metric) && seen.insert(metric) && finite && some && ordered) {
                return Err(ObjectiveError::Limit { limit: limit.to_string() });
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
                return Err(ObjectiveError::Maximised { metric: metric.clone() });
            }
        }
        let metrics = self.terms.iter().map(|term| &term.metric);
        let maximised = metrics.filter(|metric| seen.contains(metric)).cloned().collect();
        Ok(Objective { maximised, ..self })
    }

    /// This objective with trials of several frames; see [`Objective::episode_frames`].
    pub fn with_episode_frames(self, frames: u32) -> Result<Self, ObjectiveError> {
        if !(1..=EPISODE_FRAMES_MAX).contains(&frames) {
            return Err(ObjectiveError::EpisodeFrames { frames });
        }
        Ok(Objective { episode_frames: frames, ..self })
    }

    /// The number of frames of a trial, 1 to 64. Their mean is the trial's measurement, which shows what a
    /// single frame does not: costs that rise or fall while a configuration is in use.
    pub fn episode_frames(&self) -> u32 {
        self.episode_frames
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
    /// [`ObjectiveError::LimitedMissing`].
    pub fn beyond(&self, measurements: &BTreeMap<String, f64>) -> Result<Option<String>, ObjectiveError> {
        for limit in &self.limits {
            let metric = &limit.metric;
            let Some(&value) = measurements.get(metric) else {
                let limit = limit.to_string();
                return Err(ObjectiveError::LimitedMissing { metric: metric.clone(), limit });
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
                return Err(ObjectiveError::MetricMissing { metric: metric.clone() });
            };
            if !value.is_finite() || value < 0.0 {
                return Err(ObjectiveError::MetricValue { metric: metric.clone(), value });
            }
            if self.maximised.contains(metric) {
                if !(weight / value).is_finite() {
                    return Err(ObjectiveError::MaximisedValue { metric: metric.clone(), value });
                }
                cost += weight / value;
            } else {
                cost += weight * value;
            }
        }
        if cost.is_finite() { Ok(cost + 0.0) } else { Err(ObjectiveError::Overflow) }
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
            Stored::Whole { terms, auxiliary, limits, maximised } => Objective::new(terms)?
                .with_auxiliary(auxiliary)?
                .with_limits(limits)?
                .with_maximised(maximised),
            Stored::Directed { directed_terms, auxiliary, limits, maximised, episode_frames } => {
                Objective::new(directed_terms)?
                    .with_auxiliary(auxiliary)?
                    .with_limits(limits)?
                    .with_maximised(maximised)?
                    .with_episode_frames(episode_frames)
            }
        }
    }
}

impl From<Objective> for Stored {
    fn from(objective: Objective) -> Self {
        let Objective { terms, auxiliary, limits, maximised, episode_frames } = objective;
        match (maximised.is_empty() && episode_frames == 1, auxiliary.is_empty() && limits.is_empty()) {
            (true, true) => Stored::Terms(terms),
            (true, false) => Stored::Whole { terms, auxiliary, limits, maximised },
            (false, _) => {
                Stored::Directed { directed_terms: terms, auxiliary, limits, maximised, episode_frames }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn term(metric: &str, weight: f64) -> ObjectiveTerm {
        ObjectiveTerm { metric: metric.into(), weight }
    }

    #[test]
    fn the_cost_is_the_weighted_sum() {
        let objective =
            Objective::new(vec![term("build_ms", 1.0 / 4.0), term("render_ms", 1.0)]).expect("valid");
        let mut measurements = BTreeMap::from([("build_ms".to_owned(), 8.0), ("render_ms".to_owned(), 3.0)]);
        assert_eq!(objective.cost(&measurements), Ok(5.0));
        measurements.insert("render_ms".into(), f64::NAN);
        assert!(matches!(objective.cost(&measurements), Err(ObjectiveError::MetricValue { .. })));
        measurements.insert("render_ms".into(), f64::MAX);
        measurements.insert("build_ms".into(), f64::MAX);
        assert_eq!(objective.cost(&measurements), Err(ObjectiveError::Overflow));
        measurements.remove("build_ms");
        assert!(
            objective
                .cost(&measurements)
                .expect_err("missing")
                .to_string()
                .contains("\"build_ms\" is missing")
        );
    }

    #[test]
    fn what_is_maximised_costs_its_reciprocal() {
        let plain = Objective::new(vec![term("build_ms", 0.5), term("fps", 1000.0)]).expect("valid");
        for wrong in [vec!["frames"], vec!["fps", "fps"]] {
            let wrong = wrong.into_iter().map(str::to_owned).collect();
            assert!(matches!(plain.clone().with_maximised(wrong), Err(ObjectiveError::Maximised { .. })));
        }
        let both = plain.clone().with_maximised(vec!["fps".to_owned()]).expect("valid");
        let measured = |fps: f64| BTreeMap::from([("build_ms".to_owned(), 8.0), ("fps".to_owned(), fps)]);
        assert_eq!(both.cost(&measured(50.0)), Ok(24.0));
        assert_eq!(both.cost(&measured(100.0)), Ok(14.0), "more is better");
        for wrong in [0.0, 1e-320] {
            let refused = both.cost(&measured(wrong));
            assert!(matches!(refused, Err(ObjectiveError::MaximisedValue { .. })), "{wrong}: {refused:?}");
        }
        assert_eq!(both.view(), CostView::default(), "it is not alone");
        assert_eq!(both.to_string(), "minimises 0.5 × build_ms + 1000 / fps");
        let one = Objective::new(vec![term("fps", 1000.0)]).expect("valid");
        assert_eq!(one.view(), CostView::default(), "it is minimised");
        let one = one.with_maximised(vec!["fps".to_owned()]).expect("valid");
        assert_eq!((one.to_string().as_str(), one.view().value(20.0)), ("maximises fps", 50.0));
        let text = serde_json::to_string(&one).expect("plain data");
        assert_eq!(serde_json::from_str::<Objective>(&text).expect("its own form"), one);
        // A version without maximised metrics finds no terms, and so cannot minimise them.
        assert!(!text.contains("\"terms\""), "{text}");
        let older = text.replace("directed_terms", "terms");
        assert_eq!(serde_json::from_str::<Objective>(&older).expect("an earlier form"), one);
    }

    #[test]
    fn trials_of_several_frames_are_checked_stored_and_told() {
        let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
        let text = |objective: &Objective| serde_json::to_string(objective).expect("plain data");
        for wrong in [0, EPISODE_FRAMES_MAX + 1] {
            let refused = plain.clone().with_episode_frames(wrong);
            assert_eq!(refused, Err(ObjectiveError::EpisodeFrames { frames: wrong }));
        }
        let one = plain.clone().with_episode_frames(1).expect("valid");
        assert_eq!(text(&one), r#"[{"metric":"render_ms","weight":1.0}]"#, "as ever");
        let many = plain.with_episode_frames(EPISODE_FRAMES_MAX).expect("valid");
        assert_eq!(many.to_string(), "minimises 1 × render_ms, the mean of 64 frames");
        assert_eq!(serde_json::from_str::<Objective>(&text(&many)).expect("its own form"), many);
        // A version that knows no episodes finds no terms, and so cannot take a frame for a trial.
        assert!(!text(&many).contains("\"terms\""), "{}", text(&many));
        assert!(serde_json::from_str::<Objective>(&text(&many).replace("64", "65")).is_err());
    }

    #[test]
    fn bad_terms_are_refused() {
        for terms in [
            vec![],
            vec![term("a", 1.0); 2],
            vec![term("A", 1.0)],
            vec![term("a", 0.0)],
            vec![term("a", f64::INFINITY)],
            (0..17).map(|i| term(&format!("m{i}"), 1.0)).collect(),
        ] {
            assert!(Objective::new(terms).is_err());
        }
        assert!(serde_json::from_str::<Objective>(r#"[{"metric":"a","weight":-1.0}]"#).is_err());
    }

    #[test]
    fn limits_are_checked_stored_and_told() {
        let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
        let limit =
            |metric: &str, at_least, at_most| MeasurementLimit { metric: metric.into(), at_least, at_most };
        for wrong in [
            vec![limit("no name", None, Some(1.0))],
            vec![limit("a", None, None)],
            vec![limit("a", Some(2.0), Some(1.0))],
            vec![limit("a", None, Some(f64::NAN))],
            vec![limit("a", None, Some(1.0)), limit("a", Some(0.0), None)],
            (0..17).map(|i| limit(&format!("m{i}"), Some(0.0), None)).collect(),
        ] {
            assert!(plain.clone().with_limits(wrong.clone()).is_err(), "{wrong:?}");
        }
        let limits = vec![limit("memory_mb", None, Some(2000.0)), limit("psnr_db", Some(30.0), Some(90.0))];
        let both = plain.clone().with_limits(limits).expect("valid");
        let beyond = |memory_mb: f64, psnr_db: f64| {
            let measured = [("memory_mb", memory_mb), ("psnr_db", psnr_db)];
            both.beyond(&measured.map(|(name, value)| (name.to_owned(), value)).into())
        };
        assert_eq!(beyond(2000.0, 30.0), Ok(None));
        let message = beyond(2300.0, 31.0).expect("it is there").expect("too much");
        assert_eq!(message, "memory_mb is 2300, and the study asks for memory_mb <= 2000");
        assert!(
            beyond(1.0, 91.0)
                .expect("it is there")
                .is_some_and(|message| message.contains("30 <= psnr_db <= 90"))
        );
        let missing = both.beyond(&BTreeMap::from([("memory_mb".to_owned(), 1.0)])).expect_err("no psnr");
        assert!(missing.to_string().contains("\"psnr_db\" is missing"), "{missing}");
        assert_eq!(plain.beyond(&BTreeMap::new()), Ok(None));
        let text = serde_json::to_string(&both).expect("plain data");
        assert_eq!(serde_json::from_str::<Objective>(&text).expect("its own form"), both);
        let before = r#"{"terms":[{"metric":"render_ms","weight":1.0}],"auxiliary":["nodes"]}"#;
        assert!(serde_json::from_str::<Objective>(before).expect("an earlier form").limits().is_empty());
    }

    #[test]
    fn auxiliary_metrics_are_checked_and_stored() {
        let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let with = |given: &[&str]| plain.clone().with_auxiliary(names(given));
        assert!(
            with(&["render_ms"]).is_err() && with(&["cpu", "cpu"]).is_err() && with(&["no name"]).is_err()
        );
        assert!(with(&["a", "b", "c", "d", "e", "f", "g", "h", "i"]).is_err());
        let both = with(&["render_cpu_ms", "nodes"]).expect("valid");
        let measured = |pairs: &[(&str, f64)]| -> BTreeMap<String, f64> {
            pairs.iter().map(|&(name, value)| (name.to_owned(), value)).collect()
        };
        let whole = measured(&[("render_ms", 3.0), ("nodes", 7.0), ("render_cpu_ms", 5.0)]);
        assert_eq!(both.auxiliary_of(&whole), Some(vec![5.0, 7.0]));
        assert_eq!(both.cost(&whole), Ok(3.0));
        assert_eq!(both.auxiliary_of(&measured(&[("nodes", 7.0)])), None);
        assert_eq!(both.auxiliary_of(&measured(&[("nodes", 7.0), ("render_cpu_ms", 0.0)])), None);
        assert_eq!(plain.auxiliary_of(&whole), None);
        for objective in [plain.clone(), both] {
            let text = serde_json::to_string(&objective).expect("plain data");
            assert_eq!(serde_json::from_str::<Objective>(&text).expect("its own form"), objective);
        }
        let old = r#"[{"metric":"render_ms","weight":1.0}]"#;
        assert_eq!(serde_json::from_str::<Objective>(old).expect("an earlier form"), plain);
    }
}
