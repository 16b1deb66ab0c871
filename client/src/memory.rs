//! The configuration to run with when the daemon does not answer: the last one of the
//! daemon that was not reported infeasible.

use std::collections::VecDeque;

use crate::{Configuration, limits};

/// The last good configurations of one study, and those known to be bad.
#[derive(Debug, Default)]
pub(crate) struct RememberedConfigurations {
    /// Oldest first, distinct.
    good: VecDeque<Configuration>,
    infeasible: VecDeque<Configuration>,
}

impl RememberedConfigurations {
    /// A configuration came from the daemon.
    pub(crate) fn remember(&mut self, configuration: &Configuration) {
        if !self.infeasible.contains(configuration) {
            push(&mut self.good, configuration, limits::REMEMBERED_CONFIGURATIONS);
        }
    }

    /// A configuration was reported infeasible.
    pub(crate) fn infeasible(&mut self, configuration: &Configuration) {
        self.good.retain(|other| other != configuration);
        push(&mut self.infeasible, configuration, limits::REMEMBERED_INFEASIBLE);
    }

    /// A configuration was measured, so it works after all (in another state).
    pub(crate) fn feasible(&mut self, configuration: &Configuration) {
        self.infeasible.retain(|other| other != configuration);
    }

    pub(crate) fn last_good(&self) -> Option<&Configuration> {
        self.good.back()
    }
}

/// Puts an entry at the end, once, and forgets the oldest beyond the limit.
fn push(list: &mut VecDeque<Configuration>, configuration: &Configuration, limit: usize) {
    list.retain(|other| other != configuration);
    list.push_back(configuration.clone());
    if list.len() > limit {
        list.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn configuration(quality: i64) -> Configuration {
        Configuration::new().with("quality", quality)
    }

    #[test]
    fn an_infeasible_configuration_is_not_handed_out_again() {
        let mut memory = RememberedConfigurations::default();
        assert_eq!(memory.last_good(), None);
        memory.remember(&configuration(1));
        memory.remember(&configuration(2));
        memory.infeasible(&configuration(2));
        assert_eq!(memory.last_good(), Some(&configuration(1)));
        memory.remember(&configuration(2));
        assert_eq!(memory.last_good(), Some(&configuration(1)));
        memory.feasible(&configuration(2));
        memory.remember(&configuration(2));
        assert_eq!(memory.last_good(), Some(&configuration(2)));
    }

    #[test]
    fn it_does_not_grow() {
        let mut memory = RememberedConfigurations::default();
        for quality in 0..1000 {
            memory.remember(&configuration(quality));
            memory.infeasible(&configuration(-quality));
        }
        assert_eq!(memory.good.len(), limits::REMEMBERED_CONFIGURATIONS);
        assert_eq!(memory.infeasible.len(), limits::REMEMBERED_INFEASIBLE);
    }
}
