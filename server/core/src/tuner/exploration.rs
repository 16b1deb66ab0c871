//! The search of one state together with the trials that carry its points.

use serde::{Deserialize, Serialize};

/// The search of one state and its points in flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exploration {}
