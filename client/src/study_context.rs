//! What a suggestion keeps of the study that it came from: the connection, the name, the specification, and what is remembered
//! to fall back on. All handles of the study share it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::core::Core;
use crate::memory::RememberedConfigurations;
use crate::{Configuration, Outcome, StudySpec};

#[derive(Debug)]
pub(crate) struct StudyContext {
    pub(crate) core: Arc<Core>,
    /// The resource name.
    pub(crate) name: Arc<str>,
    pub(crate) spec: StudySpec,
    memory: Mutex<RememberedConfigurations>,
}

impl StudyContext {
    pub(crate) fn new(core: &Arc<Core>, name: &str, spec: StudySpec) -> Self {
        Self { core: Arc::clone(core), name: Arc::from(name), spec, memory: Mutex::default() }
    }

    /// The last configuration that came from the daemon and was not reported infeasible.
    pub(crate) fn last_good(&self) -> Option<Configuration> {
        self.memory().last_good().cloned()
    }

    /// The daemon has sent a configuration.
    pub(crate) fn remember(&self, configuration: &Configuration) {
        self.memory().remember(configuration);
    }

    /// Learns from a result what to fall back on.
    pub(crate) fn learn(&self, configuration: &Configuration, outcome: &Outcome) {
        match outcome {
            Outcome::Infeasible { .. } => self.memory().infeasible(configuration),
            Outcome::Ok => self.memory().feasible(configuration),
            Outcome::Aborted { .. } | Outcome::Failed { .. } => {}
        }
    }

    fn memory(&self) -> MutexGuard<'_, RememberedConfigurations> {
        // Nothing panics while it holds the lock; a poisoned one is still in order.
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
