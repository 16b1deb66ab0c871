//! Rebuilding a tuner from what its changes wrote.

use std::sync::Arc;

use crate::study::StudySpec;
use crate::trial::{Trial, TrialState};
use crate::tuner::{RestoreError, Snapshot, StateRecord, Tuner, Visit};

impl Tuner {
    /// Rebuilds a tuner. `trials`: the open ones in any place, the completed ones by rising `completion`;
    /// others are not needed and passed over. All configurations were made by `spec.space`. The answers that follow are those of a tuner that never
    /// stopped.
    pub fn restore(
        spec: Arc<StudySpec>,
        snapshot: Snapshot,
        trials: impl IntoIterator<Item = Trial>,
    ) -> Result<Self, RestoreError> {
        let mut tuner = Tuner::new(spec)?;
        tuner.last_trial = snapshot.last_trial;
        for record in snapshot.states {
            tuner.restore_state(record)?;
        }
        for visit in snapshot.visits {
            tuner.restore_visit(visit)?;
        }
        for trial in trials {
            tuner.restore_trial(trial)?;
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

    fn restore_state(&mut self, record: StateRecord) -> Result<(), RestoreError> {
        let StateRecord { id, indicators, search } = record;
        let expected = self.states.len() as u64 + 1;
        if id != expected {
            return Err(inconsistent(format!("state {id} stands where state {expected} should")));
        }
        let width = self.spec.indicators.indicators().len();
        if indicators.len() != width || indicators.iter().any(|value| !value.is_finite()) {
            return Err(inconsistent(format!("state {id} does not have {width} finite indicators")));
        }
        let state = self.found(indicators);
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

    fn restore_trial(&mut self, trial: Trial) -> Result<(), RestoreError> {
        let what = || format!("trial {}", trial.number);
        self.check_state(trial.state_id, what)?;
        if trial.number == 0 || trial.number > self.last_trial {
            let last = self.last_trial;
            return Err(inconsistent(format!("{} is not among the {last} handed out", what())));
        }
        match trial.state {
            TrialState::Open => self.enter(trial),
            TrialState::Completed => {
                if trial.completion.is_none_or(|completion| completion <= self.last_completion) {
                    return Err(inconsistent(format!("{} comes out of the order of completion", what())));
                }
                if trial.cost.is_some_and(|cost| !cost.is_finite() || cost < 0.0) {
                    return Err(inconsistent(format!("{} has an impossible cost", what())));
                }
                self.complete(&trial);
            }
            TrialState::Abandoned | TrialState::Expired => {}
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
