//! Rebuilding a tuner from its stored changes, trial after trial, or from a checkpoint on.
//!
//! The knowledge of a tuner follows from the completed trials in their order. [`Restoring`] replays them in
//! stretches of any length, so that a history of any length needs no more memory than the tuner itself.

use std::sync::Arc;

use crate::ids::{StateId, TrialNumber};
use crate::limits::MODELS_TRIALS_MAX;
use crate::policy::PredictorMethod;
use crate::predict::Predictors;
use crate::study::StudySpec;
use crate::trial::{Trial, TrialState};
use crate::tuner::clients::OpenTrials;
use crate::tuner::knowledge::States;
use crate::tuner::{Change, Checkpoint, Exploration, RestoreError, Snapshot, StateRecord, Tuner, Visit};

/// A tuner that is being rebuilt. The driver reads the completed trials behind [`after`](Restoring::after) in
/// the order of completion and [learns](Restoring::learn) them, again and again until there are none, and
/// then [finishes](Restoring::finish).
///
/// Where the policy's predictor was changed at some completion, [`after`](Restoring::after) goes back there
/// once: the new models are taught the last trials before.
///
/// Trials may be missing between those that are there, where retention removed them. Their knowledge is then
/// in the checkpoint or lost.
#[derive(Debug)]
pub struct Restoring {
    tuner: Tuner,
    /// The models, once begun, were taught up to this completion.
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
        let since = snapshot.models_since;
        // No model is taught until its place in the order of completion is reached.
        tuner.knowledge.models.begin(
            &tuner.spec,
            PredictorMethod::NearestNeighbour,
            &tuner.knowledge.states,
            since,
        );
        tuner.clients.trials = OpenTrials::after(TrialNumber(snapshot.last_trial));
        let mut restoring = Restoring { tuner, taught: None, models_begun: false, passed_over: None };
        for record in snapshot.states {
            restoring.restore_state(record)?;
        }
        for visit in snapshot.visits {
            restoring.restore_visit(visit)?;
        }
        restoring.passed_over = checkpoint.and_then(|checkpoint| {
            restoring.tuner.knowledge.take_over(&restoring.tuner.spec, checkpoint).err()
        });
        // A checkpoint from the very place of the change, or from behind it, brings the models with it.
        restoring.models_begun = restoring.tuner.knowledge.last_completion > since;
        restoring.begin_models();
        Ok(restoring)
    }

    /// Rebuilds a tuner from all its trials at once. `trials` holds the open ones in any place and the
    /// completed ones by rising `completion`; others are ignored. All configurations were made by
    /// `spec.space`.
    pub fn of_all(
        spec: Arc<StudySpec>,
        snapshot: Snapshot,
        trials: impl IntoIterator<Item = Trial>,
    ) -> Result<Tuner, RestoreError> {
        let mut restoring = Restoring::new(spec, snapshot, None)?;
        let (mut open, mut completed) = (Vec::new(), Vec::new());
        for trial in trials {
            match trial.state {
                TrialState::Open => open.push(trial),
                TrialState::Completed => completed.push(trial),
                TrialState::Abandoned | TrialState::Expired => {}
            }
        }
        loop {
            let after = restoring.after();
            let next = completed.partition_point(|trial| trial.completion.is_some_and(|at| at <= after));
            let Some(trial) = completed.get(next) else { break };
            restoring.learn(trial)?;
        }
        restoring.finish(open)
    }

    /// Why the checkpoint is of no use, if it is not.
    pub fn passed_over(&self) -> Option<&str> {
        self.passed_over.as_deref()
    }

    /// The place in the order of completion behind which the next trial to learn stands.
    pub fn after(&self) -> u64 {
        self.taught.unwrap_or(self.tuner.knowledge.last_completion)
    }

    /// Learns the next completed trial, or passes over it if it is excluded; its configuration was made by
    /// the study's space. If [`after`](Restoring::after) then stands before the trial, the trial was not
    /// learnt: `after` went back, and the trial comes again later.
    pub fn learn(&mut self, trial: &Trial) -> Result<(), RestoreError> {
        check_trial(&self.tuner, trial)?;
        let Some(completion) = trial
            .completion
            .filter(|completion| trial.state == TrialState::Completed && *completion > self.after())
        else {
            return Err(inconsistent(format!("trial {} comes out of the order of completion", trial.number)));
        };
        if trial.cost.is_some_and(|cost| !cost.is_finite() || cost < 0.0) {
            return Err(inconsistent(format!("trial {} has an impossible cost", trial.number)));
        }
        self.step(completion, Some(trial).filter(|trial| trial.exclusion.is_none()));
        Ok(())
    }

    /// Passes over the next completed trial, which is outside the study's space. It is still counted, and
    /// [`after`](Restoring::after) may go back as for one that is learnt.
    pub fn pass_over(&mut self, completion: u64) -> Result<(), RestoreError> {
        if completion <= self.after() {
            return Err(inconsistent(format!("completion {completion} comes out of its order")));
        }
        self.step(completion, None);
        Ok(())
    }

    /// Goes on to a completion, with its trial unless that is passed over.
    fn step(&mut self, completion: u64, trial: Option<&Trial>) {
        // Trials in between may be gone.
        let since = self.tuner.knowledge.models.since;
        self.taught = self.taught.filter(|_| completion <= since);
        if !self.models_begun && completion > since {
            self.reach(since);
            self.begin_models();
            if self.taught.is_some() {
                return;
            }
        }
        if let Some(taught) = &mut self.taught {
            *taught = completion;
            if let Some(trial) = trial
                && let Ok(normalised) = self.tuner.spec.indicators.normalise(&trial.indicators)
            {
                self.tuner.knowledge.teach(&self.tuner.spec, trial, &normalised);
            }
            self.tuner.knowledge.models.catch_up(&self.tuner.spec.space);
        } else if let Some(trial) = trial {
            self.reach(completion - 1);
            let is_few = self.tuner.searches.few().count().is_some();
            self.tuner.knowledge.complete(&self.tuner.spec, is_few, trial);
        } else {
            self.reach(completion);
        }
        self.taught = self.taught.filter(|taught| *taught < since);
        self.begin_models();
    }

    /// Begins the models once the tables have reached their completion.
    fn begin_models(&mut self) {
        let tuner = &mut self.tuner;
        let since = tuner.knowledge.models.since;
        if self.models_begun || tuner.knowledge.last_completion != since {
            return;
        }
        self.models_begun = true;
        let predictor = tuner.spec.policy.predictor;
        tuner.knowledge.models.begin(&tuner.spec, predictor, &tuner.knowledge.states, since);
        if Predictors::are_needed(predictor) && since > 0 {
            self.taught = Some(since.saturating_sub(MODELS_TRIALS_MAX));
        }
    }

    /// Goes on in the order of completion past trials that are not stored any more. They are still counted.
    fn reach(&mut self, completion: u64) {
        assert!(
            completion >= self.tuner.knowledge.last_completion,
            "{completion} after {}",
            self.tuner.knowledge.last_completion
        );
        self.tuner.knowledge.completed += completion - self.tuner.knowledge.last_completion;
        self.tuner.knowledge.last_completion = completion;
    }

    fn restore_state(&mut self, record: StateRecord) -> Result<(), RestoreError> {
        let StateRecord { id, indicators, fingerprint, mut search } = record;
        let expected = self.tuner.knowledge.states.len() as u64 + 1;
        if id != expected {
            return Err(inconsistent(format!("state {id} stands where state {expected} should")));
        }
        let width = self.tuner.spec.indicators.indicators().len();
        if indicators.len() != width || indicators.iter().any(|value| !value.is_finite()) {
            return Err(inconsistent(format!("state {id} does not have {width} finite indicators")));
        }
        if search.as_ref().is_some_and(|search| !search.fits(&self.tuner.spec.space)) {
            return Err(inconsistent(format!("the race of state {id} does not fit the space")));
        }
        if let Some(search) = search.as_mut().and_then(|exploration| exploration.search.as_mut()) {
            search.set_space(&self.tuner.spec.space);
        }
        let state = self.tuner.knowledge.found(indicators, fingerprint.as_ref());
        self.tuner.knowledge.states.restore_search(state, search.as_ref().is_some_and(Exploration::is_begun));
        self.tuner.searches.found(search);
        assert_eq!(state.0, expected, "states are founded in their order");
        Ok(())
    }

    fn restore_visit(&mut self, visit: Visit) -> Result<(), RestoreError> {
        let what = || format!("the visit of client {:?}", visit.client_id);
        check_state(&self.tuner.knowledge.states, visit.state_id, what)?;
        self.tuner.clients.visits.begin(visit);
        Ok(())
    }

    /// Enters the open trials. The answers that follow are those of a tuner that never stopped.
    pub fn finish(self, open: impl IntoIterator<Item = Trial>) -> Result<Tuner, RestoreError> {
        let mut tuner = self.tuner;
        if self.taught.is_some() || !self.models_begun {
            let since = tuner.knowledge.models.since;
            return Err(inconsistent(format!(
                "the models begin at completion {since}, which does not exist"
            )));
        }
        for trial in open {
            check_trial(&tuner, &trial)?;
            if trial.state == TrialState::Open {
                if !trial.decision.put_aside {
                    tuner.clients.visits.note_held(&trial.client_id, true);
                }
                tuner.clients.trials.enter(trial);
            }
        }
        // A point whose trial is gone would never come back by itself.
        for exploration in tuner.searches.all_mut() {
            let is_gone = |number: &&u64| tuner.clients.trials.get(TrialNumber(**number)).is_none();
            let gone = exploration.open.keys().filter(is_gone);
            for number in gone.copied().collect::<Vec<_>>() {
                exploration.release(number, None);
            }
            if let Some(race) = &mut exploration.confirming {
                race.keep_open(|number| tuner.clients.trials.get(TrialNumber(number)).is_some());
            }
        }
        Ok(tuner)
    }
}

impl Tuner {
    /// Drops all that rests on a completed trial of a state and is not learnt again from the completed
    /// trials. The trial is excluded from now on, or counts again. Searches, the race of the state, the
    /// clients' exploited configurations there and the references of their budgets are dropped. The tuner is
    /// then to be restored from the changed trials.
    pub fn disown(&mut self, state_id: u64) -> Change {
        let own = StateId(state_id);
        let (forgotten, visits) = self.clients.visits.disown(own);
        let mut change = Change { forgotten, visits, ..Change::default() };
        for state in self.knowledge.states.ids() {
            // The searches of other states began with what served best elsewhere.
            let runs = |search: &Exploration| search.search.is_some() || state == own;
            if self.searches.of(state).is_some_and(runs)
                && let Some(search) = self.searches.change(state)
            {
                search.disbelieve(state == own);
                change.states.push(self.standings().row(state));
            }
        }
        change
    }
}

fn check_trial(tuner: &Tuner, trial: &Trial) -> Result<(), RestoreError> {
    let what = || format!("trial {}", trial.number);
    check_state(&tuner.knowledge.states, trial.state_id, what)?;
    if trial.number == 0 || trial.number > tuner.clients.trials.last().0 {
        let last = tuner.clients.trials.last();
        return Err(inconsistent(format!("{} is not among the {last} handed out", what())));
    }
    Ok(())
}

fn check_state(states: &States, state_id: u64, what: impl Fn() -> String) -> Result<(), RestoreError> {
    if states.contains(StateId(state_id)) {
        Ok(())
    } else {
        Err(inconsistent(format!("{} names state {state_id}, which does not exist", what())))
    }
}

fn inconsistent(what: String) -> RestoreError {
    RestoreError::Inconsistent(what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::Policy;
    use crate::space::EarlierSpaces;
    use crate::trial::{Outcome, RawTrial};
    use crate::tuner::tests::{ask, cost, measured, spec};

    /// A tuner after `frames` frames in three states, its rows, and its completed trials.
    fn grown(policy: Policy, frames: u64) -> (Tuner, Snapshot, Vec<Trial>) {
        let mut tuner = Tuner::new(Arc::new(spec(policy))).expect("valid");
        let (mut states, mut completed) = (std::collections::BTreeMap::new(), Vec::new());
        for frame in 0..frames {
            let place = 0.3 * (frame / 5 % 3) as f64;
            let (trial, handed) = tuner.suggest(&ask("a", place, 0.5), 0).expect("valid");
            let (trial, reported) =
                tuner.report(&trial, measured(cost(&trial)), Outcome::Ok, 1).expect("valid");
            let rows = handed.states.into_iter().chain(reported.states);
            states.extend(rows.map(|state| (state.id, state)));
            completed.push(trial);
        }
        let states = states.into_values().collect();
        let snapshot = Snapshot { states, visits: vec![], last_trial: frames, models_since: 0 };
        (tuner, snapshot, completed)
    }

    fn restored(tuner: &Tuner, snapshot: &Snapshot, trials: &[Trial], with: Option<&Checkpoint>) -> Tuner {
        let mut restoring = Restoring::new(tuner.spec().clone(), snapshot.clone(), with).expect("consistent");
        loop {
            let after = restoring.after();
            let Some(next) = trials.iter().find(|trial| trial.completion > Some(after)) else { break };
            restoring.learn(next).expect("in order");
        }
        restoring.finish([]).expect("whole")
    }

    #[test]
    fn trials_that_were_removed_behind_a_checkpoint_are_not_missed() {
        for predictor in [PredictorMethod::NearestNeighbour, PredictorMethod::Auto] {
            let (early, _, _) = grown(Policy { predictor, ..Policy::default() }, 90);
            let checkpoint = early.knowledge.learnt(early.spec()).checkpoint().expect("a small study");
            let (tuner, snapshot, all) = grown(Policy { predictor, ..Policy::default() }, 120);
            let keep = early.knowledge.learnt(early.spec()).measured_by();
            let kept: Vec<Trial> = all
                .iter()
                .filter(|trial| trial.number > 90 || keep.contains(&trial.number))
                .cloned()
                .collect();
            assert!(kept.len() < all.len());
            let back = restored(&tuner, &snapshot, &kept, Some(&checkpoint));
            assert_eq!(
                back.knowledge.learnt(back.spec()).checkpoint(),
                tuner.knowledge.learnt(tuner.spec()).checkpoint()
            );

            // Without a checkpoint the counts and the best of each state are still right.
            let back = restored(&tuner, &snapshot, &kept, None);
            assert_eq!(back.statistics(), tuner.statistics());
            for (state, other) in back.knowledge.states.known().iter().zip(tuner.knowledge.states.known()) {
                let best = |state: &crate::results::KnownState| {
                    state.results.best().map(|best| (best.configuration.clone(), best.mean_cost))
                };
                assert_eq!(best(state), best(other));
            }
        }
    }

    #[test]
    fn what_was_measured_in_an_earlier_space_is_known_and_takes_nothing_of_a_budget() {
        let policy = Policy { epsilon: 1.0, trials_per_state: 10, confirm_rounds: 0, ..Policy::default() };
        let (mut tuner, mut snapshot, all) = grown(policy, 90);
        let next = |tuner: &mut Tuner| tuner.suggest(&ask("b", 0.0, 0.5), 2).expect("valid").0;
        assert!(!next(&mut tuner).decision.explores(), "the budget is spent");
        let space = tuner.spec().space.clone();
        let earlier = EarlierSpaces::default().changed(&space, &space, 90, Default::default());
        let earlier = earlier.expect("a change");
        snapshot.states.iter_mut().for_each(|state| state.search = None);
        let adopt = |trial: &Trial| {
            let row = serde_json::to_string(trial).expect("plain data");
            let raw: RawTrial = serde_json::from_str(&row).expect("own row");
            raw.adopt(&earlier, &space).expect("it fits").expect("it is inside")
        };
        let adopted: Vec<Trial> = all.iter().map(adopt).collect();
        let mut back = restored(&tuner, &snapshot, &adopted, None);
        let state = back.knowledge.states.known()[0].results.clone();
        assert_eq!((state.runs(), state.searched()), (0, 0));
        assert!(state.tried() >= 5 && state.is_carried_over());
        let trial = next(&mut back);
        assert!(trial.decision.explores(), "{trial:?}");
        let is_same =
            |known: &Trial| known.state_id == trial.state_id && known.configuration == trial.configuration;
        assert!(!all.iter().any(is_same), "what is known is not measured again: {trial:?}");
    }

    #[test]
    fn a_trial_that_is_passed_over_counts_and_teaches_nothing() {
        let (tuner, snapshot, all) = grown(Policy::default(), 60);
        let mut restoring = Restoring::new(tuner.spec().clone(), snapshot, None).expect("consistent");
        for trial in &all[..59] {
            restoring.learn(trial).expect("in order");
        }
        let mut learnt = restoring.tuner.clone();
        restoring.pass_over(60).expect("in order");
        assert_eq!(restoring.after(), 60);
        assert!(restoring.pass_over(60).is_err(), "it was passed over");
        let back = restoring.finish([]).expect("whole");
        assert_eq!(back.statistics().completed_trials, 60);
        (learnt.knowledge.completed, learnt.knowledge.last_completion) = (60, 60);
        assert_eq!(
            back.knowledge.learnt(back.spec()).checkpoint(),
            learnt.knowledge.learnt(learnt.spec()).checkpoint()
        );
    }

    #[test]
    fn models_begin_where_their_first_trial_is_gone() {
        let policy = Policy { predictor: PredictorMethod::RbfGreedyGq, ..Policy::default() };
        let (tuner, snapshot, all) = grown(policy, 60);
        for since in [20, 30, 40] {
            let snapshot = Snapshot { models_since: since, ..snapshot.clone() };
            let kept: Vec<Trial> = all.iter().filter(|trial| trial.number > 30).cloned().collect();
            let back = restored(&tuner, &snapshot, &kept, None);
            assert_eq!(back.statistics().completed_trials, 60);
        }
        // Backwards is no order.
        let mut restoring = Restoring::new(tuner.spec().clone(), snapshot, None).expect("consistent");
        restoring.learn(&all[5]).expect("behind a gap");
        assert!(restoring.learn(&all[5]).is_err() && restoring.learn(&all[2]).is_err());
    }
}
