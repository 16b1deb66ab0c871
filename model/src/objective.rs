//! The scalar that is minimised: a weighted sum of named measurements.
//!
//! Measurements are kept raw, so that the same numbers can be weighed differently later. Render time alone
//! is one term `render_ms`; build and render together are two (paper sections 3.3 and 7).

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::limits::OBJECTIVE_TERMS_MAX;
use crate::names::{NAME_RULE, is_name};

/// A weighted metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectiveTerm {
    /// Name of a measurement, spelt like a parameter.
    pub metric: String,
    /// Finite, greater than 0.
    pub weight: f64,
}

/// 1 to 16 terms with distinct metrics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<ObjectiveTerm>", into = "Vec<ObjectiveTerm>")]
pub struct Objective {
    terms: Vec<ObjectiveTerm>,
}

/// Why an objective is refused, or cannot be computed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ObjectiveError {
    /// No term, or too many.
    #[error("the objective has {count} terms; give 1 to {OBJECTIVE_TERMS_MAX}")]
    TermCount {
        /// How many were given.
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
        Ok(Objective { terms })
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

impl TryFrom<Vec<ObjectiveTerm>> for Objective {
    type Error = ObjectiveError;

    fn try_from(terms: Vec<ObjectiveTerm>) -> Result<Self, ObjectiveError> {
        Objective::new(terms)
    }
}

impl From<Objective> for Vec<ObjectiveTerm> {
    fn from(objective: Objective) -> Self {
        objective.terms
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
}
