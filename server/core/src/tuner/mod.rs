//! The state machine of one study: who gets which configuration, and what a report teaches.

mod exploration;
mod types;

use std::collections::BTreeMap;
use std::sync::Arc;

pub use exploration::Exploration;
pub use types::{
    Ask, Best, Change, Decision, Prediction, RawVisit, RestoreError, Snapshot, StateRecord,
    Statistics, TunerError, Visit,
};

use crate::policy::Policy;
use crate::study::{StudyError, StudySpec};
use crate::trial::{Outcome, Trial};

/// The state machine of one study. Pure: time comes in as `now_ms`, randomness from the study's seed.
#[derive(Clone, Debug)]
pub struct Tuner {
    spec: Arc<StudySpec>,
}

#[allow(unused_variables)]
impl Tuner {
    /// A tuner that has seen nothing yet.
    pub fn new(spec: Arc<StudySpec>) -> Result<Self, StudyError> {
        spec.validate()?;
        Ok(Tuner { spec })
    }

    /// Rebuilds a tuner from what its changes wrote. `trials`: the open ones in any place, the completed
    /// ones by rising `completion`; others are not needed and passed over.
    pub fn restore(
        spec: Arc<StudySpec>,
        snapshot: Snapshot,
        trials: impl IntoIterator<Item = Trial>,
    ) -> Result<Self, RestoreError> {
        unimplemented!()
    }

    /// The specification, with the policy in force.
    pub fn spec(&self) -> &Arc<StudySpec> {
        &self.spec
    }

    /// Hands out a trial under a lease.
    pub fn suggest(&mut self, ask: &Ask, now_ms: i64) -> Result<(Trial, Change), TunerError> {
        unimplemented!()
    }

    /// Takes the result of a trial: an open one, or one that expired (then it counts as late).
    pub fn report(
        &mut self,
        trial: &Trial,
        measurements: BTreeMap<String, f64>,
        outcome: Outcome,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        unimplemented!()
    }

    /// Gives a trial back unmeasured. Idempotent.
    pub fn abandon(&mut self, trial: &Trial) -> Result<(Trial, Change), TunerError> {
        unimplemented!()
    }

    /// Renews the lease of an open trial, counted from now.
    pub fn extend_lease(
        &mut self,
        trial: &Trial,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        unimplemented!()
    }

    /// Ends every lease that has run out: the trial is expired and its search point goes back.
    pub fn expire(&mut self, now_ms: i64) -> Change {
        unimplemented!()
    }

    /// When the next lease runs out.
    pub fn next_expiry_ms(&self) -> Option<i64> {
        unimplemented!()
    }

    /// An open trial.
    pub fn open_trial(&self, number: u64) -> Option<&Trial> {
        unimplemented!()
    }

    /// What would be exploited for these indicators. Changes nothing.
    pub fn predict(&self, indicators: &BTreeMap<String, f64>) -> Result<Prediction, TunerError> {
        unimplemented!()
    }

    /// The best known configuration of the state that matches the indicators, or of all states. `None`
    /// when nothing has been measured there.
    pub fn best(
        &self,
        indicators: Option<&BTreeMap<String, f64>>,
    ) -> Result<Option<Best>, TunerError> {
        unimplemented!()
    }

    /// Replaces the policy. It takes effect with the next suggestion.
    pub fn set_policy(&mut self, policy: Policy) -> Result<(), StudyError> {
        unimplemented!()
    }

    /// Counts.
    pub fn statistics(&self) -> Statistics {
        unimplemented!()
    }
}
