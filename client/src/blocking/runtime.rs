//! The thread behind the blocking client.

use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use tokio::runtime::{Builder, Handle};
use tokio::sync::oneshot;

use crate::core::Core;
use crate::locks::lock;
use crate::{ClientError, limits};

/// A thread that drives a tokio runtime until the last handle is gone and the outbox is empty.
#[derive(Debug)]
pub(crate) struct RuntimeThread {
    handle: Handle,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
    core: Arc<Mutex<Option<Arc<Core>>>>,
}

impl RuntimeThread {
    pub(crate) fn start() -> Result<Self, ClientError> {
        let no_runtime = |error: std::io::Error| ClientError::NoRuntime { reason: error.to_string() };
        let runtime = Builder::new_current_thread().enable_all().build().map_err(no_runtime)?;
        let handle = runtime.handle().clone();
        let (end, ended) = oneshot::channel();
        let core: Arc<Mutex<Option<Arc<Core>>>> = Arc::default();
        let to_flush = Arc::clone(&core);
        let drive = move || {
            runtime.block_on(async {
                // An error means that the sender is gone, which also ends the thread.
                let _ = ended.await;
                let core = lock(&to_flush).take();
                if let Some(core) = core
                    && let Err(problem) = core.flush(limits::FLUSH_ON_DROP).await
                {
                    tracing::warn!(%problem, "reports are lost");
                }
            });
            runtime.shutdown_background();
        };
        let thread =
            std::thread::Builder::new().name("treewright-client".into()).spawn(drive).map_err(no_runtime)?;
        Ok(Self { handle, end: Some(end), thread: Some(thread), core })
    }

    /// Names whose outbox is to be emptied at the end.
    pub(crate) fn flush_at_the_end(&self, client: &crate::Client) {
        *lock(&self.core) = Some(Arc::clone(&client.core));
    }

    /// Runs a future on the caller's thread, while the runtime's thread drives timers and sockets.
    ///
    /// Works inside another runtime, too, where it blocks that thread like any blocking call.
    pub(crate) fn run<F: AsyncFnOnce() -> T, T>(&self, work: F) -> T {
        let _inside = self.handle.enter();
        pollster::block_on(work())
    }
}

impl Drop for RuntimeThread {
    fn drop(&mut self) {
        if let Some(end) = self.end.take() {
            // An error means that the thread has ended already.
            let _ = end.send(());
        }
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the client's thread panicked");
        }
    }
}
