//! Limit of requests a second: the generic cell rate algorithm (ITU-T I.371), a token bucket that needs no
//! filling.
//!
//! Only one time is kept: when the bucket would be full again. Each request moves it on by its share of a
//! second. A request that would move it more than a second ahead is refused, and the excess is the wait until
//! the next try.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

/// A bucket that holds a second's worth of requests.
#[derive(Debug, Default)]
pub(super) struct Rate {
    full_again: Mutex<Option<Instant>>,
}

const SECOND: Duration = Duration::from_secs(1);

impl Rate {
    /// Takes a request out, or returns the wait for one.
    pub(super) fn take(&self, per_s: u32, now: Instant) -> Result<(), Duration> {
        let share = SECOND / per_s.max(1);
        let mut full_again = self.full_again.lock().unwrap_or_else(PoisonError::into_inner);
        let next = full_again.map_or(now, |at| at.max(now)) + share;
        let wait = next.saturating_duration_since(now + SECOND.max(share));
        if wait.is_zero() {
            *full_again = Some(next);
            Ok(())
        } else {
            Err(wait)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_s_worth_at_once_and_then_as_much_as_flows_in() {
        let (rate, start) = (Rate::default(), Instant::now());
        for _ in 0..10 {
            rate.take(10, start).unwrap();
        }
        assert_eq!(rate.take(10, start), Err(Duration::from_millis(100)));
        rate.take(10, start + Duration::from_millis(100)).unwrap();
        assert!(rate.take(10, start + Duration::from_millis(150)).is_err());
        // After a long pause no more than a second's worth has gathered.
        let later = start + Duration::from_secs(60);
        assert_eq!((0..100).filter(|_| rate.take(10, later).is_ok()).count(), 10);
    }

    #[test]
    fn in_the_long_run_the_rate_is_kept_exactly() {
        let (rate, start) = (Rate::default(), Instant::now());
        let taken = (0..100_000_u32)
            .filter(|step| rate.take(7, start + Duration::from_millis(u64::from(*step))).is_ok())
            .count();
        assert!((7 * 100..=7 * 101).contains(&taken), "{taken} in 100 seconds");
    }
}
