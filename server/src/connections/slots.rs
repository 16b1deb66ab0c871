//! Limits of the number of connections, and the choice of the one that leaves when there are too many.
//!
//! A connection is a *newcomer* until a request on it was authorised. Newcomers may only have a share of the
//! slots. Within the limit of its address, no connection is refused while another can be dismissed. The
//! oldest newcomer of the address with the most newcomers leaves. Without newcomers it is the longest unused
//! connection of the address with the most connections. At that limit one of the address itself has to leave,
//! by these rules. So any number of connections without a token shuts out no client of another address that
//! has one. A client has to send its first request before it is dismissed, and a dismissed idle client
//! connects again with its next request. Connections with a request under way stay. A new connection waits
//! until the other has left, so that the limit is never exceeded.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::future::poll_fn;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use tokio::sync::Notify;
use tokio::time::timeout;

use crate::limits;

/// Limits of the number of connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// In all.
    pub total: usize,
    /// Connections without an authorised request.
    pub newcomers: usize,
    /// Connections from one address, or from one IPv6 network of 64 bits.
    pub per_address: usize,
}

impl ConnectionLimits {
    /// At most `total` connections, of which half may be newcomers.
    pub fn new(total: usize, per_address: usize) -> Self {
        Self { total, newcomers: (total / 2).max(1), per_address }
    }
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self::new(limits::CONNECTIONS, limits::CONNECTIONS / 2)
    }
}

/// The origin of a connection: an address, or none for local sockets. For IPv6 it is the network, because one
/// machine can use all its addresses (RFC 4291, section 2.5.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Origin(Option<IpAddr>);

impl From<Option<IpAddr>> for Origin {
    fn from(address: Option<IpAddr>) -> Self {
        Self(address.map(|address| match address.to_canonical() {
            IpAddr::V6(long) => Ipv6Addr::from_bits(long.to_bits() >> 64 << 64).into(),
            short => short,
        }))
    }
}

/// The slots of all connections. Clones share them.
#[derive(Clone, Debug)]
pub(crate) struct ConnectionSlots {
    limits: ConnectionLimits,
    taken: Arc<Mutex<OpenConnections>>,
    left: Arc<Notify>,
}

#[derive(Debug, Default)]
struct OpenConnections {
    /// Connections by number, which is the order in which they came.
    open: BTreeMap<u64, OpenConnection>,
    crowds: HashMap<Origin, Crowd>,
    newcomers: usize,
    /// The number of dismissed connections that have not closed yet.
    leaving: usize,
    last_number: u64,
}

#[derive(Debug)]
struct OpenConnection {
    origin: Origin,
    notice: Arc<Notice>,
    is_leaving: bool,
}

#[derive(Debug, Default)]
struct Crowd {
    open: usize,
    leaving: usize,
    /// In the order in which they came.
    newcomers: BTreeSet<u64>,
}

/// The slot of one connection, until dropped.
#[derive(Debug)]
pub(crate) struct ConnectionSlot {
    slots: ConnectionSlots,
    number: u64,
    origin: Origin,
    notice: Arc<Notice>,
}

/// Dismisses a connection, and notes when it is used.
#[derive(Debug, Default)]
pub(super) struct Notice {
    state: Mutex<(bool, Option<Waker>)>,
    /// The number of the last use; [`BUSY`] while a request is under way.
    last_use: AtomicU64,
}

/// Marks a connection with a request under way.
const BUSY: u64 = u64::MAX;

/// Counts uses of connections, so that they can be put in order without a clock.
static USES: AtomicU64 = AtomicU64::new(0);

impl ConnectionSlots {
    pub(crate) fn new(limits: ConnectionLimits) -> Self {
        assert!((1..=limits.total).contains(&limits.newcomers), "nobody could come in: {limits:?}");
        assert!(limits.per_address > 0, "nobody could come in from an address: {limits:?}");
        Self { limits, taken: Arc::default(), left: Arc::default() }
    }

    fn lock(&self) -> MutexGuard<'_, OpenConnections> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A slot for a connection from an origin, once another has made room for it; or the reached limit, in
    /// one word for counting.
    pub(super) async fn take(&self, origin: Origin) -> Result<ConnectionSlot, &'static str> {
        let taking = async {
            loop {
                // Registered first, so that no leaving connection is missed.
                let left = self.left.notified();
                if let Some(slot) = self.try_take(origin)? {
                    return Ok(slot);
                }
                left.await;
            }
        };
        timeout(limits::LEAVING, taking).await.unwrap_or(Err("limit"))
    }

    /// `None` while a dismissed connection has not left.
    fn try_take(&self, origin: Origin) -> Result<Option<ConnectionSlot>, &'static str> {
        let mut taken = self.lock();
        let from_there = taken.crowds.get(&origin).map_or(0, |crowd| crowd.open - crowd.leaving);
        if origin.0.is_some() && from_there >= self.limits.per_address && !taken.dismiss(Some(origin)) {
            return Err("address");
        }
        // Where an idle one of the address has left, there may still be too many newcomers.
        let staying = taken.open.len() - taken.leaving;
        let is_full = staying >= self.limits.total || taken.newcomers >= self.limits.newcomers;
        if is_full && !taken.dismiss(None) {
            return Err("limit");
        }
        if taken.open.len() >= self.limits.total {
            return Ok(None);
        }
        taken.last_number += 1;
        let (number, notice) = (taken.last_number, Arc::<Notice>::default());
        let last = taken.open.last_key_value().map_or(0, |(last, _)| *last);
        assert!(last < number, "connection {number} comes after {last}");
        let crowd = taken.crowds.entry(origin).or_default();
        crowd.open += 1;
        crowd.newcomers.insert(number);
        let from_there = crowd.open - crowd.leaving;
        assert!(origin.0.is_none() || from_there <= self.limits.per_address, "{from_there} of one address");
        taken.newcomers += 1;
        taken.open.insert(number, OpenConnection { origin, notice: Arc::clone(&notice), is_leaving: false });
        assert!(taken.open.len() <= self.limits.total, "{} connections", taken.open.len());
        assert!(taken.newcomers <= self.limits.newcomers, "{} newcomers", taken.newcomers);
        taken.check();
        Ok(Some(ConnectionSlot { slots: self.clone(), number, origin, notice }))
    }

    pub(crate) fn limit(&self) -> usize {
        self.limits.total
    }

    pub(crate) fn counts(&self) -> (usize, usize) {
        let taken = self.lock();
        (taken.open.len(), taken.newcomers)
    }
}

impl OpenConnections {
    /// Dismisses one, from an origin or from any; false where none can leave.
    fn dismiss(&mut self, of: Option<Origin>) -> bool {
        let Some(number) = self.first_newcomer(of).or_else(|| self.longest_idle(of)) else { return false };
        let Some(one) = self.open.get_mut(&number) else { return false };
        assert!(!one.is_leaving, "connection {number} is dismissed twice");
        assert!(of.is_none_or(|of| one.origin == of), "connection {number} comes from elsewhere");
        one.is_leaving = true;
        one.notice.give();
        let origin = one.origin;
        self.leaving += 1;
        if let Some(crowd) = self.crowds.get_mut(&origin) {
            crowd.leaving += 1;
        }
        self.settle(number, origin);
        self.check();
        true
    }

    /// Checks the state between two changes. A dismissed connection is no newcomer any more.
    fn check(&self) {
        let (open, newcomers, leaving) = (self.open.len(), self.newcomers, self.leaving);
        debug_assert!(newcomers <= open, "{newcomers} of {open}");
        debug_assert!(leaving <= open - newcomers, "{newcomers} and {leaving} of {open}");
        debug_assert!(self.crowds.len() <= open, "{} places for {open} connections", self.crowds.len());
        debug_assert_eq!(self.crowds.is_empty(), self.open.is_empty());
    }

    /// The oldest newcomer of an origin, or of the address with the most newcomers.
    fn first_newcomer(&self, of: Option<Origin>) -> Option<u64> {
        let crowd = match of {
            Some(origin) => self.crowds.get(&origin),
            None => self.crowds.values().max_by_key(|crowd| crowd.newcomers.len()),
        };
        crowd?.newcomers.first().copied()
    }

    /// The longest unused known connection of an origin, or of the address with the most connections among
    /// those with an idle one.
    fn longest_idle(&self, of: Option<Origin>) -> Option<u64> {
        let there = self.open.iter().filter(|(_, one)| of.is_none_or(|of| one.origin == of));
        let idle = there.filter_map(|(number, one)| {
            let last_use = one.notice.last_use.load(Ordering::Relaxed);
            let is_idle = !one.is_leaving && last_use != BUSY;
            let crowd = || self.crowds.get(&one.origin).map_or(0, |crowd| crowd.open - crowd.leaving);
            is_idle.then(|| (Reverse(crowd()), last_use, *number))
        });
        idle.min().map(|(.., number)| number)
    }

    /// Takes one from the newcomers, if it is one.
    fn settle(&mut self, number: u64, origin: Origin) {
        let was = self.crowds.get_mut(&origin).is_some_and(|crowd| crowd.newcomers.remove(&number));
        debug_assert!(self.newcomers >= usize::from(was), "{number} is a newcomer and not counted as one");
        self.newcomers -= usize::from(was);
    }
}

impl ConnectionSlot {
    pub(super) fn origin(&self) -> Origin {
        self.origin
    }

    pub(super) fn notice(&self) -> &Arc<Notice> {
        &self.notice
    }

    /// Its number, in the order in which connections came.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// A request on the connection was authorised.
    pub(crate) fn settle(&self) {
        self.slots.lock().settle(self.number, self.origin);
    }

    /// Notes whether a request is under way on the connection.
    pub(super) fn used(&self, is_busy: bool) {
        let now = if is_busy { BUSY } else { USES.fetch_add(1, Ordering::Relaxed) };
        self.notice.last_use.store(now, Ordering::Relaxed);
    }

    /// Ends when the connection has to make room for others.
    pub(super) async fn dismissed(&self) {
        let given = |context: &mut Context<'_>| self.notice.is_given(context);
        poll_fn(|context| if given(context) { Poll::Ready(()) } else { Poll::Pending }).await;
    }
}

impl Drop for ConnectionSlot {
    fn drop(&mut self) {
        let mut taken = self.slots.lock();
        taken.settle(self.number, self.origin);
        let one = taken.open.remove(&self.number);
        debug_assert!(one.is_some(), "connection {} ends twice", self.number);
        let was_leaving = one.is_some_and(|one| one.is_leaving);
        taken.leaving -= usize::from(was_leaving);
        if let Some(crowd) = taken.crowds.get_mut(&self.origin) {
            debug_assert!(crowd.open > 0 && crowd.leaving >= usize::from(was_leaving), "{crowd:?}");
            crowd.open -= 1;
            crowd.leaving -= usize::from(was_leaving);
            if crowd.open == 0 {
                taken.crowds.remove(&self.origin);
            }
        }
        taken.check();
        drop(taken);
        self.slots.left.notify_waiters();
    }
}

impl Notice {
    pub(super) fn give(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.0 = true;
        if let Some(waker) = state.1.take() {
            waker.wake();
        }
    }

    /// Whether the connection has to go; otherwise its task is woken as soon as it has to.
    pub(super) fn is_given(&self, context: &Context<'_>) -> bool {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let (is_given, waker) = &mut *state;
        if !waker.as_ref().is_some_and(|waker| waker.will_wake(context.waker())) {
            *waker = Some(context.waker().clone());
        }
        *is_given
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(last: u8) -> Origin {
        Some(IpAddr::from([10, 0, 0, last])).into()
    }

    fn must_go(slot: &ConnectionSlot) -> bool {
        slot.notice.is_given(&Context::from_waker(Waker::noop()))
    }

    fn slots(total: usize, newcomers: usize, per_address: usize) -> ConnectionSlots {
        ConnectionSlots::new(ConnectionLimits { newcomers, ..ConnectionLimits::new(total, per_address) })
    }

    /// A slot that there is room for at once.
    fn room(slots: &ConnectionSlots, origin: Origin) -> ConnectionSlot {
        slots.try_take(origin).expect("within the limits").expect("room")
    }

    fn busy(slots: &ConnectionSlots, origin: Origin) -> ConnectionSlot {
        let slot = room(slots, origin);
        slot.settle();
        slot.used(true);
        slot
    }

    #[test]
    fn the_oldest_newcomer_makes_room_and_who_is_at_work_stays() {
        let slots = slots(4, 2, 9);
        let known = busy(&slots, from(1));
        let first = room(&slots, from(1));
        let second = room(&slots, from(1));
        assert_eq!(slots.counts(), (3, 2));
        let third = room(&slots, from(1));
        assert!(must_go(&first) && !must_go(&second) && !must_go(&third) && !must_go(&known));
        drop(first);
        assert_eq!(slots.counts(), (3, 2));
        for slot in [&second, &third] {
            slot.settle();
            slot.used(true);
        }
        let _fourth = busy(&slots, from(1));
        assert_eq!(slots.try_take(from(1)).expect_err("all are at work"), "limit");
        assert!(!must_go(&known));
        // The longest unused connection goes, and comes again with its next request.
        for slot in [&third, &known] {
            slot.used(false);
        }
        assert!(slots.try_take(from(1)).expect("an idle one makes room").is_none());
        assert!(must_go(&third) && !must_go(&known));
        drop(third);
        room(&slots, from(1));
    }

    #[test]
    fn the_address_with_most_makes_room_for_another() {
        let slots = slots(12, 10, 100);
        let stranger = room(&slots, from(2));
        let mut flood: Vec<_> = (0..9).map(|_| room(&slots, from(1))).collect();
        let next = room(&slots, from(3));
        assert!(must_go(&flood[0]) && !must_go(&flood[1]));
        assert!(!must_go(&stranger) && !must_go(&next), "those who are few stay");
        // The rule also holds among known idle connections.
        drop(flood.remove(0));
        for slot in flood.iter().rev().chain([&stranger, &next]) {
            slot.settle();
            slot.used(false);
        }
        let _others = [busy(&slots, from(4)), busy(&slots, from(5))];
        assert!(slots.try_take(from(6)).expect("one makes room").is_none());
        assert!(must_go(&flood[7]) && !must_go(&stranger) && !must_go(&next));
    }

    #[test]
    fn where_the_largest_crowd_is_at_work_the_largest_with_an_idle_one_makes_room() {
        let slots = slots(8, 8, 100);
        let _farm: Vec<_> = (0..5).map(|_| busy(&slots, from(1))).collect();
        let idle = |last| {
            let slot = room(&slots, from(last));
            slot.settle();
            slot.used(false);
            slot
        };
        let (single, pair) = (idle(2), [idle(3), idle(3)]);
        assert!(slots.try_take(from(4)).expect("one makes room").is_none());
        assert!(must_go(&pair[0]) && !must_go(&pair[1]) && !must_go(&single));
    }

    #[test]
    fn an_address_has_a_limit_of_its_own_within_which_its_oldest_make_room() {
        let slots = slots(9, 9, 2);
        let (one, two) = (room(&slots, from(1)), room(&slots, from(1)));
        let other = room(&slots, from(2));
        let three = room(&slots, from(1));
        assert!(must_go(&one) && !must_go(&two) && !must_go(&three) && !must_go(&other));
        room(&slots, None.into());
        for slot in [&two, &three] {
            slot.settle();
            slot.used(true);
        }
        assert_eq!(slots.try_take(from(1)).expect_err("both are at work"), "address");
        drop(one);
        two.used(false);
        room(&slots, from(1));
        assert!(must_go(&two));
    }

    #[test]
    fn whoever_comes_in_for_an_idle_one_of_its_address_is_a_newcomer_like_others() {
        let slots = slots(9, 2, 1);
        let known = room(&slots, from(1));
        known.settle();
        known.used(false);
        let others = [room(&slots, from(2)), room(&slots, from(3))];
        let next = room(&slots, from(1));
        assert!(must_go(&known) && !must_go(&next));
        assert_eq!(others.iter().filter(|slot| must_go(slot)).count(), 1);
        assert_eq!(slots.counts(), (4, 2));
    }

    #[test]
    fn a_network_of_ipv6_is_one_address() {
        let slots = slots(9, 9, 1);
        let of = |text: &str| Origin::from(Some(text.parse::<IpAddr>().expect("an address")));
        let first = room(&slots, of("2001:db8::1"));
        let _second = room(&slots, of("2001:db8::ffff:1"));
        assert!(must_go(&first));
        let other = room(&slots, of("2001:db8:0:1::1"));
        assert!(!must_go(&other));
        assert_eq!(of("::ffff:10.0.0.1"), from(1));
    }

    #[tokio::test]
    async fn however_many_come_at_once_each_is_taken_once_another_has_left() {
        let slots = slots(4, 4, 4);
        let mut tasks = tokio::task::JoinSet::new();
        for _ in 0..1000 {
            let slot = slots.take(from(1)).await.expect("the oldest makes room");
            assert!(slots.counts().0 <= 4);
            tasks.spawn(async move { slot.dismissed().await });
        }
    }

    #[tokio::test(start_paused = true)]
    async fn who_does_not_leave_keeps_others_out() {
        let slots = slots(1, 1, 9);
        let _stays = room(&slots, from(1));
        assert_eq!(slots.take(from(1)).await.expect_err("it does not leave"), "limit");
    }

    /// The counts are those of the held slots in any order of coming and going.
    #[test]
    fn counts_are_those_of_what_is_held() {
        let slots = slots(8, 4, 5);
        let mut held: Vec<ConnectionSlot> = Vec::new();
        let mut seed = 7_u64;
        let mut random = |below: usize| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as usize % below
        };
        for _ in 0..20_000 {
            match random(4) {
                0 | 1 => held.extend(slots.try_take(from(random(4) as u8)).ok().flatten()),
                2 if !held.is_empty() => drop(held.swap_remove(random(held.len()))),
                _ if !held.is_empty() => {
                    let one = &held[random(held.len())];
                    one.settle();
                    one.used(random(2) == 0);
                }
                _ => {}
            }
            let leaving = held.iter().filter(|slot| must_go(slot)).count();
            let taken = slots.lock();
            assert_eq!((taken.open.len(), taken.leaving), (held.len(), leaving));
            assert!(held.len() <= 8 && taken.newcomers <= 4, "{taken:?}");
            let newcomers: usize = taken.crowds.values().map(|crowd| crowd.newcomers.len()).sum();
            let open: usize = taken.crowds.values().map(|crowd| crowd.open).sum();
            assert_eq!((newcomers, open), (taken.newcomers, held.len()));
        }
    }
}
