//! What a client's session wants for itself.
//!
//! A run such as a benchmark wants to explore more, or not at all, without changing how the study treats everybody else.
//! It sends its wishes with every question. They hold for its own answers and nobody else's; nothing of them is kept in
//! the study, so that a run that is killed leaves nothing behind.

use serde::{Deserialize, Serialize};

use crate::limits::{COST_FACTOR_MAX, TRIALS_PER_STATE_MAX};
use crate::policy::PolicyError;

/// What replaces the study's [`Policy`](crate::policy::Policy) for one session. What is `None` is as the study has it.
///
/// Pinned configurations, the operation and the regret budget belong to the study's operator and cannot be replaced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SessionPolicy {
    /// Probability of exploring when the client's state changes, 0 to 1, whatever the number of visits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    /// For this session a state's search ends after so many measured configurations, 1 to 100,000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials_per_state: Option<u32>,
    /// Exploring trials are told to stop when their cost exceeds that of the reference by this factor, above 1. Where
    /// the study keeps a regret budget, its own factor holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub abort_above: Option<f64>,
}

impl SessionPolicy {
    /// Whether nothing is replaced.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value that is out of its range.
    pub fn validate(&self) -> Result<(), PolicyError> {
        if let Some(epsilon) = self.epsilon.filter(|epsilon| !(0.0..=1.0).contains(epsilon)) {
            return Err(PolicyError::Epsilon(epsilon));
        }
        let trials = self.trials_per_state.unwrap_or(1);
        if !(1..=TRIALS_PER_STATE_MAX).contains(&trials) {
            let (field, limit) = ("trials_per_state", TRIALS_PER_STATE_MAX);
            return Err(PolicyError::Range { field, value: trials, limit });
        }
        let factor = self.abort_above.unwrap_or(COST_FACTOR_MAX);
        if !(factor > 1.0 && factor <= COST_FACTOR_MAX) {
            let rule = "above 1 and at most a million";
            return Err(PolicyError::Number { field: "abort_above", value: factor, rule });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wishes_are_checked_like_policies() {
        SessionPolicy::default().validate().expect("nothing is wished for");
        let wishes =
            |epsilon, trials_per_state, abort_above| SessionPolicy { epsilon, trials_per_state, abort_above };
        wishes(Some(1.0), Some(TRIALS_PER_STATE_MAX), Some(1.5)).validate().expect("all in range");
        for (bad, field) in [
            (wishes(Some(1.1), None, None), "epsilon"),
            (wishes(Some(f64::NAN), None, None), "epsilon"),
            (wishes(None, Some(0), None), "trials_per_state"),
            (wishes(None, Some(TRIALS_PER_STATE_MAX + 1), None), "trials_per_state"),
            (wishes(None, None, Some(1.0)), "abort_above"),
            (wishes(None, None, Some(f64::INFINITY)), "abort_above"),
        ] {
            let error = bad.validate().expect_err(field).to_string();
            assert!(error.contains(field), "{error}");
        }
    }
}
