//! The holder of each study, as the shared database knows it and as the machines believe.
//!
//! The rules are those of the real database: a machine that crashes loses its claims at once, one that is
//! away loses them after [`REPLICA_LAPSE`], and no machine takes a study from one that is there. Each machine
//! remembers for a while the holder that it learnt.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::time::Instant;
use treewright_store::Fence;
use treewright_store::limits::OWNER_REMEMBERED;

/// A study that is held.
struct Claim {
    /// The durable store's fence.
    fence: Fence,
    replica: usize,
    /// Of the process that took it.
    alive: Arc<AtomicBool>,
}

/// The shared database's knowledge.
#[derive(Default)]
pub(crate) struct Claims(Mutex<HashMap<String, Claim>>);

/// Locks a mutex, also after a holder has panicked.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Claims {
    /// The machine that holds a study, where it is another one, lives, and is not among those whose claims
    /// have lapsed.
    pub(crate) fn other_holder(
        &self,
        study: &str,
        me: usize,
        has_lapsed: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        let claims = lock(&self.0);
        let claim = claims.get(study)?;
        let lives = claim.alive.load(Ordering::SeqCst) && !has_lapsed(claim.replica);
        (claim.replica != me && lives).then_some(claim.replica)
    }

    /// A machine takes a study.
    pub(crate) fn take(&self, study: &str, fence: Fence, replica: usize, alive: &Arc<AtomicBool>) {
        let claim = Claim { fence, replica, alive: Arc::clone(alive) };
        lock(&self.0).insert(study.to_owned(), claim);
    }

    /// The fence of the machine that took a study last.
    pub(crate) fn fence(&self, study: &str) -> Option<Fence> {
        lock(&self.0).get(study).map(|claim| claim.fence.clone())
    }
}

/// The holders of studies that one machine remembers.
#[derive(Default)]
pub(crate) struct Known(Mutex<HashMap<String, (usize, Instant)>>);

impl Known {
    pub(crate) fn holder(&self, study: &str) -> Option<usize> {
        let known = lock(&self.0);
        let (replica, since) = known.get(study)?;
        (since.elapsed() < OWNER_REMEMBERED).then_some(*replica)
    }

    pub(crate) fn remember(&self, study: &str, replica: usize) {
        lock(&self.0).insert(study.to_owned(), (replica, Instant::now()));
    }

    pub(crate) fn forget(&self, study: &str) {
        lock(&self.0).remove(study);
    }
}
