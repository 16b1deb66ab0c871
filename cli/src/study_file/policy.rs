//! The policy of a study file.

use std::collections::BTreeMap;

use treewright_client::{Configuration, Policy};

use super::{PRESET, ParameterEntry, Plain, PolicyEntry, StudyFile};
use crate::failure::{Failure, Result};

impl StudyFile {
    /// The policy as its entries say it.
    pub(super) fn policy_settings(&self) -> Result<Policy> {
        let mut policy = Policy::new();
        if let Some(PolicyEntry::Value(name)) = self.policy.get(PRESET) {
            policy = Policy::preset(&name.value(false).to_string())
                .map_err(|error| Failure::Usage(error.to_string()))?;
        }
        for (field, entry) in self.policy.iter().filter(|(field, _)| *field != PRESET) {
            match entry {
                // A file of an earlier version, such as an export.
                _ if Policy::RETIRED.contains(&field.as_str()) => {}
                PolicyEntry::Value(value) => policy
                    .set_text(field, &value.value(false).to_string())
                    .map_err(|error| Failure::Usage(error.to_string()))?,
                PolicyEntry::Configuration(values) if field == "pinned" => {
                    let values = values.iter().map(|(name, value)| (name.clone(), value.value(false)));
                    let space_of = |name: &str| self.parameters.iter().find(|entry| entry.name == name);
                    let typed = values.map(|(name, value)| {
                        let floats = space_of(&name).is_some_and(ParameterEntry::is_float);
                        (name, Plain::from(&value).value(floats))
                    });
                    policy.pinned = Some(typed.collect::<Configuration>());
                }
                PolicyEntry::Configuration(_) => {
                    return Err(Failure::Usage(format!("policy.{field} is not a table")));
                }
            }
        }
        Ok(policy)
    }
}

/// The fields of a policy that are not as the daemon would have them anyway.
pub(super) fn policy_entries(policy: &Policy) -> Result<BTreeMap<String, PolicyEntry>> {
    let mut entries = BTreeMap::new();
    let serde_json::Value::Object(values) = serde_json::to_value(policy)? else {
        return Err(Failure::Data("a policy is no object".into()));
    };
    for field in Policy::FIELDS {
        let said = policy.show(field.name);
        if said.is_none() || said.as_deref() == Some(field.unset) {
            continue;
        }
        if let Some(value) = values.get(field.name) {
            entries.insert(field.name.to_owned(), serde_json::from_value(value.clone())?);
        }
    }
    Ok(entries)
}
