//! What happens on a connection, and until when something must.

use std::sync::{Arc, Mutex, PoisonError};
use std::task::Context;

use tokio::time::Instant;

use super::slots::ConnectionSlot;
use crate::limits;

/// Bytes with which every HTTP/2 connection begins (RFC 9113, section 3.4).
const PREFACE_BYTES: u64 = 24;

/// What happens on a connection: shared by it and its requests.
#[derive(Debug)]
pub(crate) struct Activity {
    opened: Instant,
    slot: ConnectionSlot,
    state: Mutex<ActivityState>,
}

#[derive(Clone, Copy, Debug, Default)]
struct ActivityState {
    bytes: u64,
    under_way: usize,
    last: Option<Instant>,
    /// A request was authorised.
    is_known: bool,
}

/// A request or stream under way, until dropped.
#[derive(Debug)]
pub(crate) struct UnderWay {
    activity: Arc<Activity>,
}

impl Activity {
    pub(super) fn new(opened: Instant, slot: ConnectionSlot) -> Self {
        Self { opened, slot, state: Mutex::default() }
    }

    /// More bytes have come.
    pub(super) fn read(&self, bytes: u64) {
        self.with(|state| state.bytes += bytes);
    }

    /// Whether the connection has to make room for others.
    pub(super) fn has_to_go(&self, context: &Context<'_>) -> bool {
        self.slot.has_to_go(context)
    }

    /// A request on the connection was authorised: it has its slot for as long as it is used.
    pub(crate) fn settle(&self) {
        if !self.with(|state| std::mem::replace(&mut state.is_known, true)) {
            self.slot.settle();
        }
    }

    fn with<T>(&self, change: impl FnOnce(&mut ActivityState) -> T) -> T {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// A request begins.
    pub(crate) fn begin(self: &Arc<Self>) -> UnderWay {
        self.with(|state| state.under_way += 1);
        UnderWay { activity: Arc::clone(self) }
    }

    /// Until when something must happen.
    pub(super) fn deadline(&self) -> Instant {
        let state = self.with(|state| *state);
        match state.last {
            _ if state.under_way > 0 => Instant::now() + limits::IDLE,
            Some(last) if state.is_known => last + limits::IDLE,
            _ if state.bytes < PREFACE_BYTES => self.opened + limits::PREFACE,
            _ => self.opened + limits::FIRST_REQUEST,
        }
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.activity.with(|state| {
            state.under_way -= 1;
            state.last = Some(Instant::now());
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::slots::{ConnectionLimits, ConnectionSlots};
    use super::*;

    fn activity(opened: Instant) -> Arc<Activity> {
        let slot = ConnectionSlots::new(ConnectionLimits::default()).take(None).expect("room");
        Arc::new(Activity::new(opened, slot))
    }

    #[tokio::test(start_paused = true)]
    async fn a_connection_must_get_on() {
        let opened = Instant::now();
        let activity = activity(opened);
        assert_eq!(activity.deadline(), opened + limits::PREFACE);
        activity.read(PREFACE_BYTES);
        assert_eq!(activity.deadline(), opened + limits::FIRST_REQUEST);
        let (first, second) = (activity.begin(), activity.begin());
        activity.settle();
        tokio::time::advance(2 * limits::IDLE).await;
        drop(first);
        assert!(activity.deadline() > Instant::now(), "something is under way");
        drop(second);
        assert_eq!(activity.deadline(), Instant::now() + limits::IDLE);
        tokio::time::advance(limits::IDLE).await;
        assert!(activity.deadline() <= Instant::now());
    }

    #[tokio::test(start_paused = true)]
    async fn requests_that_were_not_authorised_win_no_time() {
        let opened = Instant::now();
        let activity = activity(opened);
        activity.read(PREFACE_BYTES);
        for _ in 0..3 {
            drop(activity.begin());
        }
        assert_eq!(activity.deadline(), opened + limits::FIRST_REQUEST);
        let _watching = activity.begin();
        assert!(activity.deadline() > opened + limits::FIRST_REQUEST, "an answer is under way");
    }
}
