//! A client's own default where that is not the study's: its start.
//!
//! For the searches, races and verdicts of a state a start is one more configuration. Its runs take nothing
//! of a search's budget, and a verdict stands beside it unless it beats the incumbent. A client with a start
//! measures it before anything else that has to be compared with it. From then on its answers are those that
//! the measurements of the state show to be better than its start, which takes the place of the study's
//! default and of the incumbent. Where nothing is known, its answer is its start.

use crate::configuration::{Configuration, RawConfiguration};
use crate::decision::{
    BudgetStatus, Choice, ExploitSource, ExplorationEstimate, Explore, ExploreRule, ExploredPoint,
};
use crate::ids::StateId;
use crate::limits::LEASES_LOST_MAX;
use crate::policy::Operation;
use crate::results::runs_start;
use crate::trial::Trial;
use crate::tuner::decide::Ground;
use crate::tuner::plan::Planned;
use crate::tuner::proposal::Exploitation;
use crate::tuner::{Ask, Prediction, Tuner, TunerError, VisitDecision};

impl Tuner {
    /// Checks a start; `None` for the study's default.
    pub(super) fn checked_start(
        &self,
        start: Option<&RawConfiguration>,
    ) -> Result<Option<Configuration>, TunerError> {
        let Some(start) = start else { return Ok(None) };
        let start = self.spec.space.configuration(start.clone()).map_err(TunerError::Start)?;
        Ok((start != *self.spec.space.default_ref()).then_some(start))
    }

    /// The start of a client whose question was checked.
    pub(super) fn start_of(&self, ask: &Ask) -> Option<Configuration> {
        self.checked_start(ask.start.as_ref()).ok().flatten()
    }

    /// A client's start, unless it is known to fail in a state or was lost there too often.
    pub(super) fn usable_start(&self, ask: &Ask, state: StateId) -> Option<Configuration> {
        let is_lost = |start: &Configuration| self.searches.lost_starts(state, start) >= LEASES_LOST_MAX;
        self.start_of(ask).filter(|start| !self.states.results(state).fails(start) && !is_lost(start))
    }

    /// The trial of a client's start, where that has to be compared with what else ran in the state, or where
    /// the client explores. Nobody measures it twice, or again where it failed or was lost too often. A
    /// session that never explores measures nothing for that.
    pub(super) fn start_first(&self, ask: &Ask, state: StateId) -> Option<Prediction> {
        let start = self.usable_start(ask, state)?;
        let results = self.states.results(state);
        let visit = self.visits.of(&ask.client_id);
        let exploits = visit.is_some_and(|visit| matches!(visit.decision, VisitDecision::Exploit { .. }));
        let is_needed = !exploits || results.best().is_some();
        let may = self.spec.policy.operation == Operation::Tune && !self.never_explores(&ask.session_policy);
        let is_known = results.ran(&start).is_some() || self.trials.runs(state, &start);
        if !(is_needed && may) || is_known {
            return None;
        }
        let explore = Explore {
            point: ExploredPoint::Start,
            rule: ExploreRule::Dice,
            estimate: ExplorationEstimate::default(),
            budget: BudgetStatus::default(),
            abort_above: None,
        };
        let decision = Choice::Explore(explore).decided();
        Some(Prediction { configuration: start, predicted_cost: None, decision, insight: None })
    }

    /// Lets the race or the verdict of a state stand where a completed trial is the first result of a
    /// client's start, unless that beats the incumbent. `tried` configurations had a verdict before.
    pub(super) fn stand_beside_start(&mut self, completed: &Trial, tried: usize) {
        let state = StateId(completed.state_id);
        let (results, incumbent) = (self.states.results(state), self.standings().incumbent(state));
        let is_new = runs_start(completed, self.spec.space.default_ref()) && results.tried() > tried;
        let beats = results.ran(&completed.configuration).is_some_and(|start| {
            results.ran(incumbent).is_none_or(|incumbent| results.beats(start, incumbent))
        });
        let races = self.searches.of(state).is_some_and(|own| own.confirming.is_some());
        if is_new
            && !beats
            && races
            && let Some(race) = self.searches.change(state).and_then(|own| own.confirming.as_mut())
        {
            race.pass_over();
        }
    }

    /// Whether a client's start ran in a state for the first time after trial `since`, so that what was
    /// decided then has to be decided again.
    pub(super) fn has_new_start(&self, ask: &Ask, state: StateId, since: u64) -> bool {
        let Some(start) = self.start_of(ask) else { return false };
        let record = self.states.results(state).ran(&start);
        record.is_some_and(|record| record.measurements == 1 && record.last_trial > since)
    }

    /// [`Tuner::exploitation`] for a client with a start.
    pub(super) fn exploitation_from(
        &self,
        start: Option<&Configuration>,
        normalised: &[f64],
        here: Option<StateId>,
        ground: Ground,
        planned: &Planned,
    ) -> Exploitation {
        let answer = self.exploitation(normalised, here, ground, planned);
        self.beside_start(answer, start, here, planned)
    }

    /// An answer as a client with a start gets it: it gives way to the start where nothing is known to be
    /// better than that.
    pub(super) fn beside_start(
        &self,
        answer: Exploitation,
        start: Option<&Configuration>,
        here: Option<StateId>,
        planned: &Planned,
    ) -> Exploitation {
        let Some(start) = start else { return answer };
        let is_default = matches!(answer.source, ExploitSource::Default | ExploitSource::Incumbent { .. });
        let ran = here.and_then(|state| Some((state, self.states.results(state).ran(start)?.mean_cost)));
        let Some((state, cost)) = ran else {
            let fails = here.is_some_and(|state| self.states.results(state).fails(start));
            return if is_default && !fails { unmeasured(start, answer.source) } else { answer };
        };
        let is_measured = is_default || matches!(answer.source, ExploitSource::BestKnown { .. });
        let is_cheaper = answer.predicted_cost.is_some_and(|expected| expected < cost);
        if !is_measured && is_cheaper {
            return answer;
        }
        self.best_known(state, Some(start), planned).unwrap_or(answer)
    }
}

/// A start that did not run in a state, in place of the default that is answered there. Nothing is known of
/// what others gain over it.
fn unmeasured(start: &Configuration, source: ExploitSource) -> Exploitation {
    let source = match source {
        ExploitSource::Incumbent { tried, is_maximised, beside_start, .. } => {
            ExploitSource::Incumbent { tried, gain_at_most: None, is_maximised, beside_start }
        }
        other => other,
    };
    Exploitation { configuration: start.clone(), predicted_cost: None, source, rolled_back: false }
}
