//! A study as a program holds it: questions for suggestions, predictions and results.

use std::sync::{Arc, Mutex};

use crate::answer::{self, Outstanding};
use crate::client::LastHandle;
use crate::core::Core;
use crate::locks::lock;
use crate::shared::Shared;
use crate::study_context::StudyContext;
use crate::{
    Best, Client, ClientError, Configuration, Indicators, Prediction, PrefetchingTuner, SessionPolicy,
    StudyRecord, StudySpec, Suggestion, Tuner, checks,
};

/// A study of a client. Cheap to clone; clones share everything. Threads and tasks may share it, too. Each
/// suggestion that is neither reported nor given back is a trial of its own, run by a worker of the client
/// ([`crate::Options::client_id`]).
#[derive(Debug, Clone)]
pub struct Study {
    /// Late answers to earlier questions. Not among what suggestions share, because they hold some.
    outstanding: Arc<Mutex<Vec<Outstanding>>>,
    pub(crate) shared: Arc<Shared>,
    // The last field: fields dropped before it still find the outbox open.
    _last_handle: Arc<LastHandle>,
}

impl Study {
    pub(crate) fn new(
        core: &Arc<Core>,
        last_handle: &Arc<LastHandle>,
        name: &str,
        spec: StudySpec,
        found: Option<&StudyRecord>,
        ours: bool,
    ) -> Self {
        let context = StudyContext::new(core, name, spec);
        if let Some(record) = found {
            context.identify(record);
        }
        let differs = found.map(|record| record.policy_differs.clone()).unwrap_or_default();
        let shared = Shared::new(context, found.is_some(), ours, differs);
        Self { outstanding: Arc::default(), shared, _last_handle: Arc::clone(last_handle) }
    }

    /// This study by another client: the one of this process, after a fork.
    pub(crate) fn again(&self, client: &Client) -> Self {
        let shared = self.shared.again(&client.core);
        Self { outstanding: Arc::default(), shared, _last_handle: Arc::clone(&client.last_handle) }
    }

    /// The resource name, `studies/{study}`, at the time when this handle was made: by now another study may
    /// have it. [`Study::identified_name`] names this one.
    pub fn name(&self) -> &str {
        &self.shared.context.name
    }

    /// `studies/{study}@{uid}`, by which this handle asks the daemon, and which no other study ever has: for
    /// calls of the client about this study. Until the daemon has answered for the first time it is
    /// [`Study::name`].
    pub fn identified_name(&self) -> String {
        self.shared.context.asked_name().to_string()
    }

    /// Its specification.
    pub fn spec(&self) -> &StudySpec {
        &self.shared.context.spec
    }

    /// Sets this process's own policy from now on, in place of the study's. It goes along with every question
    /// of this study's handles and holds for their answers alone. Other clients are not concerned. When the
    /// process ends, however it ends, nothing is left behind.
    ///
    /// Errors: [`ClientError::Invalid`] for a value out of its range.
    pub fn set_session_policy(&self, policy: SessionPolicy) -> Result<(), ClientError> {
        policy.validate().map_err(|problem| ClientError::invalid("session policy", problem.to_string()))?;
        self.shared.set_session_policy(policy);
        Ok(())
    }

    /// Sets the configuration that this program runs by default, where that is not the study's default;
    /// `None` for that. It goes along with every question of this study's handles. It is measured first in a
    /// state, and answers there are what is better than it; their gains are told over it. Without the daemon
    /// it takes the place of the study's default. For other clients it is a configuration like any.
    ///
    /// Errors: [`ClientError::Invalid`] for a configuration that does not fit the study's space.
    pub fn set_start(&self, start: Option<&Configuration>) -> Result<(), ClientError> {
        if let Some(start) = start {
            let checked = self.spec().space.configuration(start.as_raw().clone());
            checked.map_err(|problem| ClientError::invalid("start", problem.to_string()))?;
        }
        self.shared.context.set_start(start.cloned());
        Ok(())
    }

    /// The fields of the policy given to [`crate::Client::study`] that differ from the stored policy, which
    /// stays as it is. Empty until the daemon has answered.
    pub fn policy_differs(&self) -> Vec<String> {
        self.shared.policy_differs()
    }

    /// The next suggestion for these indicators, within the client's deadline ([`crate::Options::deadline`]):
    /// from the daemon; else the last good configuration; else the default. It never fails:
    /// [`Suggestion::problem`] gives the reason of a fallback, be it a wrong indicator or an absent daemon.
    ///
    /// An answer that comes too late is kept for the next call with that state, or given back.
    pub async fn suggest(&self, indicators: &Indicators) -> Suggestion {
        let shared = &self.shared;
        let mut outstanding = self.late_answer(indicators);
        let suggestion =
            answer::within_deadline(shared, &mut outstanding, indicators, || shared.ask(indicators.clone()))
                .await;
        lock(&self.outstanding).extend(outstanding);
        suggestion
    }

    /// The answer to an earlier question about this state; those about others are given back when they come.
    fn late_answer(&self, indicators: &Indicators) -> Option<Outstanding> {
        let mut all = lock(&self.outstanding);
        let spec = self.spec();
        let (mut same, others): (Vec<_>, Vec<_>) = std::mem::take(&mut *all)
            .into_iter()
            .partition(|each| checks::are_one_state(spec, &each.indicators, indicators));
        let earliest = (!same.is_empty()).then(|| same.remove(0));
        *all = same;
        drop(all);
        // Only now, because a suggestion that is given back takes locks.
        drop(others);
        earliest
    }

    /// A trial of a configuration of the program's own choice, e.g. to measure a winner once more or to try
    /// one from elsewhere. Its result is learnt like any other; the search goes on as it was.
    ///
    /// Unlike [`Study::suggest`] there is nothing to fall back on. So a daemon that cannot serve yet, because
    /// it is still loading the study, is asked again until the client's deadline. Errors:
    /// [`ClientError::Refused`] when the configuration does not fit the study's space, [`ClientError::Away`],
    /// [`ClientError::Late`].
    pub async fn trial_of(
        &self,
        indicators: &Indicators,
        configuration: &Configuration,
    ) -> Result<Suggestion, ClientError> {
        checks::state(&self.shared.context.spec, indicators)?;
        let core = &self.shared.context.core;
        let worker = self.shared.worker(indicators, None)?;
        let ask = || self.shared.ask_after_reports(&worker, indicators, Some(configuration));
        let suggestion = core.until_ready("Suggest", core.options.deadline, ask).await?;
        Ok(self.shared.deliver(suggestion))
    }

    /// A per-frame loop, which reports and asks in one round trip.
    pub fn tuner(&self) -> Tuner {
        Tuner::new(self)
    }

    /// A per-frame loop whose calls never wait: each returns the answer to the question of a frame ago.
    pub fn prefetching_tuner(&self) -> PrefetchingTuner {
        PrefetchingTuner::new(self)
    }

    /// The exploitation for these indicators. Writes nothing. Here and in what follows, a daemon that is
    /// still loading the study is asked again until [`crate::Options::call_deadline`] is over.
    ///
    /// Errors: [`ClientError::Invalid`] for wrong indicators; [`ClientError::Refused`],
    /// [`ClientError::Away`], [`ClientError::Late`].
    pub async fn predict(&self, indicators: &Indicators) -> Result<Prediction, ClientError> {
        checks::state(self.spec(), indicators)?;
        let context = &self.shared.context;
        context.core.predict(&context.asked_name(), indicators, context.asked_by()).await
    }

    /// The best configuration of the state with these indicators, or of all states when there are none.
    ///
    /// Errors: [`ClientError::Invalid`] for wrong indicators; [`ClientError::Refused`] when nothing is
    /// measured there yet; [`ClientError::Away`], [`ClientError::Late`].
    pub async fn best(&self, indicators: &Indicators) -> Result<Best, ClientError> {
        if !indicators.0.is_empty() {
            checks::state(self.spec(), indicators)?;
        }
        let context = &self.shared.context;
        let machine = Some(&context.core.options.fingerprint);
        context.core.best(&context.asked_name(), indicators, machine, context.asked_by()).await
    }

    /// The study as the daemon has stored it.
    ///
    /// Errors: [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub async fn record(&self) -> Result<StudyRecord, ClientError> {
        self.shared.context.core.study_record(&self.shared.context.asked_name()).await
    }
}
