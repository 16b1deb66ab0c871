//! One budget in bytes for all unfinished data: requests whose message is incomplete, and answers that their
//! client has not read.
//!
//! One connection is cheap, but thousands that hold back the end of a message, or do not read their answers,
//! are not. Unfinished bytes are counted by connection and by address. When they exceed the budget, the
//! address that holds most of them loses the connection on which no message was finished for longest: it is
//! closed, and its bytes are freed. A client that makes progress is not affected, and a closed one tries
//! again.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::slots::{ConnectionSlot, Notice, Origin};

/// The unfinished bytes of all connections. Clones share them.
#[derive(Clone, Debug)]
pub(crate) struct Unfinished {
    limit: usize,
    held: Arc<Mutex<Ledger>>,
}

#[derive(Debug, Default)]
struct Ledger {
    /// Without the bytes of dismissed connections.
    bytes: usize,
    by_origin: HashMap<Origin, usize>,
    by_connection: BTreeMap<u64, LedgerEntry>,
    /// Counts finished messages.
    finished: u64,
}

#[derive(Debug)]
struct LedgerEntry {
    origin: Origin,
    bytes: usize,
    /// The ledger's `finished` when a message was last finished here.
    since: u64,
    notice: Arc<Notice>,
    is_leaving: bool,
}

impl Unfinished {
    pub(crate) fn new(limit: usize) -> Self {
        Self { limit, held: Arc::default() }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.lock().bytes
    }

    fn lock(&self) -> MutexGuard<'_, Ledger> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn add(&self, slot: &ConnectionSlot, bytes: usize) {
        if bytes == 0 {
            return;
        }
        let mut held = self.lock();
        let since = held.finished;
        let one = held.by_connection.entry(slot.number()).or_insert_with(|| LedgerEntry {
            origin: slot.origin(),
            bytes: 0,
            since,
            notice: Arc::clone(slot.notice()),
            is_leaving: false,
        });
        one.bytes += bytes;
        if one.is_leaving {
            return;
        }
        held.bytes += bytes;
        *held.by_origin.entry(slot.origin()).or_default() += bytes;
        while held.bytes > self.limit && held.dismiss() {}
        debug_assert!(held.bytes <= self.limit, "{} unfinished bytes", held.bytes);
        held.check();
    }

    /// Counts `bytes` bytes of a connection as finished or given up.
    pub(super) fn remove(&self, slot: &ConnectionSlot, bytes: usize) {
        if bytes == 0 {
            return;
        }
        let mut held = self.lock();
        held.finished += 1;
        let finished = held.finished;
        let Some(one) = held.by_connection.get_mut(&slot.number()) else { return };
        debug_assert!(one.bytes >= bytes, "more is finished than was begun");
        one.bytes = one.bytes.saturating_sub(bytes);
        one.since = finished;
        let (is_over, was_leaving) = (one.bytes == 0, one.is_leaving);
        if is_over {
            held.by_connection.remove(&slot.number());
        }
        if !was_leaving {
            held.forget(slot.origin(), bytes);
        }
        held.check();
    }
}

impl Ledger {
    /// Dismisses one connection; false where there is none.
    fn dismiss(&mut self) -> bool {
        let heaviest = self.by_origin.iter().max_by_key(|(_, bytes)| **bytes).map(|(origin, _)| *origin);
        let there = self.by_connection.values_mut();
        let there = there.filter(|one| !one.is_leaving && Some(one.origin) == heaviest);
        let Some(one) = there.min_by_key(|one| one.since) else { return false };
        one.is_leaving = true;
        one.notice.give();
        let (origin, bytes) = (one.origin, one.bytes);
        debug_assert!(bytes > 0, "a connection leaves for nothing");
        self.forget(origin, bytes);
        true
    }

    fn forget(&mut self, origin: Origin, bytes: usize) {
        debug_assert!(self.bytes >= bytes, "{bytes} bytes of {} are given back", self.bytes);
        self.bytes = self.bytes.saturating_sub(bytes);
        if let Some(there) = self.by_origin.get_mut(&origin) {
            debug_assert!(*there >= bytes, "{bytes} bytes of {there} are given back");
            *there = there.saturating_sub(bytes);
            if *there == 0 {
                self.by_origin.remove(&origin);
            }
        }
    }

    /// Checks the state between two changes: finished data leaves no entry.
    fn check(&self) {
        let (places, connections) = (self.by_origin.len(), self.by_connection.len());
        debug_assert!(places <= connections, "{places} places for {connections} connections");
        debug_assert_eq!(places == 0, self.bytes == 0, "{} bytes of {places} places", self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;
    use std::task::{Context, Waker};

    use super::super::slots::{ConnectionLimits, ConnectionSlots};
    use super::*;

    async fn slot(slots: &ConnectionSlots, last: u8) -> ConnectionSlot {
        slots.take(Some(IpAddr::from([10, 0, 0, last])).into()).await.expect("room")
    }

    fn must_go(slot: &ConnectionSlot) -> bool {
        slot.notice().is_given(&Context::from_waker(Waker::noop()))
    }

    #[tokio::test]
    async fn the_address_that_holds_most_gives_way_with_what_stands_still_for_longest() {
        let slots = ConnectionSlots::new(ConnectionLimits::default());
        let unfinished = Unfinished::new(100);
        let (slow, moving, other) = (slot(&slots, 1).await, slot(&slots, 1).await, slot(&slots, 2).await);
        unfinished.add(&slow, 30);
        unfinished.add(&moving, 40);
        unfinished.add(&other, 30);
        unfinished.remove(&moving, 10);
        unfinished.add(&moving, 10);
        assert!(![&slow, &moving, &other].into_iter().any(must_go), "the budget is just used up");
        unfinished.add(&other, 1);
        assert!(must_go(&slow) && !must_go(&moving) && !must_go(&other));
        assert_eq!(unfinished.bytes(), 71);
        // Bytes of a dismissed connection do not count, and its end changes nothing.
        unfinished.add(&slow, 50);
        unfinished.remove(&slow, 80);
        assert_eq!(unfinished.bytes(), 71);
        unfinished.remove(&moving, 40);
        unfinished.remove(&other, 31);
        assert_eq!(unfinished.bytes(), 0);
        assert!(unfinished.lock().by_connection.is_empty() && unfinished.lock().by_origin.is_empty());
    }

    #[tokio::test]
    async fn one_that_holds_all_gives_way_itself() {
        let slots = ConnectionSlots::new(ConnectionLimits::default());
        let unfinished = Unfinished::new(100);
        let only = slot(&slots, 1).await;
        unfinished.add(&only, 101);
        assert!(must_go(&only));
        assert_eq!(unfinished.bytes(), 0);
    }
}
