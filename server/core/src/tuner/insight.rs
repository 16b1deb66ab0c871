//! What the policy knows of a state, for people: why it explores there or not, and what it leaves out.

use serde::{Deserialize, Serialize};

/// What the policy knows of a state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Insight {
    /// The state.
    pub state_id: u64,
    /// Configurations with a verdict.
    pub tried: u64,
    /// How often clients came to the state, as far as they reported something from it.
    pub visits: u64,
    /// How many frames were reported from it.
    pub frames: u64,
    /// How much repeated measurements differ, relative to the cost: a robust standard deviation. `None` before
    /// anything was measured twice.
    pub noise: Option<f64>,
    /// Measurements that were set aside as outliers.
    pub outliers: u64,
    /// How often costs were found to have changed for good.
    pub drifts: u64,
    /// What going on with the search is expected to bring.
    pub prospect: Option<Prospect>,
    /// What is left out of the search, and of what predictors see.
    pub omissions: Vec<Omission>,
}

/// What exploring a state is expected to bring and to cost. Relative to the best known cost, so that it can be told
/// of states in which nothing was measured yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prospect {
    /// By how much the cost of each later frame falls, as a share.
    pub gain: f64,
    /// The most by which it may fall, judged by what searches found so far.
    pub gain_at_most: f64,
    /// How many frames profit.
    pub frames: f64,
    /// What the trials cost above the reference in all, in frames of the reference.
    pub exploring_cost: f64,
}

/// Something that is left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Omission {
    /// The parameter, or for [`OmissionReason::Constant`] and [`OmissionReason::Redundant`] the indicator; `None` for
    /// the whole search of the state.
    pub parameter: Option<String>,
    /// Why.
    pub reason: OmissionReason,
    /// For people.
    pub summary: String,
    /// How many trials were or will be saved by it, estimated.
    pub saved_trials: f64,
    /// With which probability leaving it out is wrong; `None` where it is certain.
    pub risk: Option<f64>,
}

/// Why something is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OmissionReason {
    /// The parameter means nothing beside the best known values of others.
    Inactive,
    /// The parameter was shown not to matter.
    Insensitive,
    /// The most that can be gained is below the noise.
    BelowNoise,
    /// The gain to expect does not pay for the search.
    BelowCost,
    /// The indicator is the same in all states: left out of distances and features.
    Constant,
    /// The indicator follows another in a straight line: left out of distances and features.
    Redundant,
}
