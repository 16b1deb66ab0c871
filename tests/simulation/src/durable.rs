//! What outlives every machine: the stored studies, and who holds which.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use tokio::task::unconstrained;
use treewright_store::MemoryStore;

use crate::claims::Claims;

/// What outlives every machine.
#[derive(Default)]
pub(crate) struct Durable {
    /// What is on the disk.
    pub(crate) store: Arc<MemoryStore>,
    /// Who holds which study.
    pub(crate) claims: Claims,
    /// Up to which completion a checkpoint on the disk covers the trials.
    pub(crate) covered: AtomicU64,
}

/// The result of a future that never waits: those of the memory store. Not under the runtime's budget, by
/// which a task that has polled many futures in a row is made to wait for no other reason.
pub(crate) fn now<T>(future: impl Future<Output = T>) -> T {
    let mut future = std::pin::pin!(unconstrained(future));
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match future.as_mut().poll(&mut context) {
        std::task::Poll::Ready(value) => value,
        std::task::Poll::Pending => panic!("the memory store does not wait"),
    }
}
