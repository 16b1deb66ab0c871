//! The second half of a client's frame, and the other ends of a trial.

use crate::configuration::Configuration;
use crate::decision::{BudgetStatus, Choice, Exploit, ExploitRule, ExploitSource, Explore};
use crate::ids::{StateId, TrialNumber};
use crate::policy::Policy;
use crate::predict::Predictors;
use crate::results::Record;
use crate::search::{Feedback, Step, Verdict};
use crate::trial::{Outcome, Trial, TrialState};
use crate::tuner::auxiliaries::Beside;
use crate::tuner::budget::Terms;
use crate::tuner::rechecks::Moved;
use crate::tuner::searches::is_spent;
use crate::tuner::speeds::Unheld;
use crate::tuner::transfer;
use crate::tuner::{Change, Exploration, Tuner, TunerError, Visit, models, progress};

/// The learnt cost of a completed trial.
#[derive(Clone, Copy, Debug)]
pub(super) struct LearntCost {
    /// Its cost as the table has it.
    pub(super) cost: Option<f64>,
    /// The believed cost: it is drawn in where it lies far from all others.
    pub(super) believed: Option<f64>,
    /// The speed of its client's machine was found to have jumped.
    pub(super) has_jumped: bool,
    /// The costs of the state were found to have changed.
    pub(super) has_changed: bool,
}

impl Tuner {
    /// A trial with its result, which the caller has checked.
    pub(super) fn completed(
        &self,
        trial: &Trial,
        measurements: std::collections::BTreeMap<String, f64>,
        outcome: Outcome,
        now_ms: i64,
    ) -> Result<Trial, TunerError> {
        // A limit holds for full trials, and so does a cost.
        let is_full = trial.decision.fidelity.is_none();
        let beyond = match outcome {
            Outcome::Ok if is_full => self.spec.objective.beyond(&measurements)?,
            _ => None,
        };
        let outcome = beyond.map_or(outcome, Outcome::infeasible);
        let cost = match &outcome {
            Outcome::Ok => Some(self.spec.objective.cost(&measurements)?),
            Outcome::Aborted { lower_bound } => Some(*lower_bound + 0.0),
            Outcome::Infeasible { .. } | Outcome::Failed { .. } => None,
        };
        Ok(Trial {
            late: trial.state == TrialState::Expired || now_ms > trial.lease_expire_ms,
            state: TrialState::Completed,
            measurements,
            cost: cost.filter(|_| is_full),
            outcome: Some(outcome),
            complete_ms: Some(now_ms),
            completion: Some(self.last_completion + 1),
            ..trial.clone()
        })
    }

    /// Takes a completed trial out of the open ones, learns it, and passes its result to its search.
    pub(super) fn take(&mut self, completed: &Trial) -> Change {
        let (state, number) = (StateId(completed.state_id), TrialNumber(completed.number));
        let (before, tried) = (self.searches.changes(state), self.states.results(state).tried());
        self.end(number);
        let learnt = self.complete(completed);
        if learnt.has_changed {
            self.searches.begin_again(state);
            self.states.forget_search(state);
        }
        if learnt.has_jumped
            && let Some(exploration) = self.searches.change(state)
        {
            // The search learnt costs that are no longer believed. Another search begins with the rest of the
            // table.
            exploration.end();
        }
        if !matches!(completed.outcome, Some(Outcome::Failed { .. })) {
            self.searches.forgive(state, &completed.configuration);
        }
        self.stand_beside_start(completed, tried);
        let mut change = Change { trials: vec![completed.clone()], ..Change::default() };
        change.visits.extend(self.settle(completed));
        match completed.decision.fidelity {
            Some(_) => self.tell_cheaper(completed),
            None => self.tell_in_full(completed, &learnt),
        }
        if self.searches.changes(state) != before {
            change.states.push(self.state_record(state));
        }
        change
    }

    /// Passes the result of a full trial to its search and to the race.
    fn tell_in_full(&mut self, completed: &Trial, learnt: &LearntCost) {
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
        self.racing().tell_race(completed, learnt.cost);
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

    /// Passes the result of a trial at a cheaper level to its search, which alone hears of it. The point of a
    /// silent one goes back.
    fn tell_cheaper(&mut self, completed: &Trial) {
        let state = StateId(completed.state_id);
        let name = completed.decision.fidelity.as_ref();
        let levels = self.spec.objective.fidelities();
        let share = levels.iter().find(|level| Some(&level.name) == name).map(|level| level.cost);
        let verdict = self.cheaper_verdict(completed);
        if let Some(share) = share.filter(|_| !completed.decision.silent)
            && let Some(own) = self.searches.change(state)
        {
            own.release_cheaper(completed.number, share, verdict);
        } else {
            self.release(completed, None);
        }
        self.end_spent(state);
    }

    /// The factor on all costs of a client at the moment, where the policy follows the speed of machines.
    pub(super) fn pace_of(&self, client_id: &str) -> f64 {
        if self.spec.policy.track_speed { self.speeds.factor(client_id) } else { 1.0 }
    }

    /// The verdict of a trial at a cheaper level, corrected for the present speed of its client's machine;
    /// `None` where it failed.
    fn cheaper_verdict(&self, trial: &Trial) -> Option<Verdict> {
        let factor = self.pace_of(&trial.client_id);
        let at_factor = |cost: f64| (cost / factor).min(f64::MAX);
        match &trial.outcome {
            Some(Outcome::Ok) => {
                self.spec.objective.cost(&trial.measurements).ok().map(|cost| Verdict::Cost(at_factor(cost)))
            }
            Some(Outcome::Aborted { lower_bound }) => Some(Verdict::AtLeast(at_factor(*lower_bound))),
            Some(Outcome::Infeasible { .. }) => Some(Verdict::Infeasible),
            Some(Outcome::Failed { .. }) | None => None,
        }
    }

    /// Feeds a completed trial to the table and the models: now, and again when they are rebuilt. Returns the
    /// learnt cost.
    pub(super) fn complete(&mut self, completed: &Trial) -> LearntCost {
        let before = self.last_completion;
        self.completed += 1;
        self.last_completion = completed.completion.unwrap_or(self.last_completion + 1);
        assert!(self.last_completion > before, "completion {} after {before}", self.last_completion);
        let state = StateId(completed.state_id);
        let mut learnt = self.understood(completed);
        let understood = Trial { cost: learnt.cost, ..completed.clone() };
        // The table keeps every measurement and decides which of them count; all other parts learn the
        // believed cost.
        let is_cost = |cost: f64| (0.0..=f64::MAX).contains(&cost);
        assert!(learnt.cost.is_none_or(is_cost), "a cost of {:?}", learnt.cost);
        let results = self.states.results(state);
        // One failure does not make infeasible what ran before.
        let is_flaky = results.ran(&completed.configuration).is_some();
        learnt.believed = learnt.cost.map(|cost| results.believed(&completed.configuration, cost));
        assert!(learnt.believed.is_none_or(is_cost), "a cost of {:?}", learnt.believed);
        let believed = Trial { cost: learnt.believed, ..understood.clone() };
        let (trial, spec) = (&believed, &self.spec);
        self.history.frame(&trial.client_id, state);
        if self.history.frames(state) == 1 && self.states.note_first_frame(state) {
            self.models.begin_features(spec, &self.states);
        }
        let verdict = verdict(trial).filter(|verdict| *verdict != Verdict::Infeasible || !is_flaky);
        if is_silent(trial) {
            return learnt;
        }
        let has_failed = matches!(trial.outcome, Some(Outcome::Failed { .. })) || verdict.is_none();
        if trial.decision.explores() && !has_failed {
            let best = self.states.results(state).believed_best().map(|best| best.mean_cost);
            if let Some(best) = best.filter(|&best| best > 0.0) {
                self.history.explored(trial.cost.map(|cost| cost / best - 1.0));
            }
        }
        // The indicators were checked when the trial was handed out.
        let normalised = spec.indicators.normalise(&trial.indicators).ok();
        if let Some(Verdict::Cost(cost)) = verdict {
            if let Some(normalised) = &normalised {
                // The predictors are asked before they learn anything of the trial.
                let query = self.states.query(&spec.space, normalised, Some(state));
                self.models.predictors.test(&query, &trial.configuration, cost);
            }
            let default = spec.space.default_ref();
            transfer::compare(&mut self.states, default, state, &trial.configuration, cost);
        }
        let error = spec.objective.relative_error(&trial.measurements, &trial.standard_errors);
        self.states.learn(state, &understood, error);
        let results = self.states.results(state);
        if self.history.octave_is_over(state, results.tried()) {
            let before =
                self.history.best_then(state).and_then(|best| spec.space.configuration(best.clone()).ok());
            if let Some((best, gain)) = progress::gained(&spec.space, results, before.as_ref()) {
                self.history.octave_ends(state, best.to_raw(), gain);
            }
        }
        if let Some(normalised) = normalised.as_ref().filter(|_| verdict.is_some()) {
            self.teach(trial, normalised);
        }
        self.models.catch_up(&self.spec.space);
        self.states.forget_somewhere(self.searches.few().count().is_some());
        learnt
    }

    /// The cost of a completed trial without the shares that its auxiliary measurements and its movement
    /// within the state explain, corrected for the present speed of its client's machine.
    fn understood(&mut self, trial: &Trial) -> LearntCost {
        let unchanged =
            LearntCost { cost: trial.cost, believed: trial.cost, has_jumped: false, has_changed: false };
        let state = StateId(trial.state_id);
        // A trial carried over from elsewhere says nothing of the speed of the machine here.
        let is_own = trial.outcome.is_some() && !is_silent(trial) && trial.decision.origin.is_none();
        let Some(cost) = trial.cost.filter(|_| is_own) else { return unchanged };
        if trial.outcome != Some(Outcome::Ok) {
            let factor = self.pace_of(&trial.client_id);
            return LearntCost { cost: Some((cost / factor).min(f64::MAX)), ..unchanged };
        }
        let beside = self.beside(trial);
        let denoised =
            beside.as_ref().map_or(cost, |beside| self.auxiliaries.understood(state, cost, beside));
        let (mut factor, mut has_jumped) = (1.0, false);
        if self.spec.policy.track_speed && self.changed(trial, denoised) {
            return LearntCost { has_changed: true, ..unchanged };
        }
        if self.spec.policy.track_speed {
            let table = (self.states.results(state), self.spec.space.default_ref());
            // A difference that may have another explanation is no speed.
            let has_metrics = beside.as_ref().is_some_and(|beside| !beside.auxiliary.is_empty());
            let holds = !has_metrics || self.auxiliaries.explains(state);
            let what = (trial.client_id.as_str(), trial.number, state);
            let held = self.speeds.take(what, &trial.configuration, denoised, table, holds);
            factor = held.factor;
            self.states.amend(state, |results| results.note_pace(factor));
            if let Some(unheld) = held.jumped {
                has_jumped = true;
                let table = (self.states.results(state), self.spec.space.default_ref());
                self.rechecks.begin((&trial.client_id, state), &trial.configuration, table);
                self.take_back_unheld(state, &unheld);
            }
        }
        let mut learnt = (denoised / factor).min(f64::MAX);
        if let Some(beside) = &beside {
            let what = (trial.number, &trial.configuration);
            let before = (factor, self.states.results(state));
            if let Some((restated, explains_more)) = self.auxiliaries.take(state, what, cost, beside, before)
            {
                self.states.amend(state, |results| {
                    restated.iter().for_each(|(configuration, costs)| results.restate(configuration, costs));
                });
                if explains_more {
                    // The search learnt other costs.
                    (factor, has_jumped) = (1.0, true);
                    self.speeds.reset(state);
                }
                learnt = (self.auxiliaries.understood(state, cost, beside) / factor).min(f64::MAX);
                // The table will learn the trial once more.
                self.states.amend(state, |results| results.withhold(&trial.configuration));
            }
        }
        LearntCost { cost: Some(learnt), believed: Some(learnt), has_jumped, has_changed: false }
    }

    /// The data of a trial beside its cost. `None` where it lacks a metric that the study names.
    fn beside(&self, trial: &Trial) -> Option<Beside> {
        let auxiliary = match self.spec.objective.auxiliary().is_empty() {
            true => Vec::new(),
            false => self.spec.objective.auxiliary_of(&trial.measurements)?,
        };
        let anchor = &self.states[StateId(trial.state_id)].anchor;
        // The indicators were checked when the trial was handed out.
        let normalised = self.spec.indicators.normalise(&trial.indicators).unwrap_or_default();
        let mut offset: Vec<f64> = normalised.iter().zip(anchor).map(|(x, anchor)| x - anchor).collect();
        if offset.iter().any(|offset| offset.abs() > self.spec.state_tolerance) {
            // No state matches, and there may be no more of them: its distance says nothing.
            offset.clear();
        }
        Some(Beside { auxiliary, offset })
    }

    /// Whether a trial shows that the costs of its state have changed. Its measurements are then forgotten,
    /// and later ones hold the speed of machines.
    fn changed(&mut self, trial: &Trial, cost: f64) -> bool {
        let state = StateId(trial.state_id);
        let finding = self.rechecks.take((&trial.client_id, state), &trial.configuration, cost);
        let is_changed = finding == Some(Moved::State);
        if is_changed {
            self.states.begin_again(state);
            self.auxiliaries.begin_again(state);
            self.history.begin_again(state);
            self.speeds.reset(state);
        }
        is_changed
    }

    /// Takes back the trials that were learnt since the speed of a client's machine was last held, before it
    /// jumped.
    fn take_back_unheld(&mut self, state: StateId, unheld: &[Unheld]) {
        let trials: Vec<u64> = unheld.iter().map(|one| one.trial).collect();
        let restated = self.auxiliaries.take_back(state, &trials);
        self.states.amend(state, |results| {
            results.note_disturbance();
            for one in unheld {
                match restated.iter().find(|(configuration, _)| *configuration == one.configuration.0) {
                    Some((configuration, costs)) => results.restate(configuration, costs),
                    None => results.take_back(&one.configuration.0, one.trial, one.cost),
                }
            }
        });
    }

    /// Teaches the models a completed trial whose result the tables hold.
    pub(super) fn teach(&mut self, trial: &Trial, normalised: &[f64]) {
        let needed = Predictors::are_needed(self.spec.policy.predictor);
        if let Some(verdict) = verdict(trial).filter(|_| needed) {
            let (state, configuration) = (StateId(trial.state_id), &trial.configuration);
            let result = models::Result { normalised, state, configuration, verdict };
            self.models.teach(&self.spec, &self.states, &result);
        }
    }

    /// Enters a completed trial into its client's account; the row of the visit, if there is one.
    fn settle(&mut self, trial: &Trial) -> Option<Visit> {
        let is_default = trial.configuration == *self.spec.space.default_ref() || runs_as_default(trial);
        let most = self.most_charged(trial);
        let account = self.visits.account_mut(&trial.client_id)?;
        account.report(trial.number, trial.state_id, trial.cost.map(|cost| cost.min(most)), is_default);
        self.visits.of(&trial.client_id).cloned()
    }

    /// The most that a trial is charged: the assumed worst for an incumbent, which is not stopped.
    fn most_charged(&self, trial: &Trial) -> f64 {
        let reference = match &trial.decision.choice {
            Choice::Explore(Explore {
                budget: BudgetStatus { set_aside: Some(_), reference_cost, .. },
                ..
            }) if !trial.decision.explores() => *reference_cost,
            _ => None,
        };
        let terms = Terms::of(&self.spec.policy);
        terms.zip(reference).map_or(f64::INFINITY, |(terms, reference)| terms.worst(reference))
    }

    /// Takes an open trial out unmeasured and gives its point back.
    pub(super) fn take_back(&mut self, number: TrialNumber, state: TrialState) -> Option<Trial> {
        let mut trial = self.end(number)?;
        trial.state = state;
        self.release(&trial, None);
        Some(trial)
    }

    /// Takes a trial out of the open ones.
    fn end(&mut self, number: TrialNumber) -> Option<Trial> {
        let trial = self.trials.remove(number)?;
        self.visits.note_held(&trial.client_id, self.trials.held_by(&trial.client_id) > 0);
        Some(trial)
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
        let (results, policy): (_, &Policy) = (self.states.results(state), &self.spec.policy);
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

    /// Whether a record that is not open can be of this study.
    pub(super) fn is_ours(&self, trial: &Trial) -> bool {
        trial.number <= self.trials.last().0 && self.states.contains(StateId(trial.state_id))
    }
}

/// Whether only the infeasibility of a trial is learnt, or at a cheaper level nothing of it.
fn is_silent(trial: &Trial) -> bool {
    let is_infeasible = matches!(trial.outcome, Some(Outcome::Infeasible { .. }));
    trial.decision.fidelity.is_some() || trial.decision.silent && !is_infeasible
}

/// Whether a trial runs its client's start as others run the default: it is a reference for a budget.
fn runs_as_default(trial: &Trial) -> bool {
    let is_reference =
        |one: &Exploit| one.source == ExploitSource::Default && one.rule == ExploitRule::Budget;
    trial.decision.measures_start()
        || matches!(&trial.decision.choice, Choice::Exploit(exploit) if is_reference(exploit))
}

/// The verdict of a completed trial on its configuration; `None` where it has none.
fn verdict(trial: &Trial) -> Option<Verdict> {
    match (&trial.outcome, trial.cost) {
        _ if is_silent(trial) => None,
        (Some(Outcome::Ok), Some(cost)) => Some(Verdict::Cost(cost)),
        (Some(Outcome::Aborted { lower_bound }), _) => Some(Verdict::AtLeast(*lower_bound)),
        (Some(Outcome::Infeasible { .. }), _) => Some(Verdict::Infeasible),
        _ => None,
    }
}
