//! The differences between a client's policy in CreateStudy and the stored one.

use treewright_core::policy::{Policy, PolicySettings};
use treewright_proto::convert::policy_from_wire;
use treewright_proto::v1;

/// The fields that `given` sets to other values than `stored`; `meant` is the parsed `given`.
pub fn policy_differences(given: &v1::Policy, meant: &Policy, stored: &Policy) -> Vec<String> {
    // The policy was parsed once already, so this cannot fail.
    let said = |policy: v1::Policy| policy_from_wire("policy", policy).unwrap_or_default();
    let (given, unset) = (said(given.clone()), said(v1::Policy::default()));
    let (meant, stored): (PolicySettings, PolicySettings) = (meant.clone().into(), stored.clone().into());
    let differs =
        |field: &&str| given.show(field) != unset.show(field) && meant.show(field) != stored.show(field);
    let fields = PolicySettings::FIELDS.iter().map(|field| field.name);
    fields.filter(differs).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_set_and_differs_is_named() {
        let stored = Policy { epsilon: 0.0, trials_per_state: 40, ..Policy::default() };
        let differences = |given: v1::Policy, meant: Policy| policy_differences(&given, &meant, &stored);
        assert!(differences(v1::Policy::default(), Policy::default()).is_empty(), "nothing was asked for");
        let given = v1::Policy { epsilon: Some(0.5), trials_per_state: 40, ..v1::Policy::default() };
        let meant = Policy { epsilon: 0.5, trials_per_state: 40, ..Policy::default() };
        assert_eq!(differences(given, meant), ["epsilon"]);
    }
}
