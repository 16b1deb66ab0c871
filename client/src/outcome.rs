//! How a trial ended, in the client's words.

use serde::Serialize;

use crate::{ClientError, Measurements, ObjectiveTerm, limits};

/// How a trial ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Measured; the measurements hold every metric of the objective.
    Ok,
    /// The configuration cannot work here, e.g. the builder reached its depth limit. A finding, not an error.
    Infeasible {
        /// For people; cut at 1000 characters.
        reason: String,
    },
    /// Stopped early because it was already worse than needed.
    Aborted {
        /// The objective is at least this; finite, at least 0.
        lower_bound: f64,
    },
    /// The client failed for a reason that says nothing about the configuration; it may be tried again.
    Failed {
        /// For people; cut at 1000 characters.
        reason: String,
    },
}

impl Outcome {
    /// The configuration cannot work here.
    #[must_use]
    pub fn infeasible(reason: impl Into<String>) -> Self {
        Self::Infeasible { reason: cut(reason.into()) }
    }

    /// Stopped early; the objective is at least `lower_bound`.
    #[must_use]
    pub fn aborted(lower_bound: f64) -> Self {
        Self::Aborted { lower_bound }
    }

    /// The client failed for a reason that says nothing about the configuration.
    #[must_use]
    pub fn failed(reason: impl Into<String>) -> Self {
        Self::Failed { reason: cut(reason.into()) }
    }

    /// Checks what the service would refuse.
    pub(crate) fn check(
        &self,
        measurements: &Measurements,
        objective: &[ObjectiveTerm],
    ) -> Result<(), ClientError> {
        measurements.check()?;
        match self {
            Self::Ok => match objective.iter().find(|term| measurements.get(&term.metric).is_none()) {
                Some(term) => {
                    let problem =
                        "it is part of the objective and missing; measure it, or report another outcome";
                    Err(ClientError::invalid(format!("measurement `{}`", term.metric), problem))
                }
                None => Ok(()),
            },
            Self::Aborted { lower_bound } if !(lower_bound.is_finite() && *lower_bound >= 0.0) => {
                let problem = format!("{lower_bound} is not a finite number of at least 0");
                Err(ClientError::invalid("lower bound of an aborted trial", problem))
            }
            Self::Aborted { .. } | Self::Infeasible { .. } | Self::Failed { .. } => Ok(()),
        }
    }
}

/// Cuts at the contract's limit, between characters.
pub(crate) fn cut(mut reason: String) -> String {
    if let Some((end, _)) = reason.char_indices().nth(limits::REASON_CHARACTERS) {
        reason.truncate(end);
    }
    reason
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outcome_needs_its_numbers() {
        let objective = [ObjectiveTerm { metric: "render_ms".into(), weight: 1.0 }];
        let nothing = Measurements::new();
        let problem = Outcome::Ok.check(&nothing, &objective).unwrap_err().to_string();
        assert!(problem.contains("render_ms"), "{problem}");
        assert!(Outcome::Ok.check(&Measurements::from([("render_ms", 1.0)]), &objective).is_ok());
        assert!(Outcome::infeasible("depth limit reached").check(&nothing, &objective).is_ok());
        assert!(Outcome::aborted(f64::NAN).check(&nothing, &objective).is_err());
    }

    #[test]
    fn long_reasons_are_cut_between_characters() {
        let Outcome::Failed { reason } = Outcome::failed("é".repeat(1500)) else { unreachable!() };
        assert_eq!(reason.chars().count(), 1000);
    }
}
