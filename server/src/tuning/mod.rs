//! The use cases of the daemon, apart from the wire: the work of each request on tuner and store.
//!
//! Each one takes the tuner's lock, computes, queues the change, releases the lock, waits until the change is
//! durable, and answers. So every answer rests on durable changes. No model is fitted under the lock:
//! `planning` does that before. `runtime` holds the tuners in memory. `loading` reads a study from the
//! database. `checkpoints` saves knowledge, so that less has to be read. `retention` removes old trials.
//! `frames` suggests and reports. `spaces` changes spaces, and answers to clients of earlier ones.
//! `exclusion` keeps trials out of all that is learnt. `trials` and `studies` have the other requests by
//! topic. `presence` notes absences of the daemon. `figures` collects the metrics' data.

mod checkpoints;
mod compute;
mod exclusion;
mod figures;
mod frames;
mod loading;
mod planned_searches;
mod planning;
mod presence;
mod retention;
mod runtime;
mod spaces;
mod studies;
mod trials;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Semaphore;
use treewright_core::ids::StudyUid;
use treewright_core::limits::CHECKPOINT_TRIALS_MIN;
use treewright_store::Store;

use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::limits;
use crate::metrics::Metrics;
use presence::Presence;
use runtime::{Live, Runtime};

pub use frames::{FrameAnswer, Reported};
pub use spaces::SpaceEffect;

/// The use cases on one store, with the errors that the wire contract names. Holds the tuners of the studies
/// in memory.
pub struct Tuning {
    environment: Arc<Environment>,
    /// Completed trials after which a checkpoint is worth its bytes, as long as it is small.
    checkpoint_after: u64,
    /// Permits for plans that are computed at once.
    planning_permits: Arc<Semaphore>,
    /// One caller at a time saves checkpoints: a slow one must not replace a newer checkpoint, on whose
    /// ground trials may have been removed. Nor is one saved while a trial is excluded or the space changes.
    saving: Semaphore,
    runtimes: Mutex<Runtimes>,
}

/// The environment of a study in memory: the database, the time, the metrics, and the start of the daemon.
#[derive(Clone)]
struct Environment {
    store: Arc<dyn Store>,
    clock: Arc<dyn Clock>,
    metrics: Arc<Metrics>,
    presence: Arc<Presence>,
}

/// The studies in memory, each with the time of its last use, counted in uses.
#[derive(Default)]
struct Runtimes {
    by_study: HashMap<String, (Arc<Runtime>, u64)>,
    uses: u64,
}

impl Tuning {
    /// The use cases on a store and a clock.
    pub fn new(store: Arc<dyn Store>, clock: Arc<dyn Clock>) -> Self {
        let environment =
            Arc::new(Environment { store, clock, metrics: Arc::default(), presence: Arc::default() });
        let (checkpoint_after, planning_permits) = (CHECKPOINT_TRIALS_MIN, planning::permits());
        let saving = Semaphore::new(1);
        Self { environment, checkpoint_after, planning_permits, saving, runtimes: Mutex::default() }
    }

    /// Counts in `metrics`, instead of private figures.
    #[must_use]
    pub fn with_metrics(self, metrics: Arc<Metrics>) -> Self {
        let environment = Environment { metrics, ..(*self.environment).clone() };
        Self { environment: Arc::new(environment), ..self }
    }

    /// The metrics.
    pub fn metrics(&self) -> &Arc<Metrics> {
        &self.environment.metrics
    }

    fn store(&self) -> &dyn Store {
        &*self.environment.store
    }

    /// The time of the clock for leases, in milliseconds since 1970.
    pub fn now_ms(&self) -> i64 {
        self.environment.clock.now_ms()
    }

    /// Saves checkpoints after `trials` completed trials, for tests, in which the usual number would be too
    /// high.
    #[must_use]
    pub fn with_checkpoints_after(self, trials: u64) -> Self {
        Self { checkpoint_after: trials, ..self }
    }

    /// Computes on a study's tuner, after it has ended every lease that has run out.
    async fn with_tuner<T>(
        &self,
        study: &str,
        compute: impl FnOnce(&mut Live, &dyn Store, i64) -> T + Send,
    ) -> Result<T> {
        let (runtime, store) = (self.runtime(study), self.store());
        let computed = runtime
            .with(|live| {
                let now_ms = self.now_ms();
                live.tuner.clients_mut().pardon_leases(self.environment.presence.pardoned_until_ms(now_ms));
                live.expire(store, now_ms);
                compute(live, store, now_ms)
            })
            .await;
        match &computed {
            Ok(_) | Err(Error::Loading { .. }) => {}
            // Names of missing studies must not fill the memory.
            Err(_) => self.forget(study),
        }
        computed
    }

    /// The place of a study in memory. Where room is short, the least recently used one is dropped; its
    /// queued changes are still stored.
    fn runtime(&self, study: &str) -> Arc<Runtime> {
        let mut runtimes = self.runtimes.lock().unwrap_or_else(PoisonError::into_inner);
        runtimes.uses += 1;
        let now = runtimes.uses;
        if let Some((runtime, used)) = runtimes.by_study.get_mut(study) {
            *used = now;
            return Arc::clone(runtime);
        }
        if runtimes.by_study.len() >= limits::STUDIES_IN_MEMORY {
            let oldest = runtimes.by_study.iter().min_by_key(|(_, (_, used))| *used);
            if let Some(oldest) = oldest.map(|(study, _)| study.clone()) {
                runtimes.by_study.remove(&oldest);
            }
        }
        let runtime = Runtime::new(study, Arc::clone(&self.environment));
        let entry = (Arc::clone(&runtime), now);
        runtimes.by_study.insert(study.to_owned(), entry);
        let studies = runtimes.by_study.len();
        assert!(studies <= limits::STUDIES_IN_MEMORY, "{studies} studies in memory");
        runtime
    }

    fn uid_in_memory(&self, study: &str) -> Option<StudyUid> {
        let runtimes = self.runtimes.lock().unwrap_or_else(PoisonError::into_inner);
        let runtime = runtimes.by_study.get(study).map(|(runtime, _)| Arc::clone(runtime));
        drop(runtimes);
        runtime?.peek(|live| live.identity.uid)
    }

    /// Begins to load a study that is not in memory yet, so that soon requests wait less.
    pub(crate) fn begin_loading(&self, study: &str) {
        self.runtime(study).begin_loading();
    }

    /// Studies in memory, and the trials of theirs that are under a lease.
    pub(crate) fn in_use(&self) -> (usize, u64) {
        let studies = self.in_memory();
        let open =
            |(_, runtime): &(String, Arc<Runtime>)| runtime.peek(|live| live.tuner.statistics().open_trials);
        (studies.len(), studies.iter().filter_map(open).sum())
    }

    /// The studies in memory that were used last, at most `most`.
    fn last_used(&self, most: usize) -> Vec<(String, Arc<Runtime>)> {
        let runtimes = self.runtimes.lock().unwrap_or_else(PoisonError::into_inner);
        let mut all: Vec<_> = runtimes.by_study.iter().collect();
        all.sort_by_key(|(_, (_, used))| std::cmp::Reverse(*used));
        let pair =
            |(study, (runtime, _)): (&String, &(Arc<Runtime>, u64))| (study.clone(), Arc::clone(runtime));
        all.into_iter().take(most).map(pair).collect()
    }

    fn in_memory(&self) -> Vec<(String, Arc<Runtime>)> {
        let runtimes = self.runtimes.lock().unwrap_or_else(PoisonError::into_inner);
        let pair =
            |(study, (runtime, _)): (&String, &(Arc<Runtime>, u64))| (study.clone(), Arc::clone(runtime));
        runtimes.by_study.iter().map(pair).collect()
    }

    fn forget(&self, study: &str) {
        let mut runtimes = self.runtimes.lock().unwrap_or_else(PoisonError::into_inner);
        runtimes.by_study.remove(study);
    }
}
