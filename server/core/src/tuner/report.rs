//! The second half of a client's frame, and the other ends a trial can come to.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::knowledge::Knowledge;
use crate::limits::{RECORDS_PER_STUDY_MAX, RELEARNT_MAX};
use crate::policy::Policy;
use crate::predict::{Lesson, Predictors};
use crate::search::{Feedback, Step, Verdict};
use crate::trial::{Mode, Outcome, Trial, TrialState};
use crate::tuner::{Change, Exploration, Tuner, TunerError, Visit, Work, checks, place, query};

impl Tuner {
    /// Takes the result of a trial and tells what must be stored before it is acknowledged.
    ///
    /// `trial` is the record the caller has: [`Tuner::open_trial`], or what its store holds when the lease
    /// has run out (the result is taken all the same and flagged `late`). [`TunerError::AlreadyCompleted`]
    /// and [`TunerError::Abandoned`] tell what the caller's record says. `measurements` are finite and not
    /// negative; with [`Outcome::Ok`] they hold every metric of the objective.
    pub fn report(
        &mut self,
        trial: &Trial,
        measurements: BTreeMap<String, f64>,
        outcome: Outcome,
        now_ms: i64,
    ) -> Result<(Trial, Change), TunerError> {
        let number = trial.number;
        let trial = match (self.open.get(&number), trial.state) {
            (Some(open), _) => open,
            (None, TrialState::Completed) => return Err(TunerError::AlreadyCompleted { number }),
            (None, TrialState::Abandoned) => return Err(TunerError::Abandoned { number }),
            (None, TrialState::Expired) if self.is_ours(trial) => trial,
            (None, _) => return Err(TunerError::UnknownTrial { number }),
        };
        checks::measurements(&measurements)?;
        checks::outcome(&outcome)?;
        let cost = match &outcome {
            Outcome::Ok => Some(self.spec.objective.cost(&measurements)?),
            Outcome::Aborted { lower_bound } => Some(*lower_bound + 0.0),
            Outcome::Infeasible { .. } | Outcome::Failed { .. } => None,
        };
        let outcome_is_ok = outcome == Outcome::Ok;
        let completed = Trial {
            late: trial.state == TrialState::Expired || now_ms > trial.lease_expire_ms,
            state: TrialState::Completed,
            measurements,
            cost,
            outcome: Some(outcome),
            complete_ms: Some(now_ms),
            completion: Some(self.last_completion + 1),
            ..trial.clone()
        };
        self.remove(number);
        self.complete(&completed);
        let state = place(completed.state_id);
        let visit = self.settle(&completed);
        let settled =
            self.states[state].knowledge.settled(&completed.configuration, self.spec.policy.replicates);
        let verdict = match completed.cost {
            // The search keeps the mean of what it has measured again itself.
            Some(cost) if is_replicate(&completed) && outcome_is_ok => Some(Verdict::Cost(cost)),
            _ => settled,
        };
        let mut change = Change { trials: vec![completed.clone()], ..Change::default() };
        change.visits.extend(visit);
        let heard = self.tell_of_transfer(&completed, state, verdict);
        if self.release(&completed, verdict.map(|verdict| Feedback { verdict, fresh: true })) || heard {
            change.states.push(self.state_record(state));
        }
        Ok((completed, change))
    }

    /// Feeds a completed trial to the table and the models: now, and again when they are rebuilt.
    pub(super) fn complete(&mut self, trial: &Trial) {
        self.completed += 1;
        self.last_completion = trial.completion.unwrap_or(self.last_completion + 1);
        let state = place(trial.state_id);
        self.history.frame(&trial.client_id, state);
        if self.history.frames(state) == 1 && self.atlas.weigh(&self.states[state].anchor) {
            self.begin_features();
        }
        let verdict = verdict(trial);
        if is_silent(trial) {
            return;
        }
        if trial.mode == Mode::Explore && !matches!(trial.outcome, Some(Outcome::Failed { .. })) {
            let best = self.states[state].knowledge.best().map(|best| best.mean_cost);
            if let Some(best) = best.filter(|&best| best > 0.0) {
                self.history.explored(trial.cost.map(|cost| cost / best - 1.0));
            }
        }
        if let Some(Verdict::Cost(cost) | Verdict::AtLeast(cost)) = verdict {
            self.screening.learn(&self.spec.space, state, &trial.configuration, cost);
        }
        // The indicators were checked when the trial was handed out.
        if let Some(Verdict::Cost(cost)) = verdict.filter(|_| self.predictors.are_tested())
            && let Ok(normalised) = &self.spec.indicators.normalise(&trial.indicators)
        {
            // What would they have said of it? Asked before anything of the trial is known.
            let query = query(&self.spec, &self.states, &self.atlas, &self.fleet, normalised, Some(state));
            self.predictors.test(&query, &trial.configuration, cost);
        }
        if let Some(Verdict::Cost(cost)) = verdict {
            self.compare(trial, state, cost);
        }
        let before = self.states[state].knowledge.remembered();
        Arc::make_mut(&mut self.states[state].knowledge).learn(trial, self.spec.space.default_ref());
        let knowledge = &self.states[state].knowledge;
        self.remembered = self.remembered + knowledge.remembered() - before;
        if let Some(best) = knowledge.best() {
            self.history.progress(state, knowledge.tried(), best.mean_cost);
        }
        self.atlas.note(&self.states[state]);
        self.teach(trial);
        self.settle_debts();
        self.forget_somewhere();
    }

    /// Begins the models of features anew where other indicators are left out than before, and teaches them what the
    /// tables hold of the states that were met last.
    fn begin_features(&mut self) {
        if !self.predictors.have_features() {
            return;
        }
        self.predictors.begin_features(self.untaught(self.spec.policy.predictor));
        let mut latest: Vec<usize> = (0..self.states.len()).collect();
        latest.sort_unstable_by_key(|&state| Reverse((self.states[state].knowledge.latest(), state)));
        let mut left = RELEARNT_MAX;
        let enough = latest.iter().position(|&state| {
            let records = self.states[state].knowledge.remembered();
            let fits = records <= left;
            left = left.saturating_sub(records);
            !fits
        });
        latest.truncate(enough.unwrap_or(latest.len()));
        for &state in latest.iter().rev() {
            let known = &self.states[state];
            let factor = self.fleet.factor(known.machine, 0);
            let default = self.default_cost(state).map(|cost| (factor * cost).min(f64::MAX));
            for record in known.knowledge.ranked() {
                self.predictors.learn_features(&Lesson {
                    state: &known.anchor,
                    configuration: &record.configuration,
                    point: &self.spec.space.encode(&record.configuration),
                    verdict: Verdict::Cost((factor * record.mean_cost).min(f64::MAX)),
                    default_cost: default,
                    origin: self.fleet.origin(known.machine),
                });
            }
        }
    }

    /// Teaches the models a completed trial whose result the tables hold.
    pub(super) fn teach(&mut self, trial: &Trial) {
        let Some(verdict) = verdict(trial).filter(|_| Predictors::are_needed(self.spec.policy.predictor))
        else {
            return;
        };
        let Ok(normalised) = self.spec.indicators.normalise(&trial.indicators) else {
            return;
        };
        let point = self.spec.space.encode(&trial.configuration);
        let state = place(trial.state_id);
        let machine = self.states[state].machine;
        let factor = self.fleet.factor(machine, 0);
        let on_the_first = |cost: f64| if machine == 0 { cost } else { (factor * cost).min(f64::MAX) };
        self.predictors.learn(&Lesson {
            state: &normalised,
            configuration: &trial.configuration,
            point: &point,
            verdict: match verdict {
                Verdict::Cost(cost) => Verdict::Cost(on_the_first(cost)),
                Verdict::AtLeast(bound) => Verdict::AtLeast(on_the_first(bound)),
                Verdict::Infeasible => Verdict::Infeasible,
            },
            default_cost: self.default_cost(state).map(on_the_first),
            origin: self.fleet.origin(machine),
        });
    }

    /// Where more configurations are remembered than a study may, forgets most of the states that nobody has
    /// reported from for longest.
    fn forget_somewhere(&mut self) {
        if self.remembered <= self.forget_above {
            return;
        }
        let aim = RECORDS_PER_STUDY_MAX - RECORDS_PER_STUDY_MAX / 8;
        let each = (aim / 2 / self.states.len()).max(1);
        let mut order: Vec<usize> = (0..self.states.len()).collect();
        order.sort_unstable_by_key(|&state| (self.states[state].knowledge.latest(), state));
        for state in order {
            let before = self.states[state].knowledge.remembered();
            if self.remembered <= aim {
                break;
            }
            if before > each {
                let knowledge = Arc::make_mut(&mut self.states[state].knowledge);
                knowledge.forget(each, self.spec.space.default_ref());
                self.remembered = self.remembered + knowledge.remembered() - before;
            }
        }
        // Where states are so many that this was not enough, not at every report.
        self.forget_above = RECORDS_PER_STUDY_MAX.max(self.remembered + self.remembered / 8);
    }

    /// Enters a completed trial into its client's account; the row of the visit, if there is one.
    fn settle(&mut self, trial: &Trial) -> Option<Visit> {
        let is_default = trial.configuration == *self.spec.space.default_ref();
        let visit = self.visits.get_mut(&trial.client_id)?;
        visit.account.as_mut()?.report(trial.number, trial.state_id, trial.cost, is_default);
        Some(visit.clone())
    }

    /// Gives a trial back unmeasured; its search point is handed out again. Idempotent. `trial` is the
    /// record the caller has, as for [`Tuner::report`].
    pub fn abandon(&mut self, trial: &Trial) -> Result<(Trial, Change), TunerError> {
        let number = trial.number;
        if let Some(state) = self.open.get(&number).map(|open| place(open.state_id)) {
            let before = self.work[state].changes;
            let abandoned = self.take_back(number, TrialState::Abandoned);
            let mut change = Change { trials: abandoned.into_iter().collect(), ..Change::default() };
            if self.work[state].changes != before {
                change.states.push(self.state_record(state));
            }
            let trial = change.trials[0].clone();
            return Ok((trial, change));
        }
        match trial.state {
            TrialState::Completed => Err(TunerError::AlreadyCompleted { number }),
            TrialState::Abandoned => Ok((trial.clone(), Change::default())),
            TrialState::Expired if self.is_ours(trial) => {
                let abandoned = Trial { state: TrialState::Abandoned, ..trial.clone() };
                Ok((abandoned.clone(), Change { trials: vec![abandoned], ..Change::default() }))
            }
            _ => Err(TunerError::UnknownTrial { number }),
        }
    }

    /// Renews the lease of an open trial, counted from now.
    pub fn extend_lease(&mut self, trial: &Trial, now_ms: i64) -> Result<(Trial, Change), TunerError> {
        match self.renew(trial.number, now_ms) {
            Some(renewed) => Ok((renewed.clone(), Change { trials: vec![renewed], ..Change::default() })),
            None => Err(TunerError::NotOpen { number: trial.number, state: trial.state }),
        }
    }

    /// Ends every lease that has run out by `now_ms`: the trial is expired and its search point goes back.
    pub fn expire(&mut self, now_ms: i64) -> Change {
        let ended = self.leases.range(..(now_ms, 0));
        let due: BTreeSet<u64> = ended.map(|&(_, number)| number).collect();
        let mut change = Change::default();
        let mut states = BTreeSet::new();
        for number in due {
            let Some(state) = self.open.get(&number).map(|trial| place(trial.state_id)) else {
                continue;
            };
            let before = self.work[state].changes;
            change.trials.extend(self.take_back(number, TrialState::Expired));
            if self.work[state].changes != before {
                states.insert(state);
            }
        }
        change.states = states.into_iter().map(|state| self.state_record(state)).collect();
        change
    }

    /// Takes an open trial out unmeasured and gives its point back.
    pub(super) fn take_back(&mut self, number: u64, state: TrialState) -> Option<Trial> {
        let mut trial = self.remove(number)?;
        trial.state = state;
        self.release(&trial, None);
        Some(trial)
    }

    fn release(&mut self, trial: &Trial, feedback: Option<Feedback>) -> bool {
        let state = place(trial.state_id);
        let Work { exploration: Some(exploration), changes, .. } = &mut self.work[state] else {
            return false;
        };
        if !exploration.release(trial.number, feedback) {
            return false;
        }
        *changes += 1;
        // What is spent is not needed any more: the table knows what came of it.
        let (knowledge, policy) = (&self.states[state].knowledge, &self.spec.policy);
        if exploration.open.is_empty()
            && is_spent(exploration, knowledge, policy)
            && (policy.replicates == 1 || knowledge.is_settled(policy.replicates))
        {
            exploration.end();
        }
        true
    }

    /// Whether a record that is not open can be of this study.
    fn is_ours(&self, trial: &Trial) -> bool {
        let states = 1..=self.states.len() as u64;
        trial.number <= self.last_trial && states.contains(&trial.state_id)
    }
}

/// Whether a search has no trial left to hand out that adds a configuration.
pub(super) fn is_spent(exploration: &Exploration, knowledge: &Knowledge, policy: &Policy) -> bool {
    let taken = knowledge.tried() + exploration.repeats() as usize + exploration.open.len();
    taken >= policy.trials_per_state as usize
}

/// Whether nothing is to be learnt of a trial but that it cannot be run.
fn is_silent(trial: &Trial) -> bool {
    trial.reason.explanation.silent && !matches!(trial.outcome, Some(Outcome::Infeasible { .. }))
}

/// What a completed trial says of its configuration; `None` where it says nothing.
fn verdict(trial: &Trial) -> Option<Verdict> {
    match (&trial.outcome, trial.cost) {
        _ if is_silent(trial) => None,
        (Some(Outcome::Ok), Some(cost)) => Some(Verdict::Cost(cost)),
        (Some(Outcome::Aborted { lower_bound }), _) => Some(Verdict::AtLeast(*lower_bound)),
        (Some(Outcome::Infeasible { .. }), _) => Some(Verdict::Infeasible),
        _ => None,
    }
}

/// Whether the trial measured a configuration again that its search had measured before.
fn is_replicate(trial: &Trial) -> bool {
    trial.reason.step == Step::Replicate.name()
}
