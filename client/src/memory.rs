//! The configurations to run with when the daemon does not answer: those of the daemon that ran here.

use std::collections::VecDeque;

use crate::{Configuration, limits};

/// The last configurations of one study that ran to their end and did not fail since. Oldest first, distinct.
#[derive(Debug, Default)]
pub(crate) struct RememberedConfigurations(VecDeque<Configuration>);

impl RememberedConfigurations {
    /// A configuration ran to its end, or could not be run.
    pub(crate) fn note(&mut self, configuration: &Configuration, runs: bool) {
        self.0.retain(|other| other != configuration);
        if runs {
            self.0.push_back(configuration.clone());
        }
        if self.0.len() > limits::REMEMBERED_CONFIGURATIONS {
            self.0.pop_front();
        }
    }

    pub(crate) fn last_good(&self) -> Option<&Configuration> {
        self.0.back()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn configuration(quality: i64) -> Configuration {
        Configuration::new().with("quality", quality)
    }

    #[test]
    fn what_failed_is_not_handed_out_again_until_it_runs() {
        let mut memory = RememberedConfigurations::default();
        assert_eq!(memory.last_good(), None);
        memory.note(&configuration(1), true);
        memory.note(&configuration(2), true);
        memory.note(&configuration(2), false);
        assert_eq!(memory.last_good(), Some(&configuration(1)));
        memory.note(&configuration(1), false);
        assert_eq!(memory.last_good(), None);
        memory.note(&configuration(2), true);
        assert_eq!(memory.last_good(), Some(&configuration(2)));
    }

    #[test]
    fn it_does_not_grow() {
        let mut memory = RememberedConfigurations::default();
        for quality in 0..1000 {
            memory.note(&configuration(quality), true);
            memory.note(&configuration(-quality), false);
        }
        assert_eq!(memory.0.len(), limits::REMEMBERED_CONFIGURATIONS);
    }
}
