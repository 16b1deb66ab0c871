//! Absences of the daemon: a lease that ends while the daemon cannot take reports says nothing of its
//! configuration.
//!
//! The daemon is away before it has loaded a study. It is also away where the sweep of leases, which runs
//! every second, has not run for long: the process was stopped, the machine slept, or the database did not
//! answer.

use std::sync::atomic::{AtomicI64, Ordering};

use crate::limits::{ABSENCE_MIN, RETURN_GRACE};

/// The last presence of the daemon. Times are milliseconds of the daemon's clock for leases.
#[derive(Debug)]
pub(super) struct Presence {
    /// The begin of the last sweep that could read the database; the largest number before the first.
    swept_ms: AtomicI64,
    pardoned_until_ms: AtomicI64,
}

impl Default for Presence {
    fn default() -> Self {
        Self { swept_ms: AtomicI64::new(i64::MAX), pardoned_until_ms: AtomicI64::new(i64::MIN) }
    }
}

impl Presence {
    /// The time up to which leases that end do not count as lost, as of `now_ms`.
    pub(super) fn pardoned_until_ms(&self, now_ms: i64) -> i64 {
        let away_ms = now_ms.saturating_sub(self.swept_ms.load(Ordering::Relaxed));
        if away_ms < ABSENCE_MIN.as_millis() as i64 {
            return self.pardoned_until_ms.load(Ordering::Relaxed);
        }
        let until_ms = back_since(now_ms);
        self.pardoned_until_ms.fetch_max(until_ms, Ordering::Relaxed).max(until_ms)
    }

    pub(super) fn swept(&self, now_ms: i64) {
        self.pardoned_until_ms(now_ms);
        self.swept_ms.store(now_ms, Ordering::Relaxed);
    }
}

/// The time up to which leases are pardoned after a return at `now_ms`: clients need a moment to notice it.
pub(super) fn back_since(now_ms: i64) -> i64 {
    now_ms.saturating_add(RETURN_GRACE.as_millis() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_sweeps_every_second_pardons_nothing_and_who_was_away_does() {
        let presence = Presence::default();
        assert_eq!(presence.pardoned_until_ms(50_000), i64::MIN, "before the first sweep");
        for now_ms in [60_000, 61_000, 70_999] {
            presence.swept(now_ms);
        }
        assert_eq!(presence.pardoned_until_ms(71_500), i64::MIN);
        assert_eq!(presence.pardoned_until_ms(80_998), i64::MIN, "a slow sweep is no absence");
        assert_eq!(presence.pardoned_until_ms(80_999), 90_999);
        // The first request after the absence notices it, and the sweep keeps it.
        presence.swept(81_100);
        assert_eq!(presence.pardoned_until_ms(81_200), 91_100);
        presence.swept(81_300);
        assert_eq!(presence.pardoned_until_ms(81_400), 91_100);
    }
}
