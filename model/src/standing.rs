//! How the answer of a state stands against its reference: what is proven, and what is only hoped for.
//!
//! The reference of a state is its incumbent: the study's default configuration, until another one is proven better. Costs
//! and gains are estimates with 95 % intervals, drawn towards each other as far as the measurements are noisy, never the
//! luckiest of many measurements.

use serde::{Deserialize, Serialize};

use crate::words::words;

words! {
    /// How far the confirmation of a state's best configurations is.
    pub enum ConfirmationStage {
        /// The policy wants none.
        Off = "OFF",
        /// The search goes on.
        Searching = "SEARCHING",
        /// The best few run against the incumbent.
        Racing = "RACING",
        /// A challenger was proven better than the incumbent, and is the answer.
        Better = "BETTER",
        /// None was proven better than the incumbent, which is the answer.
        NothingBetter = "NOTHING_BETTER",
    }
}

/// By how much the cost of one configuration lies below that of another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gain {
    /// As a share of the other's cost; negative where it is dearer.
    pub share: f64,
    /// The lower end of the 95 % interval; `None` where nothing is known of it.
    pub low: Option<f64>,
    /// The upper end.
    pub high: Option<f64>,
    /// The probability that it is cheaper at all, where it can be told.
    pub probability_better: Option<f64>,
}

/// What came of running the best few configurations of a state against its incumbent, in rounds in which each is
/// measured once.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Confirmation {
    /// How far it is.
    pub stage: ConfirmationStage,
    /// How many rounds the incumbent has run.
    pub rounds: u64,
    /// The most that it may run.
    pub rounds_max: u64,
    /// How many measurements there were in all.
    pub measurements: u64,
    /// Of the winner over the incumbent, by these rounds alone: its interval holds at whichever moment one looks.
    pub gain: Option<Gain>,
}

impl Confirmation {
    /// Whether it will not change any more, so that a client that waits for a verdict has it.
    pub fn is_over(&self) -> bool {
        matches!(
            self.stage,
            ConfirmationStage::Off | ConfirmationStage::Better | ConfirmationStage::NothingBetter
        )
    }
}

/// How the answer of a state stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// The cost of the answer, in the objective's units, with its 95 % interval.
    pub cost: f64,
    /// The lower end of the interval.
    pub cost_low: f64,
    /// The upper end.
    pub cost_high: f64,
    /// Its gain over the study's default configuration; `None` where that was not measured in the state.
    pub gain: Option<Gain>,
    /// Nothing is proven to be better than the incumbent, which therefore is the answer.
    pub nothing_better: bool,
    /// How far its confirmation is.
    pub confirmation: Confirmation,
    /// How often the speed of a client's machine was found to have jumped while the state was measured.
    pub disturbances: u64,
}
