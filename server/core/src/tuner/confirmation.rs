//! The last stage of a state's search: its best few run against the incumbent, in rounds, until one is proven
//! better.
//!
//! The incumbent of a state is the configuration that did best in other states, else the study's default,
//! until a race replaces it. The state's [assessment](super::assessment) chooses the contenders, and the
//! clients that explore there measure them. A [race](crate::statistics::confirm) that its rounds leave open
//! is settled by a test of the rounds alone. Otherwise one more assessment of all the contenders'
//! measurements settles it. Its winner is the answer and is reported as likely, because only rounds prove.
//! From then on the verdict is exploited without further computation. The default runs in every race, so that
//! the winner's gain is measured beside it.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, unchecked};
use crate::decision::ExploredPoint;
use crate::ids::{StateId, TrialNumber};
use crate::limits::FAILURES_PER_CONFIGURATION_MAX;
use crate::policy::Operation;
use crate::results::{Record, ResultTable};
use crate::space::Space;
use crate::standing::{Confirmation, ConfirmationStage, Gain, LIKELY, Standing};
use crate::statistics::confirm::{ERROR_MAX, PROVEN_ERROR_MAX, Race, RaceResult, rounds_needed};
use crate::trial::{Outcome, Trial};
use crate::tuner::Tuner;
use crate::tuner::assessment::{Assessment, AssessmentRequest};
use crate::tuner::plan::Planned;
use crate::tuner::proposal::ProposedTrial;

/// Most of a search's best configurations that run against the incumbent.
const CHALLENGERS_MAX: usize = 4;
/// Factor by which the noise is assumed to be larger than measured. A proof holds only if the noise is not
/// larger still.
const NOISE_MARGIN: f64 = 1.25;
/// The least noise that is assumed: timers and clocks are not better.
const NOISE_LEAST: f64 = 0.01;

/// A configuration as it stands in a state's row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Stored(#[serde(with = "unchecked")] pub(super) Configuration);

/// A race in a state. Plain data, exact through serde.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Confirming {
    /// The incumbent first; the default among the others where it is not the incumbent.
    contenders: Vec<Stored>,
    race: Race,
    rounds_max: u64,
    /// The number of tried configurations when it began. Once more configurations are tried, another race
    /// begins.
    tried: usize,
    /// The number of disturbances of the machine before it began.
    disturbances: u64,
    /// The contender of each open trial, by trial number.
    open: BTreeMap<u64, usize>,
    /// The challengers of which a run was stopped below their known cost.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    stopped: BTreeSet<usize>,
    /// Its consequences have been decided.
    settled: bool,
}

impl Confirming {
    /// Begins with the incumbent, the default, and the configurations that may be better by an assessment.
    fn new(
        (incumbent, default): (&Configuration, &Configuration),
        assessment: &Assessment,
        noise: f64,
        rounds: u32,
        results: &ResultTable,
    ) -> Self {
        let is_new = |one: &&Configuration| ![incumbent, default].contains(one);
        let challengers = assessment.challengers.iter().filter(is_new).take(CHALLENGERS_MAX);
        let default =
            [default].into_iter().filter(|_| incumbent != default && !results.is_infeasible(default));
        let contenders = [incumbent].into_iter().chain(default).chain(challengers);
        let contenders: Vec<Stored> = contenders.cloned().map(Stored).collect();
        let noise = noise.max(NOISE_LEAST);
        let rounds_max = rounds_needed(noise, rounds as usize);
        assert!(rounds_max > 0 && rounds_max <= rounds as usize, "{rounds_max} of {rounds} rounds");
        assert!(contenders.len() <= 2 + CHALLENGERS_MAX, "{} contenders", contenders.len());
        assert!(contenders[0].0 == *incumbent, "the incumbent comes first");
        let race = Race::new(contenders.len(), Some(NOISE_MARGIN * noise), rounds_max);
        Confirming {
            contenders,
            race,
            rounds_max: rounds_max as u64,
            tried: results.tried(),
            disturbances: results.disturbances(),
            open: BTreeMap::new(),
            stopped: BTreeSet::new(),
            settled: false,
        }
    }

    /// Whether it is over, for a table with `tried` tried configurations.
    pub(super) fn is_settled(&self, tried: usize) -> bool {
        self.settled && tried <= self.tried
    }

    /// Passes over one more tried configuration, which is no reason for another race.
    pub(super) fn pass_over(&mut self) {
        self.tried += 1;
    }

    /// The next contender to run, and its round.
    fn next(&self) -> Option<(usize, u64)> {
        let running = |place: usize| self.open.values().filter(|&&other| other == place).count();
        let place = self.race.next(running)?;
        Some((place, (self.race.rounds(place) + running(place)) as u64 + 1))
    }

    /// Takes a trial out, with what it found of its contender if it found anything.
    pub(super) fn release(&mut self, trial: u64, finding: Option<Finding>) {
        let Some(place) = self.open.remove(&trial) else { return };
        match finding {
            Some(Finding::Cost(cost)) => self.race.tell(place, cost),
            Some(Finding::Stopped { known }) if self.stopped.insert(place) => self.race.tell(place, known),
            Some(Finding::Stopped { .. } | Finding::Fails) => self.race.fail(place),
            None => {}
        }
    }

    pub(super) fn runs(&self, trial: u64) -> bool {
        self.open.contains_key(&trial)
    }

    /// Forgets open trials that are gone.
    pub(super) fn keep_open(&mut self, is_open: impl Fn(u64) -> bool) {
        self.open.retain(|&number, _| is_open(number));
    }

    /// The contender that the race alone proved better.
    fn winner(&self) -> Option<&Configuration> {
        match self.race.verdict() {
            RaceResult::Better(place) => self.contenders.get(place).map(|contender| &contender.0),
            RaceResult::Open | RaceResult::NothingBetter => None,
        }
    }

    /// Whether a configuration ran against the incumbent.
    fn is_challenger(&self, configuration: &Configuration) -> bool {
        self.contenders.iter().skip(1).any(|contender| contender.0 == *configuration)
    }

    /// The contender that is better by the rounds alone, at an error probability of at most `error`.
    fn better_by_rounds(&self, error: f64) -> Option<&Configuration> {
        Some(&self.contenders.get(self.race.better_by_rounds(error)?)?.0)
    }

    /// The gain of a contender by the rounds alone: over the default where that ran, else over the incumbent.
    fn gain(&self, of: &Configuration, default: &Configuration) -> Option<Gain> {
        let place = |one: &Configuration| self.contenders.iter().position(|contender| contender.0 == *one);
        let (of, over) = (place(of)?, place(default).unwrap_or(0));
        let gain = self.race.gain(of, over).filter(|_| of != over)?;
        let share = |log_ratio: f64| -libm::expm1(-log_ratio);
        let finite = |log_ratio: f64| Some(share(log_ratio)).filter(|_| log_ratio.is_finite());
        let (low, high) = (finite(gain.low), finite(gain.high));
        Some(Gain {
            share: share(gain.log_ratio),
            low,
            high,
            probability_better: Some(gain.probability_better),
        })
    }

    /// Whether a configuration runs in it.
    fn has(&self, configuration: &Configuration) -> bool {
        self.contenders.iter().any(|contender| contender.0 == *configuration)
    }

    /// Whether its configurations are of the space.
    pub(super) fn fits(&self, space: &Space) -> bool {
        self.contenders.iter().all(|contender| space.owns(&contender.0))
    }
}

/// The result of a trial of a race.
#[derive(Clone, Copy, Debug)]
pub(super) enum Finding {
    /// A cost.
    Cost(f64),
    /// A challenger was stopped below its known cost. Once may be chance, and counts as that cost. A
    /// challenger that is stopped so twice is never run to its end.
    Stopped {
        /// The mean cost of its runs before.
        known: f64,
    },
    /// The contender cannot be run.
    Fails,
}

/// The answer of a state's own measurements.
#[derive(Clone, Debug)]
pub(super) struct Answered {
    pub(super) configuration: Configuration,
    pub(super) cost: f64,
    /// Its gain over the default, or over the client's start.
    pub(super) gain: Option<Gain>,
    /// The answer is the incumbent, because nothing was shown to be better.
    pub(super) is_incumbent: bool,
    /// That incumbent is the default, or the client's start.
    pub(super) nothing_better: bool,
    /// The most that any configuration may gain over the answer; `None` where there is no time to find out.
    pub(super) gain_at_most: Option<f64>,
}

impl Tuner {
    fn race(&self, state: StateId) -> Option<&Confirming> {
        self.searches.of(state)?.confirming.as_ref()
    }

    /// The incumbent of a state where that is not the default.
    fn confirmed(&self, state: StateId) -> Option<&Configuration> {
        Some(&self.searches.of(state)?.confirmed.as_ref()?.0)
    }

    /// The configuration that challengers are measured against in a state.
    pub(super) fn incumbent(&self, state: StateId) -> &Configuration {
        let results = self.states.results(state);
        let confirmed = self.confirmed(state).filter(|confirmed| !results.is_infeasible(confirmed));
        confirmed.unwrap_or(self.spec.space.default_ref())
    }

    /// Whether the verdict on a state's search stands.
    pub(super) fn is_settled(&self, state: StateId) -> bool {
        let tried = self.states.results(state).tried();
        self.race(state).is_some_and(|race| race.is_settled(tried))
    }

    /// Whether a search that is at its end is still to be confirmed.
    pub(super) fn is_to_be_confirmed(&self, state: StateId) -> bool {
        let policy = &self.spec.policy;
        policy.confirm_rounds > 0
            && policy.operation == Operation::Tune
            && self.searches.of(state).is_some()
            && self.states.results(state).best().is_some()
            && !self.is_settled(state)
    }

    /// A copy of the inputs of a state's assessment; `None` where no measured configuration can be run. No
    /// race was run beside a `start`, so that only measurements count there.
    pub(super) fn assessment_request(
        &self,
        state: StateId,
        start: Option<&Configuration>,
    ) -> Option<AssessmentRequest> {
        self.states.results(state).best()?;
        Some(AssessmentRequest {
            state,
            spec: std::sync::Arc::clone(&self.spec),
            results: std::sync::Arc::clone(&self.states[state].results),
            confirmed: self.confirmed(state).filter(|_| start.is_none()).cloned(),
            is_settled: start.is_none() && self.is_settled(state),
            start: start.cloned(),
        })
    }

    /// The request where the assessment, beside the default or a start that ran there, has to be made apart
    /// before a client asks for it.
    pub(super) fn assessment_to_plan(
        &self,
        state: StateId,
        start: Option<&Configuration>,
    ) -> Option<AssessmentRequest> {
        let made = self.assessments.of(state, start);
        let request = self.assessment_request(state, start)?;
        let is_at_hand = request.is_quick() || made.is_some_and(|made| request.is_answered_by(made));
        (!is_at_hand).then_some(request)
    }

    /// The assessment of a state beside the default or a start that ran there, and whether it is up to date
    /// with the table.
    fn assessment(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Option<(std::sync::Arc<Assessment>, bool)> {
        self.assessment_within(state, start, planned.is_at_once())
    }

    /// [`Tuner::assessment`], which is computed where it is missing and quick, or where it may take long.
    fn assessment_within(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        may_take_long: bool,
    ) -> Option<(std::sync::Arc<Assessment>, bool)> {
        let request = self.assessment_request(state, start)?;
        let made = self.assessments.of(state, start);
        if let Some(made) = made.filter(|made| request.is_answered_by(made)) {
            return Some((std::sync::Arc::clone(made), true));
        }
        if may_take_long || request.is_quick() {
            return request.compute().map(|assessment| (std::sync::Arc::new(assessment), true));
        }
        made.map(|made| (std::sync::Arc::clone(made), false))
    }

    /// The assessment by which a race begins or is settled: one that is up to date, or the one that was made
    /// for this question. Where many clients report from the state, its table changes before that is made.
    fn assessment_of_race(&self, state: StateId, planned: &Planned) -> Option<std::sync::Arc<Assessment>> {
        let (made, is_current) = self.assessment(state, None, planned)?;
        let is_fresh = || planned.has_assessed(state) && made.is_beside(self.confirmed(state));
        (is_current || is_fresh()).then_some(made)
    }

    /// The answer of a state's own measurements: the verdict where it stands, else the configuration that is
    /// proven so far. Beside a `start` that ran there it is what is better than that.
    pub(super) fn answered(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Option<Answered> {
        let (results, start) = (self.states.results(state), self.measured_start(state, start));
        if start.is_none()
            && self.is_settled(state)
            && let Some(record) = results.ran(self.incumbent(state))
        {
            let made = self.assessment_within(state, None, false).map(|(made, _)| made);
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
        if let Some((made, _)) = self.assessment(state, start, planned)
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

    /// The next measurement of a state's confirmation, in a state whose search is at its end. `None` where
    /// the confirmation is over, or waits for other clients' measurements.
    pub(super) fn confirm(
        &mut self,
        state: StateId,
        number: TrialNumber,
        planned: &Planned,
    ) -> Option<ProposedTrial> {
        if !self.is_to_be_confirmed(state) {
            return None;
        }
        let tried = self.states.results(state).tried();
        let begins = self.race(state).is_none_or(|race| race.settled && tried > race.tried);
        if begins {
            let assessment = self.assessment_of_race(state, planned)?;
            let results = self.states.results(state);
            let noise = assessment.noise.max(results.noise().unwrap_or(0.0));
            let rounds = self.spec.policy.confirm_rounds;
            let incumbents = (self.incumbent(state), self.spec.space.default_ref());
            let race = Confirming::new(incumbents, &assessment, noise, rounds, results);
            self.searches.change(state)?.confirming = Some(race);
        }
        self.settle_race(state, planned);
        let (place, round) = self.race(state)?.next()?;
        let default = self.spec.space.default_ref().clone();
        let race = self.searches.change(state)?.confirming.as_mut()?;
        race.open.insert(number.0, place);
        let (configuration, rounds_max) = (race.contenders[place].0.clone(), race.rounds_max);
        let point = match place {
            0 => ExploredPoint::Incumbent { is_default: configuration == default, round: Some(round) },
            _ => ExploredPoint::Confirming { round, rounds_max },
        };
        let record = self.states.results(state).record(&configuration);
        let predicted_cost = record.filter(|record| record.measurements > 0).map(|record| record.mean_cost);
        Some(ProposedTrial { configuration, predicted_cost, point })
    }

    /// Settles a race that is over. The new incumbent is the race's winner, else the challenger that all
    /// rounds together prove better, else the one that is likely to be better by all measurements or by the
    /// rounds.
    fn settle_race(&mut self, state: StateId, planned: &Planned) -> Option<()> {
        let race =
            self.race(state).filter(|race| race.race.verdict() != RaceResult::Open && !race.settled)?;
        let winner = match race.winner().or_else(|| race.better_by_rounds(PROVEN_ERROR_MAX)) {
            Some(winner) => winner.clone(),
            None => {
                let assessment = self.assessment_of_race(state, planned)?;
                // Where the machine was disturbed meanwhile, costs of different times compare badly: only
                // pairs count.
                let is_disturbed = self.states.results(state).disturbances() > race.disturbances;
                let probable = assessment.probable.as_ref();
                let assessed = probable.filter(|probable| !is_disturbed && race.is_challenger(probable));
                let better = assessed.or_else(|| race.better_by_rounds(ERROR_MAX));
                better.unwrap_or_else(|| self.incumbent(state)).clone()
            }
        };
        let is_default = winner == *self.spec.space.default_ref();
        let own = self.searches.change(state)?;
        own.confirmed = (!is_default).then_some(Stored(winner));
        own.confirming.as_mut()?.settled = true;
        Some(())
    }

    /// Enters the result of a completed trial into the race; its cost is `learnt`.
    pub(super) fn tell_race(&mut self, trial: &Trial, learnt: Option<f64>) {
        let state = StateId(trial.state_id);
        if !self.race(state).is_some_and(|race| race.open.contains_key(&trial.number)) {
            return;
        }
        let record = self.states.results(state).record(&trial.configuration);
        let gives_up = record.is_some_and(|record| record.failures >= FAILURES_PER_CONFIGURATION_MAX);
        let finding = match (&trial.outcome, learnt) {
            (Some(Outcome::Infeasible { .. }), _)
                if self.states.results(state).ran(&trial.configuration).is_some() =>
            {
                None
            }
            (Some(Outcome::Infeasible { .. }), _) => Some(Finding::Fails),
            _ if trial.decision.silent => None,
            (Some(Outcome::Ok), Some(cost)) => Some(Finding::Cost(cost)),
            // A contender did well before, so a trial that was stopped is one dear measurement like others. A
            // bound below the known cost is none.
            (Some(Outcome::Aborted { .. }), Some(bound)) => {
                let known = record.map_or(0.0, |record| record.mean_cost);
                let is_incumbent = trial.configuration == *self.incumbent(state);
                let counts = is_incumbent || bound >= known;
                Some(if counts { Finding::Cost(bound.max(known)) } else { Finding::Stopped { known } })
            }
            (Some(Outcome::Failed { .. }), _) if gives_up => Some(Finding::Fails),
            _ => None,
        };
        if let Some(race) = self.searches.change(state).and_then(|own| own.confirming.as_mut()) {
            race.release(trial.number, finding);
        }
    }

    /// The standing of a state's answer, beside the default or a start that ran there; `None` where no
    /// measured configuration can be run.
    pub(super) fn standing(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Option<Standing> {
        let start = self.measured_start(state, start);
        let answered = self.answered(state, start, planned)?;
        let (made, _) = self.assessment(state, start, planned)?;
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
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::policy::Policy;
    use crate::tuner::tests::{ask, cost, measured, spec};

    #[test]
    fn a_challenger_leaves_when_it_is_stopped_below_its_known_cost_a_second_time() {
        let policy = Policy { epsilon: 1.0, trials_per_state: 12, ..Policy::default() };
        let mut tuner = Tuner::new(Arc::new(spec(policy))).expect("valid");
        let state = StateId(1);
        let of_challenger = (0..100).find_map(|frame| {
            let trial = tuner.suggest(&ask("a", 0.5, 0.5), 0).expect("valid").0;
            let place = tuner.race(state).and_then(|race| race.open.get(&trial.number).copied());
            if let Some(place) = place.filter(|&place| place > 0) {
                return Some((trial, place));
            }
            let noise = 1.0 + 0.01 * f64::from(frame % 3);
            assert!(tuner.report(&trial, measured(noise * cost(&trial)), Outcome::Ok, 1).is_ok());
            None
        });
        let (trial, place) = of_challenger.expect("a race");
        let known = tuner.states.results(state).record(&trial.configuration).expect("it ran").mean_cost;
        let stopped = Trial { outcome: Some(Outcome::Aborted { lower_bound: 0.001 }), ..trial };
        let mut race = tuner.race(state).expect("a race").clone();
        race.race = Race::new(race.contenders.len(), Some(1.0), 10);
        let mut stop = |race: Confirming| {
            let own = tuner.searches.change(state).expect("a search");
            own.confirming.insert(race).open.insert(stopped.number, place);
            tuner.tell_race(&stopped, Some(0.001));
            tuner.race(state).expect("still a race").clone()
        };
        let stands =
            |race: &Confirming| race.race.next(|other| if other == place { 0 } else { 100 }) == Some(place);
        let mut once = stop(race);
        assert!(stands(&once) && once.race.rounds(place) == 1 && once.open.is_empty(), "{once:?}");
        let text = serde_json::to_string(&once).expect("plain data");
        assert_eq!(serde_json::from_str::<Confirming>(&text).expect("own text"), once);
        let twice = stop(once.clone());
        assert!(!stands(&twice) && twice.race.rounds(place) == 1, "{twice:?}");
        once.race.tell(0, known);
        let gain = once.race.gain(place, 0).expect("a round of both");
        assert!(gain.log_ratio.abs() < 1e-12, "it counts as {known}: {gain:?}");
    }
}
