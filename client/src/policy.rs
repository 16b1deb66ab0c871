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

/// What a study does with what it knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Operation {
    /// Explores, exploits and learns.
    Tune,
    /// Neither explores nor learns: answers stay what they are.
    Freeze,
    /// Every client gets the default configuration; what would have been answered stands in the reason.
    Shadow,
}

/// How the service decides. What is `None` takes the service's default.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Policy {
    /// Probability of exploring when a client's state changes, 0 to 1. Default 0.2.
    pub epsilon: Option<f64>,
    /// Search inside a state. Default [`SearchMethod::Auto`].
    pub search: Option<SearchMethod>,
    /// Predictor that answers when exploiting. Default [`PredictorMethod::NearestNeighbour`].
    pub predictor: Option<PredictorMethod>,
    /// A state's search ends after so many measured configurations, 1 to 100000. Default 80.
    pub trials_per_state: Option<u32>,
    /// How often one configuration is measured in one state, 1 to 100. Default 1.
    pub replicates: Option<u32>,
    /// How long a lease lasts, in seconds, 1 to 86400. Default 60.
    pub lease_s: Option<u32>,
    /// Every client gets this configuration.
    pub pinned: Option<Configuration>,
    /// After so many visits to a state epsilon is halved there, 0 to 1000000. Default 0: it stays constant.
    pub epsilon_halves_after: Option<u32>,
    /// Exploring may cost each client at most this share of its frame time in each session, 0 to 1. Default: no limit.
    /// The guarantee needs clients that stop trials in time ([`crate::Options::can_abort`]).
    pub regret_budget: Option<f64>,
    /// Exploring trials are told to stop when their cost exceeds that of the reference by this factor, above 1; see
    /// [`crate::Suggestion::abort_above`]. Default: 2 where a budget is kept, else never.
    pub abort_above: Option<f64>,
    /// What a trial of a client that cannot stop is taken to cost at worst, in multiples of the reference. Default 100.
    pub worst_factor: Option<f64>,
    /// What the study does with what it knows. Default [`Operation::Tune`].
    pub operation: Option<Operation>,
    /// Explore only where the expected gain pays for it within the expected stay. Default off.
    pub weigh_gain: Option<bool>,
    /// Hold parameters that are shown not to matter; each of these verdicts may be wrong with this probability, above
    /// 0 and at most 0.5. Default: nothing is held.
    pub freeze_risk: Option<f64>,
    /// The first so many trials of each session of a client are not learnt, 0 to 10000. Default 0.
    pub warm_up: Option<u32>,
    /// A configuration that does clearly worse where it is exploited than another that was measured there gives way
    /// to it at once. Default on.
    pub roll_back: Option<bool>,
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

    /// Halves epsilon after so many visits to a state.
    #[must_use]
    pub fn epsilon_halves_after(mut self, visits: u32) -> Self {
        self.epsilon_halves_after = Some(visits);
        self
    }

    /// Limits what exploring may cost, as a share of the frame time.
    #[must_use]
    pub fn regret_budget(mut self, share: f64) -> Self {
        self.regret_budget = Some(share);
        self
    }

    /// Stops exploring trials that cost more than the reference by this factor.
    #[must_use]
    pub fn abort_above(mut self, factor: f64) -> Self {
        self.abort_above = Some(factor);
        self
    }

    /// Sets what a trial of a client that cannot stop is taken to cost at worst.
    #[must_use]
    pub fn worst_factor(mut self, factor: f64) -> Self {
        self.worst_factor = Some(factor);
        self
    }

    /// Sets what the study does with what it knows.
    #[must_use]
    pub fn operation(mut self, operation: Operation) -> Self {
        self.operation = Some(operation);
        self
    }

    /// Explores only where it is expected to pay.
    #[must_use]
    pub fn weigh_gain(mut self, weigh: bool) -> Self {
        self.weigh_gain = Some(weigh);
        self
    }

    /// Holds parameters that are shown not to matter.
    #[must_use]
    pub fn freeze_risk(mut self, risk: f64) -> Self {
        self.freeze_risk = Some(risk);
        self
    }

    /// Sets how many trials of each session are not learnt.
    #[must_use]
    pub fn warm_up(mut self, trials: u32) -> Self {
        self.warm_up = Some(trials);
        self
    }

    /// Sets whether what does clearly worse gives way at once.
    #[must_use]
    pub fn roll_back(mut self, roll_back: bool) -> Self {
        self.roll_back = Some(roll_back);
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
        let counts = [
            ("epsilon_halves_after", self.epsilon_halves_after, 1_000_000),
            ("warm_up", self.warm_up, 10_000),
        ];
        for (name, value, most) in counts {
            if let Some(value) = value.filter(|value| *value > most) {
                return Err(ClientError::invalid(
                    format!("policy {name}"),
                    format!("{value} is not within 0 to {most}"),
                ));
            }
        }
        let factor = |value: f64| value > 1.0 && value <= 1e6;
        type Number = (&'static str, Option<f64>, fn(f64) -> bool, &'static str);
        let numbers: [Number; 4] = [
            ("regret_budget", self.regret_budget, |share| (0.0..=1.0).contains(&share), "within 0 to 1"),
            ("abort_above", self.abort_above, factor, "above 1 and at most 1000000"),
            ("worst_factor", self.worst_factor, factor, "above 1 and at most 1000000"),
            ("freeze_risk", self.freeze_risk, |risk| risk > 0.0 && risk <= 0.5, "above 0 and at most 0.5"),
        ];
        for (name, value, allowed, rule) in numbers {
            if let Some(value) = value.filter(|&value| !allowed(value)) {
                return Err(ClientError::invalid(format!("policy {name}"), format!("{value} is not {rule}")));
            }
        }
        Ok(())
    }
}

/// A change of a stored study's policy: the fields that are `Some` in `set` are replaced, those named in `clear` go
/// back to the service's defaults, the others stay.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PolicyChange {
    /// New values.
    pub set: Policy,
    /// Clears the pinned configuration. Wins over `set.pinned`.
    pub unpin: bool,
    /// Fields that go back to their defaults, e.g. `regret_budget`. Win over `set`.
    pub clear: Vec<String>,
}

impl PolicyChange {
    /// Replaces the fields that are `Some`.
    #[must_use]
    pub fn set(policy: Policy) -> Self {
        Self { set: policy, ..Self::default() }
    }

    /// Clears the pinned configuration.
    #[must_use]
    pub fn unpin() -> Self {
        Self { unpin: true, ..Self::default() }
    }

    /// Sets fields back to the service's defaults.
    #[must_use]
    pub fn clear<T: Into<String>>(fields: impl IntoIterator<Item = T>) -> Self {
        Self { clear: fields.into_iter().map(Into::into).collect(), ..Self::default() }
    }

    /// The values to send: what is cleared is left out, so that the service takes its default.
    pub(crate) fn values(&self) -> Policy {
        let mut set = self.set.clone();
        for field in &self.clear {
            match field.as_str() {
                "epsilon" => set.epsilon = None,
                "search" => set.search = None,
                "predictor" => set.predictor = None,
                "trials_per_state" => set.trials_per_state = None,
                "replicates" => set.replicates = None,
                "lease_s" => set.lease_s = None,
                "epsilon_halves_after" => set.epsilon_halves_after = None,
                "regret_budget" => set.regret_budget = None,
                "abort_above" => set.abort_above = None,
                "worst_factor" => set.worst_factor = None,
                "operation" => set.operation = None,
                "weigh_gain" => set.weigh_gain = None,
                "freeze_risk" => set.freeze_risk = None,
                "warm_up" => set.warm_up = None,
                "roll_back" => set.roll_back = None,
                // Unknown names are refused by the service, which knows what there is.
                _ => {}
            }
        }
        if self.unpin || self.clear.iter().any(|field| field == "pinned") {
            set.pinned = None;
        }
        set
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
            ("epsilon_halves_after", set.epsilon_halves_after.is_some()),
            ("regret_budget", set.regret_budget.is_some()),
            ("abort_above", set.abort_above.is_some()),
            ("worst_factor", set.worst_factor.is_some()),
            ("operation", set.operation.is_some()),
            ("weigh_gain", set.weigh_gain.is_some()),
            ("freeze_risk", set.freeze_risk.is_some()),
            ("warm_up", set.warm_up.is_some()),
            ("roll_back", set.roll_back.is_some()),
        ]
        .into_iter()
        .filter(|(field, changes)| *changes && !self.clear.iter().any(|cleared| cleared == field))
        .map(|(field, _)| field.to_owned())
        .chain(self.clear.iter().cloned())
        .map(|field| format!("policy.{field}"))
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
        let set = Policy::new().epsilon(0.5).regret_budget(0.05);
        let change = PolicyChange { clear: vec!["regret_budget".into()], ..PolicyChange::set(set) };
        assert_eq!(change.paths(), ["policy.epsilon", "policy.regret_budget"]);
        assert_eq!((change.values().epsilon, change.values().regret_budget), (Some(0.5), None));
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
        assert!(Policy::new().regret_budget(0.05).abort_above(1.5).freeze_risk(0.05).check().is_ok());
        for bad in [
            Policy::new().regret_budget(1.5),
            Policy::new().abort_above(1.0),
            Policy::new().worst_factor(f64::INFINITY),
            Policy::new().freeze_risk(0.0),
            Policy::new().warm_up(10_001),
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
        assert!(Policy::new().lease_s(0).check().unwrap_err().to_string().contains("lease_s"));
    }
}
