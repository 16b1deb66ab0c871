//! A change of a stored study's policy.

use super::PolicySettings;

/// A change of a stored study's policy. The fields that are `Some` in `set` are replaced. Those named in
/// `clear` go back to the daemon's defaults. The others stay.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolicyChange {
    /// New values.
    pub set: PolicySettings,
    /// Fields that go back to their defaults, e.g. `regret_budget`. Win over `set`.
    pub clear: Vec<String>,
}

impl PolicyChange {
    /// Replaces the fields that are `Some`.
    pub fn set(policy: PolicySettings) -> Self {
        Self { set: policy, ..Self::default() }
    }

    /// Clears the pinned configuration.
    pub fn unpin() -> Self {
        Self::clear(["pinned"])
    }

    /// Sets fields back to the daemon's defaults.
    pub fn clear<T: Into<String>>(fields: impl IntoIterator<Item = T>) -> Self {
        Self { clear: fields.into_iter().map(Into::into).collect(), ..Self::default() }
    }

    /// The values to send. Cleared fields are left out, so that the daemon takes its defaults.
    pub fn values(&self) -> PolicySettings {
        let mut set = self.set.clone();
        for field in &self.clear {
            // The daemon refuses unknown names.
            set.unset(field);
        }
        set
    }

    /// The fields that change, as paths of the wire contract's field mask.
    pub fn paths(&self) -> Vec<String> {
        let set = PolicySettings::FIELDS.iter().map(|field| field.name).filter(|name| {
            self.set.show(name).is_some() && !self.clear.iter().any(|cleared| cleared == name)
        });
        set.chain(self.clear.iter().map(String::as_str)).map(|field| format!("policy.{field}")).collect()
    }
}
