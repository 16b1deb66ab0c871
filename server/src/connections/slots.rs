//! How many connections there may be, and who has to leave when there are too many.
//!
//! A connection is a *newcomer* until a request on it was authorised. Newcomers have a share of the slots and no more:
//! when it is used up, the one that has been a newcomer for longest is closed to make room. So whoever opens
//! connections without a token, however many, shuts nobody out who has one: a client only has to send its first
//! request before its turn to leave comes. Each address has a limit of its own besides.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Waker};

use crate::limits;

/// How many connections there may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// In all.
    pub total: usize,
    /// On which no request was authorised yet.
    pub newcomers: usize,
    /// From one address.
    pub per_address: usize,
}

impl ConnectionLimits {
    /// So many in all, of which half may be newcomers.
    #[must_use]
    pub fn new(total: usize, per_address: usize) -> Self {
        Self { total, newcomers: (total / 2).max(1), per_address }
    }
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self::new(limits::CONNECTIONS, limits::CONNECTIONS_PER_ADDRESS)
    }
}

/// The slots of all connections. Clones share them.
#[derive(Clone, Debug)]
pub(crate) struct ConnectionSlots {
    limits: ConnectionLimits,
    taken: Arc<Mutex<OpenConnections>>,
}

#[derive(Debug, Default)]
struct OpenConnections {
    open: usize,
    by_address: HashMap<IpAddr, usize>,
    /// The newcomers in the order in which they came.
    newcomers: BTreeMap<u64, Arc<Notice>>,
    last_number: u64,
}

/// The slot of one connection, until dropped.
#[derive(Debug)]
pub(super) struct ConnectionSlot {
    slots: ConnectionSlots,
    number: u64,
    address: Option<IpAddr>,
    notice: Arc<Notice>,
}

/// Tells a connection that it has to go.
#[derive(Debug, Default)]
struct Notice(Mutex<(bool, Option<Waker>)>);

impl ConnectionSlots {
    pub(crate) fn new(limits: ConnectionLimits) -> Self {
        Self { limits, taken: Arc::default() }
    }

    fn lock(&self) -> MutexGuard<'_, OpenConnections> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A slot for a connection from `address`, which is none for local sockets.
    ///
    /// # Errors
    /// Which limit is reached, in one word for counting.
    pub(super) fn take(&self, address: Option<IpAddr>) -> Result<ConnectionSlot, &'static str> {
        let mut taken = self.lock();
        let from_there = address.and_then(|address| taken.by_address.get(&address));
        if from_there.is_some_and(|count| *count >= self.limits.per_address) {
            return Err("address");
        }
        if taken.newcomers.len() >= self.limits.newcomers || taken.open >= self.limits.total {
            // Its slot becomes free a moment later, when its task has seen the notice.
            let oldest = taken.newcomers.pop_first();
            oldest.ok_or("limit")?.1.give();
        }
        if taken.open >= self.limits.total + limits::CONNECTIONS_LEAVING {
            return Err("limit");
        }
        taken.open += 1;
        taken.last_number += 1;
        if let Some(address) = address {
            *taken.by_address.entry(address).or_default() += 1;
        }
        let (number, notice) = (taken.last_number, Arc::<Notice>::default());
        taken.newcomers.insert(number, Arc::clone(&notice));
        Ok(ConnectionSlot { slots: self.clone(), number, address, notice })
    }

    /// Connections that are open, and those of them that are newcomers.
    pub(crate) fn counts(&self) -> (usize, usize) {
        let taken = self.lock();
        (taken.open, taken.newcomers.len())
    }
}

impl ConnectionSlot {
    /// A request on the connection was authorised.
    pub(super) fn settle(&self) {
        self.slots.lock().newcomers.remove(&self.number);
    }

    /// Whether the connection has to go; otherwise its task is woken as soon as it has to.
    pub(super) fn has_to_go(&self, context: &Context<'_>) -> bool {
        let mut notice = self.notice.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (is_given, waker) = &mut *notice;
        if !waker.as_ref().is_some_and(|waker| waker.will_wake(context.waker())) {
            *waker = Some(context.waker().clone());
        }
        *is_given
    }
}

impl Drop for ConnectionSlot {
    fn drop(&mut self) {
        let mut taken = self.slots.lock();
        taken.open -= 1;
        taken.newcomers.remove(&self.number);
        if let Some(address) = self.address
            && let Some(count) = taken.by_address.get_mut(&address)
        {
            *count -= 1;
            if *count == 0 {
                taken.by_address.remove(&address);
            }
        }
    }
}

impl Notice {
    fn give(&self) {
        let mut notice = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        notice.0 = true;
        if let Some(waker) = notice.1.take() {
            waker.wake();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Option<IpAddr> = Some(IpAddr::V4(std::net::Ipv4Addr::LOCALHOST));
    const THERE: Option<IpAddr> = Some(IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 7)));

    fn must_go(slot: &ConnectionSlot) -> bool {
        slot.has_to_go(&Context::from_waker(Waker::noop()))
    }

    #[test]
    fn the_oldest_newcomer_makes_room_and_who_is_known_stays() {
        let slots = ConnectionSlots::new(ConnectionLimits { total: 4, newcomers: 2, per_address: 9 });
        let known = slots.take(HERE).expect("room");
        known.settle();
        let first = slots.take(HERE).expect("room");
        let second = slots.take(HERE).expect("room");
        assert_eq!(slots.counts(), (3, 2));
        let third = slots.take(HERE).expect("the first makes room");
        assert!(must_go(&first) && !must_go(&second) && !must_go(&third) && !must_go(&known));
        drop(first);
        assert_eq!(slots.counts(), (3, 2));
        second.settle();
        third.settle();
        let fourth = slots.take(HERE).expect("a slot is left");
        fourth.settle();
        assert_eq!(slots.take(HERE).expect_err("all are taken by known ones"), "limit");
        assert!(!must_go(&known));
    }

    #[test]
    fn an_address_has_a_limit_of_its_own() {
        let slots = ConnectionSlots::new(ConnectionLimits { total: 9, newcomers: 9, per_address: 2 });
        let (one, _two) = (slots.take(HERE).expect("room"), slots.take(HERE).expect("room"));
        assert_eq!(slots.take(HERE).expect_err("a third"), "address");
        slots.take(THERE).expect("another address");
        slots.take(None).expect("a local socket");
        drop(one);
        slots.take(HERE).expect("room again");
        assert_eq!(slots.counts().0, 1);
    }

    #[test]
    fn who_makes_room_and_does_not_leave_keeps_others_out_at_some_point() {
        let slots = ConnectionSlots::new(ConnectionLimits { total: 1, newcomers: 1, per_address: 10_000 });
        let open: Vec<_> = std::iter::from_fn(|| slots.take(HERE).ok()).take(10_000).collect();
        assert_eq!(open.len(), 1 + limits::CONNECTIONS_LEAVING);
    }
}
