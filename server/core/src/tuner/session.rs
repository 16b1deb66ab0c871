//! A session's own policy takes the place of the study's here, and nowhere else.

use crate::ids::StateId;
use crate::policy::{Operation, Policy};
use crate::session::SessionPolicy;
use crate::tuner::decide::Ground;
use crate::tuner::gain::GainEvidence;
use crate::tuner::standings::Standings;

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

    /// The ground of its answers.
    pub(super) fn ground(&self) -> Ground {
        match self.policy().operation == Operation::Freeze || self.never_explores() {
            true => Ground::Measured,
            false => Ground::Predicted,
        }
    }
}
