//! The gate that every request passes: how many are inside, and whether it is closing.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::error::Error;
use crate::limits;

/// Counts requests and streams, and lets none in while draining.
#[derive(Clone, Debug)]
pub struct Gate {
    requests: Arc<Semaphore>,
    streams: Arc<Semaphore>,
    draining: Arc<watch::Sender<bool>>,
}

/// Inside, until dropped.
#[derive(Debug)]
pub struct Entered {
    _permit: OwnedSemaphorePermit,
}

impl Default for Gate {
    fn default() -> Self {
        Self {
            requests: Arc::new(Semaphore::new(limits::REQUESTS_IN_FLIGHT)),
            streams: Arc::new(Semaphore::new(limits::TUNE_STREAMS)),
            draining: Arc::new(watch::Sender::new(false)),
        }
    }
}

impl Gate {
    /// Lets a request in.
    ///
    /// # Errors
    /// [`Error::Draining`] and [`Error::Busy`].
    pub fn request(&self) -> Result<Entered, Error> {
        self.enter(&self.requests, "requests", limits::REQUESTS_IN_FLIGHT)
    }

    /// Lets a Tune stream in; each of its frames is a request of its own.
    ///
    /// # Errors
    /// [`Error::Draining`] and [`Error::Busy`].
    pub fn stream(&self) -> Result<Entered, Error> {
        self.enter(&self.streams, "Tune streams", limits::TUNE_STREAMS)
    }

    fn enter(&self, semaphore: &Arc<Semaphore>, what: &'static str, limit: usize) -> Result<Entered, Error> {
        if self.is_draining() {
            return Err(Error::Draining);
        }
        match Arc::clone(semaphore).try_acquire_owned() {
            Ok(permit) => Ok(Entered { _permit: permit }),
            Err(_) => Err(Error::Busy { what, limit }),
        }
    }

    /// Closes the gate: those inside finish, streams end after the frame they are at.
    pub fn drain(&self) {
        self.draining.send_replace(true);
    }

    /// Whether the gate is closed.
    #[must_use]
    pub fn is_draining(&self) -> bool {
        *self.draining.borrow()
    }

    /// Requests and streams that are inside.
    #[must_use]
    pub fn inside(&self) -> (usize, usize) {
        let requests = limits::REQUESTS_IN_FLIGHT.saturating_sub(self.requests.available_permits());
        (requests, limits::TUNE_STREAMS.saturating_sub(self.streams.available_permits()))
    }

    /// Waits until the gate closes.
    pub async fn draining(&self) {
        // The sender lives in `self`, so that this cannot fail.
        let _ = self.draining.subscribe().wait_for(|draining| *draining).await;
    }

    /// Waits until nobody is inside. Only ends for certain after [`drain`](Self::drain).
    pub async fn empty(&self) {
        for (semaphore, limit) in
            [(&self.requests, limits::REQUESTS_IN_FLIGHT), (&self.streams, limits::TUNE_STREAMS)]
        {
            // The semaphores are never closed; their limits are far below 2^32.
            let _ = semaphore.acquire_many(u32::try_from(limit).unwrap_or(u32::MAX)).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_gate_counts_and_closes() {
        let gate = Gate::default();
        let inside: Vec<_> = (0..limits::REQUESTS_IN_FLIGHT).map(|_| gate.request().expect("room")).collect();
        assert!(matches!(gate.request(), Err(Error::Busy { .. })));
        let stream = gate.stream().expect("room");
        assert_eq!(gate.inside(), (limits::REQUESTS_IN_FLIGHT, 1));
        drop(inside);
        gate.request().expect("room again");

        assert!(!gate.is_draining());
        gate.drain();
        gate.draining().await;
        assert!(gate.is_draining());
        assert_eq!(gate.request().unwrap_err(), Error::Draining);
        assert_eq!(gate.stream().unwrap_err(), Error::Draining);
        drop(stream);
        gate.empty().await;
    }
}
