//! A circuit breaker (after M. Nygard, "Release It!"): whether the daemon answers. After a failure no call
//! waits for it until a probe in the background finds it answering again; probes come after growing pauses.
//! So an absent daemon costs one frame one deadline, and the frames after it none.

use std::sync::{Arc, Mutex};

use tokio::sync::watch;
use tokio::time::Instant;

use crate::back_off::BackOff;
use crate::locks::lock;
use crate::{ClientError, SharedError};

/// The state of the connection.
#[derive(Debug, Clone)]
pub enum Status {
    /// Nothing was heard of the daemon yet, neither good nor bad.
    Unknown,
    /// The daemon answered last time.
    Connected,
    /// The daemon did not answer; frames get fallbacks while it is looked for in the background.
    Away {
        /// Failures in a row.
        failures: u32,
        /// The most recent one.
        problem: SharedError,
    },
}

/// Shared knowledge of the connection.
#[derive(Debug)]
pub(crate) struct CircuitBreaker {
    state: watch::Sender<BreakerState>,
    /// Until when the daemon asked to be left in peace, and with which words. It answers, so it is not away.
    hint: Mutex<Option<(Instant, SharedError)>>,
}

#[derive(Debug, Clone)]
struct BreakerState {
    status: Status,
    /// Failures since the last real success. A probe that succeeds does not reset it: a daemon that
    /// answers probes and nothing else must not be trusted again and again at the shortest interval.
    failures: u32,
}

impl CircuitBreaker {
    pub(crate) fn new() -> Self {
        let state = BreakerState { status: Status::Unknown, failures: 0 };
        Self { state: watch::Sender::new(state), hint: Mutex::new(None) }
    }

    pub(crate) fn status(&self) -> Status {
        self.state.borrow().status.clone()
    }

    /// Why the daemon is not worth waiting for at the moment: it is away, or asked to be left in peace.
    pub(crate) fn problem(&self) -> Option<SharedError> {
        match &self.state.borrow().status {
            Status::Away { problem, .. } => Some(Arc::clone(problem)),
            Status::Unknown | Status::Connected => self.hint(),
        }
    }

    fn hint(&self) -> Option<SharedError> {
        let mut hint = lock(&self.hint);
        let over = hint.as_ref().is_some_and(|(until, _)| *until <= Instant::now());
        if over {
            *hint = None;
        }
        hint.as_ref().map(|(_, problem)| Arc::clone(problem))
    }

    /// Heeds what a refusal says about when to ask again. A daemon that cannot serve at all is looked for
    /// instead.
    pub(crate) fn note_hint(&self, problem: &ClientError) {
        if let Some(wait) = problem.retry_after().filter(|_| !problem.is_unreachable()) {
            let mut hint = lock(&self.hint);
            *hint = Some((Instant::now() + wait, Arc::new(problem.clone())));
        }
    }

    /// The daemon answered, be it with a refusal.
    pub(crate) fn success(&self) {
        self.state.send_if_modified(|state| {
            let changes = state.failures > 0 || !matches!(state.status, Status::Connected);
            *state = BreakerState { status: Status::Connected, failures: 0 };
            changes
        });
    }

    /// The daemon did not answer. Failures of calls that were under way when the first one failed count once.
    pub(crate) fn failure(&self, problem: SharedError) {
        self.state.send_modify(|state| {
            if !matches!(state.status, Status::Away { .. }) {
                state.failures = state.failures.saturating_add(1);
            }
            state.status = Status::Away { failures: state.failures, problem };
        });
    }

    pub(crate) async fn wait_until_worth_asking(&self) {
        // The sender lives as long as `self`, so that waiting cannot fail.
        let _ = self.state.subscribe().wait_for(|state| !matches!(state.status, Status::Away { .. })).await;
    }

    /// Looks for the daemon whenever it is away, for ever.
    pub(crate) async fn keep_probing<F>(&self, back_off: BackOff, probe: impl Fn() -> F)
    where
        F: Future<Output = Result<(), ClientError>>,
    {
        if matches!(self.status(), Status::Unknown) {
            self.probed(probe().await);
        }
        loop {
            let _ =
                self.state.subscribe().wait_for(|state| matches!(state.status, Status::Away { .. })).await;
            let failures = self.state.borrow().failures;
            back_off.sleep(failures).await;
            if matches!(self.status(), Status::Away { .. }) {
                self.probed(probe().await);
            }
        }
    }

    fn probed(&self, result: Result<(), ClientError>) {
        self.state.send_modify(|state| match result {
            Ok(()) => state.status = Status::Connected,
            Err(problem) => {
                state.failures = state.failures.saturating_add(1);
                state.status = Status::Away { failures: state.failures, problem: Arc::new(problem) };
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::time::Duration;

    use super::*;
    use crate::Options;

    fn away() -> ClientError {
        ClientError::away("http://nowhere", "refused")
    }

    fn back_off() -> BackOff {
        let (back_off_min, back_off_max) = (Duration::from_secs(1), Duration::from_secs(16));
        BackOff::new(&Options { back_off_min, back_off_max, ..Options::default() })
    }

    #[tokio::test(start_paused = true)]
    async fn an_absent_daemon_is_looked_for_ever_more_rarely() {
        let breaker = CircuitBreaker::new();
        let start = Instant::now();
        let times = std::sync::Mutex::new(Vec::new());
        let probe = async || {
            times.lock().unwrap().push(start.elapsed().as_secs_f64());
            if times.lock().unwrap().len() < 8 { Err(away()) } else { Ok(()) }
        };
        tokio::select! {
            () = breaker.keep_probing(back_off(), probe) => unreachable!("it never ends"),
            () = async {
                tokio::time::sleep(Duration::from_millis(1)).await;
                assert!(breaker.problem().is_some());
                breaker.wait_until_worth_asking().await;
            } => {}
        }
        let times = times.into_inner().unwrap();
        let pauses: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        for (pause, whole) in pauses.iter().zip([1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]) {
            assert!((0.5 * whole..=whole + 0.01).contains(pause), "{pauses:?}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_daemon_that_only_answers_probes_is_trusted_ever_more_rarely() {
        let breaker = CircuitBreaker::new();
        let probes = AtomicU32::new(0);
        let probe = async || {
            probes.fetch_add(1, Ordering::Relaxed);
            Ok(())
        };
        let ask_in_vain = async {
            for failures in 1..=5 {
                breaker.wait_until_worth_asking().await;
                breaker.failure(Arc::new(away()));
                assert!(
                    matches!(breaker.status(), Status::Away { failures: counted, .. } if counted == failures)
                );
            }
            breaker.wait_until_worth_asking().await;
            breaker.success();
            breaker.failure(Arc::new(away()));
            assert!(matches!(breaker.status(), Status::Away { failures: 1, .. }));
        };
        tokio::select! {
            () = breaker.keep_probing(back_off(), probe) => unreachable!("it never ends"),
            () = ask_in_vain => {}
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_hint_is_heeded_until_its_time_is_over() {
        use tonic_types::StatusExt as _;
        let breaker = CircuitBreaker::new();
        breaker.success();
        let refused = |wait| {
            let details = tonic_types::ErrorDetails::with_retry_info(wait);
            let status = tonic::Status::with_error_details(tonic::Code::ResourceExhausted, "busy", details);
            ClientError::from_status("http://x", "Suggest", &status)
        };
        breaker.note_hint(&refused(None));
        assert!(breaker.problem().is_none());
        breaker.note_hint(&refused(Some(Duration::from_secs(2))));
        assert!(breaker.problem().is_some_and(|problem| problem.to_string().contains("busy")));
        assert!(matches!(breaker.status(), Status::Connected), "it answers");
        tokio::time::advance(Duration::from_secs(2)).await;
        assert!(breaker.problem().is_none());
    }

    #[test]
    fn failures_of_the_same_outage_count_once() {
        let breaker = CircuitBreaker::new();
        for _ in 0..100 {
            breaker.failure(Arc::new(away()));
        }
        assert!(matches!(breaker.status(), Status::Away { failures: 1, .. }));
    }
}
