//! The tuner of one study in memory: a cache of what the store holds.
//!
//! A use case locks it, computes, queues the change in the order of the computations, unlocks, and only
//! then waits for the disk. The lock is a plain one and is never held across an await. Whether the cache is
//! still worth anything is told by its [`Fence`]: once a write under it failed, the next use case loads
//! the study anew.

use std::sync::{Mutex, MutexGuard, PoisonError};

use treewright_core::tuner::{Change, Tuner};
use treewright_store::{Fence, Receipt, Store};

use super::checkpoints::Saved;
use super::figures::Tally;
use super::loading::{self, Read};
use super::thinking::Searched;
use crate::clock::Clock;
use crate::error::Error;
use crate::metrics::METRICS;

/// How often a study is loaded for one request, should its fence break at once each time.
const LOADS_PER_REQUEST: usize = 3;

/// The cache of one study.
#[derive(Debug, Default)]
pub(super) struct Runtime {
    live: Mutex<Option<Live>>,
    /// Lets one request load while the others wait for it. Not held by anyone who has a tuner.
    loading: tokio::sync::Mutex<()>,
}

/// A tuner and the right to store what it decides.
#[derive(Debug)]
pub(super) struct Live {
    pub(super) tuner: Tuner,
    fence: Fence,
    /// Rises with each change of a trial that was not open. Whoever read such a trial from the store can
    /// tell by it whether the trial may have changed since.
    pub(super) closed_changes: u64,
    /// The last checkpoint.
    pub(super) saved: Saved,
    /// The states whose search somebody plans for.
    pub(super) searched: Searched,
    /// For those who watch.
    pub(super) tally: Tally,
    /// Up to which completion there was a checkpoint when trials were last looked through for what can go.
    pub(super) thinned: u64,
    /// The tuner has to be read anew: its policy needs models that it lacks.
    pub(super) is_stale: bool,
}

impl Live {
    /// Queues what the tuner decided. Must be called under the lock under which it was decided.
    pub(super) fn commit(&mut self, store: &dyn Store, changes: &[Change]) -> Receipt {
        METRICS.decided(changes);
        self.tally.take(&self.tuner, changes);
        store.commit(&self.fence, changes)
    }

    /// Ends the leases that have run out, so that nothing is decided on their ground.
    pub(super) fn expire(&mut self, store: &dyn Store, now_ms: i64) {
        if self.tuner.next_expiry_ms().is_none_or(|next_ms| next_ms >= now_ms) {
            return;
        }
        let change = self.tuner.expire(now_ms);
        METRICS.expired(change.trials.len());
        for trial in &change.trials {
            tracing::info!(
                study = self.fence.study(),
                trial = trial.number,
                client = trial.client_id,
                "lease expired"
            );
        }
        if !change.is_empty() {
            // Whatever is queued later waits for it too; and should it fail, the fence breaks.
            drop(self.commit(store, &[change]));
        }
    }

    /// The fence, to tell one load of a study from the next.
    pub(super) fn fence(&self) -> &Fence {
        &self.fence
    }
}

impl Runtime {
    /// Computes on the tuner, loading it first where that is needed.
    pub(super) async fn with<T>(
        &self,
        store: &dyn Store,
        study: &str,
        clock: &dyn Clock,
        compute: impl FnOnce(&mut Live) -> T + Send,
    ) -> Result<T, Error> {
        for _ in 0..LOADS_PER_REQUEST {
            if let Some(live) = current(&mut self.lock()) {
                return Ok(compute(live));
            }
            self.load(store, study, clock).await?;
        }
        Err(Error::Reloading { study: study.to_owned() })
    }

    /// Looks at the tuner, if there is one and it is current.
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

    async fn load(&self, store: &dyn Store, study: &str, clock: &dyn Clock) -> Result<(), Error> {
        let _alone = self.loading.lock().await;
        if current(&mut self.lock()).is_some() {
            return Ok(());
        }
        let Read { mut tuner, fence, saved } = loading::load(store, study, clock.now_ms()).await?;
        tuner.defer_updates();
        let completed = tuner.statistics().completed_trials;
        tracing::info!(study, completed, from_checkpoint = saved.completion, "study loaded");
        let (tally, searched) = (Tally::default(), Searched::default());
        *self.lock() = Some(Live {
            tuner,
            fence,
            closed_changes: 0,
            saved,
            thinned: 0,
            searched,
            tally,
            is_stale: false,
        });
        Ok(())
    }
}

/// The tuner, if it is still current.
fn current(live: &mut Option<Live>) -> Option<&mut Live> {
    live.as_mut().filter(|live| live.fence.holds() && !live.is_stale)
}
