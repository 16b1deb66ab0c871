//! Admission control: the number of requests and streams in progress, and the refusal of new ones while
//! draining.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::error::{Error, Result};
use crate::limits;

/// Counts the requests and streams in progress, and takes none while draining. Clones share the counts.
#[derive(Clone, Debug)]
pub struct Admission {
    requests: Arc<Semaphore>,
    streams: Arc<Semaphore>,
    draining: Arc<watch::Sender<bool>>,
    limits: AdmissionLimits,
}

/// Most work at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdmissionLimits {
    /// Requests; a frame of a Tune stream counts as one.
    pub requests: usize,
    /// Tune streams.
    pub streams: usize,
}

impl Default for AdmissionLimits {
    fn default() -> Self {
        Self { requests: limits::REQUESTS_IN_FLIGHT, streams: limits::TUNE_STREAMS }
    }
}

/// A place among the requests or streams in progress, until dropped.
#[derive(Debug)]
pub struct Admitted {
    _permit: OwnedSemaphorePermit,
}

impl Default for Admission {
    fn default() -> Self {
        Self::new(AdmissionLimits::default())
    }
}

impl Admission {
    /// Admits work up to `limits` at once.
    pub fn new(limits: AdmissionLimits) -> Self {
        let can_be_waited_for = |limit: usize| limit > 0 && u32::try_from(limit).is_ok();
        assert!(can_be_waited_for(limits.requests) && can_be_waited_for(limits.streams), "{limits:?}");
        Self {
            requests: Arc::new(Semaphore::new(limits.requests)),
            streams: Arc::new(Semaphore::new(limits.streams)),
            draining: Arc::new(watch::Sender::new(false)),
            limits,
        }
    }

    /// Admits a request.
    pub fn request(&self) -> Result<Admitted> {
        self.enter(&self.requests, "requests", self.limits.requests)
    }

    /// Admits a Tune stream; each of its frames is a request of its own.
    pub fn stream(&self) -> Result<Admitted> {
        self.enter(&self.streams, "Tune streams", self.limits.streams)
    }

    fn enter(&self, semaphore: &Arc<Semaphore>, what: &'static str, limit: usize) -> Result<Admitted> {
        if self.is_draining() {
            return Err(Error::Draining);
        }
        match Arc::clone(semaphore).try_acquire_owned() {
            Ok(permit) => Ok(Admitted { _permit: permit }),
            Err(_) => Err(Error::Busy { what, limit }),
        }
    }

    /// Begins to drain: admitted requests finish, streams end after their present frame, and no new ones are
    /// taken.
    pub fn drain(&self) {
        self.draining.send_replace(true);
    }

    /// Whether the daemon is draining.
    pub fn is_draining(&self) -> bool {
        *self.draining.borrow()
    }

    /// The most work at once.
    pub fn limits(&self) -> AdmissionLimits {
        self.limits
    }

    /// Requests and streams in progress.
    pub fn in_progress(&self) -> (usize, usize) {
        let taken = |places: &Semaphore, limit: usize| {
            let free = places.available_permits();
            assert!(free <= limit, "{free} of {limit} places are free");
            limit - free
        };
        (taken(&self.requests, self.limits.requests), taken(&self.streams, self.limits.streams))
    }

    /// Waits until draining begins.
    pub async fn draining(&self) {
        // The sender lives in `self`, so that this cannot fail.
        let _ = self.draining.subscribe().wait_for(|draining| *draining).await;
    }

    /// Waits until nothing is in progress. Only ends for certain after [`drain`](Self::drain).
    pub async fn empty(&self) {
        for (semaphore, limit) in
            [(&self.requests, self.limits.requests), (&self.streams, self.limits.streams)]
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
    async fn what_is_admitted_is_counted_and_nothing_is_while_draining() {
        let admission = Admission::default();
        let inside: Vec<_> =
            (0..limits::REQUESTS_IN_FLIGHT).map(|_| admission.request().expect("room")).collect();
        assert!(matches!(admission.request(), Err(Error::Busy { .. })));
        let stream = admission.stream().expect("room");
        assert_eq!(admission.in_progress(), (limits::REQUESTS_IN_FLIGHT, 1));
        drop(inside);
        admission.request().expect("room again");

        assert!(!admission.is_draining());
        admission.drain();
        admission.draining().await;
        assert!(admission.is_draining());
        assert_eq!(admission.request().unwrap_err(), Error::Draining);
        assert_eq!(admission.stream().unwrap_err(), Error::Draining);
        drop(stream);
        admission.empty().await;
    }
}
