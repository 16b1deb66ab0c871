//! Changes of policies, whole and field by field.

use prost_types::FieldMask;
use treewright_core::policy::{Policy, PolicySettings, RawPolicy, field_names};
use treewright_core::space::Space;
use treewright_proto::convert::policy_from_wire;
use treewright_proto::v1;

use crate::error::Error;

/// A change of a policy: the given values, and the fields that count.
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
        let paths = if paths.is_empty() { vec!["policy".to_owned()] } else { paths };
        let mut said = policy_from_wire("study.policy", wire)?;
        let counts = |name: &str| {
            paths.iter().any(|path| path == "policy" || path.strip_prefix("policy.") == Some(name))
        };
        // Fields that are sent outside the mask are ignored: a newer client may send unknown ones.
        for field in PolicySettings::FIELDS.iter().filter(|field| !counts(field.name)) {
            said.unset(field.name);
        }
        let given = said.decide().map_err(|error| Error::invalid("study", error))?;
        let update = Self { given, paths };
        // The paths are tried on a default policy, so that a wrong one is refused before a study changes.
        update.merged(RawPolicy::default())?;
        Ok(update)
    }

    /// The policy that results from `current`, checked against the study's space.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the field that does not fit.
    pub fn apply(&self, current: &Policy, space: &Space) -> Result<Policy, Error> {
        self.merged(current.to_raw())?.check(space).map_err(|error| Error::invalid("study", error))
    }

    fn merged(&self, mut policy: RawPolicy) -> Result<RawPolicy, Error> {
        assert!(!self.paths.is_empty(), "an update without paths changes nothing");
        for path in &self.paths {
            let field = path.strip_prefix("policy.");
            if path == "policy" {
                policy = self.given.clone();
            } else if field.is_some_and(|field| PolicySettings::RETIRED.contains(&field)) {
                // Clients may still change it, to no effect.
            } else if field.is_none_or(|field| policy.replace_field(field, &self.given).is_err()) {
                let problem = format!(
                    "{path:?} cannot be changed; use policy, or policy.FIELD with one of {}",
                    field_names()
                );
                return Err(Error::invalid("update_mask", problem));
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
    fn only_masked_fields_change() {
        let given = v1::Policy { epsilon: Some(0.0), lease_s: 7, replicates: 3, ..v1::Policy::default() };
        let current = RawPolicy { trials_per_state: 5, ..RawPolicy::default() };
        let update = PolicyUpdate::read(given.clone(), mask(&["policy.lease_s", "policy.epsilon"]));
        let merged = update.unwrap().merged(current.clone()).unwrap();
        assert_eq!(
            merged,
            RawPolicy { epsilon: 0.0, lease_s: 7, trials_per_state: 5, ..RawPolicy::default() }
        );
        let update = PolicyUpdate::read(given.clone(), mask(&["policy.freeze_risk"])).unwrap();
        assert_eq!(update.merged(current.clone()).unwrap(), current);
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
        let error = PolicyUpdate::read(odd, None).unwrap_err().to_string();
        let words = "study: policy.search: 99 is not a known value; known are auto, nelder_mead, ";
        assert!(error.starts_with(words), "{error}");
    }
}
