//! Clocks: the daemon reads the system's, and tests set theirs.

use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A clock.
pub trait Clock: Send + Sync + 'static {
    /// Milliseconds since 1970, UTC.
    fn now_ms(&self) -> i64;
}

/// The system's clock, for calendar times such as the end of a token. After a small step backwards, as by a
/// correction over the network, it waits. A large one shows that the time before was wrong, and is followed:
/// a token that seemed to have expired by it has not.
#[derive(Debug, Default)]
pub struct SystemClock {
    latest_ms: Mutex<i64>,
}

impl SystemClock {
    /// The largest step backwards for which it waits.
    const WAIT_MS: i64 = 60_000;

    fn show(&self, system_ms: i64) -> i64 {
        // A poisoned lock is usable: it holds one number.
        let mut latest_ms = self.latest_ms.lock().unwrap_or_else(PoisonError::into_inner);
        let was_wrong = latest_ms.saturating_sub(system_ms) > Self::WAIT_MS;
        *latest_ms = if was_wrong { system_ms } else { system_ms.max(*latest_ms) };
        *latest_ms
    }
}

impl Clock for SystemClock {
    fn now_ms(&self) -> i64 {
        self.show(i64::try_from(since_1970().as_millis()).unwrap_or(i64::MAX))
    }
}

/// A clock for leases. It runs as evenly as the machine's monotonic one, and is drawn towards the system's
/// time by at most a tenth of the elapsed time. So no correction, of seconds or of years, ends all leases at
/// once or none for long. After a while it shows the right time again. (Slewing instead of stepping, as of D.
/// Mills, "Computer Network Time Synchronization", chapter 3, and of `adjtime`.)
#[derive(Debug)]
pub struct SteadyClock {
    begun: Instant,
    steady: Mutex<Steady>,
}

impl SteadyClock {
    /// A clock that begins with the system's time.
    pub fn new() -> Self {
        let steady = Steady { since: Duration::ZERO, shown: since_1970() };
        Self { begun: Instant::now(), steady: Mutex::new(steady) }
    }
}

impl Default for SteadyClock {
    fn default() -> Self {
        Self::new()
    }
}

impl Clock for SteadyClock {
    fn now_ms(&self) -> i64 {
        // A poisoned lock is usable: its two numbers are set together.
        let mut steady = self.steady.lock().unwrap_or_else(PoisonError::into_inner);
        let shown = steady.advance(self.begun.elapsed(), since_1970());
        i64::try_from(shown.as_millis()).unwrap_or(i64::MAX)
    }
}

/// The last time that a steady clock showed, and its moment by the monotonic clock.
#[derive(Debug)]
struct Steady {
    since: Duration,
    shown: Duration,
}

impl Steady {
    /// Largest share of the elapsed time by which it runs faster or slower.
    const SLEW: u32 = 10;

    fn advance(&mut self, monotonic: Duration, system: Duration) -> Duration {
        let (passed, before) = (monotonic.saturating_sub(self.since), self.shown);
        let even = self.shown.saturating_add(passed);
        let most = passed / Self::SLEW;
        self.since = monotonic;
        self.shown = system.clamp(even - most, even.saturating_add(most));
        assert!(self.shown >= before, "the clock goes back from {before:?} to {:?}", self.shown);
        assert!(self.shown.abs_diff(even) <= most, "the clock jumps from {before:?} to {:?}", self.shown);
        self.shown
    }
}

fn since_1970() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}

/// A clock that stands still until it is moved.
#[derive(Debug)]
pub struct ManualClock {
    now_ms: AtomicI64,
}

impl ManualClock {
    /// A clock that shows `now_ms`.
    pub fn at(now_ms: i64) -> Self {
        Self { now_ms: AtomicI64::new(now_ms) }
    }

    /// Moves it on.
    pub fn advance_ms(&self, by_ms: i64) {
        self.now_ms.fetch_add(by_ms, Ordering::SeqCst);
    }
}

impl Clock for ManualClock {
    fn now_ms(&self) -> i64 {
        self.now_ms.load(Ordering::SeqCst)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_tell_the_time() {
        let clock = ManualClock::at(5);
        clock.advance_ms(7);
        assert_eq!(clock.now_ms(), 12);

        let steady = SteadyClock::new();
        let wall_ms = SystemClock::default().now_ms();
        assert!((steady.now_ms() - wall_ms).abs() < 60_000);

        assert!(SystemClock::default().now_ms() > 1_700_000_000_000);
    }

    #[test]
    fn the_calendar_waits_for_a_small_step_back_and_follows_a_large_one() {
        const YEAR_MS: i64 = 365 * 86_400_000;
        let (clock, start_ms) = (SystemClock::default(), 1_750_000_000_000);
        for (system_ms, shown_ms) in [
            (start_ms, start_ms),
            (start_ms - SystemClock::WAIT_MS, start_ms),
            (start_ms + 5, start_ms + 5),
            // It jumps ahead, and is corrected.
            (start_ms + YEAR_MS, start_ms + YEAR_MS),
            (start_ms + 10, start_ms + 10),
            (start_ms + 9, start_ms + 10),
            (i64::MAX, i64::MAX),
            (0, 0),
        ] {
            assert_eq!(clock.show(system_ms), shown_ms, "at {system_ms}");
        }
    }

    /// Jumps by a day and by forty years, either way: a minute stays a minute to within a tenth, and in the
    /// end the clock is right.
    #[test]
    fn a_jump_of_the_systems_clock_is_made_up_for_slowly() {
        const DAY: Duration = Duration::from_secs(86_400);
        let start = DAY * 20_000;
        let minute = Duration::from_secs(60);
        for system in [start + DAY, start - DAY, start + DAY * 14_600, Duration::ZERO] {
            let mut steady = Steady { since: Duration::ZERO, shown: start };
            let (mut monotonic, mut last) = (Duration::ZERO, start);
            for _ in 0..600 {
                monotonic += Duration::from_millis(100);
                let shown = steady.advance(monotonic, system + monotonic);
                assert!(shown > last, "it never stands still");
                last = shown;
            }
            let shown_minute = last - start;
            assert!(shown_minute >= minute * 9 / 10 && shown_minute <= minute * 11 / 10, "{shown_minute:?}");
        }
        let mut steady = Steady { since: Duration::ZERO, shown: start };
        let jumped = start + Duration::from_secs(30);
        (1..=400).for_each(|second| {
            steady.advance(Duration::from_secs(second), jumped + Duration::from_secs(second));
        });
        assert_eq!(steady.shown, jumped + Duration::from_secs(400));
        // Frequent and rare callers get one time.
        assert_eq!(steady.advance(Duration::from_secs(400), jumped), jumped + Duration::from_secs(400));
    }
}
