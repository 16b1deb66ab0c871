//! Why the service answers as it does, and which parameters it leaves out.

use serde::Serialize;

use crate::{Configuration, OmissionReason, OpenEnum, Rule, Standing};

/// The figures that the policy weighed. Costs are in the objective's units; `None` played no part.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Explanation {
    /// The rule that decided.
    pub rule: Option<OpenEnum<Rule>>,
    /// The probability of exploring that the dice were thrown with.
    pub epsilon: Option<f64>,
    /// The rest of the client's regret budget before this answer.
    pub budget_left: Option<f64>,
    /// The part of it that was reserved for this trial.
    pub set_aside: Option<f64>,
    /// The cost of what would have been run without exploring.
    pub reference_cost: Option<f64>,
    /// By how much exploring is expected to lower the cost of each later frame, as a share.
    pub expected_gain: Option<f64>,
    /// The number of frames that are expected to profit.
    pub expected_frames: Option<f64>,
    /// The expected cost of exploring in all, in frames of the reference.
    pub exploring_cost: Option<f64>,
    /// The answer without shadow operation.
    pub instead_of: Option<Configuration>,
    /// The cost of this trial is not learnt.
    pub silent: bool,
}

/// The policy's knowledge of a state.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct StateInsight {
    /// The state's number.
    pub state_id: i64,
    /// Configurations with a verdict.
    pub tried: i64,
    /// Number of clients' visits to the state.
    pub visits: i64,
    /// The number of frames reported from it.
    pub frames: i64,
    /// The difference of repeated measurements, relative to the cost; `None` before anything was measured
    /// twice.
    pub noise: Option<f64>,
    /// Measurements that were far from all others of their configuration.
    pub outliers: i64,
    /// Number of lasting changes of the costs.
    pub drifts: i64,
    /// By how much going on with the search is expected to lower the cost of each later frame, as a share.
    pub expected_gain: Option<f64>,
    /// The number of frames that are expected to profit.
    pub expected_frames: Option<f64>,
    /// The expected cost of the search, in frames.
    pub exploring_cost: Option<f64>,
    /// The parameters and indicators that the search leaves out here, and why.
    pub omissions: Vec<Omission>,
    /// How far the configuration exploited here is proven.
    pub standing: Option<Standing>,
}

/// Something that is left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Omission {
    /// The parameter, or for [`Constant`](OmissionReason::Constant) and
    /// [`Redundant`](OmissionReason::Redundant) the indicator; `None` for the state's whole search.
    pub parameter: Option<String>,
    /// Why.
    pub reason: Option<OpenEnum<OmissionReason>>,
    /// For people.
    pub summary: String,
    /// The estimated number of trials that it has saved or will save.
    pub saved_trials: f64,
}
