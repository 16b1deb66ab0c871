//! Rebuilding a tuner from what its changes wrote, trial after trial, or from a checkpoint on.
//!
//! What a tuner learnt follows from the completed trials in their order. [`Restoring`] goes through them in
//! stretches of any length, so that a history of any length needs no more memory than the tuner itself.

use std::sync::Arc;

use crate::limits::MODELS_TRIALS_MAX;
use crate::policy::PredictorMethod;
use crate::predict::Predictors;
use crate::study::StudySpec;
use crate::trial::{Trial, TrialState};
use crate::tuner::{Checkpoint, RestoreError, Snapshot, StateRecord, Tuner, Visit};

/// A tuner that is being rebuilt. The driver reads the completed trials behind [`after`](Restoring::after) in the
/// order of completion and [learns](Restoring::learn) them, again and again until there are none, and then
/// [finishes](Restoring::finish).
///
/// Where the policy's predictor was changed at some completion, [`after`](Restoring::after) goes back there once: the
/// new models are taught the last trials before.
#[derive(Debug)]
pub struct Restoring {
    tuner: Tuner,
    /// The tables stand where the models begin, and these were taught up to here.
    taught: Option<u64>,
    models_begun: bool,
    passed_over: Option<String>,
}

impl Restoring {
    /// Begins with the states and visits of a study, and with a checkpoint where there is one that fits.
    pub fn new(
        spec: Arc<StudySpec>,
        snapshot: Snapshot,
        checkpoint: Option<&Checkpoint>,
    ) -> Result<Self, RestoreError> {
        let mut tuner = Tuner::new(spec)?;
        tuner.predictors = tuner.untaught(PredictorMethod::NearestNeighbour);
        tuner.last_trial = snapshot.last_trial;
        tuner.models_since = snapshot.models_since;
        for record in snapshot.states {
            tuner.restore_state(record)?;
        }
        for visit in snapshot.visits {
            tuner.restore_visit(visit)?;
        }
        let passed_over = checkpoint.and_then(|checkpoint| tuner.take_over(checkpoint).err());
        let mut restoring = Restoring { tuner, taught: None, models_begun: false, passed_over };
        // A checkpoint from the very place of the change, or from behind it, brings the models with it.
        restoring.models_begun = restoring.tuner.last_completion > restoring.tuner.models_since;
        restoring.begin_models();
        Ok(restoring)
    }

    /// Why the checkpoint is of no use, if it is not.
    pub fn passed_over(&self) -> Option<&str> {
        self.passed_over.as_deref()
    }

    /// The place in the order of completion behind which the next trial to learn stands.
    pub fn after(&self) -> u64 {
        self.taught.unwrap_or(self.tuner.last_completion)
    }

    /// Learns the next completed trial; its configuration was made by the study's space.
    pub fn learn(&mut self, trial: &Trial) -> Result<(), RestoreError> {
        self.tuner.check_trial(trial)?;
        if trial.state != TrialState::Completed || trial.completion != Some(self.after() + 1) {
            return Err(inconsistent(format!("trial {} comes out of the order of completion", trial.number)));
        }
        if trial.cost.is_some_and(|cost| !cost.is_finite() || cost < 0.0) {
            return Err(inconsistent(format!("trial {} has an impossible cost", trial.number)));
        }
        if let Some(taught) = &mut self.taught {
            *taught += 1;
            self.tuner.teach(trial);
        } else {
            self.tuner.complete(trial);
        }
        self.taught = self.taught.filter(|taught| *taught < self.tuner.models_since);
        self.begin_models();
        Ok(())
    }

    /// Begins the models once the tables are where they do.
    fn begin_models(&mut self) {
        let tuner = &mut self.tuner;
        if self.models_begun || tuner.last_completion != tuner.models_since {
            return;
        }
        self.models_begun = true;
        let predictor = tuner.spec.policy.predictor;
        tuner.predictors = tuner.untaught(predictor);
        if Predictors::are_needed(predictor) && tuner.models_since > 0 {
            self.taught = Some(tuner.models_since.saturating_sub(MODELS_TRIALS_MAX));
        }
    }

    /// Enters the open trials. The answers that follow are those of a tuner that never stopped.
    pub fn finish(self, open: impl IntoIterator<Item = Trial>) -> Result<Tuner, RestoreError> {
        let mut tuner = self.tuner;
        if self.taught.is_some() || !self.models_begun {
            let since = tuner.models_since;
            return Err(inconsistent(format!(
                "the models begin at completion {since}, which does not exist"
            )));
        }
        for trial in open {
            tuner.check_trial(&trial)?;
            if trial.state == TrialState::Open {
                tuner.enter(trial);
            }
        }
        // A point whose trial is gone would never come back by itself.
        for exploration in tuner.work.iter_mut().filter_map(|work| work.exploration.as_mut()) {
            let gone = exploration.open.keys().filter(|number| !tuner.open.contains_key(number));
            for number in gone.copied().collect::<Vec<_>>() {
                exploration.release(number, None);
            }
        }
        Ok(tuner)
    }
}

impl Tuner {
    /// Rebuilds a tuner from all its trials at once. `trials`: the open ones in any place, the completed ones by
    /// rising `completion`; others are not needed and passed over. All configurations were made by `spec.space`.
    pub fn restore(
        spec: Arc<StudySpec>,
        snapshot: Snapshot,
        trials: impl IntoIterator<Item = Trial>,
    ) -> Result<Self, RestoreError> {
        let mut restoring = Restoring::new(spec, snapshot, None)?;
        let (mut open, mut completed) = (Vec::new(), Vec::new());
        for trial in trials {
            match trial.state {
                TrialState::Open => open.push(trial),
                TrialState::Completed => completed.push(trial),
                TrialState::Abandoned | TrialState::Expired => {}
            }
        }
        while let Some(trial) = completed.get(restoring.after() as usize) {
            restoring.learn(trial)?;
        }
        restoring.finish(open)
    }

    fn restore_state(&mut self, record: StateRecord) -> Result<(), RestoreError> {
        let StateRecord { id, indicators, fingerprint, search } = record;
        let expected = self.states.len() as u64 + 1;
        if id != expected {
            return Err(inconsistent(format!("state {id} stands where state {expected} should")));
        }
        let width = self.spec.indicators.indicators().len();
        if indicators.len() != width || indicators.iter().any(|value| !value.is_finite()) {
            return Err(inconsistent(format!("state {id} does not have {width} finite indicators")));
        }
        let state = self.found(indicators, fingerprint.as_ref());
        self.states[state].explored = search.is_some();
        self.work[state].exploration = search;
        Ok(())
    }

    fn restore_visit(&mut self, visit: Visit) -> Result<(), RestoreError> {
        let what = || format!("the visit of client {:?}", visit.client_id);
        self.check_state(visit.state_id, what)?;
        self.visits.insert(visit.client_id.clone(), visit);
        Ok(())
    }

    fn check_trial(&self, trial: &Trial) -> Result<(), RestoreError> {
        let what = || format!("trial {}", trial.number);
        self.check_state(trial.state_id, what)?;
        if trial.number == 0 || trial.number > self.last_trial {
            let last = self.last_trial;
            return Err(inconsistent(format!("{} is not among the {last} handed out", what())));
        }
        Ok(())
    }

    fn check_state(&self, state_id: u64, what: impl Fn() -> String) -> Result<(), RestoreError> {
        if (1..=self.states.len() as u64).contains(&state_id) {
            Ok(())
        } else {
            Err(inconsistent(format!("{} names state {state_id}, which does not exist", what())))
        }
    }
}

fn inconsistent(what: String) -> RestoreError {
    RestoreError::Inconsistent(what)
}
