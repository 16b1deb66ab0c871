//! The length of a search that tries every configuration of a space.

use crate::policy::{Policy, PolicySettings};
use crate::space::Space;

/// A space so small that a state's search tries all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Few {
    /// The number of configurations.
    pub configurations: u64,
    /// The approximate number of runs until they are tried, separated and confirmed: the mean of simulated
    /// searches on a quiet machine, good to a third.
    pub runs: u64,
}

/// The mean number of runs of each configuration, and the number of configurations in the confirmation.
const RUNS_EACH: f64 = 1.8;
const CONTENDERS: u64 = 3;
/// The most rounds of a confirmation on a quiet machine.
const ROUNDS: u64 = 10;

impl PolicySettings {
    /// The length of tuning in a space, where this policy's searches try all of it; `None` where they do not.
    pub fn few(&self, space: &Space) -> Option<Few> {
        let policy: Policy = Policy::default();
        let trials = u64::from(self.trials_per_state.unwrap_or(policy.trials_per_state));
        let configurations = space.enumerate()?.len() as u64;
        if configurations > trials {
            return None;
        }
        let rounds = u64::from(self.confirm_rounds.unwrap_or(policy.confirm_rounds)).min(ROUNDS);
        let search = match rounds {
            0 => configurations,
            _ => (RUNS_EACH * configurations as f64).round() as u64,
        };
        let confirmation = if configurations > 1 { rounds * configurations.min(CONTENDERS) } else { 0 };
        Some(Few { configurations, runs: search.min(trials) + confirmation })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_configurations_are_announced_and_many_are_not() {
        let levels = |most| {
            let levels = Space::builder().integer("level", 1..=most).default(3);
            levels.build().expect("valid")
        };
        let policy = PolicySettings::default();
        let few = policy.few(&levels(19)).expect("19 are few");
        assert_eq!(few.configurations, 19);
        assert!((40..100).contains(&few.runs), "{few:?}");
        assert_eq!(policy.few(&levels(81)), None, "more than a search has runs");
        let unconfirmed = PolicySettings { confirm_rounds: Some(0), ..policy };
        assert_eq!(unconfirmed.few(&levels(19)), Some(Few { configurations: 19, runs: 19 }));
    }
}
