//! The state that outlives every machine: the stored studies and their holders.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use tokio::task::unconstrained;
use treewright_store::MemoryStore;

use crate::claims::Claims;

/// The state that outlives every machine.
#[derive(Default)]
pub(crate) struct Durable {
    /// The contents of the disk.
    pub(crate) store: Arc<MemoryStore>,
    /// The holder of each study.
    pub(crate) claims: Claims,
    /// Up to which completion a checkpoint on the disk covers the trials.
    pub(crate) covered: AtomicU64,
}

/// The result of a future of the memory store, which never waits. It runs outside the runtime's budget, which
/// would make a task wait after many polls in a row.
pub(crate) fn now<T>(future: impl Future<Output = T>) -> T {
    let mut future = std::pin::pin!(unconstrained(future));
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match future.as_mut().poll(&mut context) {
        std::task::Poll::Ready(value) => value,
        std::task::Poll::Pending => panic!("the memory store does not wait"),
    }
}
