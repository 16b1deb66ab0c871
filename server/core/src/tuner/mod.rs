//! The state machine of one study: it decides which configuration a client runs, and learns from reports.
//!
//! It carries out the workflow of paper section 6 (figure 10). It recognises indicators as a state. On every
//! change of a client's state it decides epsilon-greedily to explore the state with a search or to exploit a
//! predictor's answer. The decision is kept until the state changes again. Every report feeds the table, the
//! search and the model.
//!
//! The machine is pure. Its answers depend only on the rows of the [`Change`]s that it returned: a
//! [restored](Restoring) tuner gives the next answers of one that never stopped, byte for byte.
//!
//! [`Tuner`] joins the parts of three rooms, which keep their own invariants. [`Knowledge`] holds the
//! `states` (recognition, and the table of each state), their `history` and `assessment`s, the `speeds` of
//! machines, `auxiliaries` and `models`, and packs them as a `checkpoint`. [`Clients`] holds the `visits`
//! (states and budgets) and `trials` (the open ones and their holders). `exploring` holds the `searches` and
//! what works on them: the `walk` to the next point, the `repeats`, the `confirmation` of the best against
//! the incumbent, the `standings` of a state's own measurements, the choice of what is exploited
//! (`exploiting`), and the `transfer` of the results of other states and machines.
//!
//! In that room a session's `wishes` `decide` what its client does, and a client may `start` with its own
//! default.
//!
//! Each step that needs more than one room has its file: `explore` and `within_budget` choose what is
//! explored, `planning` copies the inputs of slow computations and `plan` computes them apart, `suggest` and
//! `report` are the two halves of a client's frame, `learning` is what tables and models make of a report,
//! `leases` ends trials that never come back, `restore` rebuilds. `views` joins parts of the rooms for one
//! step each.

pub mod budget;
mod checks;
mod clients;
mod explore;
mod exploring;
mod insight;
mod knowledge;
mod learning;
mod leases;
mod plan;
mod planning;
mod proposal;
mod recorded;
mod report;
mod restore;
mod suggest;
mod types;
mod views;
mod within_budget;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

pub use budget::Account;
pub use clients::Clients;
pub use exploring::exploration::Exploration;
pub use insight::{Insight, Omission, OmissionReason, Prospect};
pub use knowledge::Knowledge;
pub use knowledge::assessment::{Assessment, AssessmentRequest};
pub use knowledge::checkpoint::Learnt;
pub use leases::gave_up;
pub use plan::{DecisionStep, PlanRequest, SuggestionPlan};
pub use recorded::{RecordedVisitDecision, VisitDecisionBefore};
pub use restore::Restoring;
pub use types::{
    Ask, Best, Change, Checkpoint, CheckpointTooLarge, Prediction, RawVisit, RestoreError, Snapshot,
    StateRecord, StudyCounts, TunerError, Visit, VisitDecision,
};

use crate::configuration::RawConfiguration;
use crate::decision::{Choice, Decision};
use crate::ids::{StateId, TrialNumber};
use crate::objective::check_report;
use crate::policy::Policy;
use crate::predict::Predictors;
use crate::study::{StudyError, StudySpec};
use crate::trial::{Fingerprint, Outcome, Trial, TrialState};
use crate::tuner::exploring::Searches;
use crate::tuner::plan::Planned;

/// The state machine of one study. Pure: time comes in as `now_ms`, randomness from the study's seed.
///
/// No call costs more with more trials; recognising a state takes the logarithm of the number of states.
/// Computations of milliseconds can be done [apart](PlanRequest).
#[derive(Clone, Debug)]
pub struct Tuner {
    spec: Arc<StudySpec>,
    knowledge: Knowledge,
    clients: Clients,
    searches: Searches,
}

/// A client's question with its indicators normalised and its state recognised. Valid until the tuner is
/// changed.
#[derive(Clone, Debug)]
pub struct Question<'a> {
    ask: &'a Ask,
    normalised: Vec<f64>,
    /// The known state; `None` for one that is new.
    state: Option<StateId>,
}

impl<'a> Question<'a> {
    fn recognised(ask: &'a Ask, normalised: Vec<f64>, knowledge: &Knowledge, clients: &Clients) -> Self {
        let current = clients.visits.state_of(&ask.client_id);
        let state = knowledge.states.recognise(current, ask.fingerprint.as_ref(), &normalised);
        Question { ask, normalised, state }
    }

    /// The known state; `None` where it is new.
    pub fn state(&self) -> Option<StateId> {
        self.state
    }
}

impl Tuner {
    /// A tuner without any trial.
    pub fn new(spec: Arc<StudySpec>) -> Result<Self, StudyError> {
        spec.validate()?;
        Ok(Tuner {
            knowledge: Knowledge::new(&spec),
            searches: Searches::new(&spec.space),
            clients: Clients::new(),
            spec,
        })
    }

    // Suggest.

    /// Recognises the state of a client's question. Changes nothing.
    pub fn question<'a>(&self, ask: &'a Ask) -> Result<Question<'a>, TunerError> {
        checks::client_id(&ask.client_id)?;
        checks::origin(ask.origin.as_deref())?;
        checks::fingerprint(ask.fingerprint.as_ref())?;
        checks::start(&self.spec.space, ask.start.as_ref())?;
        let normalised = self.spec.indicators.normalise(&ask.indicators)?;
        Ok(Question::recognised(ask, normalised, &self.knowledge, &self.clients))
    }

    /// Hands out a trial under a lease, and returns the change to store before the client receives it.
    ///
    /// A client that still holds an open trial for the state has lost its answer, and gets the trial again
    /// with a fresh lease. It gets another one in three cases: the policy began or ceased to pin since, the
    /// session explores no more and never renewed the lease, or the client's regret budget does not cover a
    /// second run. `now_ms` is the caller's clock.
    pub fn suggest(&mut self, ask: &Ask, now_ms: i64) -> Result<(Trial, Change), TunerError> {
        let question = self.question(ask)?;
        self.answer(question, Prediction::pinned(&self.spec.policy), Planned::AtOnce, now_ms)
    }

    /// [`Tuner::suggest`] in microseconds. A question without a plan may [need](Tuner::plan) one first, and
    /// comes again with it; `may_plan` says whether to plan for a state's search. The tuner may have changed
    /// since. A question with a plan is always answered.
    pub fn suggest_step(
        &mut self,
        ask: &Ask,
        plan: Option<SuggestionPlan>,
        may_plan: impl Fn(StateId) -> bool,
        now_ms: i64,
    ) -> Result<DecisionStep<(Trial, Change)>, TunerError> {
        let question = match plan.as_ref().and_then(SuggestionPlan::normalised) {
            Some(normalised) => {
                Question::recognised(ask, normalised.to_vec(), &self.knowledge, &self.clients)
            }
            None => self.question(ask)?,
        };
        if plan.is_none()
            && let Some(request) = self.plan(&question, may_plan)
        {
            return Ok(DecisionStep::Need(Box::new(request)));
        }
        let planned = Planned::Ahead(Box::new(plan.unwrap_or_default()));
        self.answer(question, Prediction::pinned(&self.spec.policy), planned, now_ms).map(DecisionStep::Done)
    }

    /// Hands out a trial of a configuration that the client wants to measure, or that the caller chose for
    /// it, as if the policy pinned it for this one question. `said` are the words that say why. The client's
    /// visit and the state's search stay as they are.
    pub fn suggest_wanted(
        &mut self,
        ask: &Ask,
        wanted: RawConfiguration,
        said: Option<String>,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        let configuration = self.spec.space.configuration(wanted)?;
        let question = self.question(ask)?;
        let decision = Decision { origin: ask.origin.clone(), said, ..Choice::Wanted.decided() };
        let wanted = Prediction { configuration, predicted_cost: None, decision, insight: None };
        self.answer(question, Some(wanted), Planned::AtOnce, now_ms)
    }

    // Report, and the other ends of a trial.

    /// Takes the result of a trial and returns the change to store before the result is acknowledged.
    ///
    /// `trial` is the caller's record: [`Clients::open_trial`], or the record of its store when the lease has
    /// run out. The result then still counts and is flagged `late`. [`TunerError::AlreadyCompleted`] and
    /// [`TunerError::Abandoned`] follow from the caller's record. `measurements` are finite and not negative;
    /// with [`Outcome::Ok`] they hold every metric of the objective and of its limits. A measurement beyond a
    /// limit makes the trial infeasible.
    pub fn report(
        &mut self,
        trial: &Trial,
        measurements: BTreeMap<String, f64>,
        outcome: Outcome,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        self.report_estimates(trial, measurements, BTreeMap::new(), outcome, now_ms)
    }

    /// [`Tuner::report`] of measurements some of which are estimates with `standard_errors`, finite and not
    /// negative.
    pub fn report_estimates(
        &mut self,
        trial: &Trial,
        measurements: BTreeMap<String, f64>,
        standard_errors: BTreeMap<String, f64>,
        outcome: Outcome,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        let number = trial.number;
        let is_ours =
            self.clients.handed_out(trial) && self.knowledge.states.contains(StateId(trial.state_id));
        let trial = match (self.clients.trials.get(TrialNumber(number)), trial.state) {
            (Some(open), _) => open,
            (None, TrialState::Completed) if gave_up(trial) => {
                return Err(TunerError::GivenUp(number));
            }
            (None, TrialState::Completed) => return Err(TunerError::AlreadyCompleted(number)),
            (None, TrialState::Abandoned) => return Err(TunerError::Abandoned(number)),
            (None, TrialState::Expired) if is_ours => trial,
            (None, _) => return Err(TunerError::UnknownTrial(number)),
        };
        check_report(&measurements, &standard_errors)?;
        checks::outcome(&outcome)?;
        let completion = self.knowledge.last_completion + 1;
        let completed =
            report::completed(&self.spec.objective, trial, measurements, outcome, completion, now_ms)?;
        let completed = Trial { standard_errors, ..completed };
        let change = self.take(&completed);
        assert!(self.clients.open_trial(number).is_none(), "trial {number} is not open any more");
        Ok((completed, change))
    }

    /// Gives a trial back unmeasured; its search point is handed out again. Idempotent. `trial` is the
    /// record the caller has, as for [`Tuner::report`].
    pub fn abandon(&mut self, trial: &Trial) -> Result<(Trial, Change), TunerError> {
        let number = trial.number;
        if let Some(state) = self.clients.trials.get(TrialNumber(number)).map(|open| StateId(open.state_id)) {
            let before = self.searches.changes(state);
            let ended = self.clients.end(TrialNumber(number));
            let abandoned = ended.map(|trial| self.racing().take_back(trial, TrialState::Abandoned));
            let mut change = Change { trials: abandoned.into_iter().collect(), ..Change::default() };
            assert_eq!(change.trials.len(), 1, "trial {number} was open");
            if self.searches.changes(state) != before {
                change.states.push(self.standings().row(state));
            }
            let trial = change.trials[0].clone();
            return Ok((trial, change));
        }
        let is_ours =
            self.clients.handed_out(trial) && self.knowledge.states.contains(StateId(trial.state_id));
        match trial.state {
            TrialState::Completed => Err(TunerError::AlreadyCompleted(number)),
            TrialState::Abandoned => Ok((trial.clone(), Change::default())),
            TrialState::Expired if is_ours => {
                let abandoned = Trial { state: TrialState::Abandoned, ..trial.clone() };
                Ok((abandoned.clone(), Change { trials: vec![abandoned], ..Change::default() }))
            }
            _ => Err(TunerError::UnknownTrial(number)),
        }
    }

    /// Renews the lease of an open trial, counted from now.
    pub fn extend_lease(&mut self, trial: &Trial, now_ms: i64) -> Result<(Trial, Change), TunerError> {
        let number = TrialNumber(trial.number);
        self.clients.trials.note_heartbeat(number);
        match self.clients.renew(number, &self.spec.policy, now_ms) {
            Some(renewed) => Ok((renewed.clone(), Change { trials: vec![renewed], ..Change::default() })),
            None => Err(TunerError::NotOpen { number: trial.number, state: trial.state }),
        }
    }

    /// Ends every lease that has run out by `now_ms`: the trial is expired and its search point goes back. A
    /// configuration that loses its [last](crate::limits::LEASES_LOST_MAX) lease in the state, and was never
    /// measured there, is completed as infeasible. This does not hold for a lease that is
    /// [pardoned](Clients::pardon_leases), or whose client never showed that it lives.
    pub fn expire(&mut self, now_ms: i64) -> Change {
        let mut change = Change::default();
        let mut states = BTreeSet::new();
        for number in self.clients.trials.due(now_ms) {
            let Some(trial) = self.clients.trials.get(number) else { continue };
            let state = StateId(trial.state_id);
            let before = self.searches.changes(state);
            let (results, default) = (self.knowledge.states.results(state), self.spec.space.default_ref());
            // Enough sessions left behind what was put aside.
            let was_alive = trial.decision.heartbeat || trial.decision.put_aside;
            let lost_leases = match self.clients.is_pardoned(trial) {
                true => 0,
                false => self.searches.note_lost_lease(trial, results, default, was_alive),
            };
            let lost = self.end_lost(number, lost_leases, now_ms);
            change.trials.extend(lost.trials);
            change.visits.extend(lost.visits);
            if self.searches.changes(state) != before {
                states.insert(state);
            }
        }
        change.states = states.into_iter().map(|state| self.standings().row(state)).collect();
        change
    }

    // Predict and best.

    /// The exploitation for these indicators, on a machine where one is named. Changes nothing.
    pub fn predict(
        &self,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
    ) -> Result<Prediction, TunerError> {
        let (normalised, here) =
            self.knowledge.recognise_for(&self.spec.indicators, indicators, fingerprint)?;
        let room = here.and_then(|here| self.clients.visits.room(here));
        Ok(self.exploiting(&Planned::AtOnce).prediction(&normalised, here, None, room))
    }

    /// [`Tuner::predict`] in microseconds, for a client with a start or without. Without a plan it may need
    /// one first, and is asked again with it.
    pub fn predict_step(
        &mut self,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&RawConfiguration>,
        plan: Option<SuggestionPlan>,
    ) -> Result<DecisionStep<Prediction>, TunerError> {
        let start = checks::start(&self.spec.space, start)?;
        let (normalised, here) =
            self.knowledge.recognise_for(&self.spec.indicators, indicators, fingerprint)?;
        let unplanned = plan.is_none();
        let mut planned = Planned::Ahead(Box::new(plan.unwrap_or_default()));
        if unplanned && let Some(request) = self.exploiting(&planned).plan(&normalised, here, start.as_ref())
        {
            return Ok(DecisionStep::Need(Box::new(request)));
        }
        planned.keep_in(&mut self.knowledge.assessments);
        let room = here.and_then(|here| self.clients.visits.room(here));
        let exploiting = self.exploiting(&planned);
        Ok(DecisionStep::Done(exploiting.prediction(&normalised, here, start.as_ref(), room)))
    }

    /// The best known configuration of the state that matches the indicators, or of all states where none are
    /// given. `None` when nothing has been measured there. The state is that of the named machine if it has
    /// been there, else of the one that has reported the most frames from it.
    pub fn best(
        &self,
        indicators: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
    ) -> Result<Option<Best>, TunerError> {
        let state = self.knowledge.best_state(&self.spec.indicators, indicators, fingerprint)?;
        Ok(state.and_then(|state| self.standings().best(state, None, &Planned::AtOnce)))
    }

    /// [`Tuner::best`] in microseconds. Without a plan it may need one first, and is asked again with it. For
    /// a client with a start that ran in the state it is what is better than that, and the start takes the
    /// place of the default in all figures.
    pub fn best_step(
        &mut self,
        indicators: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&RawConfiguration>,
        plan: Option<SuggestionPlan>,
    ) -> Result<DecisionStep<Option<Best>>, TunerError> {
        let start = checks::start(&self.spec.space, start)?;
        let state = self.knowledge.best_state(&self.spec.indicators, indicators, fingerprint)?;
        if plan.is_none() {
            let [assessment, beside_start] = self.standings().assessments_to_plan(state, start.as_ref());
            let request = PlanRequest { assessment, beside_start, ..PlanRequest::nothing(&self.spec) };
            if !request.is_empty() {
                return Ok(DecisionStep::Need(Box::new(request)));
            }
        }
        let mut planned = Planned::Ahead(Box::new(plan.unwrap_or_default()));
        planned.keep_in(&mut self.knowledge.assessments);
        let best = state.and_then(|state| self.standings().best(state, start.as_ref(), &planned));
        Ok(DecisionStep::Done(best))
    }

    // The study.

    /// What is known of it.
    pub fn knowledge(&self) -> &Knowledge {
        &self.knowledge
    }

    /// Its clients, and the trials that they hold.
    pub fn clients(&self) -> &Clients {
        &self.clients
    }

    /// Its clients, for a caller that pardons leases or keeps an answer to itself.
    pub fn clients_mut(&mut self) -> &mut Clients {
        &mut self.clients
    }

    /// What is known of it, for a caller that computes the models' long updates apart.
    pub fn knowledge_mut(&mut self) -> &mut Knowledge {
        &mut self.knowledge
    }

    /// The specification, with the policy in force.
    pub fn spec(&self) -> &Arc<StudySpec> {
        &self.spec
    }

    /// Takes over the texts for people of another specification. No decision depends on them.
    pub fn set_texts(&mut self, from: &StudySpec) {
        let StudySpec { display_name, note, tags, .. } = from.clone();
        let spec = Arc::make_mut(&mut self.spec);
        (spec.display_name, spec.note, spec.tags) = (display_name, note, tags);
    }

    /// Replaces the policy. It takes effect with the next suggestion; trials that are out stay as they are.
    ///
    /// Only the models that the policy's predictor needs are kept. Where the new predictor needs others, they
    /// begin with the completed trials of now. They are taught the latest
    /// [`MODELS_TRIALS_MAX`](crate::limits::MODELS_TRIALS_MAX) of them, with the tables as they stand, and
    /// all that follow. The tuner does not have these trials any more, so the answer `true` asks the caller
    /// to store the policy with [`Knowledge::models_since`], to drop this tuner, and to [restore](Restoring)
    /// it.
    #[must_use = "a tuner that lacks its models must be restored"]
    pub fn set_policy(&mut self, policy: Policy) -> Result<bool, StudyError> {
        policy.validate(&self.spec.space)?;
        let (before, now) = (self.spec.policy.predictor, policy.predictor);
        Arc::make_mut(&mut self.spec).policy = policy;
        if before == now || !(Predictors::are_needed(before) || Predictors::are_needed(now)) {
            return Ok(false);
        }
        self.knowledge.models.begin(&self.spec, now, &self.knowledge.states, self.knowledge.last_completion);
        Ok(Predictors::are_needed(now) && self.knowledge.last_completion > 0)
    }
}

#[cfg(test)]
mod replay_tests;
#[cfg(test)]
mod tests;
