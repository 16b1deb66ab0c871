//! What is known of a study: its states with their tables, how they came about, the speeds of machines, what
//! costs are believed to be, and what models and other states say.

pub(super) mod assessment;
mod auxiliaries;
mod gain;
mod history;
pub(super) mod models;
mod portfolio;
pub(super) mod progress;
mod rechecks;
mod speeds;
mod states;
pub(super) mod warm_start;

pub(crate) use assessment::{Assessment, AssessmentRequest, Assessments};
pub(crate) use auxiliaries::{Auxiliaries, Beside};
pub(crate) use gain::GainEvidence;
pub(crate) use history::History;
pub(crate) use models::Models;
pub(crate) use portfolio::{MeasuredElsewhere, OtherState};
pub(crate) use rechecks::{Moved, Rechecks};
pub(crate) use speeds::{Speeds, Unheld};
pub(crate) use states::{States, at, place};
pub(crate) use warm_start::WarmStart;

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, unchecked};

/// A configuration as it stands in a state's row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(crate) struct Stored(#[serde(with = "unchecked")] pub(crate) Configuration);

/// The learnt cost of a completed trial.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LearntCost {
    /// Its cost as the table has it.
    pub(crate) cost: Option<f64>,
    /// The believed cost: it is drawn in where it lies far from all others.
    pub(crate) believed: Option<f64>,
    /// The speed of its client's machine was found to have jumped.
    pub(crate) has_jumped: bool,
    /// The costs of the state were found to have changed.
    pub(crate) has_changed: bool,
}
