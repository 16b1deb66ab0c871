//! The reason of an answer, for clients and for people: its mode, its rule, the policy's figures, and the
//! omissions. It is made from a [`Decision`](crate::decision::Decision), and never read back.

use serde::{Deserialize, Serialize};

use crate::configuration::RawConfiguration;
use crate::words::words;

words! {
    /// Why a client got a configuration.
    pub enum Mode {
        /// The space's defaults: the first measurement in a state that is explored, or nothing better is
        /// known.
        Default = "DEFAULT",
        /// The next point of the state's search.
        Explore = "EXPLORE",
        /// The predictor's answer or the best known configuration.
        Exploit = "EXPLOIT",
        /// The policy pins it.
        Pinned = "PINNED",
    }
}

/// The reason of an answer, for people and for logs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reason {
    /// One plain sentence.
    pub summary: String,
    /// Name of the search or predictor that chose: `nelder_mead`, `nearest_neighbour`, `default`, ...
    pub source: String,
    /// The step of the search: `latin_hypercube`, `reflect`, ... Empty when exploiting.
    pub step: String,
    /// The known states behind the answer, nearest first, at most 5.
    pub neighbours: Vec<Neighbour>,
    /// The figures that the policy weighed.
    #[serde(default, skip_serializing_if = "Explanation::is_empty")]
    pub explanation: Explanation,
}

words! {
    /// The rule of the policy that an answer follows.
    pub enum Rule {
        /// The dice decided to explore.
        Explore = "EXPLORE",
        /// Explored, because no known configuration could be exploited.
        NothingKnown = "NOTHING_KNOWN",
        /// The dice decided to exploit.
        Exploit = "EXPLOIT",
        /// The state's search is over.
        Finished = "FINISHED",
        /// Not explored, because the regret budget does not allow it yet.
        Budget = "BUDGET",
        /// Not explored, because the expected gain does not pay for it, or is below the noise.
        Gain = "GAIN",
        /// The configuration exploited here did clearly worse than another.
        RolledBack = "ROLLED_BACK",
        /// The study is frozen.
        Frozen = "FROZEN",
        /// The study answers the default and learns silently.
        Shadow = "SHADOW",
        /// The policy pins the configuration.
        Pinned = "PINNED",
        /// The client asked for the configuration.
        Wanted = "WANTED",
        /// Explores, but the search waits for other clients' measurements; the best known configuration is
        /// run meanwhile.
        Waiting = "WAITING",
        /// The search is over, and its best few run against the incumbent.
        Confirming = "CONFIRMING",
        /// The incumbent is measured again while others are explored, to follow the machine's speed.
        Incumbent = "INCUMBENT",
    }
}

/// The figures that the policy weighed when it answered. Costs are in the objective's units, and finite.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Explanation {
    /// The rule that decided.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rule: Option<Rule>,
    /// The probability of exploring at the throw of the dice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    /// The rest of the client's regret budget before this answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_left: Option<f64>,
    /// The part of it that was reserved for this trial: the most that it can cost above the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_aside: Option<f64>,
    /// The client is to stop the trial as soon as its cost exceeds this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub abort_above: Option<f64>,
    /// The cost of the reference, which would run without exploring.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_cost: Option<f64>,
    /// The share by which exploring is expected to lower the cost of each later frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_gain: Option<f64>,
    /// The number of frames that are expected to profit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_frames: Option<f64>,
    /// The expected cost of exploring in all, in frames of the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exploring_cost: Option<f64>,
    /// The answer without shadow operation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instead_of: Option<RawConfiguration>,
    /// The cost of this trial is not learnt.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub silent: bool,
}

impl Explanation {
    /// An explanation that only names the rule.
    pub fn of(rule: Rule) -> Self {
        Explanation { rule: Some(rule), ..Explanation::default() }
    }

    /// Whether no field is set.
    pub fn is_empty(&self) -> bool {
        *self == Explanation::default()
    }
}

/// A known state near the asked one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Neighbour {
    /// The state.
    pub state_id: u64,
    /// Euclidean distance of the normalised indicators.
    pub distance: f64,
    /// Best mean objective known there.
    pub best_cost: f64,
}

words! {
    /// Why a search leaves a parameter out, or predictors an indicator.
    pub enum OmissionReason {
        /// The parameter is inactive at the best known values of others.
        Inactive = "INACTIVE",
        /// The most that can be gained is below the noise.
        BelowNoise = "BELOW_NOISE",
        /// The expected gain does not pay for the search.
        BelowCost = "BELOW_COST",
        /// The indicator is equal in all states: left out of distances and features.
        Constant = "CONSTANT",
        /// The indicator is a linear function of another: left out of distances and features.
        Redundant = "REDUNDANT",
    }
}
