//! How the service decides what a client gets, and changes to that.

use serde::Serialize;

use crate::{ClientError, Configuration};

/// The search inside a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchMethod {
    /// Whatever suits the space, the budget and what was measured so far.
    Auto,
    /// Latin hypercube start, then a stochastic Nelder-Mead after Chang (paper section 6).
    NelderMead,
    /// Latin hypercube designs, one after the other.
    LatinHypercube,
    /// Independent uniform samples.
    Random,
    /// Gaussian processes and expected improvement: strong at 20 to 80 trials in mixed, conditional spaces.
    Model,
}

/// What answers when the service exploits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PredictorMethod {
    /// Whichever of the others errs least in this study.
    Auto,
    /// Best configuration of the nearest known state (paper 6.1).
    NearestNeighbour,
    /// Radial basis functions trained by Greedy-GQ with γ = 0 (paper 6.2).
    RbfGreedyGq,
    /// Best configuration over the eight nearest known states, weighted by distance.
    WeightedNeighbours,
    /// The same with Gaussians, as the paper's words have it.
    GaussianGreedyGq,
    /// The same features by recursive least squares, with models for each machine and client.
    LeastSquares,
    /// A Gaussian process over indicators and parameters, which also proposes what to explore.
    Contextual,
}

/// How the service decides. What is `None` takes the service's default.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Policy {
    /// Probability of exploring when a client's state changes, 0 to 1. Default 0.2.
    pub epsilon: Option<f64>,
    /// Search inside a state. Default [`SearchMethod::Auto`].
    pub search: Option<SearchMethod>,
    /// Predictor that answers when exploiting. Default [`PredictorMethod::Auto`].
    pub predictor: Option<PredictorMethod>,
    /// A state's search ends after so many measured configurations, 1 to 100000. Default 80.
    pub trials_per_state: Option<u32>,
    /// How often one configuration is measured in one state, 1 to 100. Default 1.
    pub replicates: Option<u32>,
    /// How long a lease lasts, in seconds, 1 to 86400. Default 60.
    pub lease_s: Option<u32>,
    /// Every client gets this configuration.
    pub pinned: Option<Configuration>,
}

impl Policy {
    /// The service's defaults.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the probability of exploring when a client's state changes.
    #[must_use]
    pub fn epsilon(mut self, epsilon: f64) -> Self {
        self.epsilon = Some(epsilon);
        self
    }

    /// Sets the search inside a state.
    #[must_use]
    pub fn search(mut self, search: SearchMethod) -> Self {
        self.search = Some(search);
        self
    }

    /// Sets the predictor that answers when exploiting.
    #[must_use]
    pub fn predictor(mut self, predictor: PredictorMethod) -> Self {
        self.predictor = Some(predictor);
        self
    }

    /// Sets after how many measured configurations a state's search ends.
    #[must_use]
    pub fn trials_per_state(mut self, trials: u32) -> Self {
        self.trials_per_state = Some(trials);
        self
    }

    /// Sets how often one configuration is measured in one state.
    #[must_use]
    pub fn replicates(mut self, replicates: u32) -> Self {
        self.replicates = Some(replicates);
        self
    }

    /// Sets how long a lease lasts, in seconds.
    #[must_use]
    pub fn lease_s(mut self, lease_s: u32) -> Self {
        self.lease_s = Some(lease_s);
        self
    }

    /// Gives every client this configuration.
    #[must_use]
    pub fn pinned(mut self, configuration: Configuration) -> Self {
        self.pinned = Some(configuration);
        self
    }

    pub(crate) fn check(&self) -> Result<(), ClientError> {
        if let Some(epsilon) = self.epsilon
            && !(0.0..=1.0).contains(&epsilon)
        {
            return Err(ClientError::invalid(
                "policy epsilon",
                format!("{epsilon} is not a probability within 0 to 1"),
            ));
        }
        let ranges = [
            ("trials_per_state", self.trials_per_state, 100_000),
            ("replicates", self.replicates, 100),
            ("lease_s", self.lease_s, 86_400),
        ];
        for (name, value, most) in ranges {
            if let Some(value) = value
                && !(1..=most).contains(&value)
            {
                return Err(ClientError::invalid(
                    format!("policy {name}"),
                    format!("{value} is not within 1 to {most}"),
                ));
            }
        }
        Ok(())
    }
}

/// A change of a stored study's policy: the fields that are `Some` in `set` are replaced, the others stay.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PolicyChange {
    /// New values.
    pub set: Policy,
    /// Clears the pinned configuration. Wins over `set.pinned`.
    pub unpin: bool,
}

impl PolicyChange {
    /// Replaces the fields that are `Some`.
    #[must_use]
    pub fn set(policy: Policy) -> Self {
        Self { set: policy, unpin: false }
    }

    /// Clears the pinned configuration.
    #[must_use]
    pub fn unpin() -> Self {
        Self { set: Policy::default(), unpin: true }
    }

    /// The fields that change, as paths of the wire contract's field mask.
    pub(crate) fn paths(&self) -> Vec<String> {
        let set = &self.set;
        [
            ("epsilon", set.epsilon.is_some()),
            ("search", set.search.is_some()),
            ("predictor", set.predictor.is_some()),
            ("trials_per_state", set.trials_per_state.is_some()),
            ("replicates", set.replicates.is_some()),
            ("lease_s", set.lease_s.is_some()),
            ("pinned", self.unpin || set.pinned.is_some()),
        ]
        .into_iter()
        .filter(|(_, changes)| *changes)
        .map(|(field, _)| format!("policy.{field}"))
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_names_only_what_changes() {
        assert_eq!(
            PolicyChange::set(Policy::new().epsilon(0.0).lease_s(5)).paths(),
            ["policy.epsilon", "policy.lease_s"]
        );
        assert_eq!(PolicyChange::unpin().paths(), ["policy.pinned"]);
        assert!(PolicyChange::default().paths().is_empty());
    }

    #[test]
    fn ranges_are_those_of_the_contract() {
        assert!(
            Policy::new()
                .epsilon(1.0)
                .trials_per_state(100_000)
                .replicates(100)
                .lease_s(86_400)
                .check()
                .is_ok()
        );
        assert!(Policy::new().epsilon(f64::NAN).check().is_err());
        assert!(Policy::new().lease_s(0).check().unwrap_err().to_string().contains("lease_s"));
    }
}
