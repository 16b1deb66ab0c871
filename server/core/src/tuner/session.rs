//! A session's own policy takes the place of the study's here, and nowhere else.

use crate::ids::{StateId, TrialNumber};
use crate::policy::{Operation, Policy};
use crate::session::SessionPolicy;
use crate::tuner::decide::Ground;
use crate::tuner::exploring::standings::Standings;
use crate::tuner::knowledge::gain::GainEvidence;

/// The policy for a session: its own wishes before the study's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wishes<'a> {
    pub(super) session: &'a SessionPolicy,
    pub(super) standings: Standings<'a>,
    pub(super) gain: GainEvidence<'a>,
}

impl Wishes<'_> {
    fn policy(&self) -> &Policy {
        &self.standings.spec.policy
    }

    /// The probability of exploring a state, which may be unknown yet.
    pub(super) fn epsilon(&self, state: Option<StateId>) -> f64 {
        let by_policy = || state.map_or(self.policy().epsilon, |state| self.gain.epsilon(state));
        self.session.epsilon.unwrap_or_else(by_policy)
    }

    /// Whether it never explores, as long as anything else can be run.
    pub(super) fn never_explores(&self) -> bool {
        self.session.epsilon.unwrap_or(self.policy().epsilon) == 0.0
    }

    /// Whether it explores every state until its search has ended, without a draw.
    pub(super) fn explores_to_the_end(&self) -> bool {
        let has_one_state = self.standings.spec.indicators.indicators().is_empty();
        let offline = self.policy().offline || has_one_state;
        offline && self.session.epsilon.is_none() && self.policy().epsilon > 0.0
    }

    /// After how many trials a state's search is over.
    pub(super) fn room(&self) -> usize {
        self.session.trials_per_state.unwrap_or(self.policy().trials_per_state) as usize
    }

    /// Whether a state's search is over, and confirmed.
    pub(super) fn is_finished(&self, state: StateId) -> bool {
        self.is_spent(state) && !self.standings.is_to_be_confirmed(state)
    }

    /// Whether a state's search has spent its number of trials, confirmed or not.
    pub(super) fn is_spent(&self, state: StateId) -> bool {
        self.standings.is_spent_within(self.room(), state)
    }

    /// The costs of the cheaper levels at which its client runs trials, as shares of a full one, if it runs
    /// any. With a budget of regret there are none, nor where the search tries every configuration.
    pub(super) fn open_levels(&self, runs_any: bool) -> Vec<f64> {
        let room = self.room();
        let is_open = runs_any
            && self.policy().regret_budget.is_none()
            && self.standings.searches.few().count().is_none_or(|count| count > room);
        let levels = self.standings.spec.objective.fidelities().iter().filter(|_| is_open);
        levels.map(|level| level.cost).collect()
    }

    /// The name of the cheaper level at which a trial measures the point of the state's search. `None` for in
    /// full.
    pub(super) fn cheaper_level(
        &self,
        runs_any: bool,
        number: TrialNumber,
        state: StateId,
    ) -> Option<String> {
        let own = self.standings.searches.of(state)?;
        let level = own.search.as_ref()?.level_of(*own.open.get(&number.0)?)?;
        let is_open = !self.open_levels(runs_any).is_empty();
        let level = self.standings.spec.objective.fidelities().get(level as usize).filter(|_| is_open);
        level.map(|level| level.name.clone())
    }

    /// The ground of its answers.
    pub(super) fn ground(&self) -> Ground {
        match self.policy().operation == Operation::Freeze || self.never_explores() {
            true => Ground::Measured,
            false => Ground::Predicted,
        }
    }
}
