//! Policies on the wire, whole and field by field.

use prost_types::FieldMask;
use treewright_core::policy::{Operation, Policy, PredictorMethod, RawPolicy, SearchMethod};
use treewright_core::space::Space;
use treewright_proto::v1;

use super::from_proto::{configuration, unknown};
use crate::error::Error;

/// Reads a policy that its space has yet to check; unset fields take their defaults.
///
/// # Errors
/// [`Error::Invalid`] with the field.
pub fn policy(field: &str, wire: v1::Policy) -> Result<RawPolicy, Error> {
    let default = RawPolicy::default();
    let count = |name: &str, value: i32, default: u32| match u32::try_from(value) {
        Ok(0) => Ok(default),
        Ok(value) => Ok(value),
        Err(_) => Err(Error::invalid(format!("{field}.{name}"), format!("{value} must not be negative"))),
    };
    Ok(RawPolicy {
        epsilon: wire.epsilon.unwrap_or(default.epsilon),
        search: match v1::SearchMethod::try_from(wire.search) {
            Ok(v1::SearchMethod::Unspecified) => default.search,
            Ok(v1::SearchMethod::NelderMead) => SearchMethod::NelderMead,
            Ok(v1::SearchMethod::LatinHypercube) => SearchMethod::LatinHypercube,
            Ok(v1::SearchMethod::Random) => SearchMethod::Random,
            Ok(v1::SearchMethod::Model) => SearchMethod::Model,
            Ok(v1::SearchMethod::Auto) => SearchMethod::Auto,
            Err(_) => return Err(unknown(&format!("{field}.search"), wire.search)),
        },
        predictor: match v1::PredictorMethod::try_from(wire.predictor) {
            Ok(v1::PredictorMethod::Unspecified) => default.predictor,
            Ok(v1::PredictorMethod::NearestNeighbour) => PredictorMethod::NearestNeighbour,
            Ok(v1::PredictorMethod::RbfGreedyGq) => PredictorMethod::RbfGreedyGq,
            Ok(v1::PredictorMethod::Auto) => PredictorMethod::Auto,
            Ok(v1::PredictorMethod::WeightedNeighbours) => PredictorMethod::WeightedNeighbours,
            Ok(v1::PredictorMethod::GaussianGreedyGq) => PredictorMethod::GaussianGreedyGq,
            Ok(v1::PredictorMethod::LeastSquares) => PredictorMethod::LeastSquares,
            Ok(v1::PredictorMethod::Contextual) => PredictorMethod::Contextual,
            Err(_) => return Err(unknown(&format!("{field}.predictor"), wire.predictor)),
        },
        trials_per_state: count("trials_per_state", wire.trials_per_state, default.trials_per_state)?,
        replicates: count("replicates", wire.replicates, default.replicates)?,
        lease_s: count("lease_s", wire.lease_s, default.lease_s)?,
        pinned: wire.pinned.map(|pinned| configuration(&format!("{field}.pinned"), pinned)).transpose()?,
        epsilon_halves_after: count("epsilon_halves_after", wire.epsilon_halves_after, 0)?,
        regret_budget: wire.regret_budget,
        abort_above: wire.abort_above,
        worst_factor: wire.worst_factor.unwrap_or(default.worst_factor),
        operation: match v1::Operation::try_from(wire.operation) {
            Ok(v1::Operation::Unspecified | v1::Operation::Tune) => Operation::Tune,
            Ok(v1::Operation::Freeze) => Operation::Freeze,
            Ok(v1::Operation::Shadow) => Operation::Shadow,
            Err(_) => return Err(unknown(&format!("{field}.operation"), wire.operation)),
        },
        weigh_gain: wire.weigh_gain,
        freeze_risk: wire.freeze_risk,
        warm_up: count("warm_up", wire.warm_up, 0)?,
        roll_back: wire.roll_back.unwrap_or(default.roll_back),
    })
}

/// A change of a policy: the given values, and which of them count.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyUpdate {
    given: RawPolicy,
    paths: Vec<String>,
}

impl PolicyUpdate {
    /// Reads an update.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the field, or with a path that is not a policy's.
    pub fn read(wire: v1::Policy, mask: Option<FieldMask>) -> Result<Self, Error> {
        let paths = mask.map(|mask| mask.paths).unwrap_or_default();
        let update = Self {
            given: policy("study.policy", wire)?,
            paths: if paths.is_empty() { vec!["policy".to_owned()] } else { paths },
        };
        // The paths are tried on a policy of no consequence, so that a wrong one is refused before a
        // study is touched.
        update.merged(RawPolicy::default())?;
        Ok(update)
    }

    /// The policy that results from `current`, checked against the study's space.
    ///
    /// # Errors
    /// [`Error::Invalid`] with what does not fit.
    pub fn apply(&self, current: &Policy, space: &Space) -> Result<Policy, Error> {
        self.merged(current.to_raw())?.check(space).map_err(|error| Error::invalid("study", error))
    }

    fn merged(&self, mut policy: RawPolicy) -> Result<RawPolicy, Error> {
        for path in &self.paths {
            let given = self.given.clone();
            match path.as_str() {
                "policy" => policy = given,
                "policy.epsilon" => policy.epsilon = given.epsilon,
                "policy.search" => policy.search = given.search,
                "policy.predictor" => policy.predictor = given.predictor,
                "policy.trials_per_state" => policy.trials_per_state = given.trials_per_state,
                "policy.replicates" => policy.replicates = given.replicates,
                "policy.lease_s" => policy.lease_s = given.lease_s,
                "policy.pinned" => policy.pinned = given.pinned,
                "policy.epsilon_halves_after" => policy.epsilon_halves_after = given.epsilon_halves_after,
                "policy.regret_budget" => policy.regret_budget = given.regret_budget,
                "policy.abort_above" => policy.abort_above = given.abort_above,
                "policy.worst_factor" => policy.worst_factor = given.worst_factor,
                "policy.operation" => policy.operation = given.operation,
                "policy.weigh_gain" => policy.weigh_gain = given.weigh_gain,
                "policy.freeze_risk" => policy.freeze_risk = given.freeze_risk,
                "policy.warm_up" => policy.warm_up = given.warm_up,
                "policy.roll_back" => policy.roll_back = given.roll_back,
                _ => {
                    return Err(Error::invalid(
                        "update_mask",
                        format!(
                            "{path:?} cannot be changed; use policy, or policy.FIELD with epsilon, search, \
                             predictor, trials_per_state, replicates, lease_s, pinned, epsilon_halves_after, \
                             regret_budget, abort_above, worst_factor, operation, weigh_gain, freeze_risk, warm_up \
                             or roll_back"
                        ),
                    ));
                }
            }
        }
        Ok(policy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(paths: &[&str]) -> Option<FieldMask> {
        Some(FieldMask { paths: paths.iter().map(|path| (*path).to_owned()).collect() })
    }

    #[test]
    fn unset_fields_take_their_defaults() {
        let read = policy("policy", v1::Policy::default()).unwrap();
        assert_eq!(read, RawPolicy::default());
    }

    #[test]
    fn only_masked_fields_change() {
        let given = v1::Policy { epsilon: Some(0.0), lease_s: 7, replicates: 3, ..v1::Policy::default() };
        let current = RawPolicy { trials_per_state: 5, ..RawPolicy::default() };
        let update = PolicyUpdate::read(given.clone(), mask(&["policy.lease_s", "policy.epsilon"]));
        let merged = update.unwrap().merged(current.clone()).unwrap();
        assert_eq!(
            merged,
            RawPolicy { epsilon: 0.0, lease_s: 7, trials_per_state: 5, ..RawPolicy::default() }
        );
        for whole in [None, mask(&[]), mask(&["policy"])] {
            let update = PolicyUpdate::read(given.clone(), whole).unwrap();
            let merged = update.merged(current.clone()).unwrap();
            assert_eq!((merged.replicates, merged.trials_per_state), (3, 80));
        }
    }

    #[test]
    fn other_paths_and_values_are_refused() {
        for path in ["seed", "policy.colour", "*", "policy.pinned.values", ""] {
            let error = PolicyUpdate::read(v1::Policy::default(), mask(&[path])).unwrap_err();
            assert!(error.to_string().starts_with("update_mask: "), "{error}");
        }
        let negative = v1::Policy { lease_s: -1, ..v1::Policy::default() };
        let error = PolicyUpdate::read(negative, None).unwrap_err();
        assert_eq!(error.to_string(), "study.policy.lease_s: -1 must not be negative");
        let odd = v1::Policy { search: 99, ..v1::Policy::default() };
        let error = PolicyUpdate::read(odd, None).unwrap_err();
        assert_eq!(error.to_string(), "study.policy.search: 99 is not a known value");
    }
}
