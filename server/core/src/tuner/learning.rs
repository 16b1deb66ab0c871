//! Learning from completed trials: what a cost is believed to be, and what the tables, the speeds of machines
//! and the models make of it.

use crate::decision::Choice;
use crate::ids::StateId;
use crate::predict::Predictors;
use crate::search::Verdict;
use crate::study::StudySpec;
use crate::trial::{Outcome, Rule, Trial};
use crate::tuner::exploring::transfer;
use crate::tuner::knowledge::{Beside, Knowledge, LearntCost, Moved, Unheld, models, progress};

impl Knowledge {
    /// Feeds a completed trial to the tables and the models: now, and again when they are rebuilt. Returns
    /// the learnt cost. `is_few` says whether the space has so few configurations that all can be tried.
    pub(super) fn complete(&mut self, spec: &StudySpec, is_few: bool, completed: &Trial) -> LearntCost {
        let before = self.last_completion;
        self.completed += 1;
        self.last_completion = completed.completion.unwrap_or(before + 1);
        assert!(self.last_completion > before, "completion {} after {before}", self.last_completion);
        self.learn(spec, is_few, completed)
    }

    fn learn(&mut self, spec: &StudySpec, is_few: bool, completed: &Trial) -> LearntCost {
        let state = StateId(completed.state_id);
        let mut learnt = self.understood(spec, completed);
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
        let trial = &believed;
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
            self.teach(spec, trial, normalised);
        }
        self.models.catch_up(&spec.space);
        self.states.forget_somewhere(is_few);
        learnt
    }

    /// The cost of a completed trial without the shares that its auxiliary measurements and its movement
    /// within the state explain, corrected for the present speed of its client's machine.
    fn understood(&mut self, spec: &StudySpec, trial: &Trial) -> LearntCost {
        let unchanged =
            LearntCost { cost: trial.cost, believed: trial.cost, has_jumped: false, has_changed: false };
        let state = StateId(trial.state_id);
        // A trial carried over from elsewhere says nothing of the speed of the machine here.
        let is_own = trial.outcome.is_some() && !is_silent(trial) && trial.decision.origin.is_none();
        if is_own && trial.outcome != Some(Outcome::Ok) {
            self.rechecks.give_up((&trial.client_id, state), &trial.configuration);
        }
        let Some(cost) = trial.cost.filter(|_| is_own) else { return unchanged };
        if trial.outcome != Some(Outcome::Ok) {
            let factor = self.speeds.pace_of(&spec.policy, &trial.client_id);
            return LearntCost { cost: Some((cost / factor).min(f64::MAX)), ..unchanged };
        }
        let beside = self.beside(spec, trial);
        let denoised =
            beside.as_ref().map_or(cost, |beside| self.auxiliaries.understood(state, cost, beside));
        let (mut factor, mut has_jumped) = (1.0, false);
        if spec.policy.track_speed && self.changed(trial, denoised) {
            return LearntCost { has_changed: true, ..unchanged };
        }
        if spec.policy.track_speed {
            let pace = self.speeds.pace_of(&spec.policy, &trial.client_id);
            let table = (self.states.results(state), spec.space.default_ref());
            // A difference that may have another explanation is no speed.
            let has_metrics = beside.as_ref().is_some_and(|beside| !beside.auxiliary.is_empty());
            let holds = !has_metrics || self.auxiliaries.explains(state);
            let what = (trial.client_id.as_str(), trial.number, state);
            let is_again = trial.decision.rule() == Some(Rule::Incumbent);
            let held = self.speeds.take(what, &trial.configuration, denoised, table, (holds, is_again));
            factor = held.factor;
            self.states.amend(state, |results| results.note_pace(trial, denoised, factor));
            // While others are explored, a shift may be the luck by which they were chosen.
            let is_answer = matches!(trial.decision.choice, Choice::Exploit(_));
            if held.jumped.is_some() || held.is_shifted && is_answer {
                let table = (self.states.results(state), spec.space.default_ref());
                let what = (trial.client_id.as_str(), state);
                self.rechecks.begin(what, &trial.configuration, (denoised, pace), table);
            }
            if let Some(unheld) = held.jumped {
                has_jumped = true;
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
                    if explains_more {
                        results.forget_at_rest();
                    }
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
    fn beside(&self, spec: &StudySpec, trial: &Trial) -> Option<Beside> {
        let auxiliary = match spec.objective.auxiliary().is_empty() {
            true => Vec::new(),
            false => spec.objective.auxiliary_of(&trial.measurements)?,
        };
        let anchor = &self.states[StateId(trial.state_id)].anchor;
        // The indicators were checked when the trial was handed out.
        let normalised = spec.indicators.normalise(&trial.indicators).unwrap_or_default();
        let mut offset: Vec<f64> = normalised.iter().zip(anchor).map(|(x, anchor)| x - anchor).collect();
        if offset.iter().any(|offset| offset.abs() > spec.state_tolerance) {
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
    pub(super) fn teach(&mut self, spec: &StudySpec, trial: &Trial, normalised: &[f64]) {
        let needed = Predictors::are_needed(spec.policy.predictor);
        if let Some(verdict) = verdict(trial).filter(|_| needed) {
            let (state, configuration) = (StateId(trial.state_id), &trial.configuration);
            let result = models::Result { normalised, state, configuration, verdict };
            self.models.teach(spec, &self.states, &result);
        }
    }
}

/// Whether only the infeasibility of a trial is learnt, or at a cheaper level nothing of it.
fn is_silent(trial: &Trial) -> bool {
    let is_infeasible = matches!(trial.outcome, Some(Outcome::Infeasible { .. }));
    trial.decision.fidelity.is_some() || trial.decision.silent && !is_infeasible
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
