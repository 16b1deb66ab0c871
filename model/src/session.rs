//! The policy of a client's session.
//!
//! A run such as a benchmark wants to explore more, or not at all, without changing the answers to other
//! clients. It sends its policy with every question. The policy only holds for its own answers and is not
//! kept in the study, so that a killed run leaves nothing behind.

use serde::{Deserialize, Serialize};

use crate::policy::{PolicyError, PolicySettings};

/// Replaces the study's [`Policy`](crate::policy::Policy) for one session. For `None` the study's value
/// holds.
///
/// Pinned configurations, the operation and the regret budget belong to the study's operator and cannot be
/// replaced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SessionPolicy {
    /// Probability of exploring when the client's state changes, 0 to 1, for any number of visits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    /// A state's search ends for this session after this number of runs, with repeats, 1 to 100,000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials_per_state: Option<u32>,
    /// Exploring trials are stopped when their cost exceeds that of the reference by this factor, which is
    /// above 1. Where the study keeps a regret budget, its own factor holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub abort_above: Option<f64>,
    /// The end of exploring, by the daemon's clock in milliseconds since 1970. From then on the session
    /// exploits for any `epsilon`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub explore_until_ms: Option<i64>,
}

impl SessionPolicy {
    /// Whether no field is set.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The policy at a time: past its deadline a session explores no more.
    #[must_use]
    pub fn at(self, now_ms: i64) -> Self {
        match self.explore_until_ms {
            Some(until_ms) if until_ms <= now_ms => {
                Self { epsilon: Some(0.0), explore_until_ms: None, ..self }
            }
            _ => self,
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value that is out of its range.
    pub fn validate(&self) -> Result<(), PolicyError> {
        let said = [
            ("epsilon", self.epsilon),
            ("trials_per_state", self.trials_per_state.map(f64::from)),
            ("abort_above", self.abort_above),
        ];
        for (field, value) in said {
            // The ranges are those of the policy's fields.
            let range =
                PolicySettings::FIELDS.iter().find(|known| known.name == field).map(|known| known.range);
            if let Some((value, range)) = value.zip(range) {
                range.check(field, value)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::TRIALS_PER_STATE_MAX;

    #[test]
    fn wishes_are_checked_like_policies() {
        SessionPolicy::default().validate().expect("nothing is wished for");
        let wishes = |epsilon, trials_per_state, abort_above| SessionPolicy {
            epsilon,
            trials_per_state,
            abort_above,
            explore_until_ms: Some(-1),
        };
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

    #[test]
    fn nothing_is_explored_from_the_deadline_on() {
        let wishes = SessionPolicy { epsilon: Some(1.0), abort_above: Some(2.0), ..SessionPolicy::default() };
        assert_eq!(wishes.at(i64::MAX), wishes, "no deadline");
        let wishes = SessionPolicy { explore_until_ms: Some(500), ..wishes };
        assert_eq!(wishes.at(499), wishes);
        let over = SessionPolicy { epsilon: Some(0.0), explore_until_ms: None, ..wishes };
        assert_eq!((wishes.at(500), wishes.at(9_000)), (over, over));
    }
}
