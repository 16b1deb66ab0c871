//! Fences and receipts: they keep a study's copy in memory consistent with the database.
//!
//! A daemon keeps each study's tuner in memory and writes its decisions. If a write fails, the copy is ahead
//! of the database, and no later change computed on it may be stored. So each load of a study hands out a
//! [`Fence`], and every change names its fence. The store breaks the fence at the first failure, at a newer
//! load, and when the study is deleted. It refuses changes under a broken fence. (The idea is that of the
//! fencing token for leases in distributed locks; see Kleppmann, "Designing Data-Intensive Applications",
//! chapter 8.)

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::oneshot;

use crate::error::{Result, StoreError};

/// The right to change one study, from its load until the fence breaks. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Fence(Arc<FenceState>);

#[derive(Debug)]
struct FenceState {
    study: String,
    key: i64,
    epoch: i64,
    broken: AtomicBool,
}

impl Fence {
    /// A fence that holds, for stores outside this crate. `key` finds the study in their tables.
    pub fn new(study: &str, key: i64) -> Self {
        Self::of_epoch(study, key, 0)
    }

    /// A fence with the epoch in the database, which a replica raises when it takes the study later.
    pub(crate) fn of_epoch(study: &str, key: i64, epoch: i64) -> Self {
        Self(Arc::new(FenceState { study: study.to_owned(), key, epoch, broken: AtomicBool::new(false) }))
    }

    /// The study's id.
    pub fn study(&self) -> &str {
        &self.0.study
    }

    pub(crate) fn key(&self) -> i64 {
        self.0.key
    }

    /// The study's epoch when it was loaded, in stores that several replicas share.
    pub(crate) fn epoch(&self) -> i64 {
        self.0.epoch
    }

    /// Whether the loaded copy is still current. Once false, it stays false: load again.
    pub fn holds(&self) -> bool {
        !self.0.broken.load(Ordering::Acquire)
    }

    /// Whether both come from one load.
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Ends the right to change the study under this fence.
    pub fn break_up(&self) {
        self.0.broken.store(true, Ordering::Release);
    }

    /// The error for a change that comes too late.
    pub(crate) fn check(&self) -> Result<()> {
        if self.holds() { Ok(()) } else { Err(StoreError::Fenced(self.study().to_owned())) }
    }
}

/// The promise of an answer from the disk: the change has its place in the order of writes, and
/// [`durable`](Receipt::durable) waits until it is stored.
#[derive(Debug)]
#[must_use = "a client may get no answer before the receipt is durable"]
pub struct Receipt(pub(crate) oneshot::Receiver<Result<()>>);

impl Receipt {
    /// A receipt for a change that was refused at once; the fence breaks. For stores outside this crate.
    pub fn refused(fence: &Fence, error: StoreError) -> Self {
        fence.break_up();
        Self::settled(Err(error.in_study(fence.study())))
    }

    /// A receipt for a waiting change, and the sender of its result. For stores outside this crate.
    pub fn pending() -> (oneshot::Sender<Result<()>>, Self) {
        let (sender, receiver) = oneshot::channel();
        (sender, Self(receiver))
    }

    /// A receipt for a change whose result is known.
    pub(crate) fn settled(result: Result<()>) -> Self {
        let (sender, receiver) = oneshot::channel();
        // The receiver is alive: it is returned.
        let _ = sender.send(result);
        Self(receiver)
    }

    /// Waits until the change, and every change before it, is on the disk.
    pub async fn durable(self) -> Result<()> {
        self.0.await.unwrap_or(Err(StoreError::Closed))
    }
}
