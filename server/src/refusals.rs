//! Counts refused requests, and logs them at a bounded rate.
//!
//! Every refusal is counted by its reason. Of each reason only [`REFUSAL_LINES`] lines are logged within
//! [`REFUSAL_PERIOD`]; the next line then says how many were left out. So a client that is refused a thousand
//! times a second cannot fill the disk with log lines. Lines that are left out still appear at the level
//! `debug`.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tonic::Code;

use crate::error::Error;
use crate::limits::{REFUSAL_LINES, REFUSAL_PERIOD};
use crate::metrics::Metrics;
use crate::redirect::Redirect;
use crate::status;

/// Counts and logs refusals. Clones share the counts.
#[derive(Clone, Debug)]
pub struct Refusals {
    metrics: Arc<Metrics>,
    begun: Instant,
    lines: Arc<Mutex<HashMap<&'static str, LineBudget>>>,
}

impl Refusals {
    /// Counts refusals in `metrics`.
    pub fn new(metrics: Arc<Metrics>) -> Self {
        Self { metrics, begun: Instant::now(), lines: Arc::default() }
    }

    /// The metrics in which refusals are counted.
    pub fn metrics(&self) -> &Arc<Metrics> {
        &self.metrics
    }

    /// Counts and logs a request that was refused, in the request's span.
    pub(crate) fn note(&self, error: &Error) {
        let (code, reason) = (status::code(error), status::reason(error));
        let line = self.take_line(reason);
        let error = status::message(error);
        self.metrics.refused(reason);
        match line {
            None => tracing::debug!(?code, %error, "request refused"),
            Some(left_out) if code == Code::Internal => {
                tracing::error!(?code, %error, left_out, "request failed");
            }
            Some(left_out) => tracing::warn!(?code, %error, left_out, "request refused"),
        }
    }

    /// Notes an error, unless other replicas exist and one of them or another attempt may still do the
    /// request.
    pub(crate) fn note_here(&self, error: &Error, has_peers: bool) {
        if has_peers && Redirect::of(error).is_some() {
            tracing::debug!(%error, "not done here");
        } else {
            self.note(error);
        }
    }

    /// Counts and logs a request whose study no replica held in time.
    pub(crate) fn note_unplaced(&self, study: &str) {
        let reason = "elsewhere";
        self.metrics.refused(reason);
        if let Some(left_out) = self.take_line(reason) {
            tracing::warn!(study, left_out, "request refused: no replica took the study in time");
        }
    }

    /// Whether a line may be logged, and how many were left out before it.
    fn take_line(&self, reason: &'static str) -> Option<u64> {
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        lines.entry(reason).or_default().take(self.begun.elapsed())
    }
}

impl Default for Refusals {
    fn default() -> Self {
        Self::new(Arc::default())
    }
}

/// The number of lines of one kind that were logged in the current period.
#[derive(Debug, Default)]
struct LineBudget {
    period: u64,
    logged: u64,
    left_out: u64,
}

impl LineBudget {
    /// Whether a line may be logged at `now`, and how many were left out since the last one.
    fn take(&mut self, now: Duration) -> Option<u64> {
        let period = now.as_secs() / REFUSAL_PERIOD.as_secs();
        assert!(period >= self.period, "period {period} comes after {}", self.period);
        if period != self.period {
            (self.period, self.logged) = (period, 0);
        }
        if self.logged >= REFUSAL_LINES {
            self.left_out += 1;
            return None;
        }
        self.logged += 1;
        Some(std::mem::take(&mut self.left_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_refusals_is_a_few_lines_that_say_how_many_there_were() {
        let mut budget = LineBudget::default();
        let logged: Vec<_> = (0..1000).filter_map(|_| budget.take(Duration::ZERO)).collect();
        assert_eq!(logged, vec![0; REFUSAL_LINES as usize]);
        assert_eq!(budget.take(REFUSAL_PERIOD), Some(1000 - REFUSAL_LINES));
        assert_eq!(budget.take(REFUSAL_PERIOD), Some(0));
    }

    #[test]
    fn every_refusal_is_counted_and_each_reason_has_lines_of_its_own() {
        let refusals = Refusals::default();
        for _ in 0..=REFUSAL_LINES {
            refusals.note(&Error::Draining);
        }
        assert_eq!(refusals.take_line("draining"), None);
        assert_eq!(refusals.take_line("busy"), Some(0));
        let text = refusals.metrics().text(&[], |_| {}).expect("text");
        let counted = format!("treewright_refusals_total{{reason=\"draining\"}} {}", REFUSAL_LINES + 1);
        assert!(text.contains(&counted), "{text}");
    }
}
