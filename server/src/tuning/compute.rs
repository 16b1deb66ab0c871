//! Where long computations run.

use tokio::runtime::{Handle, RuntimeFlavor};

use crate::error::Error;

/// Learning and packing take a while, in which other studies go on. A runtime of one thread has no other place for it, and one that
/// simulates time must not depend on how fast another thread is.
pub(super) async fn compute<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Error> {
    match Handle::current().runtime_flavor() {
        RuntimeFlavor::CurrentThread => Ok(work()),
        _ => tokio::task::spawn_blocking(work)
            .await
            .map_err(|_| Error::Defect("rebuilding or packing a study panicked")),
    }
}
