//! Changes of studies: of the policy, whole and field by field, and of the texts for people.

use std::collections::BTreeSet;

use prost_types::FieldMask;
use treewright_core::policy::{PolicySettings, RawPolicy, field_names};
use treewright_core::study::StudySpec;
use treewright_proto::convert::policy_from_wire;
use treewright_proto::v1;

use crate::error::{Error, Result};

/// The paths beside the policy's.
const TEXTS: [&str; 3] = ["display_name", "note", "tags"];
/// The beginning of the path of one tag, so that who adds one undoes nobody else's change.
const TAG: &str = "tags.";

/// A change of a study: the given values, and the fields that count.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyUpdate {
    given: RawPolicy,
    display_name: String,
    note: String,
    tags: BTreeSet<String>,
    paths: Vec<String>,
}

impl StudyUpdate {
    /// Reads an update.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the field, or with a path of what cannot be changed.
    pub fn read(study: v1::Study, mask: Option<FieldMask>) -> Result<Self> {
        let paths = mask.map(|mask| mask.paths).unwrap_or_default();
        let paths = if paths.is_empty() { vec!["policy".to_owned()] } else { paths };
        let mut said = policy_from_wire("study.policy", study.policy.unwrap_or_default())?;
        let counts = |name: &str| {
            paths.iter().any(|path| path == "policy" || path.strip_prefix("policy.") == Some(name))
        };
        // Fields that are sent outside the mask are ignored: a newer client may send unknown ones.
        for field in PolicySettings::FIELDS.iter().filter(|field| !counts(field.name)) {
            said.unset(field.name);
        }
        let given = said.decide().map_err(|error| Error::invalid("study", error))?;
        let v1::Study { display_name, note, tags, .. } = study;
        let update = Self { given, display_name, note, tags: tags.into_iter().collect(), paths };
        // The paths are tried on a default policy, so that a wrong one is refused before a study changes.
        update.merged(RawPolicy::default())?;
        Ok(update)
    }

    /// The specification that results from `current`, checked.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the field that does not fit, and for another display name of a front's study,
    /// which is found by it.
    pub fn apply(&self, current: &StudySpec) -> Result<StudySpec> {
        let mut spec = current.clone();
        let policy = self.merged(spec.policy.to_raw())?.check(&spec.space);
        spec.policy = policy.map_err(|error| Error::invalid("study", error))?;
        for path in &self.paths {
            match path.as_str() {
                "display_name" => spec.display_name.clone_from(&self.display_name),
                "note" => spec.note.clone_from(&self.note),
                "tags" => spec.tags.clone_from(&self.tags),
                other => {
                    if let Some(tag) = other.strip_prefix(TAG) {
                        spec.tags.remove(tag);
                        spec.tags.extend(self.tags.get(tag).cloned());
                    }
                }
            }
        }
        if current.front().is_some_and(|front| spec.front() != Some(front)) {
            let name = &current.display_name;
            let problem = format!("{name:?} says which metrics the front has; use note or tags for more");
            return Err(Error::invalid("study.display_name", problem));
        }
        spec.validate().map_err(|error| Error::invalid("study", error))?;
        Ok(spec)
    }

    fn merged(&self, mut policy: RawPolicy) -> Result<RawPolicy> {
        assert!(!self.paths.is_empty(), "an update without paths changes nothing");
        for path in &self.paths {
            let field = path.strip_prefix("policy.");
            if path == "policy" {
                policy = self.given.clone();
            } else if TEXTS.contains(&path.as_str())
                || path.starts_with(TAG)
                || field.is_some_and(|field| PolicySettings::RETIRED.contains(&field))
            {
                // A text changes no policy. A retired field may still be set, to no effect.
            } else if field.is_none_or(|field| policy.replace_field(field, &self.given).is_err()) {
                let problem = format!(
                    "{path:?} cannot be changed; use {}, tags.TAG, policy, or policy.FIELD with one of {}",
                    TEXTS.join(", "),
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

    fn of(policy: v1::Policy) -> v1::Study {
        v1::Study { policy: Some(policy), ..v1::Study::default() }
    }

    fn mask(paths: &[&str]) -> Option<FieldMask> {
        Some(FieldMask { paths: paths.iter().map(|path| (*path).to_owned()).collect() })
    }

    #[test]
    fn only_masked_fields_change() {
        let given = v1::Policy { epsilon: Some(0.0), lease_s: 7, replicates: 3, ..v1::Policy::default() };
        let current = RawPolicy { trials_per_state: 5, ..RawPolicy::default() };
        let given = of(given);
        let update = StudyUpdate::read(given.clone(), mask(&["policy.lease_s", "policy.epsilon"]));
        let merged = update.unwrap().merged(current.clone()).unwrap();
        let expected = RawPolicy { epsilon: 0.0, lease_s: 7, trials_per_state: 5, ..RawPolicy::default() };
        assert_eq!(merged, expected);
        let update = StudyUpdate::read(given.clone(), mask(&["policy.freeze_risk"])).unwrap();
        assert_eq!(update.merged(current.clone()).unwrap(), current);
        for whole in [None, mask(&[]), mask(&["policy"])] {
            let update = StudyUpdate::read(given.clone(), whole).unwrap();
            let merged = update.merged(current.clone()).unwrap();
            assert_eq!((merged.replicates, merged.trials_per_state), (3, 80));
        }
    }

    #[test]
    fn other_paths_and_values_are_refused() {
        for path in ["seed", "policy.colour", "*", "policy.pinned.values", "policy.note", "note.a", ""] {
            let error = StudyUpdate::read(v1::Study::default(), mask(&[path])).unwrap_err();
            assert!(error.to_string().starts_with("update_mask: "), "{error}");
        }
        let negative = v1::Policy { lease_s: -1, ..v1::Policy::default() };
        let error = StudyUpdate::read(of(negative), None).unwrap_err();
        assert_eq!(error.to_string(), "study.policy.lease_s: -1 must not be negative");
        let odd = v1::Policy { search: 99, ..v1::Policy::default() };
        let error = StudyUpdate::read(of(odd), None).unwrap_err().to_string();
        let words = "study: policy.search: 99 is not a known value; known are auto, nelder_mead, ";
        assert!(error.starts_with(words), "{error}");
    }
}
