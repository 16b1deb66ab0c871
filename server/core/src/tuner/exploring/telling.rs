//! Passing results on: a completed trial to the search and the race that wait for it.

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::objective::Objective;
use crate::results::Record;
use crate::search::{Feedback, Step, Verdict};
use crate::trial::{Outcome, Trial, TrialState};
use crate::tuner::Exploration;
use crate::tuner::exploring::confirmation::Racing;
use crate::tuner::exploring::searches::is_spent;
use crate::tuner::knowledge::LearntCost;

impl Racing<'_> {
    /// Passes the result of a full trial to its search and to the race.
    pub(crate) fn tell_in_full(&mut self, completed: &Trial, learnt: &LearntCost) {
        let (state, replicates) = (StateId(completed.state_id), self.spec.policy.replicates);
        let settled = self.states.results(state).settled(&completed.configuration, replicates);
        let is_first = |record: &Record| record.measurements == 1;
        let is_repeat = completed.decision.search_step() == Some(Step::Replicate);
        let record = self.states.results(state).record(&completed.configuration);
        let verdict = match (learnt.believed, settled) {
            // The search keeps the mean of its own repeats.
            (Some(cost), _) if is_repeat && completed.outcome == Some(Outcome::Ok) => {
                Some(Verdict::Cost(cost))
            }
            (Some(cost), Some(Verdict::Cost(_))) if record.is_some_and(is_first) => Some(Verdict::Cost(cost)),
            _ => settled,
        };
        self.tell_of_transfer(completed, state, verdict);
        self.tell_race(completed, learnt.cost);
        self.release(completed, verdict.map(|verdict| Feedback { verdict, fresh: true }));
        self.weigh(state, &completed.configuration);
    }

    /// Tells a state's search what the measurements of a configuration count for, where standard errors of
    /// them are known.
    fn weigh(&mut self, state: StateId, configuration: &Configuration) {
        let goes_on = self.searches.of(state).is_some_and(|own| own.search.is_some());
        let weight = self.states.results(state).weight(configuration).filter(|_| goes_on);
        if let Some(weight) = weight
            && let Some(Exploration { search: Some(search), .. }) = self.searches.change(state)
        {
            search.weigh(&self.spec.space.encode(configuration), weight);
        }
    }

    /// Passes the result of a trial at a cheaper level to its search, which alone hears of it: its cost at
    /// the usual speed of its client's machine, whose present `pace` is this factor. The point of a silent
    /// one goes back.
    pub(crate) fn tell_cheaper(&mut self, completed: &Trial, pace: f64) {
        let state = StateId(completed.state_id);
        let name = completed.decision.fidelity.as_ref();
        let levels = self.spec.objective.fidelities();
        let share = levels.iter().find(|level| Some(&level.name) == name).map(|level| level.cost);
        let verdict = cheaper_verdict(&self.spec.objective, pace, completed);
        if let Some(share) = share.filter(|_| !completed.decision.silent)
            && let Some(own) = self.searches.change(state)
        {
            own.release_cheaper(completed.number, share, verdict);
        } else {
            self.release(completed, None);
        }
        self.end_spent(state);
    }

    /// Gives the state's search, if there is one, results that were taken over from others or measured
    /// elsewhere.
    fn tell_of_transfer(&mut self, trial: &Trial, state: StateId, verdict: Option<Verdict>) {
        let goes_on = self.searches.of(state).is_some_and(|own| own.search.is_some());
        let Some(verdict) = verdict.filter(|_| goes_on && trial.decision.is_from_elsewhere()) else { return };
        let point = self.spec.space.encode(&trial.configuration);
        if let Some(Exploration { search: Some(search), .. }) = self.searches.change(state) {
            search.hear(point, verdict);
        }
    }

    /// Gives back the point of a trial that has ended unmeasured, in this state.
    pub(crate) fn take_back(&mut self, mut trial: Trial, state: TrialState) -> Trial {
        trial.state = state;
        self.release(&trial, None);
        trial
    }

    /// Ends a trial's hold on a point of its state's search, or on a contender of its race.
    fn release(&mut self, trial: &Trial, feedback: Option<Feedback>) {
        let state = StateId(trial.state_id);
        let holds = |own: &Exploration| own.open.contains_key(&trial.number) || own.confirms(trial.number);
        if !self.searches.of(state).is_some_and(holds) {
            return;
        }
        let Some(exploration) = self.searches.change(state) else { return };
        exploration.release(trial.number, feedback);
        self.end_spent(state);
    }

    /// Drops a spent search, which is not needed any more: the table holds its results.
    fn end_spent(&mut self, state: StateId) {
        let (results, policy) = (self.states.results(state), &self.spec.policy);
        let Some(exploration) = self.searches.change(state) else { return };
        if exploration.open.is_empty()
            && is_spent(
                exploration,
                results,
                policy,
                exploration.room().max(policy.trials_per_state as usize),
            )
            && (policy.replicates == 1 || results.is_settled(policy.replicates))
        {
            exploration.end();
        }
    }
}

/// The verdict of a trial at a cheaper level, corrected by the `factor` of its client's machine; `None` where
/// it failed.
fn cheaper_verdict(objective: &Objective, factor: f64, trial: &Trial) -> Option<Verdict> {
    let at_factor = |cost: f64| (cost / factor).min(f64::MAX);
    match &trial.outcome {
        Some(Outcome::Ok) => {
            objective.cost(&trial.measurements).ok().map(|cost| Verdict::Cost(at_factor(cost)))
        }
        Some(Outcome::Aborted { lower_bound }) => Some(Verdict::AtLeast(at_factor(*lower_bound))),
        Some(Outcome::Infeasible { .. }) => Some(Verdict::Infeasible),
        Some(Outcome::Failed { .. }) | None => None,
    }
}
