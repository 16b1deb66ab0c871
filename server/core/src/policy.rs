//! How a study decides what a client gets.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{LEASE_S_MAX, REPLICATES_MAX, TRIALS_PER_STATE_MAX};
use crate::space::{Space, SpaceError};

/// Searches inside one state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchMethod {
    /// Whatever suits the space, the budget and what was measured so far; see [`crate::search::auto`].
    #[default]
    Auto,
    /// Latin hypercube start, then a stochastic Nelder-Mead after Chang (2012) (paper section 6).
    NelderMead,
    /// Latin hypercube designs, one after the other.
    LatinHypercube,
    /// Independent uniform samples.
    Random,
    /// Gaussian processes and expected improvement; see [`crate::search::model`].
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

/// Predictors across states; see [`crate::predict`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PredictorMethod {
    /// Whichever of the others errs least in this study, tested on every trial before it learns from it.
    #[default]
    Auto,
    /// Best configuration of the nearest known state (paper section 6.1).
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
        }
    }
}

/// Why a policy is refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PolicyError {
    /// Not a probability.
    #[error("policy.epsilon is {0}; it must be between 0 and 1")]
    Epsilon(f64),
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
        })
    }
}
