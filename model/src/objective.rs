//! The scalar that is minimised: a weighted sum of named measurements.
//!
//! Measurements are kept raw, so that the same numbers can be weighed differently later. Render time alone
//! is one term `render_ms`; build and render together are two (paper sections 3.3 and 7).

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::limits::{AUXILIARY_METRICS_MAX, OBJECTIVE_TERMS_MAX};
use crate::names::{NAME_RULE, is_name};

/// A weighted metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectiveTerm {
    /// Name of a measurement, spelt like a parameter.
    pub metric: String,
    /// Finite, greater than 0.
    pub weight: f64,
}

/// 1 to 16 terms with distinct metrics, and at most 8 auxiliary metrics that are none of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct Objective {
    terms: Vec<ObjectiveTerm>,
    auxiliary: Vec<String>,
}

/// An objective as it is stored: the list of its terms where there is nothing else.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Stored {
    Terms(Vec<ObjectiveTerm>),
    Whole { terms: Vec<ObjectiveTerm>, auxiliary: Vec<String> },
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
    /// An auxiliary metric occurs twice, or is what is minimised.
    #[error("auxiliary metric {metric:?} is listed already; leave it out, its measurements are known")]
    AuxiliaryTwice {
        /// As given.
        metric: String,
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
        Ok(Objective { terms, auxiliary: Vec::new() })
    }

    /// This objective with metrics that explain costs and are no part of them; see [`Objective::auxiliary`].
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

    /// Metrics that reports may carry beside those of the terms, in the order in which they were given:
    /// quantities that explain a cost, such as the processor time of a frame. The noise of a cost that they
    /// explain is taken out before it is compared with others.
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

    /// The weighted sum, in the unit of the metrics: finite, at least 0.
    pub fn cost(&self, measurements: &BTreeMap<String, f64>) -> Result<f64, ObjectiveError> {
        let mut cost = 0.0;
        for ObjectiveTerm { metric, weight } in &self.terms {
            let Some(&value) = measurements.get(metric) else {
                return Err(ObjectiveError::MetricMissing { metric: metric.clone() });
            };
            if !value.is_finite() || value < 0.0 {
                return Err(ObjectiveError::MetricValue { metric: metric.clone(), value });
            }
            cost += weight * value;
        }
        if cost.is_finite() { Ok(cost + 0.0) } else { Err(ObjectiveError::Overflow) }
    }
}

impl TryFrom<Stored> for Objective {
    type Error = ObjectiveError;

    fn try_from(stored: Stored) -> Result<Self, ObjectiveError> {
        match stored {
            Stored::Terms(terms) => Objective::new(terms),
            Stored::Whole { terms, auxiliary } => Objective::new(terms)?.with_auxiliary(auxiliary),
        }
    }
}

impl From<Objective> for Stored {
    fn from(Objective { terms, auxiliary }: Objective) -> Self {
        if auxiliary.is_empty() { Stored::Terms(terms) } else { Stored::Whole { terms, auxiliary } }
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
