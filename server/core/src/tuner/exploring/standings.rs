//! The standings of the states' own measurements: each state's incumbent, its answer so far, and how far that
//! is proven.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::LEASES_LOST_MAX;
use crate::policy::Operation;
use crate::results::Record;
use crate::search::Verdict;
use crate::standing::{Confirmation, ConfirmationStage, Gain, LIKELY, Standing};
use crate::study::StudySpec;
use crate::tuner::exploring::race::Confirming;
use crate::tuner::exploring::searches::{Searches, is_spent};
use crate::tuner::knowledge::{Assessment, AssessmentRequest, Assessments, States};
use crate::tuner::plan::Planned;
use crate::tuner::{Best, StateRecord};

/// The answer of a state's own measurements.
#[derive(Clone, Debug)]
pub(crate) struct Answered {
    pub(crate) configuration: Configuration,
    pub(crate) cost: f64,
    /// Its gain over the default, or over the client's start.
    pub(crate) gain: Option<Gain>,
    /// The answer is the incumbent, because nothing was shown to be better.
    pub(crate) is_incumbent: bool,
    /// That incumbent is the default, or the client's start.
    pub(crate) nothing_better: bool,
    /// The most that any configuration may gain over the answer; `None` where there is no time to find out.
    pub(crate) gain_at_most: Option<f64>,
}

/// What a state's own measurements show, of all states.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Standings<'a> {
    pub(crate) spec: &'a Arc<StudySpec>,
    pub(crate) states: &'a States,
    pub(crate) searches: &'a Searches,
    pub(crate) assessments: &'a Assessments,
}

impl<'a> Standings<'a> {
    pub(crate) fn race(&self, state: StateId) -> Option<&'a Confirming> {
        self.searches.of(state)?.confirming.as_ref()
    }

    /// The incumbent of a state where that is not the default.
    pub(crate) fn confirmed(&self, state: StateId) -> Option<&'a Configuration> {
        Some(&self.searches.of(state)?.confirmed.as_ref()?.0)
    }

    /// A start, if it ran in a state.
    pub(crate) fn measured<'s>(
        &self,
        state: StateId,
        start: Option<&'s Configuration>,
    ) -> Option<&'s Configuration> {
        start.filter(|start| self.states.results(state).ran(start).is_some())
    }

    /// Whether a start is not known to fail in a state, and was not lost there too often.
    pub(crate) fn may_run_start(&self, state: StateId, start: &Configuration) -> bool {
        let is_lost = self.searches.lost_starts(state, start) >= LEASES_LOST_MAX;
        !is_lost && !self.states.results(state).fails(start)
    }

    /// Whether a start ran in a state for the first time after trial `since`, so that what was decided then
    /// has to be decided again.
    pub(crate) fn has_new_start(&self, state: StateId, start: Option<&Configuration>, since: u64) -> bool {
        let record = start.and_then(|start| self.states.results(state).ran(start));
        record.is_some_and(|record| record.measurements == 1 && record.last_trial > since)
    }

    /// Whether the default can be run in a state, as far as is known.
    pub(crate) fn default_runs(&self, state: StateId) -> bool {
        let settled = self.states.results(state).settled(self.spec.space.default_ref(), 1);
        settled != Some(Verdict::Infeasible)
    }

    /// Whether the state's search has spent the policy's budget.
    pub(crate) fn is_finished(&self, state: StateId) -> bool {
        self.is_spent_within(self.spec.policy.trials_per_state as usize, state)
    }

    /// Whether nothing is left to be searched in a state, within a budget of `room` trials.
    pub(crate) fn is_spent_within(&self, room: usize, state: StateId) -> bool {
        self.searches.are_spent(state, self.states.results(state), &self.spec.policy, room)
    }

    /// Whether a state's search has ended within `room` trials, and none of its trials is open.
    pub(crate) fn is_over(&self, room: usize, state: StateId) -> bool {
        let (own, results) = (self.searches.of(state), self.states.results(state));
        own.is_some_and(|own| own.open.is_empty() && is_spent(own, results, &self.spec.policy, room))
    }

    /// The configuration that challengers are measured against in a state.
    pub(crate) fn incumbent(&self, state: StateId) -> &'a Configuration {
        let results = self.states.results(state);
        let confirmed = self.confirmed(state).filter(|confirmed| !results.is_infeasible(confirmed));
        confirmed.unwrap_or(self.spec.space.default_ref())
    }

    /// Whether the verdict on a state's search stands.
    pub(crate) fn is_settled(&self, state: StateId) -> bool {
        let tried = self.states.results(state).tried();
        self.race(state).is_some_and(|race| race.is_settled(tried))
    }

    /// Whether a search that is at its end is still to be confirmed.
    pub(crate) fn is_to_be_confirmed(&self, state: StateId) -> bool {
        let policy = &self.spec.policy;
        policy.confirm_rounds > 0
            && policy.operation == Operation::Tune
            && self.searches.of(state).is_some()
            && self.states.results(state).best().is_some()
            && !self.is_settled(state)
    }

    /// A copy of the inputs of a state's assessment; `None` where no measured configuration can be run. No
    /// race was run beside a `start`, so that only measurements count there.
    pub(crate) fn assessment_request(
        &self,
        state: StateId,
        start: Option<&Configuration>,
    ) -> Option<AssessmentRequest> {
        self.states.results(state).best()?;
        Some(AssessmentRequest {
            state,
            spec: Arc::clone(self.spec),
            results: Arc::clone(&self.states[state].results),
            confirmed: self.confirmed(state).filter(|_| start.is_none()).cloned(),
            is_settled: start.is_none() && self.is_settled(state),
            start: start.cloned(),
        })
    }

    /// The request where the assessment, beside the default or a start that ran there, has to be made apart
    /// before a client asks for it.
    fn assessment_to_plan(&self, state: StateId, start: Option<&Configuration>) -> Option<AssessmentRequest> {
        let made = self.assessments.of(state, start);
        let request = self.assessment_request(state, start)?;
        let is_at_hand = request.is_quick() || made.is_some_and(|made| request.is_answered_by(made));
        (!is_at_hand).then_some(request)
    }

    /// The requests of a state that is to answer, where it is known: beside the default, and beside a `start`
    /// that ran there.
    pub(crate) fn assessments_to_plan(
        &self,
        state: Option<StateId>,
        start: Option<&Configuration>,
    ) -> [Option<AssessmentRequest>; 2] {
        let Some(state) = state else { return [None, None] };
        let beside = |start| self.assessment_to_plan(state, Some(start));
        [self.assessment_to_plan(state, None), self.measured(state, start).and_then(beside)]
    }

    /// The assessment of a state beside the default or a start that ran there, and whether it is up to date
    /// with the table. It is computed where it is missing and quick, or where it may take long.
    fn assessment(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        may_take_long: bool,
    ) -> Option<(Arc<Assessment>, bool)> {
        let request = self.assessment_request(state, start)?;
        let made = self.assessments.of(state, start);
        if let Some(made) = made.filter(|made| request.is_answered_by(made)) {
            return Some((Arc::clone(made), true));
        }
        if may_take_long || request.is_quick() {
            return request.compute().map(|assessment| (Arc::new(assessment), true));
        }
        made.map(|made| (Arc::clone(made), false))
    }

    /// The assessment by which a race begins or is settled: one that is up to date, or the one that was made
    /// for this question. Where many clients report from the state, its table changes before that is made.
    pub(crate) fn assessment_of_race(&self, state: StateId, planned: &Planned) -> Option<Arc<Assessment>> {
        let (made, is_current) = self.assessment(state, None, planned.is_at_once())?;
        let is_fresh = || planned.has_assessed(state) && made.is_beside(self.confirmed(state));
        (is_current || is_fresh()).then_some(made)
    }

    /// The answer of a state's own measurements: the verdict where it stands, else the configuration that is
    /// proven so far. Beside a `start` that ran there it is what is better than that.
    pub(crate) fn answered(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Option<Answered> {
        let (results, start) = (self.states.results(state), self.measured(state, start));
        if start.is_none()
            && self.is_settled(state)
            && let Some(record) = results.ran(self.incumbent(state))
        {
            let made = self.assessment(state, None, false).map(|(made, _)| made);
            let made = made.filter(|made| made.answer == record.configuration);
            // An incumbent that other states named has won nothing here.
            let was_won = self.race(state).is_some_and(|race| race.is_challenger(&record.configuration));
            let is_default = record.configuration == *self.spec.space.default_ref();
            return Some(Answered {
                configuration: record.configuration.clone(),
                cost: record.mean_cost,
                gain: made.as_ref().and_then(|made| made.gain),
                is_incumbent: !was_won || is_default,
                nothing_better: is_default,
                gain_at_most: made.map(|made| made.gain_at_most),
            });
        }
        if let Some((made, _)) = self.assessment(state, start, planned.is_at_once())
            && results.ran(&made.answer).is_some()
        {
            return Some(Answered {
                configuration: made.answer.clone(),
                cost: made.cost,
                gain: made.gain,
                is_incumbent: made.is_incumbent,
                nothing_better: made.nothing_better,
                gain_at_most: Some(made.gain_at_most),
            });
        }
        // The state was not assessed yet, and there is no time for it now.
        let best = results.believed_best();
        let is_beaten = |start: &&Record| best.is_some_and(|best| results.beats(best, start));
        let start = start.and_then(|start| results.ran(start)).filter(|start| !is_beaten(start));
        let record = start.or(best)?;
        Some(Answered {
            configuration: record.configuration.clone(),
            cost: record.mean_cost,
            gain: None,
            is_incumbent: start.is_some(),
            nothing_better: start.is_some(),
            gain_at_most: None,
        })
    }

    /// The standing of a state's answer, beside the default or a start that ran there; `None` where no
    /// measured configuration can be run.
    pub(crate) fn standing(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Option<Standing> {
        let start = self.measured(state, start);
        let answered = self.answered(state, start, planned)?;
        let (made, _) = self.assessment(state, start, planned.is_at_once())?;
        let is_of_answer = made.answer == answered.configuration;
        let (cost, low, high) = match is_of_answer {
            true => (made.cost, made.cost_low, made.cost_high),
            false => (answered.cost, answered.cost, answered.cost),
        };
        let confirmation = self.confirmation(state, start, &answered);
        let by_all = if is_of_answer { made.gain } else { answered.gain };
        let by_rounds = confirmation.gain.filter(|_| confirmation.stage == ConfirmationStage::Better);
        let is_likely =
            |gain: &Gain| gain.probability_better.is_some_and(|probability| probability >= LIKELY);
        let gain = match (by_rounds, by_all) {
            (Some(by_rounds), _) if is_likely(&by_rounds) => Some(by_rounds),
            // On a disturbed machine measurements of different times say less than they seem to.
            (Some(by_rounds), Some(by_all)) => Some(by_all.widened(by_rounds)),
            (_, by_all) => by_all,
        };
        let results = self.states.results(state);
        // Of a settled answer it may not have been at hand.
        let at_most = if is_of_answer { Some(made.gain_at_most) } else { answered.gain_at_most };
        let (pace, at_rest) = (results.pace(), results.at_rest(&answered.configuration));
        let (cost, low, high) = match at_rest.filter(|_| cost > 0.0) {
            Some(at_rest) => {
                let pace = at_rest / cost;
                (at_rest, (pace * low).min(at_rest), (pace * high).clamp(at_rest, f64::MAX))
            }
            None => (pace * cost, pace * low, pace * high),
        };
        Some(Standing {
            cost,
            cost_low: low,
            cost_high: high,
            gain,
            nothing_better: answered.is_incumbent,
            confirmation,
            disturbances: results.disturbances(),
            gain_at_most: at_most.filter(|most| answered.is_incumbent && most.is_finite()),
        })
    }

    fn confirmation(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        answered: &Answered,
    ) -> Confirmation {
        let race = self.race(state);
        let default = start.unwrap_or(self.spec.space.default_ref());
        // Rounds in which the start did not run say nothing of the gain over it.
        let beside = race.filter(|race| start.is_none() || race.has(default));
        let stage = match race {
            _ if self.spec.policy.confirm_rounds == 0 => ConfirmationStage::Off,
            Some(_) if self.is_settled(state) && answered.is_incumbent => ConfirmationStage::NothingBetter,
            Some(_) if self.is_settled(state) => ConfirmationStage::Better,
            Some(race) if !race.settled => ConfirmationStage::Racing,
            _ => ConfirmationStage::Searching,
        };
        Confirmation {
            stage,
            rounds: race.map_or(0, |race| race.race.rounds(0) as u64),
            rounds_max: race.map_or(u64::from(self.spec.policy.confirm_rounds), |race| race.rounds_max),
            measurements: race.map_or(0, |race| race.race.measurements() as u64),
            gain: beside.and_then(|race| race.gain(&answered.configuration, default)),
        }
    }

    /// The best known configuration of a state.
    pub(crate) fn best(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Option<Best> {
        let answered = self.answered(state, start, planned)?;
        let default = self.measured(state, start).unwrap_or(self.spec.space.default_ref());
        let results = self.states.results(state);
        let record = results.record(&answered.configuration)?;
        assert!(record.measurements > 0 && !record.infeasible, "the best was measured and can be run");
        let standing = self.standing(state, start, planned)?;
        let at_rest = results.at_rest(&record.configuration);
        // The default may not have run for long, and its gain was found while both ran.
        let beside =
            |cost| results.reported_beside((default, cost), (record, at_rest), ratio_by(standing.gain));
        Some(Best {
            configuration: record.configuration.clone(),
            cost: at_rest.unwrap_or_else(|| results.pace() * record.mean_cost),
            default_cost: self.states.cost_of(state, default).map(beside),
            measurements: record.measurements,
            state_id: state.0,
            trial: record.last_trial,
            last_measure_ms: record.last_measure_ms,
            standing,
        })
    }

    /// The row of a state.
    pub(crate) fn row(&self, state: StateId) -> StateRecord {
        StateRecord {
            id: state.0,
            indicators: self.states[state].anchor.clone(),
            fingerprint: self.states.fingerprint(state).cloned(),
            search: self.searches.record(state).cloned(),
        }
    }
}

/// The ratio of the default's cost to that of an answer with a gain over it.
fn ratio_by(gain: Option<Gain>) -> Option<f64> {
    let ratio = 1.0 / (1.0 - gain?.share);
    Some(ratio).filter(|ratio| ratio.is_finite() && *ratio > 0.0)
}
