//! The same client for programs without a tokio runtime: calls return when they are done.
//!
//! One thread drives the network, the outbox and the timers; calls wait on the caller's own thread. What the
//! asynchronous client never lets block ([`crate::Suggestion::report`], dropping a suggestion) does not block here.
//!
//! When the client and its last study are dropped, queued reports are sent for at most two more seconds.

mod runtime;

use std::sync::Arc;
use std::time::Duration;

use runtime::RuntimeThread;

use crate::{
    Best, ClientError, Configuration, Finished, Indicators, Measurements, Options, Outcome, PolicyChange,
    Prediction, Question, SessionPolicy, Side, Stats, Status, StudyRecord, StudySpec, Suggestion, TrialQuery,
    TrialRecord,
};

/// See [`crate::Client`]. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Client {
    // Dropped before the thread, whose end waits for the outbox.
    client: crate::Client,
    thread: Arc<RuntimeThread>,
}

impl Client {
    /// Makes a client with a thread of its own; see [`crate::Client::connect`].
    ///
    /// Errors: [`ClientError::BadUrl`], [`ClientError::Invalid`]; [`ClientError::NoRuntime`] when the thread cannot be started.
    pub fn connect(url: &str, options: Options) -> Result<Self, ClientError> {
        let thread = RuntimeThread::start()?;
        let client = thread.run(async || crate::Client::connect(url, options))?;
        thread.flush_at_the_end(&client);
        Ok(Self { client, thread: Arc::new(thread) })
    }

    /// See [`crate::Client::study`]. Errors: as there.
    pub fn study(&self, id: &str, spec: StudySpec) -> Result<Study, ClientError> {
        Ok(self.wrap(self.thread.run(async || self.client.study(id, spec).await)?))
    }

    /// See [`crate::Client::existing_study`]. Errors: as there.
    pub fn existing_study(&self, id: &str) -> Result<Study, ClientError> {
        Ok(self.wrap(self.thread.run(async || self.client.existing_study(id).await)?))
    }

    /// See [`crate::Client::url`].
    #[must_use]
    pub fn url(&self) -> &str {
        self.client.url()
    }

    /// See [`crate::Client::status`].
    #[must_use]
    pub fn status(&self) -> Status {
        self.client.status()
    }

    /// See [`crate::Client::stats`].
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.client.stats()
    }

    /// See [`crate::Client::flush`]. Errors: as there.
    pub fn flush(&self, deadline: Duration) -> Result<(), ClientError> {
        self.thread.run(async || self.client.flush(deadline).await)
    }

    /// See [`crate::Client::ping`]. Errors: as there.
    pub fn ping(&self) -> Result<Duration, ClientError> {
        self.thread.run(async || self.client.ping().await)
    }

    /// See [`crate::Client::list_studies`]. Errors: as there.
    pub fn list_studies(&self) -> Result<Vec<StudyRecord>, ClientError> {
        self.thread.run(async || self.client.list_studies().await)
    }

    /// See [`crate::Client::get_study`]. Errors: as there.
    pub fn get_study(&self, id: &str) -> Result<StudyRecord, ClientError> {
        self.thread.run(async || self.client.get_study(id).await)
    }

    /// See [`crate::Client::update_policy`]. Errors: as there.
    pub fn update_policy(&self, id: &str, change: &PolicyChange) -> Result<StudyRecord, ClientError> {
        self.thread.run(async || self.client.update_policy(id, change).await)
    }

    /// See [`crate::Client::delete_study`]. Errors: as there.
    pub fn delete_study(&self, id: &str) -> Result<(), ClientError> {
        self.thread.run(async || self.client.delete_study(id).await)
    }

    /// Reads trials one after the other; pages are fetched as they are needed. See [`crate::Client::trials`].
    #[must_use]
    pub fn trials(&self, study: &str, query: TrialQuery) -> Trials {
        Trials { pages: Some(self.client.trials(study, query)), thread: Arc::clone(&self.thread) }
    }

    /// See [`crate::Client::predict`]. Errors: as there.
    pub fn predict(&self, study: &str, indicators: &Indicators) -> Result<Prediction, ClientError> {
        self.thread.run(async || self.client.predict(study, indicators).await)
    }

    /// See [`crate::Client::best`]. Errors: as there.
    pub fn best(&self, study: &str, indicators: &Indicators) -> Result<Best, ClientError> {
        self.thread.run(async || self.client.best(study, indicators).await)
    }

    /// See [`Suggestion::extend_lease`]. Errors: as there.
    pub fn extend_lease(&self, suggestion: &mut Suggestion) -> Result<(), ClientError> {
        self.thread.run(async || suggestion.extend_lease().await)
    }

    /// See [`crate::Client::create_study`]. Errors: as there.
    pub fn create_study(&self, id: &str, spec: &StudySpec) -> Result<StudyRecord, ClientError> {
        self.thread.run(async || self.client.create_study(id, spec).await)
    }

    /// See [`crate::Client::ask`]. Errors: as there.
    pub fn ask(&self, study: &str, question: &Question) -> Result<TrialRecord, ClientError> {
        self.thread.run(async || self.client.ask(study, question).await)
    }

    /// See [`crate::Client::tell`]. Errors: as there.
    pub fn tell(
        &self,
        trial: &str,
        measurements: &Measurements,
        outcome: &Outcome,
    ) -> Result<(TrialRecord, bool), ClientError> {
        self.thread.run(async || self.client.tell(trial, measurements, outcome).await)
    }

    /// See [`crate::Client::give_back`]. Errors: as there.
    pub fn give_back(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        self.thread.run(async || self.client.give_back(trial).await)
    }

    /// See [`crate::Client::renew`]. Errors: as there.
    pub fn renew(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        self.thread.run(async || self.client.renew(trial).await)
    }

    /// See [`crate::Client::trial`]. Errors: as there.
    pub fn trial(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        self.thread.run(async || self.client.trial(trial).await)
    }

    /// See [`crate::Client::trial_in_state`]. Errors: as there.
    pub fn trial_in_state(&self, study: &str, state_id: i64) -> Result<Option<TrialRecord>, ClientError> {
        self.thread.run(async || self.client.trial_in_state(study, state_id).await)
    }

    /// See [`crate::Client::best_of_state`]. Errors: as there.
    pub fn best_of_state(&self, study: &str, state_id: i64) -> Result<Option<Best>, ClientError> {
        self.thread.run(async || self.client.best_of_state(study, state_id).await)
    }

    fn wrap(&self, study: crate::Study) -> Study {
        Study { study, thread: Arc::clone(&self.thread) }
    }
}

/// See [`crate::Study`]. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Study {
    study: crate::Study,
    thread: Arc<RuntimeThread>,
}

impl Study {
    /// See [`crate::Study::name`].
    #[must_use]
    pub fn name(&self) -> &str {
        self.study.name()
    }

    /// See [`crate::Study::spec`].
    #[must_use]
    pub fn spec(&self) -> &StudySpec {
        self.study.spec()
    }

    /// See [`crate::Study::set_session_policy`]. Errors: as there.
    pub fn set_session_policy(&self, policy: SessionPolicy) -> Result<(), ClientError> {
        self.study.set_session_policy(policy)
    }

    /// See [`crate::Study::policy_differs`].
    #[must_use]
    pub fn policy_differs(&self) -> Vec<String> {
        self.study.policy_differs()
    }

    /// See [`crate::Study::suggest`]: answers within the deadline, whatever happens.
    pub fn suggest(&self, indicators: &Indicators) -> Suggestion {
        self.thread.run(async || self.study.suggest(indicators).await)
    }

    /// See [`crate::Study::trial_of`]. Errors: as there.
    pub fn trial_of(
        &self,
        indicators: &Indicators,
        configuration: &Configuration,
    ) -> Result<Suggestion, ClientError> {
        self.thread.run(async || self.study.trial_of(indicators, configuration).await)
    }

    /// See [`crate::Study::paired`].
    #[must_use]
    pub fn paired(
        &self,
        indicators: &Indicators,
        incumbent: &Configuration,
        challenger: &Configuration,
    ) -> Paired {
        let paired = self.study.paired(indicators, incumbent, challenger);
        Paired { paired, thread: Arc::clone(&self.thread) }
    }

    /// See [`crate::Study::tuner`].
    #[must_use]
    pub fn tuner(&self) -> Tuner {
        let tuner = self.thread.run(async || self.study.tuner());
        Tuner { tuner, thread: Arc::clone(&self.thread) }
    }

    /// See [`crate::Study::prefetching_tuner`]. Errors: as there.
    pub fn prefetching_tuner(&self) -> Result<PrefetchingTuner, ClientError> {
        let tuner = self.thread.run(async || self.study.prefetching_tuner())?;
        Ok(PrefetchingTuner { tuner, _thread: Arc::clone(&self.thread) })
    }

    /// See [`crate::Study::predict`]. Errors: as there.
    pub fn predict(&self, indicators: &Indicators) -> Result<Prediction, ClientError> {
        self.thread.run(async || self.study.predict(indicators).await)
    }

    /// See [`crate::Study::best`]. Errors: as there.
    pub fn best(&self, indicators: &Indicators) -> Result<Best, ClientError> {
        self.thread.run(async || self.study.best(indicators).await)
    }

    /// See [`crate::Study::record`]. Errors: as there.
    pub fn record(&self) -> Result<StudyRecord, ClientError> {
        self.thread.run(async || self.study.record().await)
    }
}

/// See [`crate::Tuner`].
#[derive(Debug)]
pub struct Tuner {
    tuner: crate::Tuner,
    thread: Arc<RuntimeThread>,
}

impl Tuner {
    /// See [`crate::Tuner::next`]: answers within the deadline, whatever happens.
    pub fn next(&mut self, indicators: &Indicators, previous: Option<Finished>) -> Suggestion {
        let tuner = &mut self.tuner;
        self.thread.run(async move || tuner.next(indicators, previous).await)
    }
}

/// See [`crate::Paired`].
#[derive(Debug)]
pub struct Paired {
    paired: crate::Paired,
    thread: Arc<RuntimeThread>,
}

impl Paired {
    /// See [`crate::Paired::ask`]. Errors: as there.
    pub fn ask(&mut self) -> Result<(Side, Suggestion), ClientError> {
        let paired = &mut self.paired;
        self.thread.run(async move || paired.ask().await)
    }
}

/// See [`crate::PrefetchingTuner`].
#[derive(Debug)]
pub struct PrefetchingTuner {
    // Dropped before the thread, whose end waits for the outbox.
    tuner: crate::PrefetchingTuner,
    _thread: Arc<RuntimeThread>,
}

impl PrefetchingTuner {
    /// See [`crate::PrefetchingTuner::next`]: returns at once.
    pub fn next(&mut self, indicators: &Indicators, previous: Option<Finished>) -> Suggestion {
        self.tuner.next(indicators, previous)
    }

    /// See [`crate::PrefetchingTuner::next_before`]: returns at once.
    pub fn next_before(
        &mut self,
        indicators: &Indicators,
        upcoming: &Indicators,
        previous: Option<Finished>,
    ) -> Suggestion {
        self.tuner.next_before(indicators, upcoming, previous)
    }
}

/// Trials one after the other. Ends after the first error.
#[derive(Debug)]
pub struct Trials {
    pages: Option<crate::TrialPages>,
    thread: Arc<RuntimeThread>,
}

impl Iterator for Trials {
    type Item = Result<TrialRecord, ClientError>;

    fn next(&mut self) -> Option<Self::Item> {
        let pages = self.pages.as_mut()?;
        let next = self.thread.run(async || pages.next().await).transpose();
        if !matches!(next, Some(Ok(_))) {
            self.pages = None;
        }
        next
    }
}
