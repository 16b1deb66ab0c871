//! The tried configurations of a state that its table forgot, in a space of few configurations. They stay
//! tried, and are not counted once more when they are met again.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::fnv;

/// Forgotten configurations by a hash of each, and whether the tuner chose it, not its client.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Forgotten(BTreeMap<u64, bool>);

impl Forgotten {
    /// Notes a configuration that is forgotten.
    pub(super) fn note(&mut self, configuration: &Configuration, is_searched: bool) {
        self.0.insert(hash(configuration), is_searched);
    }

    /// Takes out a configuration that is met again. Returns whether the tuner had chosen it; `None` where it
    /// was not forgotten.
    pub(super) fn take(&mut self, configuration: &Configuration) -> Option<bool> {
        // Nearly all tables have forgotten nothing.
        if self.0.is_empty() { None } else { self.0.remove(&hash(configuration)) }
    }
}

fn hash(configuration: &Configuration) -> u64 {
    fnv::hash(configuration.key().bytes())
}
