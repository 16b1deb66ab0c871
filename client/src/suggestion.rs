//! A suggestion: the configuration to run next and, if it came from the daemon, a trial under a lease.

use std::sync::Arc;
use std::time::SystemTime;

use crate::delivery::report_request;
use crate::outbox::{Message, OutboxItem};
use crate::study_context::StudyContext;
use crate::workers::Worker;
use crate::{
    ClientError, Configuration, Measurements, Mode, OpenEnum, Outcome, Reason, SharedError, TrialRecord,
    checks,
};

/// Where a configuration came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The daemon, in time.
    Daemon,
    /// The daemon did not answer; this is the last configuration that came from it and was not reported
    /// infeasible.
    LastGood,
    /// The daemon has never answered; these are the space's recommended values.
    Default,
}

/// A configuration to run next. If it came from the daemon it holds a trial: report the result with
/// [`Suggestion::report`], or drop it, which gives the trial back. Neither ever blocks.
///
/// A suggestion that did not come from the daemon ([`Suggestion::source`]) is used in the same way, but there
/// is no trial that its result could be reported to; results are only counted ([`crate::Stats::unreported`]).
#[derive(Debug)]
#[must_use = "a dropped suggestion gives its trial back"]
pub struct Suggestion {
    study: Arc<StudyContext>,
    configuration: Configuration,
    source: Source,
    mode: OpenEnum<Mode>,
    predicted_cost: Option<f64>,
    reason: Reason,
    problem: Option<SharedError>,
    lease: Option<Lease>,
    lease_expire_time: Option<SystemTime>,
    abort_above: Option<f64>,
}

impl Suggestion {
    pub(crate) fn of_trial(study: Arc<StudyContext>, trial: TrialRecord, lease: Lease) -> Self {
        Self {
            study,
            configuration: trial.configuration,
            source: Source::Daemon,
            mode: trial.mode,
            predicted_cost: trial.predicted_cost,
            reason: trial.reason,
            problem: None,
            lease: Some(lease),
            lease_expire_time: trial.lease_expire_time,
            abort_above: trial.abort_above,
        }
    }

    pub(crate) fn fallback(study: Arc<StudyContext>, problem: SharedError) -> Self {
        let last_good = study.last_good();
        let (source, mode) = match last_good {
            Some(_) => (Source::LastGood, Mode::Exploit),
            None => (Source::Default, Mode::Default),
        };
        let configuration = last_good.unwrap_or_else(|| study.spec.space.default_configuration().into());
        let what = match source {
            Source::LastGood => "the last good configuration",
            Source::Daemon | Source::Default => "the recommended values",
        };
        let summary = format!("{what}, because of: {problem}");
        let reason = Reason { summary, source: "fallback".into(), ..Reason::default() };
        let problem = Some(problem);
        Self {
            study,
            configuration,
            source,
            mode: mode.into(),
            predicted_cost: None,
            reason,
            problem,
            lease: None,
            lease_expire_time: None,
            abort_above: None,
        }
    }

    /// The configuration to run with.
    #[must_use]
    pub fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// Where it came from.
    #[must_use]
    pub fn source(&self) -> Source {
        self.source
    }

    /// Why this configuration. Fallbacks are [`Mode::Exploit`] or [`Mode::Default`].
    #[must_use]
    pub fn mode(&self) -> OpenEnum<Mode> {
        self.mode
    }

    /// Predicted objective, in the objective's units, where something is known.
    #[must_use]
    pub fn predicted_cost(&self) -> Option<f64> {
        self.predicted_cost
    }

    /// Stop as soon as the objective exceeds this, and report [`Outcome::aborted`] with the value reached by
    /// then: the service learns from it that the configuration costs at least as much. `None`: never. See
    /// [`crate::FrameSet`] for trials of several frames.
    #[must_use]
    pub fn abort_above(&self) -> Option<f64> {
        self.abort_above
    }

    /// The reason of the answer.
    #[must_use]
    pub fn reason(&self) -> &Reason {
        &self.reason
    }

    /// Why the daemon was not the source; `None` when it was.
    #[must_use]
    pub fn problem(&self) -> Option<&ClientError> {
        self.problem.as_deref()
    }

    /// Name of the trial, `studies/{study}/trials/{trial}`; `None` for fallbacks.
    #[must_use]
    pub fn trial(&self) -> Option<&str> {
        self.lease.as_ref().map(|lease| &*lease.trial)
    }

    /// Until when the result is wanted, by the daemon's clock. Later results are taken and flagged late.
    #[must_use]
    pub fn lease_expire_time(&self) -> Option<SystemTime> {
        self.lease_expire_time
    }

    /// Joins the result to the trial, for [`crate::Tuner::next`]. Dropping what this returns reports it, too.
    ///
    /// Errors: [`ClientError::Invalid`] when the service would refuse the result, e.g. a measurement that is
    /// not finite; the trial is then given back. Also in the child of a fork, whose parent was given the
    /// trial and goes on with it.
    pub fn finished(mut self, measurements: Measurements, outcome: Outcome) -> Result<Finished, ClientError> {
        self.is_ours()?;
        checks::result(&self.study.spec, &outcome, &measurements)?;
        self.study.learn(&self.configuration, &outcome);
        let lease = self.lease.take();
        match &lease {
            Some(lease) => self.study.core.outbox.mark_reported(&lease.trial),
            None => self.study.core.counters.unreported.add(1),
        }
        Ok(Finished { lease, measurements, outcome, attempts: 0 })
    }

    /// Puts the result into the outbox and returns at once; a background task delivers it.
    ///
    /// Errors: as for [`Suggestion::finished`].
    pub fn report(self, measurements: Measurements, outcome: Outcome) -> Result<(), ClientError> {
        self.finished(measurements, outcome).map(drop)
    }

    /// Gives the trial back unmeasured, as dropping it does. Returns at once.
    pub fn abandon(self) {}

    /// Renews the lease, counted from now, for work that takes longer. Does nothing for fallbacks.
    ///
    /// Errors: [`ClientError::Refused`] when the trial is no longer open; [`ClientError::Away`],
    /// [`ClientError::Late`].
    pub async fn extend_lease(&mut self) -> Result<(), ClientError> {
        self.is_ours()?;
        if let Some(lease) = &self.lease {
            self.lease_expire_time = self.study.core.extend_lease(&lease.trial).await?.lease_expire_time;
        }
        Ok(())
    }

    fn is_ours(&self) -> Result<(), ClientError> {
        if self.study.core.is_of_this_process() {
            return Ok(());
        }
        let problem = "it was given to the process that this one was forked from; report it there, or ask for another here";
        Err(ClientError::invalid("trial", problem))
    }

    pub(crate) fn lease_is_live(&self, now: SystemTime) -> bool {
        self.lease_expire_time.is_none_or(|expires| now < expires)
    }
}

/// A trial with its result, on its way to the daemon. Dropped, it goes into the outbox.
#[derive(Debug)]
pub struct Finished {
    lease: Option<Lease>,
    measurements: Measurements,
    outcome: Outcome,
    attempts: u32,
}

impl Finished {
    /// The message for a stream; `None` when there is no trial to report to.
    pub(crate) fn request(&self) -> Option<treewright_proto::v1::ReportRequest> {
        self.lease.as_ref().map(|lease| report_request(&lease.trial, &self.measurements, &self.outcome))
    }

    /// False in the child of a fork, whose parent reports it.
    pub(crate) fn is_of_this_process(&self) -> bool {
        self.lease.as_ref().is_none_or(|lease| lease.study.core.is_of_this_process())
    }

    /// The worker that ran the trial, and so may ask for the next; `None` when there was no trial.
    pub(crate) fn worker(&self) -> Option<Arc<Worker>> {
        self.lease.as_ref().map(|lease| Arc::clone(&lease.worker))
    }

    /// It is being sent outside the outbox.
    pub(crate) fn note_attempt(&mut self) {
        if let Some(lease) = &self.lease {
            let counters = &lease.study.core.counters;
            counters.sent.add(1);
            counters.resent.add(usize::from(self.attempts > 0));
            self.attempts += 1;
        }
    }

    /// The daemon has it.
    pub(crate) fn acknowledged(mut self, duplicate: bool) {
        if let Some(lease) = self.lease.take() {
            lease.study.core.counters.acknowledged.add(1);
            lease.study.core.counters.duplicates.add(usize::from(duplicate));
        }
    }

    /// The daemon will never have it.
    pub(crate) fn refused(mut self, problem: &ClientError) {
        if let Some(lease) = self.lease.take() {
            tracing::warn!(trial = %lease.trial, %problem, "a report is given up");
            lease.study.core.counters.refused.add(1);
            lease.study.core.counters.note(problem);
        }
    }
}

impl Drop for Finished {
    fn drop(&mut self) {
        if let Some(lease) = self.lease.take().filter(|lease| lease.study.core.is_of_this_process()) {
            let message = Message::Report(std::mem::take(&mut self.measurements), self.outcome.clone());
            let core = &lease.study.core;
            core.count_lost(core.outbox.report(OutboxItem {
                study: Arc::clone(&lease.study.name),
                worker: Arc::clone(lease.worker.name()),
                trial: Arc::clone(&lease.trial),
                message,
                attempts: self.attempts,
            }));
        }
    }
}

/// Our hold on a trial. The last one dropped without a result gives the trial back.
#[derive(Debug)]
pub(crate) struct Lease {
    study: Arc<StudyContext>,
    trial: Arc<str>,
    /// Free for the next trial as soon as what this one came to is in the outbox.
    worker: Arc<Worker>,
}

impl Lease {
    /// Takes hold; `None` when this client is just reporting that trial or giving it back.
    pub(crate) fn take(study: &Arc<StudyContext>, trial: &str, worker: &Arc<Worker>) -> Option<Self> {
        let (trial, worker) = (Arc::from(trial), Arc::clone(worker));
        study.core.outbox.hold(&trial).then(|| Self { study: Arc::clone(study), trial, worker })
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        let core = &self.study.core;
        if !core.is_of_this_process() {
            return;
        }
        core.count_lost(core.outbox.release(&self.study.name, self.worker.name(), &self.trial));
    }
}
