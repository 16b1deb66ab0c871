//! The client for programs without a tokio runtime: calls return when they are done.
//!
//! One thread drives the network, the outbox and the timers; calls wait on the caller's own thread.
//! [`crate::Suggestion::report`] and dropping a suggestion never block, as in the asynchronous client.
//!
//! When the client and its last study are dropped, queued reports are sent for at most two more seconds.
//!
//! The child of a fork has none of its parent's threads, and must not speak on its parent's connection.
//! Handles find out in which process they are used: in a child they connect again, as workers of their own
//! under the client's name. Suggestions, queued reports and pages of trials under way stay with the parent.

mod per_process;
mod runtime;

use std::sync::Arc;
use std::time::Duration;

use per_process::{OfProcess, PerProcess};
use runtime::RuntimeThread;

use crate::{
    Best, ChangedSpace, ClientError, Configuration, Fingerprint, Finished, FrontQuery, Indicators,
    Measurements, Options, Outcome, ParetoFront, PolicyChange, Prediction, Question, SessionPolicy, Space,
    Stats, Status, StudyRecord, StudySpec, Suggestion, TextChange, TrialQuery, TrialRecord,
};

/// See [`crate::Client`]. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Client {
    connected: Arc<PerProcess<ConnectedClient>>,
}

/// A client with the thread that drives it, of one process.
#[derive(Debug)]
struct ConnectedClient {
    // Dropped before the thread, whose end waits for the outbox.
    client: crate::Client,
    thread: Arc<RuntimeThread>,
}

impl ConnectedClient {
    fn connect(url: &str, options: Options) -> Result<Self, ClientError> {
        let thread = RuntimeThread::start()?;
        let client = thread.run(async || crate::Client::connect(url, options))?;
        thread.flush_at_the_end(&client);
        Ok(Self { client, thread: Arc::new(thread) })
    }

    /// Connects again, in another process.
    fn again(&self) -> Result<Self, ClientError> {
        Self::connect(self.client.url(), self.client.core.options.clone())
    }
}

/// Calls that wait for those of the asynchronous client, under its names.
macro_rules! calls {
    ($of:ident: $(fn $name:ident($($argument:ident: $type:ty),*) -> $answer:ty;)+) => {
        $(
            #[doc = concat!("See [`crate::", stringify!($of), "::", stringify!($name), "`]. Errors: as there.")]
            pub fn $name(&self, $($argument: $type),*) -> Result<$answer, ClientError> {
                self.run(async |asked| asked.$name($($argument),*).await)
            }
        )+
    };
}

impl Client {
    calls! { Client:
        fn flush(deadline: Duration) -> ();
        fn ping() -> Duration;
        fn list_studies() -> Vec<StudyRecord>;
        fn get_study(id: &str) -> StudyRecord;
        fn update_policy(id: &str, change: &PolicyChange) -> StudyRecord;
        fn update_texts(id: &str, change: &TextChange) -> StudyRecord;
        fn rename_study(id: &str, to: &str) -> StudyRecord;
        fn change_space(id: &str, revision: u32, space: &Space, fixed: &Configuration,
            only_try: bool) -> ChangedSpace;
        fn delete_study(id: &str) -> ();
        fn predict(study: &str, indicators: &Indicators) -> Prediction;
        fn best(study: &str, indicators: &Indicators) -> Best;
        fn front(study: &str, query: &FrontQuery) -> ParetoFront;
        fn create_study(id: &str, spec: &StudySpec) -> StudyRecord;
        fn ask(study: &str, question: &Question) -> TrialRecord;
        fn tell(trial: &str, measurements: &Measurements, outcome: &Outcome) -> (TrialRecord, bool);
        fn give_back(trial: &str) -> TrialRecord;
        fn exclude(trial: &str, reason: Option<&str>) -> TrialRecord;
        fn renew(trial: &str) -> TrialRecord;
        fn trial(trial: &str) -> TrialRecord;
        fn trial_in_state(study: &str, state_id: i64) -> Option<TrialRecord>;
        fn best_of_state(study: &str, state_id: i64) -> Option<Best>;
    }

    /// Makes a client with a thread of its own; see [`crate::Client::connect`].
    ///
    /// Errors: [`ClientError::BadUrl`], [`ClientError::Invalid`]; [`ClientError::NoRuntime`] when the thread
    /// cannot be started, which in the child of a fork is an error of each call there.
    pub fn connect(url: &str, options: Options) -> Result<Self, ClientError> {
        let connected = ConnectedClient::connect(url, options)?;
        Ok(Self { connected: Arc::new(PerProcess::new(connected)) })
    }

    /// This process's client, made at its first call. Errors: [`ClientError::NoRuntime`].
    fn here(&self) -> Result<&ConnectedClient, ClientError> {
        self.connected.get(ConnectedClient::again)
    }

    /// See [`crate::Client::study`]. Errors: as there.
    pub fn study(&self, id: &str, spec: StudySpec) -> Result<Study, ClientError> {
        self.study_by(async |client| client.study(id, spec).await)
    }

    /// See [`crate::Client::existing_study`]. Errors: as there.
    pub fn existing_study(&self, id: &str) -> Result<Study, ClientError> {
        self.study_by(async |client| client.existing_study(id).await)
    }

    /// See [`crate::Client::url`].
    pub fn url(&self) -> &str {
        self.first().url()
    }

    /// See [`crate::Client::fingerprint`].
    pub fn fingerprint(&self) -> &Fingerprint {
        self.first().fingerprint()
    }

    /// See [`crate::Client::status`].
    pub fn status(&self) -> Status {
        self.here().map_or_else(|_| self.first().status(), |here| here.client.status())
    }

    /// See [`crate::Client::stats`].
    pub fn stats(&self) -> Stats {
        self.here().map_or_else(|_| self.first().stats(), |here| here.client.stats())
    }

    /// Reads trials one after the other; pages are fetched as they are needed. See [`crate::Client::trials`].
    pub fn trials(&self, study: &str, query: TrialQuery) -> Trials {
        let pages = self.here().map(|here| (here.client.trials(study, query), Arc::clone(&here.thread)));
        Trials { pages: Some(OfProcess::new(pages)) }
    }

    /// See [`Suggestion::extend_lease`]. Errors: as there.
    pub fn extend_lease(&self, suggestion: &mut Suggestion) -> Result<(), ClientError> {
        self.here()?.thread.run(async || suggestion.extend_lease().await)
    }

    fn first(&self) -> &crate::Client {
        &self.connected.first().client
    }

    fn run<T>(
        &self,
        call: impl AsyncFnOnce(&crate::Client) -> Result<T, ClientError>,
    ) -> Result<T, ClientError> {
        let here = self.here()?;
        here.thread.run(async || call(&here.client).await)
    }

    fn study_by(
        &self,
        call: impl AsyncFnOnce(&crate::Client) -> Result<crate::Study, ClientError>,
    ) -> Result<Study, ClientError> {
        let study = self.run(call)?;
        Ok(Study { client: self.clone(), study: Arc::new(PerProcess::new(study)) })
    }
}

/// See [`crate::Study`]. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Study {
    // Dropped before the client, whose end waits for the outbox.
    study: Arc<PerProcess<crate::Study>>,
    client: Client,
}

impl Study {
    calls! { Study:
        fn trial_of(indicators: &Indicators, configuration: &Configuration) -> Suggestion;
        fn predict(indicators: &Indicators) -> Prediction;
        fn best(indicators: &Indicators) -> Best;
        fn front(query: &FrontQuery) -> ParetoFront;
        fn record() -> StudyRecord;
    }

    /// See [`crate::Study::name`].
    pub fn name(&self) -> &str {
        self.study.first().name()
    }

    /// See [`crate::Study::identified_name`].
    pub fn identified_name(&self) -> String {
        self.here().unwrap_or_else(|_| self.study.first()).identified_name()
    }

    /// See [`crate::Study::spec`].
    pub fn spec(&self) -> &StudySpec {
        self.study.first().spec()
    }

    /// See [`crate::Study::set_session_policy`]. Errors: as there.
    pub fn set_session_policy(&self, policy: SessionPolicy) -> Result<(), ClientError> {
        self.here()?.set_session_policy(policy)
    }

    /// See [`crate::Study::set_start`]. Errors: as there.
    pub fn set_start(&self, start: Option<&Configuration>) -> Result<(), ClientError> {
        self.here()?.set_start(start)
    }

    /// See [`crate::Study::policy_differs`].
    pub fn policy_differs(&self) -> Vec<String> {
        self.here().map(crate::Study::policy_differs).unwrap_or_default()
    }

    /// See [`crate::Study::suggest`]: answers within the deadline, whatever happens.
    pub fn suggest(&self, indicators: &Indicators) -> Suggestion {
        let answer = self.run(async |study| Ok(study.suggest(indicators).await));
        answer.unwrap_or_else(|problem| self.fall_back(indicators, problem))
    }

    /// See [`crate::Study::tuner`].
    pub fn tuner(&self) -> Tuner {
        Tuner { tuner: None, study: self.clone() }
    }

    /// See [`crate::Study::prefetching_tuner`].
    pub fn prefetching_tuner(&self) -> PrefetchingTuner {
        PrefetchingTuner { tuner: None, study: self.clone() }
    }

    fn here(&self) -> Result<&crate::Study, ClientError> {
        self.study.get(|study| Ok(study.again(&self.client.here()?.client)))
    }

    fn run<T>(
        &self,
        call: impl AsyncFnOnce(&crate::Study) -> Result<T, ClientError>,
    ) -> Result<T, ClientError> {
        let study = self.here()?;
        self.client.here()?.thread.run(async || call(study).await)
    }

    /// Where there is no thread to ask with.
    fn fall_back(&self, indicators: &Indicators, problem: ClientError) -> Suggestion {
        self.study.first().shared.fall_back(indicators, Arc::new(problem))
    }
}

/// See [`crate::Tuner`].
#[derive(Debug)]
pub struct Tuner {
    /// Made in the process that uses it.
    tuner: Option<OfProcess<crate::Tuner>>,
    // The last field: fields dropped before it still find the thread.
    study: Study,
}

impl Tuner {
    /// See [`crate::Tuner::next`]: answers within the deadline, whatever happens.
    pub fn next(&mut self, indicators: &Indicators, previous: Option<Finished>) -> Suggestion {
        let Self { tuner, study } = self;
        let answer = study.run(async |own| {
            let tuner = OfProcess::of_this(tuner, || own.tuner());
            let previous = previous.filter(Finished::is_of_this_process);
            Ok(tuner.next(indicators, previous).await)
        });
        answer.unwrap_or_else(|problem| study.fall_back(indicators, problem))
    }
}

/// See [`crate::PrefetchingTuner`].
#[derive(Debug)]
pub struct PrefetchingTuner {
    /// Made in the process that uses it.
    tuner: Option<OfProcess<crate::PrefetchingTuner>>,
    // The last field: fields dropped before it still find the thread.
    study: Study,
}

impl PrefetchingTuner {
    /// See [`crate::PrefetchingTuner::wait`].
    pub fn wait(&mut self, indicators: &Indicators, patience: Duration) -> bool {
        let Self { tuner, study } = self;
        let waited = study.run(async |own| {
            let tuner = OfProcess::of_this(tuner, || own.prefetching_tuner());
            Ok(tuner.wait(indicators, patience).await)
        });
        waited.unwrap_or(false)
    }

    /// See [`crate::PrefetchingTuner::next`]: returns at once.
    pub fn next(&mut self, indicators: &Indicators, previous: Option<Finished>) -> Suggestion {
        self.next_before(indicators, indicators, previous)
    }

    /// See [`crate::PrefetchingTuner::next_before`]: returns at once.
    pub fn next_before(
        &mut self,
        indicators: &Indicators,
        upcoming: &Indicators,
        previous: Option<Finished>,
    ) -> Suggestion {
        let Self { tuner, study } = self;
        let answer = study.run(async |own| {
            let tuner = OfProcess::of_this(tuner, || own.prefetching_tuner());
            let previous = previous.filter(Finished::is_of_this_process);
            Ok(tuner.next_before(indicators, upcoming, previous))
        });
        answer.unwrap_or_else(|problem| study.fall_back(indicators, problem))
    }
}

/// Trials one after the other. Ends after the first error.
#[derive(Debug)]
pub struct Trials {
    pages: Option<OfProcess<Result<PagesWithThread, ClientError>>>,
}

type PagesWithThread = (crate::TrialPages, Arc<RuntimeThread>);

impl Iterator for Trials {
    type Item = Result<TrialRecord, ClientError>;

    fn next(&mut self) -> Option<Self::Item> {
        let pages = self.pages.as_mut()?;
        let next = pages.here("reading trials").and_then(|pages| {
            let (pages, thread) = pages.as_mut().map_err(|problem| problem.clone())?;
            thread.run(async || pages.next().await)
        });
        let next = next.transpose();
        if !matches!(next, Some(Ok(_))) {
            self.pages = None;
        }
        next
    }
}
