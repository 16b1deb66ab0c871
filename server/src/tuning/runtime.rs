//! The tuner of one study in memory: a cache of the store.
//!
//! A use case locks it, computes, queues the change in the order of the computations, unlocks, and only then
//! waits for the disk. The lock is a plain one and is never held across an await. The cache is valid as long
//! as its [`Fence`] holds: once a write under it failed, the study is loaded again.
//!
//! Loading is a task of the daemon, not of the request that needs it. It goes on when the request is
//! cancelled, so that clients with short deadlines find the study in memory when they ask again. A request
//! waits for it [`LOADING_WAIT`] at most.

use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};

use tokio::sync::Notify;
use tokio::task::AbortHandle;
use tokio::time::timeout;
use treewright_core::space::EarlierSpaces;
use treewright_core::trial::TrialState;
use treewright_core::tuner::{Change, Tuner};
use treewright_store::{Fence, Receipt, Store};

use super::Environment;
use super::loading::{self, Identity, Read, Saved};
use super::planned_searches::PlannedSearches;
use super::presence::back_since;
use crate::convert::names::{StudyName, TrialName};
use crate::error::{Error, Result};
use crate::limits::LOADING_WAIT;
use crate::metrics::{FrameCounts, Metrics};

/// The number of loads of a study for one request, if its fence breaks at once each time.
const LOADS_PER_REQUEST: usize = 3;

pub(super) struct Runtime {
    study: String,
    environment: Arc<Environment>,
    live: Mutex<Option<Live>>,
    /// The last load, which may be under way. Locked before `live` where both are.
    loading: Mutex<Option<Loading>>,
    /// Held by the task that computes the deferred updates of the models.
    pub(super) updating: tokio::sync::Mutex<()>,
}

/// A load of a study. It ends when this is dropped.
struct Loading {
    ending: Arc<Ending>,
    task: AbortHandle,
}

/// The end of a load, for all waiting requests. They are woken in the order in which they came, so that a
/// simulated world is reproducible (tokio's `watch` draws lots).
#[derive(Default)]
struct Ending {
    /// `None` where the load panicked or was given up.
    result: OnceLock<Option<Result<()>>>,
    wake: Notify,
}

impl Ending {
    async fn wait(&self) -> Option<Result<()>> {
        let mut woken = pin!(self.wake.notified());
        woken.as_mut().enable();
        if self.result.get().is_none() {
            woken.await;
        }
        self.result.get().cloned().flatten()
    }

    fn end(&self, result: Option<Result<()>>) {
        // Only the first end counts.
        let _ = self.result.set(result);
        self.wake.notify_waiters();
    }
}

/// Ends a load at the latest when its task does.
struct Announcement(Arc<Ending>);

impl Drop for Announcement {
    fn drop(&mut self) {
        self.0.end(None);
    }
}

impl Drop for Loading {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// A tuner and the right to store its changes.
#[derive(Debug)]
pub(super) struct Live {
    pub(super) tuner: Tuner,
    pub(super) identity: Identity,
    fence: Fence,
    metrics: Arc<Metrics>,
    /// Rises with each change of a trial that was not open. It shows a reader of such a trial from the store
    /// whether the trial may have changed since.
    pub(super) closed_changes: u64,
    pub(super) saved: Saved,
    /// The states whose search is being planned for.
    pub(super) planned_searches: PlannedSearches,
    pub(super) tally: FrameCounts,
    /// The completion of the checkpoint at the last removal of trials.
    pub(super) thinned: u64,
    /// The tuner has to be read again: its policy needs models that it lacks, or the space or the trials that
    /// count have changed.
    pub(super) is_stale: bool,
    /// The spaces that the study had before.
    pub(super) earlier: EarlierSpaces,
}

impl Live {
    /// Queues the tuner's changes. Must be called under the lock under which they were computed.
    pub(super) fn commit(&mut self, store: &dyn Store, changes: &[Change]) -> Receipt {
        self.metrics.decided(changes);
        self.put(store, changes)
    }

    /// Queues changes that no report brought about.
    fn put(&mut self, store: &dyn Store, changes: &[Change]) -> Receipt {
        debug_assert!(!self.is_stale, "what a stale tuner decides is not to be stored");
        let (handed_out, mut all) =
            (self.tuner.statistics().trials, changes.iter().flat_map(|one| &one.trials));
        debug_assert!(all.all(|trial| trial.number <= handed_out), "a trial was stored and not handed out");
        self.tally.add(&self.tuner, changes);
        store.commit(&self.fence, changes)
    }

    /// Ends the leases that have run out, so that no decision rests on them.
    pub(super) fn expire(&mut self, store: &dyn Store, now_ms: i64) {
        if self.tuner.clients().next_expiry_ms().is_none_or(|next_ms| next_ms >= now_ms) {
            return;
        }
        let change = self.tuner.expire(now_ms);
        let next_ms = self.tuner.clients().next_expiry_ms();
        debug_assert!(next_ms.is_none_or(|next_ms| next_ms >= now_ms), "{next_ms:?} is over at {now_ms}");
        debug_assert!(change.trials.iter().all(|trial| trial.state != TrialState::Open), "a lease goes on");
        self.metrics.expired(change.trials.len());
        let study = self.fence.study();
        for trial in &change.trials {
            tracing::info!(study, trial = trial.number, client = trial.client_id, "lease expired");
        }
        if !change.is_empty() {
            // A configuration that is given up completes its trial, whose lease ran out like any other.
            let given_up = change.trials.iter().filter(|trial| trial.state == TrialState::Completed);
            self.tally.expired += given_up.count() as u64;
            // Later changes in the queue wait for it as well, and if it fails, the fence breaks.
            drop(self.put(store, &[change]));
        }
    }

    /// Checks that a request means this study and one of its trials. A request without the study's identity
    /// may come from a client of an earlier study of that name.
    pub(super) fn knows(&self, name: &TrialName) -> Result<()> {
        let study = &name.study;
        self.is_meant(study)?;
        if study.uid.is_none() && name.number <= self.identity.named_after {
            return Err(Error::EarlierTrial { study: study.id.clone(), number: name.number });
        }
        Ok(())
    }

    /// Checks that a request that gives an identity means this study.
    pub(super) fn is_meant(&self, study: &StudyName) -> Result<()> {
        match study.uid {
            Some(uid) if uid != self.identity.uid => Err(Error::Replaced(study.id.clone())),
            _ => Ok(()),
        }
    }

    /// The fence, which identifies a load of a study.
    pub(super) fn fence(&self) -> &Fence {
        &self.fence
    }
}

impl Runtime {
    pub(super) fn new(study: &str, environment: Arc<Environment>) -> Arc<Self> {
        let (live, loading, updating) = <_>::default();
        Arc::new(Self { study: study.to_owned(), environment, live, loading, updating })
    }

    /// Computes on the tuner, and loads it first if needed.
    pub(super) async fn with<T>(self: &Arc<Self>, compute: impl FnOnce(&mut Live) -> T + Send) -> Result<T> {
        for _ in 0..LOADS_PER_REQUEST {
            if let Some(live) = current(&mut self.lock()) {
                return Ok(compute(live));
            }
            match timeout(LOADING_WAIT, self.load().wait()).await {
                Ok(Some(ended)) => ended?,
                Ok(None) => return Err(Error::Defect("loading a study panicked")),
                Err(_) => return Err(Error::Loading(self.study.clone())),
            }
        }
        Err(Error::Reloading(self.study.clone()))
    }

    /// Begins to load the tuner where it is not current.
    pub(super) fn begin_loading(self: &Arc<Self>) {
        if self.peek(|_| ()).is_none() {
            self.load();
        }
    }

    /// Reads the tuner, if there is a current one.
    pub(super) fn peek<T>(&self, look: impl FnOnce(&mut Live) -> T) -> Option<T> {
        current(&mut self.lock()).map(look)
    }

    /// A panic inside the tuner may have left it half changed: such a cache is dropped.
    fn lock(&self) -> MutexGuard<'_, Option<Live>> {
        self.live.lock().unwrap_or_else(|poisoned| {
            self.live.clear_poison();
            let mut live = PoisonError::into_inner(poisoned);
            *live = None;
            live
        })
    }

    /// The load that is under way, or a new one where the tuner is not current.
    fn load(self: &Arc<Self>) -> Arc<Ending> {
        let mut loading = self.loading.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(last) = loading.as_ref() {
            let is_under_way = last.ending.result.get().is_none();
            if is_under_way || current(&mut self.lock()).is_some() {
                return Arc::clone(&last.ending);
            }
        }
        let ending = Arc::new(Ending::default());
        let announcement = Announcement(Arc::clone(&ending));
        let (study, environment) = (self.study.clone(), Arc::clone(&self.environment));
        let runtime = Arc::downgrade(self);
        let task = tokio::spawn(async move {
            let (store, now_ms) = (&*environment.store, environment.clock.now_ms());
            let read = loading::load(store, &study, now_ms).await;
            let read = read.map(|read| keep(&runtime, read, &study));
            announcement.0.end(Some(read));
        });
        *loading = Some(Loading { ending: Arc::clone(&ending), task: task.abort_handle() });
        ending
    }
}

/// Makes the loaded tuner that of a study, if the study still has a place in memory.
fn keep(runtime: &Weak<Runtime>, read: Read, study: &str) {
    let Read { mut tuner, identity, fence, saved, earlier } = read;
    assert_eq!(fence.study(), study, "another study was read");
    let Some(runtime) = runtime.upgrade() else {
        return;
    };
    tuner.knowledge_mut().defer_updates();
    tuner.clients_mut().pardon_leases(back_since(runtime.environment.clock.now_ms()));
    let completed = tuner.statistics().completed_trials;
    debug_assert!(saved.completion <= completed, "{} of {completed} are saved", saved.completion);
    tracing::info!(study, completed, from_checkpoint = saved.completion, "study loaded");
    let metrics = Arc::clone(&runtime.environment.metrics);
    let (tally, planned_searches) = (FrameCounts::default(), PlannedSearches::default());
    *runtime.lock() = Some(Live {
        tuner,
        identity,
        fence,
        metrics,
        closed_changes: 0,
        saved,
        thinned: 0,
        planned_searches,
        tally,
        is_stale: false,
        earlier,
    });
}

fn current(live: &mut Option<Live>) -> Option<&mut Live> {
    live.as_mut().filter(|live| live.fence.holds() && !live.is_stale)
}
