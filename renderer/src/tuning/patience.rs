//! A search's own patience: a daemon that is slow is not a daemon that is gone.
//!
//! A program that people watch cannot wait. A search can, and a frame without a trial measures nothing new.
//! So a search asks a frame ahead, and where an answer is not there in time it waits for it, for minutes if
//! need be. After that it goes on without the answer.

use std::time::{Duration, Instant};

use treewright_client::blocking::{PrefetchingTuner, Study, Tuner};
use treewright_client::{ClientError, Finished, Indicators, Suggestion};

/// Interval at which a wait checks whether the user wants no more.
const LOOK: Duration = Duration::from_millis(500);

/// Says what to run next.
pub trait NextTrial {
    /// The suggestion for this frame. Hands in the result of the frame before.
    fn next(&mut self, state: &Indicators, previous: Option<Finished>) -> Suggestion;
}

/// Asks when it needs an answer, and waits for it within the client's deadline.
impl NextTrial for Tuner {
    fn next(&mut self, state: &Indicators, previous: Option<Finished>) -> Suggestion {
        Tuner::next(self, state, previous)
    }
}

/// The longest wait for an answer, and whether the user still wants one.
#[derive(Clone, Copy)]
pub struct Patience<'a> {
    /// For one answer.
    pub limit: Duration,
    /// Whether the user wants to go on.
    pub go_on: &'a dyn Fn() -> bool,
}

impl Patience<'_> {
    /// Calls until the daemon answers, or patience is at its end.
    ///
    /// # Errors
    /// The error of the last call; at once where waiting cannot help.
    pub fn call<T>(self, mut call: impl FnMut() -> Result<T, ClientError>) -> Result<T, ClientError> {
        let begin = Instant::now();
        loop {
            match call() {
                Err(error)
                    if (error.is_unreachable() || error.retry_after().is_some())
                        && begin.elapsed() < self.limit
                        && (self.go_on)() =>
                {
                    std::thread::sleep(LOOK);
                }
                other => return other,
            }
        }
    }
}

/// Asks a frame ahead, and is patient.
pub struct PatientTuner<'a> {
    tuner: PrefetchingTuner,
    patience: Patience<'a>,
    /// Patience came to its end, and no answer has come since.
    gave_up: bool,
}

impl<'a> PatientTuner<'a> {
    /// A tuner of a study.
    #[must_use]
    pub fn new(study: &Study, patience: Patience<'a>) -> Self {
        Self { tuner: study.prefetching_tuner(), patience, gave_up: false }
    }
}

impl NextTrial for PatientTuner<'_> {
    fn next(&mut self, state: &Indicators, previous: Option<Finished>) -> Suggestion {
        let begin = Instant::now();
        let limit = if self.gave_up { Duration::ZERO } else { self.patience.limit };
        let mut is_there = self.tuner.wait(state, Duration::ZERO);
        while !is_there && begin.elapsed() < limit && (self.patience.go_on)() {
            is_there = self.tuner.wait(state, LOOK.min(limit));
        }
        self.gave_up = !is_there;
        self.tuner.next(state, previous)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of calls, and whether the last one was answered, where the first `late` are not.
    fn called(late: u32, limit: Duration, go_on: bool) -> (u32, bool) {
        let mut calls = 0;
        let answer = Patience { limit, go_on: &|| go_on }.call(|| {
            calls += 1;
            match calls > late {
                true => Ok(()),
                false => Err(ClientError::Late { url: "a daemon".into(), call: "GetBest", deadline: LOOK }),
            }
        });
        (calls, answer.is_ok())
    }

    #[test]
    fn what_is_not_answered_in_time_is_asked_again_while_patience_lasts() {
        let minute = Duration::from_secs(60);
        assert_eq!(called(0, Duration::ZERO, true), (1, true));
        assert_eq!(called(1, minute, true), (2, true));
        assert_eq!(called(1, Duration::ZERO, true), (1, false), "patience is at its end");
        assert_eq!(called(1, minute, false), (1, false), "the user wants no more");
        let mut calls = 0;
        let refused = Patience { limit: minute, go_on: &|| true }.call(|| {
            calls += 1;
            Err::<(), _>(ClientError::NoRuntime { reason: "none".into() })
        });
        assert!(refused.is_err() && calls == 1, "waiting cannot help");
    }
}
