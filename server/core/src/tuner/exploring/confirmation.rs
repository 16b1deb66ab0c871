//! The last stage of a state's search: its best few run against the incumbent, in rounds, until one is proven
//! better.
//!
//! The incumbent of a state is the configuration that did best in other states, else the study's default,
//! until a race replaces it. The state's [assessment](crate::tuner::knowledge::assessment) chooses the
//! contenders, and the clients that explore there measure them. A [race](crate::statistics::confirm) that its
//! rounds leave open is settled by a test of the rounds alone. Otherwise one more assessment of all the
//! contenders' measurements settles it. Its winner is the answer and is reported as likely, because only
//! rounds prove. From then on the verdict is exploited without further computation. The default runs in every
//! race, so that the winner's gain is measured beside it.

use std::sync::Arc;

use crate::decision::ExploredPoint;
use crate::ids::{StateId, TrialNumber};
use crate::limits::FAILURES_PER_CONFIGURATION_MAX;
use crate::results::runs_start;
use crate::statistics::confirm::{ERROR_MAX, PROVEN_ERROR_MAX, RaceResult};
use crate::study::StudySpec;
use crate::trial::{Outcome, Trial};
use crate::tuner::exploring::race::{Confirming, Finding};
use crate::tuner::exploring::searches::Searches;
use crate::tuner::exploring::standings::Standings;
use crate::tuner::knowledge::{Assessments, States, Stored};
use crate::tuner::plan::Planned;
use crate::tuner::proposal::ProposedTrial;

/// The searches and races of all states, which results are passed on to (`telling`).
#[derive(Debug)]
pub(crate) struct Racing<'a> {
    pub(crate) spec: &'a Arc<StudySpec>,
    pub(crate) states: &'a States,
    pub(crate) searches: &'a mut Searches,
    pub(crate) assessments: &'a Assessments,
}

impl Racing<'_> {
    fn standings(&self) -> Standings<'_> {
        let Racing { spec, states, assessments, .. } = *self;
        Standings { spec, states, searches: &*self.searches, assessments }
    }

    /// The next measurement of a state's confirmation, in a state whose search is at its end. `None` where
    /// the confirmation is over, or waits for other clients' measurements.
    pub(crate) fn confirm(
        &mut self,
        state: StateId,
        number: TrialNumber,
        planned: &Planned,
    ) -> Option<ProposedTrial> {
        if !self.standings().is_to_be_confirmed(state) {
            return None;
        }
        let tried = self.states.results(state).tried();
        let begins = self.standings().race(state).is_none_or(|race| race.settled && tried > race.tried);
        if begins {
            let assessment = self.standings().assessment_of_race(state, planned)?;
            let results = self.states.results(state);
            let noise = assessment.noise.max(results.noise().unwrap_or(0.0));
            let rounds = self.spec.policy.confirm_rounds;
            let incumbents = (self.standings().incumbent(state), self.spec.space.default_ref());
            let race = Confirming::new(incumbents, &assessment, noise, rounds, results);
            self.searches.change(state)?.confirming = Some(race);
        }
        self.settle_race(state, planned);
        let (place, round) = self.standings().race(state)?.next()?;
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
        let race = self
            .standings()
            .race(state)
            .filter(|race| race.race.verdict() != RaceResult::Open && !race.settled)?;
        let winner = match race.winner().or_else(|| race.better_by_rounds(PROVEN_ERROR_MAX)) {
            Some(winner) => winner.clone(),
            None => {
                let assessment = self.standings().assessment_of_race(state, planned)?;
                // Where the machine was disturbed meanwhile, costs of different times compare badly: only
                // pairs count.
                let is_disturbed = self.states.results(state).disturbances() > race.disturbances;
                let probable = assessment.probable.as_ref();
                let assessed = probable.filter(|probable| !is_disturbed && race.is_challenger(probable));
                let better = assessed.or_else(|| race.better_by_rounds(ERROR_MAX));
                better.unwrap_or_else(|| self.standings().incumbent(state)).clone()
            }
        };
        let is_default = winner == *self.spec.space.default_ref();
        let own = self.searches.change(state)?;
        own.confirmed = (!is_default).then_some(Stored(winner));
        own.confirming.as_mut()?.settled = true;
        Some(())
    }

    /// Enters the result of a completed trial into the race; its cost is `learnt`.
    pub(crate) fn tell_race(&mut self, trial: &Trial, learnt: Option<f64>) {
        let state = StateId(trial.state_id);
        if !self.standings().race(state).is_some_and(|race| race.open.contains_key(&trial.number)) {
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
                let is_incumbent = trial.configuration == *self.standings().incumbent(state);
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

    /// Lets the race or the verdict of a state stand where a completed trial is the first result of a
    /// client's start, unless that beats the incumbent. `tried` configurations had a verdict before.
    pub(crate) fn stand_beside_start(&mut self, completed: &Trial, tried: usize) {
        let state = StateId(completed.state_id);
        let (results, incumbent) = (self.states.results(state), self.standings().incumbent(state));
        let is_new = runs_start(completed, self.spec.space.default_ref()) && results.tried() > tried;
        let beats = results.ran(&completed.configuration).is_some_and(|start| {
            results.ran(incumbent).is_none_or(|incumbent| results.beats(start, incumbent))
        });
        let races = self.standings().race(state).is_some();
        if is_new
            && !beats
            && races
            && let Some(race) = self.searches.change(state).and_then(|own| own.confirming.as_mut())
        {
            race.pass_over();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::Policy;
    use crate::statistics::confirm::Race;
    use crate::tuner::Tuner;
    use crate::tuner::tests::{ask, cost, measured, spec};

    #[test]
    fn a_challenger_leaves_when_it_is_stopped_below_its_known_cost_a_second_time() {
        let policy = Policy { epsilon: 1.0, trials_per_state: 12, ..Policy::default() };
        let mut tuner = Tuner::new(Arc::new(spec(policy))).expect("valid");
        let state = StateId(1);
        let of_challenger = (0..100).find_map(|frame| {
            let trial = tuner.suggest(&ask("a", 0.5, 0.5), 0).expect("valid").0;
            let place = tuner.standings().race(state).and_then(|race| race.open.get(&trial.number).copied());
            if let Some(place) = place.filter(|&place| place > 0) {
                return Some((trial, place));
            }
            let noise = 1.0 + 0.01 * f64::from(frame % 3);
            assert!(tuner.report(&trial, measured(noise * cost(&trial)), Outcome::Ok, 1).is_ok());
            None
        });
        let (trial, place) = of_challenger.expect("a race");
        let known =
            tuner.knowledge.states.results(state).record(&trial.configuration).expect("it ran").mean_cost;
        let stopped = Trial { outcome: Some(Outcome::Aborted { lower_bound: 0.001 }), ..trial };
        let mut race = tuner.standings().race(state).expect("a race").clone();
        race.race = Race::new(race.contenders.len(), Some(1.0), 10);
        let mut stop = |race: Confirming| {
            let own = tuner.searches.change(state).expect("a search");
            own.confirming.insert(race).open.insert(stopped.number, place);
            tuner.racing().tell_race(&stopped, Some(0.001));
            tuner.standings().race(state).expect("still a race").clone()
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
