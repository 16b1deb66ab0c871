//! The early end of a search: once the expected gain of further trials is worth less than their time.
//!
//! The service predicts the gain of each doubling of the number of trials from other scenes, corrected by the
//! course of this one so far. That share of the remaining render time is compared here with the time of the
//! trials.

use std::{fmt, time::Duration};

/// Trials before which a search never ends early.
const TRIALS_LEAST: u32 = 8;

/// Why a search ended early. Its `Display` is a clause for people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ending {
    /// Trials of the next stage.
    pub more: u32,
    /// Expected time of that stage.
    pub takes: Duration,
    /// By which share it is expected to lower the cost of all later frames, 0 to 1.
    pub expected_gain: f64,
    /// For how long will be rendered with the result.
    pub worth: Duration,
}

/// The progress of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Its trials so far.
    pub trials: u32,
    /// Most trials of it.
    pub trials_max: u32,
    /// Configurations that were tried here, in earlier searches too.
    pub tried: u32,
    /// Time of its trials together.
    pub spent: Duration,
}

impl Ending {
    /// Whether a search ends here, by the service's expected gain until the tried ones have doubled.
    pub fn of(progress: Progress, expected_gain: f64, worth: Duration) -> Option<Self> {
        let Progress { trials, trials_max, tried, spent } = progress;
        // Without an end of the time to come every gain pays, also one that is not expected.
        if trials < TRIALS_LEAST || trials >= trials_max || worth == Duration::MAX {
            return None;
        }
        let doubled = tried.saturating_add(1).checked_next_power_of_two().unwrap_or(u32::MAX);
        let more = (doubled - tried).clamp(1, trials_max - trials);
        let takes = spent.div_f64(f64::from(trials)).mul_f64(f64::from(more));
        let pays = expected_gain * worth.as_secs_f64() > takes.as_secs_f64();
        (!pays).then_some(Self { more, takes, expected_gain, worth })
    }
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [takes_s, worth_s] = [self.takes, self.worth].map(|time| time.as_secs_f64());
        write!(
            f,
            "{} more trials would take {takes_s:.1} s and are expected to gain {:.1} %, which is {:.1} s of the {worth_s:.0} s to come",
            self.more,
            100.0 * self.expected_gain,
            self.expected_gain * worth_s,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIAL: Duration = Duration::from_millis(250);
    const WORTH: Duration = Duration::from_secs(600);

    fn after(trials: u32, trials_max: u32, gain: f64) -> Option<Ending> {
        Ending::of(Progress { trials, trials_max, tried: trials, spent: TRIAL * trials }, gain, WORTH)
    }

    #[test]
    fn a_search_ends_once_the_next_stage_takes_longer_than_it_saves() {
        // Sixteen trials of a quarter of a second are four seconds, and so are two thirds of a hundredth.
        assert_eq!(after(16, 80, 0.0068), None);
        let ending = after(16, 80, 0.0066).expect("it does not pay");
        assert_eq!((ending.more, ending.takes), (16, Duration::from_secs(4)));
        assert_eq!(
            ending.to_string(),
            "16 more trials would take 4.0 s and are expected to gain 0.7 %, which is 4.0 s of the 600 s to come"
        );
        assert_eq!(after(24, 80, 0.0034), None, "eight more take half as long");
    }

    #[test]
    fn the_last_stage_is_what_is_left() {
        assert_eq!(after(64, 80, 0.0).map(|ending| ending.more), Some(16));
        assert_eq!(after(80, 80, 0.0), None);
        assert_eq!(after(99_999, 100_000, 0.0).map(|ending| ending.more), Some(1));
        // Earlier configurations count for the stage, and not for the time of a trial.
        let progress = Progress { trials: 8, trials_max: 80, tried: 48, spent: 8 * TRIAL };
        assert_eq!(Ending::of(progress, 0.0, WORTH).map(|ending| ending.more), Some(16));
        let progress = Progress { tried: u32::MAX, ..progress };
        assert_eq!(Ending::of(progress, 0.0, WORTH).map(|ending| ending.more), Some(1));
    }

    #[test]
    fn nothing_is_weighed_before_some_trials_and_all_trials_run_where_no_time_is_short() {
        assert_eq!(after(TRIALS_LEAST - 1, 80, 0.0), None);
        assert!(after(TRIALS_LEAST, 80, 0.0).is_some());
        let progress = Progress { trials: 16, trials_max: 80, tried: 16, spent: TRIAL };
        assert!(Ending::of(progress, 1.0, Duration::ZERO).is_some());
        for gain in [0.0, 1e-9] {
            assert_eq!(Ending::of(progress, gain, Duration::MAX), None);
        }
    }
}
