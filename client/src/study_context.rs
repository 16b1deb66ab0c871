//! The part of its study that a suggestion keeps: the connection, the name, the specification, and the
//! configurations to fall back on. All handles of the study share it.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use treewright_proto::convert::configuration_to_wire;
use treewright_proto::v1;

use crate::core::Core;
use crate::locks::lock;
use crate::memory::RememberedConfigurations;
use crate::prepared::SetUps;
use crate::{Configuration, Indicators, Measurements, Outcome, StudyRecord, StudySpec};

#[derive(Debug)]
pub(crate) struct StudyContext {
    pub(crate) core: Arc<Core>,
    /// The resource name.
    pub(crate) name: Arc<str>,
    /// The name with the study's identity, once the daemon has sent it. Requests use this one.
    identified: Mutex<Arc<str>>,
    pub(crate) spec: StudySpec,
    /// The revision of the space of `spec`; 0 until the daemon has sent it.
    revision: AtomicU32,
    memory: Mutex<RememberedConfigurations>,
    /// What the program runs by default, where that is not the study's default.
    start: Mutex<Option<Configuration>>,
    pub(crate) set_ups: Arc<SetUps>,
}

impl StudyContext {
    pub(crate) fn new(core: &Arc<Core>, name: &str, spec: StudySpec) -> Self {
        let name: Arc<str> = Arc::from(name);
        let identified = Mutex::new(Arc::clone(&name));
        let (revision, memory, start) = <_>::default();
        let set_ups = core.set_ups(&name);
        Self { core: Arc::clone(core), name, identified, spec, revision, memory, start, set_ups }
    }

    /// The same study for another client. A lock that another thread held when the process was forked stays
    /// locked: the study then goes by its name alone, or has no start.
    pub(crate) fn again(&self, core: &Arc<Core>) -> Self {
        let mut again = Self::new(core, &self.name, self.spec.clone());
        if let Ok(identified) = self.identified.try_lock() {
            again.identified = Mutex::new(Arc::clone(&identified));
        }
        if let Ok(start) = self.start.try_lock() {
            again.start = Mutex::new(start.clone());
        }
        again.revision = AtomicU32::new(self.revision());
        again
    }

    pub(crate) fn asked_name(&self) -> Arc<str> {
        Arc::clone(&lock(&self.identified))
    }

    /// The revision of the space that the program works with, which the daemon answers in.
    pub(crate) fn revision(&self) -> u32 {
        self.revision.load(Ordering::Relaxed)
    }

    /// Takes the identity of the study, and the revision of its space, from the daemon's answer.
    pub(crate) fn identify(&self, record: &StudyRecord) {
        self.revision.store(record.space_revision, Ordering::Relaxed);
        let mut identified = lock(&self.identified);
        *identified = Arc::from(record.identified_name());
    }

    /// Sets what the program runs by default; `None` for the study's default.
    pub(crate) fn set_start(&self, start: Option<Configuration>) {
        *lock(&self.start) = start;
    }

    /// What the program runs by default, where that is not the study's default.
    pub(crate) fn start(&self) -> Option<Configuration> {
        lock(&self.start).clone()
    }

    /// The same, as requests have it.
    pub(crate) fn start_to_wire(&self) -> Option<v1::Configuration> {
        self.start().map(|start| configuration_to_wire(start.as_raw()))
    }

    /// The revision of the space and the start, which go along with questions that only read.
    pub(crate) fn asked_by(&self) -> (u32, Option<v1::Configuration>) {
        (self.revision(), self.start_to_wire())
    }

    /// What to run in a state while the daemon is away; `None` where only the defaults are left.
    pub(crate) fn last_good(&self, indicators: &Indicators) -> Option<Configuration> {
        lock(&self.memory).last_good(&self.spec, indicators).cloned()
    }

    /// Learns from a result what to fall back on. What is beyond a limit does not count as run. `is_answer`:
    /// the daemon did not explore with it.
    pub(crate) fn learn(
        &self,
        indicators: &Indicators,
        configuration: &Configuration,
        is_answer: bool,
        outcome: &Outcome,
        measured: &Measurements,
    ) {
        let objective = &self.spec.objective;
        let cost = match outcome {
            Outcome::Ok if matches!(objective.beyond(&measured.0), Ok(None)) => {
                objective.cost(&measured.0).ok()
            }
            Outcome::Ok | Outcome::Infeasible { .. } | Outcome::Failed { .. } => None,
            Outcome::Aborted { .. } => return,
        };
        lock(&self.memory).note(&self.spec, indicators, configuration, is_answer, cost);
    }
}
