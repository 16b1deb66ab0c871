//! Where the policy that a client gives to CreateStudy is another than the stored one.

use treewright_core::policy::Policy;
use treewright_proto::v1;

use super::to_proto;

/// Names the fields of policies that are set in `$given` and differ between `$meant` and `$stored`. All fields have to be
/// listed, or it does not compile.
macro_rules! differing {
    ($given:ident, $meant:ident, $stored:ident: $($field:ident),* $(,)?) => {{
        let unset = v1::Policy::default();
        let v1::Policy { $($field: _),* } = &unset;
        let mut names = Vec::new();
        $(
            if $given.$field != unset.$field && $meant.$field != $stored.$field {
                names.push(stringify!($field).to_owned());
            }
        )*
        names
    }};
}

/// The fields that `given` sets and that mean something else than `stored`; `meant` is `given` as it was read.
pub fn policy_differences(given: &v1::Policy, meant: &Policy, stored: &Policy) -> Vec<String> {
    let (meant, stored) = (to_proto::policy(meant), to_proto::policy(stored));
    differing!(
        given, meant, stored:
        epsilon, search, predictor, trials_per_state, replicates, lease_s, pinned, epsilon_halves_after,
        regret_budget, abort_above, worst_factor, operation, weigh_gain, freeze_risk, warm_up, roll_back,
    )
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
