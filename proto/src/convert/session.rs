//! The policy of a session.

use treewright_model::session::SessionPolicy;

use crate::convert::{timestamp_from_wire, timestamp_to_wire};
use crate::v1;

/// `None` for a policy without fields.
pub fn session_policy_to_wire(policy: SessionPolicy) -> Option<v1::SessionPolicy> {
    let SessionPolicy { epsilon, trials_per_state, abort_above, explore_until_ms } = policy;
    // It was checked against a limit far below.
    let trials_per_state = trials_per_state.map(|trials| i32::try_from(trials).unwrap_or(i32::MAX));
    let explore_until = explore_until_ms.map(timestamp_to_wire);
    let wire = v1::SessionPolicy { epsilon, trials_per_state, abort_above, explore_until };
    (!policy.is_empty()).then_some(wire)
}

/// The policy as sent: a caller validates it before use.
pub fn session_policy_from_wire(wire: v1::SessionPolicy) -> SessionPolicy {
    let v1::SessionPolicy { epsilon, trials_per_state, abort_above, explore_until } = wire;
    // A negative number is as far out of its range as 0.
    let trials_per_state = trials_per_state.map(|trials| u32::try_from(trials).unwrap_or(0));
    let explore_until_ms = explore_until.map(timestamp_from_wire);
    SessionPolicy { epsilon, trials_per_state, abort_above, explore_until_ms }
}
