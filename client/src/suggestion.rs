//! A suggestion: the configuration to run next and, if it came from the daemon, a trial under a lease.

use std::sync::{Arc, Weak};
use std::time::SystemTime;

use crate::delivery::report_request;
use crate::episode::Episode;
use crate::outbox::{Message, OutboxItem};
use crate::prepared::SetUpClaim;
use crate::study_context::StudyContext;
use crate::workers::Worker;
use crate::{
    ClientError, Configuration, Indicators, Measurements, Mode, OpenEnum, Outcome, Reason, Rule, SharedError,
    TrialRecord, checks,
};

/// Where a configuration came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The daemon, in time.
    Daemon,
    /// The daemon did not answer. In a state in which anything ran in this process, this is the daemon's
    /// latest answer that ran there and has not failed since, else the cheapest configuration that did. In
    /// another state it is the latest answer that ran elsewhere and failed nowhere.
    LastGood,
    /// The daemon did not answer, and there is none of these. It is the program's start
    /// ([`crate::Study::set_start`]), or without one the space's recommended values.
    Default,
}

/// A configuration to run next. If it came from the daemon it holds a trial: report the result with
/// [`Suggestion::report`], or drop it, which gives the trial back. Neither ever blocks.
///
/// A suggestion that did not come from the daemon ([`Suggestion::source`]) is used alike, but there is no
/// trial that its result could be reported to. Such results are only counted ([`crate::Stats::unreported`]).
#[derive(Debug)]
#[must_use = "a dropped suggestion gives its trial back"]
pub struct Suggestion {
    study: Arc<StudyContext>,
    indicators: Indicators,
    configuration: Configuration,
    source: Source,
    mode: OpenEnum<Mode>,
    predicted_cost: Option<f64>,
    reason: Reason,
    problem: Option<SharedError>,
    lease: Option<Lease>,
    lease_expire_time: Option<SystemTime>,
    abort_above: Option<f64>,
    fidelity: Option<String>,
    /// Of a frame loop whose trials have several frames.
    episode: Option<Box<Episode>>,
    /// From when the program gets it.
    set_up: Option<SetUpClaim>,
}

impl Suggestion {
    pub(crate) fn of_trial(study: Arc<StudyContext>, trial: TrialRecord, lease: Lease) -> Self {
        Self {
            study,
            indicators: trial.indicators,
            configuration: trial.configuration,
            source: Source::Daemon,
            mode: trial.mode,
            predicted_cost: trial.predicted_cost,
            reason: trial.reason,
            problem: None,
            lease: Some(lease),
            lease_expire_time: trial.lease_expire_time,
            abort_above: trial.abort_above,
            fidelity: trial.fidelity,
            episode: None,
            set_up: None,
        }
    }

    pub(crate) fn fallback(study: Arc<StudyContext>, indicators: &Indicators, problem: SharedError) -> Self {
        let last_good = study.last_good(indicators);
        let start = study.start();
        let (source, mode, what) = match (&last_good, &start) {
            (Some(_), _) => (Source::LastGood, Mode::Exploit, "the last good configuration"),
            (None, Some(_)) => (Source::Default, Mode::Default, "the program's own default"),
            (None, None) => (Source::Default, Mode::Default, "the recommended values"),
        };
        let recommended = || study.spec.space.default_configuration().into();
        let configuration = last_good.or(start).unwrap_or_else(recommended);
        let summary = format!("{what}, because of: {problem}");
        let reason = Reason { summary, source: "fallback".into(), ..Reason::default() };
        let problem = Some(problem);
        Self {
            study,
            indicators: indicators.clone(),
            configuration,
            source,
            mode: mode.into(),
            predicted_cost: None,
            reason,
            problem,
            lease: None,
            lease_expire_time: None,
            abort_above: None,
            fidelity: None,
            episode: None,
            set_up: None,
        }
    }

    /// On its way to the program.
    pub(crate) fn handed_out(mut self) -> Self {
        let part = self.study.spec.space.setup_part(self.configuration.as_raw());
        self.set_up = Some(SetUpClaim::new(&self.study.set_ups, (part, self.fidelity.clone())));
        self
    }

    pub(crate) fn first_frame(mut self, indicators: &Indicators) -> Self {
        let frames = self.study.spec.objective.episode_frames();
        if frames > 1 && self.lease.is_some() {
            let episode = Episode::new(frames, indicators, self.lease_expire_time);
            let episode = if self.fidelity.is_none() { episode } else { episode.without_limits() };
            self.episode = Some(Box::new(episode));
        }
        self
    }

    /// Whether the trial has no frame after this one.
    pub(crate) fn is_last_frame(&self) -> bool {
        self.episode.as_ref().is_none_or(|episode| episode.has_one_frame_left())
    }

    /// The state of the frames after this one, while there may be any; nothing for the last frame.
    pub(crate) fn state_of_next_frames(&self) -> Weak<Indicators> {
        let episode = self.episode.as_ref().filter(|episode| !episode.has_one_frame_left());
        episode.map_or_else(Weak::new, |episode| episode.state())
    }

    /// Renews the lease in the background, where a third of it is over: no frame waits for it. Without a
    /// daemon it stays due.
    fn keep_lease(&mut self) {
        let core = &self.study.core;
        let (Some(lease), Some(episode)) = (&self.lease, &mut self.episode) else { return };
        if core.circuit_breaker.problem().is_none() && episode.renewal_is_due() {
            let (core, trial) = (Arc::clone(core), Arc::clone(&lease.trial));
            self.study.core.runtime.spawn(async move {
                if let Err(problem) = core.extend_lease(&trial).await {
                    core.counters.note(&problem);
                }
            });
        }
    }

    /// The configuration to run with.
    pub fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// Where it came from.
    pub fn source(&self) -> Source {
        self.source
    }

    /// Why this configuration. Fallbacks are [`Mode::Exploit`] or [`Mode::Default`].
    pub fn mode(&self) -> OpenEnum<Mode> {
        self.mode
    }

    /// Predicted objective, in the objective's units, where something is known.
    pub fn predicted_cost(&self) -> Option<f64> {
        self.predicted_cost
    }

    /// Stop as soon as the objective exceeds this, and report [`Outcome::aborted`] with the value reached by
    /// then. The service learns from it that the configuration costs at least as much. `None`: never. See
    /// [`crate::FrameSet`] for frames that are run several times.
    ///
    /// Where the study's trials have several frames it is the cost of this frame from which on their mean
    /// must be above the trial's bound.
    pub fn abort_above(&self) -> Option<f64> {
        match &self.episode {
            Some(episode) => self.abort_above.map(|cap| episode.frame_cap(cap)),
            None => self.abort_above,
        }
    }

    /// The cheaper level of the study at which to run; `None` for a full trial, as all are unless
    /// [`crate::Options::fidelities`] is set. What is measured there only says whether the configuration is
    /// worth a full trial.
    pub fn fidelity(&self) -> Option<&str> {
        self.fidelity.as_deref()
    }

    /// Whether the program's set-up for the suggestion before serves this one. Then that one was measured to
    /// its end, at this level, with these values of all parameters that need a set-up
    /// ([`crate::Parameter::setup`]). Where it is true only the run is left to do, unless the program's input
    /// has changed. Of a trial of several frames it is true from the second on.
    ///
    /// It is false for the first suggestion, also where no parameter needs a set-up. It is false after one
    /// that was given back, aborted, infeasible or failed. It is false for all once a process has run trials
    /// of the study side by side. A program that keeps several set-ups compares [`crate::Space::setup_part`]
    /// itself.
    pub fn is_prepared(&self) -> bool {
        self.set_up.as_ref().is_some_and(|set_up| set_up.is_prepared)
    }

    /// The reason of the answer.
    pub fn reason(&self) -> &Reason {
        &self.reason
    }

    /// Why the daemon was not the source; `None` when it was.
    pub fn problem(&self) -> Option<&ClientError> {
        self.problem.as_deref()
    }

    /// Name of the trial, `studies/{study}/trials/{trial}`; `None` for fallbacks.
    pub fn trial(&self) -> Option<&str> {
        self.lease.as_ref().map(|lease| &*lease.trial)
    }

    /// Until when the result is wanted, by the daemon's clock. Later results are taken and flagged late.
    pub fn lease_expire_time(&self) -> Option<SystemTime> {
        self.lease_expire_time
    }

    /// Joins the result to the trial, for [`crate::Tuner::next`]. Dropping what this returns reports it, too.
    ///
    /// Where the study's trials have several frames and a frame loop gave the suggestion, this is the result
    /// of one frame. Dropping the returned value before the last frame gives the trial back.
    ///
    /// Errors: [`ClientError::Invalid`] when the service would refuse the result, e.g. a measurement that is
    /// not finite; the trial is then given back. Also in the child of a fork, whose parent was given the
    /// trial and goes on with it.
    pub fn finished(mut self, measurements: Measurements, outcome: Outcome) -> Result<Finished, ClientError> {
        self.is_ours()?;
        let is_full = self.fidelity.is_none();
        checks::result(&self.study.spec, is_full, &outcome, &measurements)?;
        let (measurements, outcome) = match self.episode.take() {
            None => (measurements, outcome),
            Some(mut episode) => {
                let spec = &self.study.spec;
                match episode.push(&spec.objective, self.abort_above, measurements, outcome) {
                    Some((means, outcome)) => {
                        checks::result(spec, is_full, &outcome, &means)?;
                        (means, outcome)
                    }
                    None => {
                        self.episode = Some(episode);
                        self.set_up.iter_mut().for_each(|set_up| set_up.is_prepared = true);
                        return Ok(Finished::unfinished(self));
                    }
                }
            }
        };
        // That the default ran is no news.
        if is_full && self.source != Source::Default {
            let is_answer = self.is_answer();
            self.study.learn(&self.indicators, &self.configuration, is_answer, &outcome, &measurements);
        }
        if let Some(set_up) = self.set_up.take().filter(|_| matches!(outcome, Outcome::Ok)) {
            set_up.done();
        }
        let lease = self.lease.take();
        match &lease {
            Some(lease) => self.study.core.outbox.mark_reported(&lease.trial),
            None => self.study.core.counters.unreported.add(1),
        }
        Ok(Finished { lease, measurements, outcome, attempts: 0, rest: None })
    }

    /// Puts the result into the outbox and returns at once; a background task delivers it.
    ///
    /// Errors: as for [`Suggestion::finished`]; [`ClientError::Invalid`], too, for a frame of a frame loop
    /// before the last one of its trial, which is then given back.
    pub fn report(self, measurements: Measurements, outcome: Outcome) -> Result<(), ClientError> {
        match self.finished(measurements, outcome)?.rest.take() {
            None => Ok(()),
            Some(_unfinished) => {
                let problem =
                    "its trial has more frames; hand what is finished to the next call of the frame loop";
                Err(ClientError::invalid("result", problem))
            }
        }
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

    /// Whether the daemon answered it, and neither explored nor let the program have its own way. The default
    /// is measured as a baseline, too, which is no answer.
    pub fn is_answer(&self) -> bool {
        use Rule::{Exploit, Finished, Frozen, Gain, RolledBack, Shadow};
        let rule = self.reason.explanation.rule.and_then(OpenEnum::known);
        let is_settled = matches!(rule, Some(Exploit | Finished | Frozen | Gain | RolledBack | Shadow));
        self.source == Source::Daemon
            && match self.mode.known() {
                Some(Mode::Exploit) => true,
                Some(Mode::Default) => is_settled,
                Some(Mode::Pinned) => rule != Some(Rule::Wanted),
                Some(Mode::Explore) | None => false,
            }
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

/// A trial with its result, on its way to the daemon. Dropped, it goes into the outbox. Or a trial that has
/// frames left, on its way to the next one. Dropped, it is given back.
#[derive(Debug)]
pub struct Finished {
    lease: Option<Lease>,
    measurements: Measurements,
    outcome: Outcome,
    attempts: u32,
    /// The trial, while it has frames left; there is nothing else then.
    rest: Option<Box<Suggestion>>,
}

impl Finished {
    fn unfinished(rest: Suggestion) -> Self {
        let (measurements, rest) = (Measurements::new(), Some(Box::new(rest)));
        Self { lease: None, measurements, outcome: Outcome::Ok, attempts: 0, rest }
    }

    /// The next frame of the trial, where that has frames left and the state lasts. A trial whose state is
    /// over is given back: the mean of its first frames would be wrong for costs that rise or fall.
    pub(crate) fn next_frame(
        previous: &mut Option<Self>,
        study: &Arc<StudyContext>,
        indicators: &Indicators,
    ) -> Option<Suggestion> {
        let mut rest = previous.as_mut()?.rest.take()?;
        *previous = None;
        let is_of_state = rest.episode.as_ref().is_some_and(|episode| episode.is_in(&study.spec, indicators));
        if !(is_of_state && Arc::ptr_eq(&rest.study, study)) {
            return None;
        }
        rest.keep_lease();
        Some(*rest)
    }

    /// The message for a stream; `None` when there is no trial to report to.
    pub(crate) fn request(&self) -> Option<treewright_proto::v1::ReportRequest> {
        self.lease.as_ref().map(|lease| report_request(&lease.trial, &self.measurements, &self.outcome))
    }

    /// False in the child of a fork, whose parent reports it.
    pub(crate) fn is_of_this_process(&self) -> bool {
        let lease = self.lease.as_ref().or_else(|| self.rest.as_ref()?.lease.as_ref());
        lease.is_none_or(|lease| lease.study.core.is_of_this_process())
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
