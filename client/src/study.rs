//! A study as a program holds it: ask for suggestions, and for what is known.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::{Semaphore, oneshot, watch};
use treewright_proto::convert::{configuration_to_wire, fingerprint_to_wire, session_policy_to_wire};
use treewright_proto::v1;

use crate::answer::{self, Answer, Outstanding};
use crate::client::LastHandle;
use crate::core::Core;
use crate::delivery::worth_repeating;
use crate::memory::RememberedConfigurations;
use crate::suggestion::Lease;
use crate::{
    Best, ClientError, Configuration, Indicators, Outcome, Paired, Prediction, PrefetchingTuner,
    SessionPolicy, SharedError, StudyRecord, StudySpec, Suggestion, Tuner, checks, limits, wire,
};

/// How often a suggestion is asked for again when the daemon names a trial that is just being reported.
const ASK_AGAIN: usize = 3;

/// A study of a client. Cheap to clone; clones share everything.
#[derive(Debug, Clone)]
pub struct Study {
    /// The late answer to an earlier question. Not among what suggestions share, because it holds one.
    outstanding: Arc<Mutex<Option<Outstanding>>>,
    pub(crate) shared: Arc<Shared>,
    // The last field: what is dropped before it still finds the outbox open.
    _last_handle: Arc<LastHandle>,
}

/// What a study's handles, suggestions and tuners share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) core: Arc<Core>,
    pub(crate) name: Arc<str>,
    pub(crate) spec: StudySpec,
    /// Whether the program specified the study, so that it may be created again when it is gone.
    ours: bool,
    registration: watch::Sender<Registration>,
    memory: Mutex<RememberedConfigurations>,
    session_policy: Mutex<SessionPolicy>,
    /// Where the stored policy is another than the one given; see [`Study::policy_differs`].
    policy_differs: Mutex<Vec<String>>,
    questions: Arc<Semaphore>,
}

/// Whether the daemon knows the study.
#[derive(Debug, Clone)]
enum Registration {
    /// Not yet; it is tried in the background.
    Pending,
    Done,
    /// It will not have it.
    Refused(SharedError),
}

impl Study {
    pub(crate) fn new(
        core: &Arc<Core>,
        last_handle: &Arc<LastHandle>,
        name: &str,
        spec: StudySpec,
        known: bool,
        ours: bool,
        differs: Vec<String>,
    ) -> Self {
        let registration = if known { Registration::Done } else { Registration::Pending };
        let shared = Arc::new(Shared {
            core: Arc::clone(core),
            name: Arc::from(name),
            spec,
            ours,
            registration: watch::Sender::new(registration),
            memory: Mutex::default(),
            session_policy: Mutex::default(),
            policy_differs: Mutex::new(differs),
            questions: Arc::new(Semaphore::new(limits::OUTSTANDING_SUGGESTIONS)),
        });
        if !known {
            tokio::spawn(Arc::clone(&shared).register());
        }
        Self { outstanding: Arc::default(), shared, _last_handle: Arc::clone(last_handle) }
    }

    /// The resource name, `studies/{study}`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.shared.name
    }

    /// What defines it.
    #[must_use]
    pub fn spec(&self) -> &StudySpec {
        &self.shared.spec
    }

    /// What this process wants for itself from now on, instead of what the study's policy says. It goes along with every
    /// question of this study's handles and holds for their answers alone: other clients are not concerned, and when the
    /// process ends, however it ends, nothing is left behind.
    ///
    /// Errors: [`ClientError::Invalid`] for a value out of its range.
    pub fn set_session_policy(&self, policy: SessionPolicy) -> Result<(), ClientError> {
        policy.validate().map_err(|problem| ClientError::invalid("session policy", problem.to_string()))?;
        *lock(&self.shared.session_policy) = policy;
        Ok(())
    }

    /// The fields of the policy given to [`crate::Client::study`] that differ from the stored policy, which stays as it
    /// is. Empty until the daemon has answered.
    #[must_use]
    pub fn policy_differs(&self) -> Vec<String> {
        lock(&self.shared.policy_differs).clone()
    }

    /// What to run next for these indicators, within the client's deadline ([`crate::Options::deadline`]): from the
    /// daemon; else the last good configuration; else the default. It never fails: what went wrong, be
    /// it a wrong indicator or an absent daemon, is told by [`Suggestion::problem`].
    ///
    /// An answer that comes too late is kept for the next call with the same state, or given back.
    pub async fn suggest(&self, indicators: &Indicators) -> Suggestion {
        let shared = &self.shared;
        let mut outstanding = lock(&self.outstanding).take();
        let suggestion =
            answer::within_deadline(shared, &mut outstanding, indicators, || shared.ask(indicators.clone()))
                .await;
        if outstanding.is_some() {
            *lock(&self.outstanding) = outstanding;
        }
        suggestion
    }

    /// A trial of a configuration of the program's own choice, e.g. to measure a winner once more or to try what
    /// is known from elsewhere. What it finds is learnt like anything else; the search goes on as it was.
    ///
    /// Unlike [`Study::suggest`] there is nothing to fall back on, so a daemon that answers that it cannot serve yet, because
    /// it is still loading the study, is asked again until the client's deadline. Errors: [`ClientError::Refused`] when the
    /// configuration does not fit the study's space, [`ClientError::Away`], [`ClientError::Late`].
    pub async fn trial_of(
        &self,
        indicators: &Indicators,
        configuration: &Configuration,
    ) -> Result<Suggestion, ClientError> {
        checks::state(&self.shared.spec, indicators)?;
        let core = &self.shared.core;
        let mut not_yet = None;
        let asked = async {
            loop {
                let problem = match self.shared.ask_once_told(indicators, Some(configuration)).await {
                    Ok(suggestion) => return Ok(suggestion),
                    Err(problem) => problem,
                };
                let Some(wait) = problem.retry_after().filter(|_| problem.is_unreachable()) else {
                    return Err(problem);
                };
                not_yet = Some(problem);
                core.back_off().sleep_at_least(1, Some(wait)).await;
            }
        };
        match tokio::time::timeout(core.options.deadline, asked).await {
            Ok(suggestion) => Ok(self.shared.deliver(suggestion?)),
            Err(_elapsed) => Err(not_yet.unwrap_or_else(|| core.late("Suggest", core.options.deadline))),
        }
    }

    /// Trials of two configurations in turn, for a comparison that drift and other load disturb least.
    pub fn paired(
        &self,
        indicators: &Indicators,
        incumbent: &Configuration,
        challenger: &Configuration,
    ) -> Paired {
        Paired::new(self, indicators, incumbent, challenger)
    }

    /// A per-frame loop, which reports and asks in one round trip.
    #[must_use]
    pub fn tuner(&self) -> Tuner {
        Tuner::new(self)
    }

    /// A per-frame loop whose calls never wait: what they answer was asked for a frame ago.
    ///
    /// Errors: [`ClientError::Invalid`] when the client's id is so long that no second one can be made of it.
    pub fn prefetching_tuner(&self) -> Result<PrefetchingTuner, ClientError> {
        PrefetchingTuner::new(self)
    }

    /// What would be exploited for these indicators. Writes nothing.
    ///
    /// Errors: [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub async fn predict(&self, indicators: &Indicators) -> Result<Prediction, ClientError> {
        self.shared.core.predict(&self.shared.name, indicators).await
    }

    /// The best configuration of the state with these indicators, or of all states when there are none.
    ///
    /// Errors: [`ClientError::Refused`] when nothing is measured there yet; [`ClientError::Away`], [`ClientError::Late`].
    pub async fn best(&self, indicators: &Indicators) -> Result<Best, ClientError> {
        self.shared.core.best(&self.shared.name, indicators).await
    }

    /// The study as the daemon has stored it.
    ///
    /// Errors: [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub async fn record(&self) -> Result<StudyRecord, ClientError> {
        self.shared.core.study_record(&self.shared.name).await
    }
}

impl Shared {
    /// Why there is no point in asking at the moment.
    pub(crate) fn problem(&self) -> Option<SharedError> {
        if let Registration::Refused(problem) = &*self.registration.borrow() {
            return Some(Arc::clone(problem));
        }
        if let Some(problem) = self.core.circuit_breaker.problem() {
            return Some(problem);
        }
        let reason = || format!("{} is not created there yet", self.name);
        match &*self.registration.borrow() {
            Registration::Pending => Some(Arc::new(ClientError::away(&self.core.url, reason()))),
            Registration::Done | Registration::Refused(_) => None,
        }
    }

    /// Hands a suggestion to the program.
    pub(crate) fn deliver(&self, suggestion: Suggestion) -> Suggestion {
        self.core.counters.suggestions.add(1);
        suggestion
    }

    /// Answers without the daemon.
    pub(crate) fn fall_back(self: &Arc<Self>, problem: SharedError) -> Suggestion {
        self.core.counters.fallbacks.add(1);
        self.core.counters.note(&problem);
        let last_good = lock(&self.memory).last_good().cloned();
        Suggestion::fallback(Arc::clone(self), last_good, problem)
    }

    /// Learns from a result what to fall back on.
    pub(crate) fn learn(&self, configuration: &Configuration, outcome: &Outcome) {
        match outcome {
            Outcome::Infeasible { .. } => lock(&self.memory).infeasible(configuration),
            Outcome::Ok => lock(&self.memory).feasible(configuration),
            Outcome::Aborted { .. } | Outcome::Failed { .. } => {}
        }
    }

    /// Turns a trial from the daemon into a suggestion.
    pub(crate) fn accept(self: &Arc<Self>, trial: v1::Trial) -> Answer {
        let malformed = |problem: String| self.core.malformed("Suggest", problem);
        let has_configuration = trial.configuration.is_some();
        let trial = wire::trial_from_wire(trial).map_err(malformed)?;
        let Some(lease) = Lease::take(self, &trial.name) else {
            return Err(malformed(format!("{} is just being reported by this client", trial.name)));
        };
        // From here on, what cannot be run is given back with the lease.
        if !has_configuration {
            return Err(malformed(format!("{} has no configuration", trial.name)));
        }
        if !trial.unreadable.is_empty() {
            let what = trial.unreadable.join(", ");
            return Err(malformed(format!("{} has values of an unknown kind for {what}", trial.name)));
        }
        lock(&self.memory).remember(&trial.configuration);
        Ok(Suggestion::of_trial(Arc::clone(self), trial, lease))
    }

    pub(crate) fn suggest_request(&self, client_id: &str, indicators: &Indicators) -> v1::SuggestRequest {
        v1::SuggestRequest {
            study: self.name.to_string(),
            client_id: client_id.to_owned(),
            indicators: indicators.0.clone(),
            fingerprint: Some(fingerprint_to_wire(&self.core.options.fingerprint)),
            wanted: None,
            session: self.core.session,
            can_abort: self.core.options.can_abort,
            session_policy: session_policy_to_wire(*lock(&self.session_policy)),
            origin: String::new(),
            reports_waiting: self.core.outbox.queued(),
        }
    }

    /// A refusal that says that the daemon has lost the study: creates it again, if it is ours.
    pub(crate) fn look_at_refusal(self: &Arc<Self>, problem: &ClientError) {
        if !(problem.is_not_found() && self.ours) {
            return;
        }
        let begins = self.registration.send_if_modified(|registration| {
            let known = matches!(registration, Registration::Done);
            if known {
                *registration = Registration::Pending;
            }
            known
        });
        if begins {
            tokio::spawn(Arc::clone(self).register());
        }
    }

    /// Asks in the background, for longer than the caller's deadline.
    fn ask(self: &Arc<Self>, indicators: Indicators) -> oneshot::Receiver<Answer> {
        let (reply, answer) = oneshot::channel();
        let shared = Arc::clone(self);
        let Ok(permit) = Arc::clone(&self.questions).try_acquire_owned() else {
            let limit = limits::OUTSTANDING_SUGGESTIONS;
            // The receiver is still in this function, so that sending cannot fail.
            let _ = reply.send(Err(ClientError::Busy { what: "suggestions under way", limit }));
            return answer;
        };
        let due = self.core.outbox.expect_answer(false);
        tokio::spawn(async move {
            let result =
                tokio::time::timeout(limits::LATE_ANSWER, shared.ask_once_told(&indicators, None)).await;
            let result = result.unwrap_or_else(|_| Err(shared.core.late("Suggest", limits::LATE_ANSWER)));
            // A suggestion that nobody waits for comes back from here and gives its trial back.
            drop(reply.send(result));
            drop((permit, due));
        });
        answer
    }

    async fn ask_once_told(
        self: &Arc<Self>,
        indicators: &Indicators,
        wanted: Option<&Configuration>,
    ) -> Answer {
        let mut result = Err(ClientError::Busy { what: "attempts to get a trial", limit: ASK_AGAIN });
        for _ in 0..ASK_AGAIN {
            self.core.outbox.wait_until_told(&self.name).await;
            let mut rpc = self.core.rpc();
            let wanted = wanted.map(|wanted| configuration_to_wire(wanted.as_raw()));
            let request = self.suggest_request(&self.core.client_id, indicators);
            let asked = rpc.suggest(v1::SuggestRequest { wanted, ..request });
            match self.core.call("Suggest", limits::LATE_ANSWER, asked).await {
                Ok(trial) => result = self.accept(trial),
                Err(problem) => {
                    self.look_at_refusal(&problem);
                    return Err(problem);
                }
            }
            if result.is_ok() {
                break;
            }
        }
        result
    }

    /// Creates the study as soon as the daemon is there.
    async fn register(self: Arc<Self>) {
        let mut failures = 0;
        let registration = loop {
            self.core.circuit_breaker.wait_until_worth_asking().await;
            match self.core.create_study(&self.name, &self.spec).await {
                Ok(record) => {
                    *lock(&self.policy_differs) = record.policy_differs;
                    break Registration::Done;
                }
                Err(problem) => {
                    failures += 1;
                    self.core.counters.note(&problem);
                    if !worth_repeating(&problem, failures) {
                        tracing::warn!(study = %self.name, %problem, "the study cannot be created");
                        break Registration::Refused(Arc::new(problem));
                    }
                    tokio::select! {
                        () = self.core.back_off().sleep_at_least(failures, problem.retry_after()) => {}
                        () = self.core.outbox.closing() => return,
                    }
                }
            }
        };
        self.registration.send_replace(registration);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Nothing in this file panics while it holds a lock; a poisoned one is still in order.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
