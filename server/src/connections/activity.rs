//! Activity on a connection, and the time limits for it.

use std::sync::{Arc, Mutex, PoisonError};
use std::task::Context;

use tokio::time::Instant;

use super::slots::ConnectionSlot;
use super::unfinished::Unfinished;
use crate::limits;

/// Bytes with which every HTTP/2 connection begins (RFC 9113, section 3.4).
const PREFACE_BYTES: u64 = 24;

/// Activity on a connection, shared by it and its requests.
#[derive(Debug)]
pub(crate) struct Activity {
    opened: Instant,
    slot: ConnectionSlot,
    unfinished: Unfinished,
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

/// Unfinished bytes of a request or an answer, until dropped.
#[derive(Debug)]
pub(crate) struct HeldBytes {
    activity: Arc<Activity>,
    bytes: usize,
}

impl Activity {
    pub(super) fn new(opened: Instant, slot: ConnectionSlot, unfinished: Unfinished) -> Self {
        Self { opened, slot, unfinished, state: Mutex::default() }
    }

    pub(super) fn read(&self, bytes: u64) {
        self.with(|state| state.bytes += bytes);
    }

    pub(super) fn has_to_go(&self, context: &Context<'_>) -> bool {
        self.slot.notice().is_given(context)
    }

    /// Ends when the connection has to make room for others.
    pub(super) async fn dismissed(&self) {
        self.slot.dismissed().await;
    }

    pub(crate) fn hold(self: &Arc<Self>, bytes: usize) -> HeldBytes {
        self.unfinished.add(&self.slot, bytes);
        HeldBytes { activity: Arc::clone(self), bytes }
    }

    /// A request on the connection was authorised: the connection keeps its slot while it is in use.
    pub(crate) fn settle(&self) {
        if !self.with(|state| std::mem::replace(&mut state.is_known, true)) {
            self.slot.settle();
        }
    }

    fn with<T>(&self, change: impl FnOnce(&mut ActivityState) -> T) -> T {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn begin(self: &Arc<Self>) -> UnderWay {
        self.with(|state| {
            state.under_way += 1;
            self.slot.used(true);
        });
        UnderWay { activity: Arc::clone(self) }
    }

    /// The time until which the client must act.
    pub(super) fn deadline(&self) -> Instant {
        let state = self.with(|state| *state);
        debug_assert!(state.last.is_none_or(|last| last >= self.opened), "it was used before it was opened");
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
        let activity = &self.activity;
        activity.with(|state| {
            debug_assert!(state.under_way > 0, "a request ends twice");
            state.under_way -= 1;
            state.last = Some(Instant::now());
            // Under the lock, so that a busy connection is never marked as idle.
            activity.slot.used(state.under_way > 0);
        });
    }
}

impl HeldBytes {
    pub(crate) fn set(&mut self, bytes: usize) {
        let before = std::mem::replace(&mut self.bytes, bytes);
        let (unfinished, slot) = (&self.activity.unfinished, &self.activity.slot);
        unfinished.add(slot, bytes.saturating_sub(before));
        unfinished.remove(slot, before.saturating_sub(bytes));
    }
}

impl Drop for HeldBytes {
    fn drop(&mut self) {
        self.set(0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::slots::{ConnectionLimits, ConnectionSlots};
    use super::*;

    async fn activity(opened: Instant) -> Arc<Activity> {
        let slots = ConnectionSlots::new(ConnectionLimits::default());
        let slot = slots.take(None.into()).await.expect("room");
        Arc::new(Activity::new(opened, slot, Unfinished::new(100)))
    }

    #[tokio::test(start_paused = true)]
    async fn a_connection_must_get_on() {
        let opened = Instant::now();
        let activity = activity(opened).await;
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

    #[tokio::test]
    async fn what_is_held_counts_until_it_is_dropped() {
        let activity = activity(Instant::now()).await;
        let mut held = activity.hold(40);
        held.set(70);
        let more = activity.hold(10);
        held.set(20);
        assert_eq!(activity.unfinished.bytes(), 30);
        drop((held, more));
        assert_eq!(activity.unfinished.bytes(), 0);
        let _all = activity.hold(101);
        activity.dismissed().await;
    }

    #[tokio::test(start_paused = true)]
    async fn requests_that_were_not_authorised_win_no_time() {
        let opened = Instant::now();
        let activity = activity(opened).await;
        activity.read(PREFACE_BYTES);
        for _ in 0..3 {
            drop(activity.begin());
        }
        assert_eq!(activity.deadline(), opened + limits::FIRST_REQUEST);
        let _watching = activity.begin();
        assert!(activity.deadline() > opened + limits::FIRST_REQUEST, "an answer is under way");
    }
}
