//! The daemon behind a session that outlives restarts. Calls with a passing error are repeated until the
//! session's patience ends, and the user's own daemon is started again when it is gone.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use treewright_client::ClientError;
use treewright_client::blocking::Client;
use treewright_client::local::LocalDaemon;

use super::Service;
use crate::failure::{Failure, Result};
use crate::progress;

/// The first pause between two attempts; it doubles with each.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(50);

pub(super) struct PatientClient<'a> {
    pub(super) client: &'a Client,
    /// Longest time for which one call is repeated.
    patience: Duration,
    /// The daemon is the user's own, which may be started again.
    is_local: bool,
    /// Somebody wants everything to end.
    stop: &'a AtomicBool,
    /// It was away when it was last asked.
    is_away: Cell<bool>,
}

impl<'a> PatientClient<'a> {
    pub(super) fn new(service: &Service<'a>, stop: &'a AtomicBool) -> Self {
        let Service { client, timeout, is_local } = *service;
        Self { client, patience: timeout, is_local, stop, is_away: Cell::new(false) }
    }

    /// Asks until there is an answer, a refusal that stays, or no patience left. The error is the last one.
    pub(super) fn ask<T, E: Into<Failure>>(&self, mut ask: impl FnMut(&Client) -> Result<T, E>) -> Result<T> {
        let begin = Instant::now();
        let mut pause = FIRST_PAUSE;
        loop {
            let problem = match ask(self.client).map_err(E::into) {
                Err(Failure::Client(problem)) if problem.may_pass() => problem,
                done => {
                    self.note_return();
                    return done;
                }
            };
            if begin.elapsed() + pause > self.patience || self.stop.load(Ordering::Relaxed) {
                self.is_away.set(true);
                return Err(problem.into());
            }
            self.note_absence(&problem);
            self.pause(pause.max(problem.retry_after().unwrap_or_default()));
            pause = (2 * pause).min(LONGEST_PAUSE);
        }
    }

    /// Asks once, for an answer that the session can do without.
    pub(super) fn ask_once<T>(&self, ask: impl FnOnce(&Client) -> Result<T, ClientError>) -> Option<T> {
        if self.is_away.get() { None } else { ask(self.client).ok() }
    }

    fn note_absence(&self, problem: &ClientError) {
        if !self.is_away.replace(true) {
            let patience = humantime::format_duration(self.patience);
            progress::note(&format!("{problem}; it is tried again for {patience} (--timeout)"));
        }
        if self.is_local {
            // If it cannot be started, the next attempt says why it is missed.
            let _ = LocalDaemon::of_user().and_then(|local| local.start(progress::note));
        }
    }

    fn note_return(&self) {
        if self.is_away.replace(false) {
            progress::note("the daemon answers again");
        }
    }

    fn pause(&self, pause: Duration) {
        let until = Instant::now() + pause.min(self.patience);
        while Instant::now() < until && !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK.min(until.saturating_duration_since(Instant::now())));
        }
    }
}
