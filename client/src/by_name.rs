//! Trials by name, with ask and tell as separate calls. They are for programs whose halves are processes of
//! their own, such as lines of a shell script, and for programs that carry measurements over from elsewhere.
//!
//! Each call is one question to the daemon and returns its error; there are no fallbacks and no queue. A
//! trial that is handed out stays with its client until it is reported or given back, or its lease ends.
//! Dropping the record does nothing. Frame loops use [`crate::Study`].

use treewright_proto::convert::{configuration_to_wire, fingerprint_to_wire, session_policy_to_wire};
use treewright_proto::v1;

use crate::client::study_name;
use crate::core::Core;
use crate::delivery::report_request;
use crate::{
    Best, Client, ClientError, Configuration, Fingerprint, Indicators, Measurements, Outcome, SessionPolicy,
    TrialQuery, TrialRecord, wire,
};

/// A question for the next trial. For `None` the client's options hold.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Question {
    /// A value for each indicator of the study.
    pub indicators: Indicators,
    /// The client that asks. It gets its trial again until it reports that, as long as the trial is wanted.
    pub client_id: Option<String>,
    /// The machine that the measurement is to hold for.
    pub fingerprint: Option<Fingerprint>,
    /// Distinguishes the client's sessions; 0 for one endless session. `None`: this process is a session.
    pub session: Option<u64>,
    /// The client stops every trial no later than when its cost reaches [`TrialRecord::abort_above`].
    pub can_abort: bool,
    /// This question's own policy, in place of the study's.
    pub session_policy: SessionPolicy,
    /// The configuration to measure, where that is not left to the service.
    pub wanted: Option<Configuration>,
    /// Where `wanted` was measured before, if its result is only carried over; at most 200 printable
    /// characters.
    pub origin: Option<String>,
    /// The client runs a trial at the level that [`TrialRecord::fidelity`] names. Without it every trial is a
    /// full one.
    pub fidelities: bool,
    /// The revision of the space that the program works with, [`crate::StudyRecord::space_revision`] of the
    /// study that it created or found; 0 for the study's present one.
    pub space_revision: u32,
    /// The configuration that the program runs by default, where that is not the study's default.
    pub start: Option<Configuration>,
}

impl Client {
    /// Hands out a trial under a lease.
    ///
    /// Errors: [`ClientError::Refused`], e.g. when there is no such study; [`ClientError::Away`],
    /// [`ClientError::Late`].
    pub async fn ask(&self, study: &str, question: &Question) -> Result<TrialRecord, ClientError> {
        let core = &self.core;
        let fingerprint = question.fingerprint.as_ref().unwrap_or(&core.options.fingerprint);
        let request = v1::SuggestRequest {
            study: study_name(study),
            client_id: question.client_id.clone().unwrap_or_else(|| core.options.client_id.clone()),
            indicators: question.indicators.0.clone(),
            fingerprint: Some(fingerprint_to_wire(fingerprint)),
            wanted: question.wanted.as_ref().map(|wanted| configuration_to_wire(wanted.as_raw())),
            session: question.session.unwrap_or(core.session),
            can_abort: question.can_abort,
            session_policy: session_policy_to_wire(question.session_policy),
            origin: question.origin.clone().unwrap_or_default(),
            reports_waiting: core.outbox.queued(),
            fidelities: question.fidelities,
            space_revision: question.space_revision,
            start: question.start.as_ref().map(|start| configuration_to_wire(start.as_raw())),
        };
        let trial = core.admin("Suggest", core.rpc().suggest(request)).await?;
        core.read_trial("Suggest", trial)
    }

    /// Reports the result of a trial; `true` beside the stored trial when it was complete before and this
    /// changed nothing.
    ///
    /// Errors: [`ClientError::Refused`], e.g. when a metric of the objective is missing;
    /// [`ClientError::Away`], [`ClientError::Late`].
    pub async fn tell(
        &self,
        trial: &str,
        measurements: &Measurements,
        outcome: &Outcome,
    ) -> Result<(TrialRecord, bool), ClientError> {
        let request = report_request(trial, measurements, outcome);
        let answer = self.core.admin("Report", self.core.rpc().report(request)).await?;
        let trial = answer.trial.unwrap_or_default();
        Ok((self.core.read_trial("Report", trial)?, answer.duplicate))
    }

    /// Gives a trial back unmeasured. Errors: as for [`Client::tell`].
    pub async fn give_back(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        let request = v1::AbandonTrialRequest { trial: trial.to_owned() };
        let trial = self.core.admin("AbandonTrial", self.core.rpc().abandon_trial(request)).await?;
        self.core.read_trial("AbandonTrial", trial)
    }

    /// Excludes a completed trial for a reason, or counts it again without one: nothing is learnt from an
    /// excluded trial, which stays in the log. Errors: as for [`Client::tell`].
    pub async fn exclude(&self, trial: &str, reason: Option<&str>) -> Result<TrialRecord, ClientError> {
        let request = v1::ExcludeTrialRequest {
            trial: trial.to_owned(),
            reason: reason.unwrap_or_default().to_owned(),
            include: reason.is_none(),
        };
        let trial = self.core.admin("ExcludeTrial", self.core.rpc().exclude_trial(request)).await?;
        self.core.read_trial("ExcludeTrial", trial)
    }

    /// Renews a trial's lease, counted from now. Errors: as for [`Client::tell`].
    pub async fn renew(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        self.core.extend_lease(trial).await
    }

    /// Reads one trial. Errors: as for [`Client::tell`].
    pub async fn trial(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        let request = v1::GetTrialRequest { name: trial.to_owned() };
        let trial = self.core.admin("GetTrial", self.core.rpc().get_trial(request)).await?;
        self.core.read_trial("GetTrial", trial)
    }

    /// One trial of a state, which holds its indicators and its machine; `None` where the state has none.
    /// Errors: as for [`Client::tell`].
    pub async fn trial_in_state(
        &self,
        study: &str,
        state_id: i64,
    ) -> Result<Option<TrialRecord>, ClientError> {
        let query = TrialQuery::all().filter(format!("state_id = {state_id}"));
        Ok(self.trials(study, query).take(1).await?.pop())
    }

    /// The best configuration of a state, by its number; `None` when nothing was measured there. Errors: as
    /// for [`Client::tell`].
    pub async fn best_of_state(&self, study: &str, state_id: i64) -> Result<Option<Best>, ClientError> {
        let Some(trial) = self.trial_in_state(study, state_id).await? else { return Ok(None) };
        let machine = trial.fingerprint.as_ref();
        match self.core.best(&study_name(study), &trial.indicators, machine, (0, None)).await {
            Ok(best) => Ok(Some(best)),
            Err(problem) if problem.is_not_found() => Ok(None),
            Err(problem) => Err(problem),
        }
    }
}

impl Core {
    pub(crate) fn read_trial(
        &self,
        call: &'static str,
        trial: v1::Trial,
    ) -> Result<TrialRecord, ClientError> {
        wire::trial_from_wire(trial).map_err(|problem| self.malformed(call, problem))
    }
}
