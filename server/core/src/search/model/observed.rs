//! The measurements of a point, as observations of its cost.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Observed {
    /// Mean of `count` measurements.
    Cost {
        mean: f64,
        count: u32,
    },
    AtLeast(f64),
    Infeasible,
}

impl Observed {
    /// A bound counts as a cost; what cannot be run costs infinitely much.
    pub(super) fn cost(self) -> f64 {
        match self {
            Observed::Cost { mean, .. } => mean,
            Observed::AtLeast(bound) => bound,
            Observed::Infeasible => f64::INFINITY,
        }
    }

    pub(super) fn count(self) -> f64 {
        match self {
            Observed::Cost { count, .. } => f64::from(count),
            _ => 1.0,
        }
    }
}
