//! The shared part of the handles and tuners of a study: whether the daemon knows it, and its questions for
//! suggestions.

use std::sync::{Arc, Mutex};

use tokio::sync::{Semaphore, oneshot, watch};
use treewright_proto::convert::{configuration_to_wire, fingerprint_to_wire, session_policy_to_wire};
use treewright_proto::v1;

use crate::core::Core;
use crate::delivery::worth_repeating;
use crate::locks::lock;
use crate::study_context::StudyContext;
use crate::suggestion::Lease;
use crate::workers::Worker;
use crate::{
    ClientError, Configuration, Finished, Indicators, SessionPolicy, SharedError, Suggestion, checks, limits,
    wire,
};

/// How often a suggestion is asked for again when the daemon names a trial that is just being reported.
const ASK_AGAIN: usize = 3;

pub(crate) type SuggestAnswer = Result<Suggestion, ClientError>;

#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) context: Arc<StudyContext>,
    /// Whether the program specified the study, so that it may be created again when it is gone.
    ours: bool,
    registration: watch::Sender<Registration>,
    session_policy: Mutex<SessionPolicy>,
    /// Where the stored policy is another than the one given; see [`crate::Study::policy_differs`].
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

impl Shared {
    /// For a study whose first handle is made. Where it is not `known` to the daemon it is created in the
    /// background. `ours`: the program specified it. `differs` are the fields in which the stored policy is
    /// another.
    pub(crate) fn new(context: StudyContext, known: bool, ours: bool, differs: Vec<String>) -> Arc<Self> {
        let registration = if known { Registration::Done } else { Registration::Pending };
        let shared = Arc::new(Self {
            context: Arc::new(context),
            ours,
            registration: watch::Sender::new(registration),
            session_policy: Mutex::default(),
            policy_differs: Mutex::new(differs),
            questions: Arc::new(Semaphore::new(limits::OUTSTANDING_SUGGESTIONS)),
        });
        if !known {
            tokio::spawn(Arc::clone(&shared).register());
        }
        shared
    }

    /// This study for another client. The state of this client, such as its open questions, stays here.
    pub(crate) fn again(&self, core: &Arc<Core>) -> Arc<Self> {
        let context = self.context.again(core);
        // Whether it is created shows in the first question.
        let again = Self::new(context, true, self.ours, Vec::new());
        // A lock that another thread held when the process was forked stays locked.
        if let Ok(policy) = self.session_policy.try_lock() {
            again.set_session_policy(*policy);
        }
        again
    }

    /// Sets this process's own policy from now on.
    pub(crate) fn set_session_policy(&self, policy: SessionPolicy) {
        *lock(&self.session_policy) = policy;
    }

    /// The fields in which the stored policy is another than the one given.
    pub(crate) fn policy_differs(&self) -> Vec<String> {
        lock(&self.policy_differs).clone()
    }

    /// Why there is no point in asking at the moment.
    pub(crate) fn problem(&self) -> Option<SharedError> {
        if let Registration::Refused(problem) = &*self.registration.borrow() {
            return Some(Arc::clone(problem));
        }
        if let Some(problem) = self.context.core.circuit_breaker.problem() {
            return Some(problem);
        }
        let reason = || format!("{} is not created there yet", self.context.name);
        match &*self.registration.borrow() {
            Registration::Pending => Some(Arc::new(ClientError::away(&self.context.core.url, reason()))),
            Registration::Done | Registration::Refused(_) => None,
        }
    }

    pub(crate) fn deliver(&self, suggestion: Suggestion) -> Suggestion {
        self.context.core.counters.suggestions.add(1);
        suggestion.handed_out()
    }

    /// Answers without the daemon.
    pub(crate) fn fall_back(self: &Arc<Self>, indicators: &Indicators, problem: SharedError) -> Suggestion {
        self.context.core.counters.fallbacks.add(1);
        self.context.core.counters.note(&problem);
        Suggestion::fallback(Arc::clone(&self.context), indicators, problem).handed_out()
    }

    /// The worker that asks for a trial: the one that hands in the previous result, or a free one.
    pub(crate) fn worker(
        &self,
        indicators: &Indicators,
        previous: Option<&Finished>,
    ) -> Result<Arc<Worker>, ClientError> {
        let StudyContext { core, name, spec, .. } = &*self.context;
        if let Some(worker) = previous.and_then(Finished::worker).filter(|worker| worker.is_of(name)) {
            return Ok(worker);
        }
        core.workers.take(name, indicators, |a, b| checks::are_one_state(spec, a, b))
    }

    /// Turns a trial from the daemon into a suggestion.
    pub(crate) fn accept(self: &Arc<Self>, trial: v1::Trial, worker: &Arc<Worker>) -> SuggestAnswer {
        let malformed = |problem: String| self.context.core.malformed("Suggest", problem);
        let has_configuration = trial.configuration.is_some();
        let trial = wire::trial_from_wire(trial).map_err(malformed)?;
        let Some(lease) = Lease::take(&self.context, &trial.name, worker) else {
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
        Ok(Suggestion::of_trial(Arc::clone(&self.context), trial, lease))
    }

    pub(crate) fn suggest_request(&self, worker: &Worker, indicators: &Indicators) -> v1::SuggestRequest {
        v1::SuggestRequest {
            study: self.context.asked_name().to_string(),
            client_id: worker.name().to_string(),
            indicators: indicators.0.clone(),
            fingerprint: Some(fingerprint_to_wire(&self.context.core.options.fingerprint)),
            wanted: None,
            session: self.context.core.session,
            can_abort: self.context.core.options.can_abort,
            session_policy: session_policy_to_wire(*lock(&self.session_policy)),
            origin: String::new(),
            reports_waiting: self.context.core.outbox.queued(),
            fidelities: self.context.core.options.fidelities,
            space_revision: self.context.revision(),
            start: self.context.start_to_wire(),
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
    pub(crate) fn ask(self: &Arc<Self>, indicators: Indicators) -> oneshot::Receiver<SuggestAnswer> {
        let (reply, answer) = oneshot::channel();
        let shared = Arc::clone(self);
        let busy =
            |_| ClientError::Busy { what: "suggestions under way", limit: limits::OUTSTANDING_SUGGESTIONS };
        let permit = Arc::clone(&self.questions).try_acquire_owned().map_err(busy);
        let ready = permit.and_then(|permit| Ok((permit, self.worker(&indicators, None)?)));
        let (permit, worker) = match ready {
            Ok(ready) => ready,
            Err(problem) => {
                // The receiver is still in this function, so that sending cannot fail.
                let _ = reply.send(Err(problem));
                return answer;
            }
        };
        let due = self.context.core.outbox.expect_answer(false);
        tokio::spawn(async move {
            let result = tokio::time::timeout(
                limits::LATE_ANSWER,
                shared.ask_after_reports(&worker, &indicators, None),
            )
            .await;
            let result =
                result.unwrap_or_else(|_| Err(shared.context.core.late("Suggest", limits::LATE_ANSWER)));
            // A caller with its answer may be done with the trial at once, and ask again.
            drop(worker);
            // A suggestion that nobody waits for comes back from here and gives its trial back.
            drop(reply.send(result));
            drop((permit, due));
        });
        answer
    }

    pub(crate) async fn ask_after_reports(
        self: &Arc<Self>,
        worker: &Arc<Worker>,
        indicators: &Indicators,
        wanted: Option<&Configuration>,
    ) -> SuggestAnswer {
        let mut result = Err(ClientError::Busy { what: "attempts to get a trial", limit: ASK_AGAIN });
        for _ in 0..ASK_AGAIN {
            self.context.core.outbox.wait_until_sent(&self.context.name, worker.name()).await;
            let mut rpc = self.context.core.rpc();
            let wanted = wanted.map(|wanted| configuration_to_wire(wanted.as_raw()));
            let request = self.suggest_request(worker, indicators);
            let asked = rpc.suggest(v1::SuggestRequest { wanted, ..request });
            match self.context.core.call("Suggest", limits::LATE_ANSWER, asked).await {
                Ok(trial) => result = self.accept(trial, worker),
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
            self.context.core.circuit_breaker.wait_until_worth_asking().await;
            match self.context.core.create_study(&self.context.name, &self.context.spec).await {
                Ok(record) => {
                    self.context.identify(&record);
                    *lock(&self.policy_differs) = record.policy_differs;
                    break Registration::Done;
                }
                Err(problem) => {
                    failures += 1;
                    self.context.core.counters.note(&problem);
                    if !worth_repeating(&problem, failures) {
                        tracing::warn!(study = %self.context.name, %problem, "the study cannot be created");
                        break Registration::Refused(Arc::new(problem));
                    }
                    tokio::select! {
                        () = self.context.core.back_off().sleep_at_least(failures, problem.retry_after()) => {}
                        () = self.context.core.outbox.closing() => return,
                    }
                }
            }
        };
        self.registration.send_replace(registration);
    }
}
