//! How a study decides what a client gets.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{
    COST_FACTOR_MAX, EPSILON_HALVES_AFTER_MAX, LEASE_S_MAX, REPLICATES_MAX, TRIALS_PER_STATE_MAX, WARM_UP_MAX,
};
use crate::space::{Space, SpaceError};

/// Searches inside one state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchMethod {
    /// The search that this version recommends, the same for every study; today [`SearchMethod::Model`].
    #[default]
    Auto,
    /// Latin hypercube start, then a stochastic Nelder-Mead after Chang (2012) (paper section 6).
    NelderMead,
    /// Latin hypercube designs, one after the other.
    LatinHypercube,
    /// Independent uniform samples.
    Random,
    /// Gaussian processes and expected improvement; see `treewright_core::search::model`.
    Model,
}

impl SearchMethod {
    /// The name that reasons carry.
    pub fn name(self) -> &'static str {
        match self {
            SearchMethod::Auto => "auto",
            SearchMethod::NelderMead => "nelder_mead",
            SearchMethod::LatinHypercube => "latin_hypercube",
            SearchMethod::Random => "random",
            SearchMethod::Model => "model",
        }
    }
}

/// Predictors across states; see `treewright_core::predict`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PredictorMethod {
    /// Whichever of the others errs least in this study, tested on every trial before it learns from it.
    Auto,
    /// Best configuration of the nearest known state (paper section 6.1).
    #[default]
    NearestNeighbour,
    /// Best configuration over the nearest known states, weighted by distance.
    WeightedNeighbours,
    /// Radial basis functions trained by Greedy-GQ with gamma = 0 (paper section 6.2, as printed).
    RbfGreedyGq,
    /// The same with Gaussians, as the paper's words have it.
    GaussianGreedyGq,
    /// The same features, fitted by recursive least squares, with corrections for each kind of machine and
    /// each client.
    LeastSquares,
    /// A Gaussian process over indicators and parameters together, which also proposes what to explore.
    Contextual,
}

impl PredictorMethod {
    /// All that answer by themselves, in the order in which they are preferred among equals.
    pub const SINGLE: [PredictorMethod; 6] = [
        PredictorMethod::Contextual,
        PredictorMethod::WeightedNeighbours,
        PredictorMethod::NearestNeighbour,
        PredictorMethod::LeastSquares,
        PredictorMethod::RbfGreedyGq,
        PredictorMethod::GaussianGreedyGq,
    ];

    /// The name that reasons carry.
    pub fn name(self) -> &'static str {
        match self {
            PredictorMethod::Auto => "auto",
            PredictorMethod::NearestNeighbour => "nearest_neighbour",
            PredictorMethod::WeightedNeighbours => "weighted_neighbours",
            PredictorMethod::RbfGreedyGq => "rbf_greedy_gq",
            PredictorMethod::GaussianGreedyGq => "gaussian_greedy_gq",
            PredictorMethod::LeastSquares => "least_squares",
            PredictorMethod::Contextual => "contextual",
        }
    }
}

/// What a study does with what it knows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Operation {
    /// Explores, exploits and learns.
    #[default]
    Tune,
    /// Neither explores nor learns: answers stay what they are. That a configuration cannot be run is taken all
    /// the same.
    Freeze,
    /// Every client gets the default configuration; what would have been answered stands in the reason. Reports
    /// are learnt.
    Shadow,
}

/// The factor of the reference's cost at which exploring trials stop where a budget is kept and the policy names
/// none.
pub const ABORT_ABOVE_DEFAULT: f64 = 2.0;

/// How a study decides. `C` is [`Configuration`] once checked, [`RawConfiguration`] as read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Policy<C = Configuration> {
    /// Probability of exploring when a client's state changes, 0 to 1. Default 0.2.
    pub epsilon: f64,
    /// Search inside a state.
    pub search: SearchMethod,
    /// Predictor that answers when exploiting.
    pub predictor: PredictorMethod,
    /// A state's search ends after so many measured configurations, 1 to 100,000. Default 80 (paper 7.1.1).
    pub trials_per_state: u32,
    /// How often one configuration is measured in one state before the search goes on, 1 to 100. Default 1.
    pub replicates: u32,
    /// A lease lasts so long unless it is extended, 1 to 86,400 seconds. Default 60.
    pub lease_s: u32,
    /// Every client gets this configuration until it is cleared.
    pub pinned: Option<C>,
    /// After so many visits to a state epsilon is halved there: it is `epsilon h / (h + n)` after `n` of them, which
    /// never stops exploring and lets it become rare (Singh, Jaakkola, Littman and Szepesvári, "Convergence results
    /// for single-step on-policy reinforcement-learning algorithms", 2000). 0, the default, leaves it constant.
    #[serde(default)]
    pub epsilon_halves_after: u32,
    /// Exploring may cost each client at most this share of its frame time in each session, 0 to 1: see
    /// `treewright_core::tuner::budget`. `None`, the default, for no limit.
    #[serde(default)]
    pub regret_budget: Option<f64>,
    /// An exploring trial is told to stop when its cost exceeds that of the reference by this factor, above 1.
    /// `None`, the default: [`ABORT_ABOVE_DEFAULT`] where a budget is kept, else never.
    #[serde(default)]
    pub abort_above: Option<f64>,
    /// What a trial of a client that cannot stop is taken to cost at worst, in multiples of the reference. Only
    /// counts where a budget is kept. Default 100.
    #[serde(default = "worst_factor")]
    pub worst_factor: f64,
    /// What the study does with what it knows.
    #[serde(default)]
    pub operation: Operation,
    /// Explore only where the expected gain pays for it within the expected stay. Default off.
    #[serde(default)]
    pub weigh_gain: bool,
    /// Parameters that are shown not to matter are held, and each of these verdicts may be wrong with this
    /// probability; above 0, at most 0.5. `None`, the default: nothing is held.
    #[serde(default)]
    pub freeze_risk: Option<f64>,
    /// The first so many trials of each session of a client are not learnt. Default 0.
    #[serde(default)]
    pub warm_up: u32,
    /// A configuration that does clearly worse where it is exploited than another that was measured there gives
    /// way to it at once. Default on.
    #[serde(default = "roll_back")]
    pub roll_back: bool,
}

fn worst_factor() -> f64 {
    100.0
}

fn roll_back() -> bool {
    true
}

/// A policy whose pinned configuration has not been checked yet.
pub type RawPolicy = Policy<RawConfiguration>;

impl<C> Default for Policy<C> {
    fn default() -> Self {
        Policy {
            epsilon: 0.2,
            search: SearchMethod::default(),
            predictor: PredictorMethod::default(),
            trials_per_state: 80,
            replicates: 1,
            lease_s: 60,
            pinned: None,
            epsilon_halves_after: 0,
            regret_budget: None,
            abort_above: None,
            worst_factor: worst_factor(),
            operation: Operation::default(),
            weigh_gain: false,
            freeze_risk: None,
            warm_up: 0,
            roll_back: roll_back(),
        }
    }
}

/// Why a policy is refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PolicyError {
    /// Not a probability.
    #[error("policy.epsilon is {0}; it must be between 0 and 1")]
    Epsilon(f64),
    /// A factor or share is out of its range.
    #[error("policy.{field} is {value}; it must be {rule}")]
    Number {
        /// The field.
        field: &'static str,
        /// As given.
        value: f64,
        /// What is allowed.
        rule: &'static str,
    },
    /// Out of its range.
    #[error("policy.{field} is {value}; it must be between 1 and {limit}")]
    Range {
        /// The field.
        field: &'static str,
        /// As given.
        value: u32,
        /// The largest allowed value.
        limit: u32,
    },
    /// The pinned configuration does not fit the space.
    #[error("policy.pinned: {0}")]
    Pinned(#[from] SpaceError),
}

impl<C> Policy<C> {
    fn check_numbers(&self) -> Result<(), PolicyError> {
        if !(0.0..=1.0).contains(&self.epsilon) {
            return Err(PolicyError::Epsilon(self.epsilon));
        }
        for (field, value, limit) in [
            ("trials_per_state", self.trials_per_state, TRIALS_PER_STATE_MAX),
            ("replicates", self.replicates, REPLICATES_MAX),
            ("lease_s", self.lease_s, LEASE_S_MAX),
        ] {
            if value == 0 || value > limit {
                return Err(PolicyError::Range { field, value, limit });
            }
        }
        for (field, value, limit) in [
            ("epsilon_halves_after", self.epsilon_halves_after, EPSILON_HALVES_AFTER_MAX),
            ("warm_up", self.warm_up, WARM_UP_MAX),
        ] {
            if value > limit {
                return Err(PolicyError::Range { field, value, limit });
            }
        }
        let factor = |value: f64| value > 1.0 && value <= COST_FACTOR_MAX;
        type Number = (&'static str, Option<f64>, fn(f64) -> bool, &'static str);
        let numbers: [Number; 4] = [
            ("regret_budget", self.regret_budget, |share| (0.0..=1.0).contains(&share), "between 0 and 1"),
            ("abort_above", self.abort_above, factor, "above 1 and at most a million"),
            ("worst_factor", Some(self.worst_factor), factor, "above 1 and at most a million"),
            ("freeze_risk", self.freeze_risk, |risk| risk > 0.0 && risk <= 0.5, "above 0 and at most 0.5"),
        ];
        for (field, value, allowed, rule) in numbers {
            if let Some(value) = value.filter(|&value| !allowed(value)) {
                return Err(PolicyError::Number { field, value, rule });
            }
        }
        Ok(())
    }

    /// How long a lease lasts, in milliseconds.
    pub fn lease_ms(&self) -> i64 {
        i64::from(self.lease_s) * 1000
    }
}

impl Policy {
    /// Checks every field against `space` and the limits.
    pub fn validate(&self, space: &Space) -> Result<(), PolicyError> {
        self.check_numbers()?;
        if let Some(pinned) = &self.pinned {
            // The configuration may come from another space than the study's.
            space.configuration(pinned.to_raw())?;
        }
        Ok(())
    }

    /// The unchecked form, for tables.
    pub fn to_raw(&self) -> RawPolicy {
        self.clone().map_pinned(|pinned| Ok::<_, SpaceError>(pinned.into())).expect("the map cannot fail")
    }
}

impl RawPolicy {
    /// Checks every field against `space` and the limits.
    pub fn check(self, space: &Space) -> Result<Policy, PolicyError> {
        self.check_numbers()?;
        Ok(self.map_pinned(|pinned| space.configuration(pinned))?)
    }
}

impl<C> Policy<C> {
    fn map_pinned<D, E>(self, map: impl FnOnce(C) -> Result<D, E>) -> Result<Policy<D>, E> {
        Ok(Policy {
            epsilon: self.epsilon,
            search: self.search,
            predictor: self.predictor,
            trials_per_state: self.trials_per_state,
            replicates: self.replicates,
            lease_s: self.lease_s,
            pinned: self.pinned.map(map).transpose()?,
            epsilon_halves_after: self.epsilon_halves_after,
            regret_budget: self.regret_budget,
            abort_above: self.abort_above,
            worst_factor: self.worst_factor,
            operation: self.operation,
            weigh_gain: self.weigh_gain,
            freeze_risk: self.freeze_risk,
            warm_up: self.warm_up,
            roll_back: self.roll_back,
        })
    }
}
