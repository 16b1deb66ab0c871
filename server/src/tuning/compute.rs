//! Threads for long computations, some of which yield to the threads that answer.

use std::sync::OnceLock;

use tokio::runtime::{Builder, Handle, Runtime, RuntimeFlavor};

use crate::error::{Error, Result};
use crate::limits::COMPUTING_NICENESS;

/// Runs learning and packing in another thread, so that other studies go on. A runtime of one thread runs
/// them itself, because simulated time must not depend on the speed of another thread.
pub(super) async fn compute<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    compute_on(&Handle::current(), work).await
}

/// Computes with a smaller share of busy processors: for fits and plans, without which an answer is worse but
/// not later. Otherwise many exploring clients would slow down all answers.
pub(super) async fn compute_aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    /// Never dropped: its threads end with the process. `None` where the system refuses it.
    static ASIDE: OnceLock<Option<Runtime>> = OnceLock::new();
    let aside =
        || Builder::new_current_thread().thread_name("computing").on_thread_start(give_way).build().ok();
    match ASIDE.get_or_init(aside) {
        Some(aside) => compute_on(aside.handle(), work).await,
        None => compute(work).await,
    }
}

async fn compute_on<T: Send + 'static>(
    threads: &Handle,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T> {
    match Handle::current().runtime_flavor() {
        RuntimeFlavor::CurrentThread => Ok(work()),
        _ => threads
            .spawn_blocking(work)
            .await
            .map_err(|_| Error::Defect("learning, planning or packing a study panicked")),
    }
}

/// Lowers the priority of the calling thread. On other systems than Linux this would lower that of the
/// process.
fn give_way() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(COMPUTING_NICENESS) {
        tracing::debug!(%error, "the system refuses to lower the priority of a thread");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(flavor = "multi_thread")]
    async fn only_what_is_computed_aside_gives_way() {
        let niceness = || rustix::process::nice(0).expect("a niceness");
        let own = niceness();
        assert_eq!(compute(niceness).await.expect("it ends"), own);
        let lowest = 19;
        assert_eq!(compute_aside(niceness).await.expect("it ends"), (own + COMPUTING_NICENESS).min(lowest));
    }
}
