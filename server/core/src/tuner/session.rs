//! A session's own policy takes the place of the study's here, and nowhere else.

use crate::ids::StateId;
use crate::session::SessionPolicy;
use crate::tuner::Tuner;

impl Tuner {
    /// The probability of exploring for a session in a state, which may be unknown yet.
    pub(super) fn epsilon_of(&self, session: &SessionPolicy, state: Option<StateId>) -> f64 {
        let by_policy = || state.map_or(self.spec.policy.epsilon, |state| self.gain().epsilon(state));
        session.epsilon.unwrap_or_else(by_policy)
    }

    /// Whether a session never explores, as long as anything else can be run.
    pub(super) fn never_explores(&self, session: &SessionPolicy) -> bool {
        session.epsilon.unwrap_or(self.spec.policy.epsilon) == 0.0
    }

    /// Whether a session explores every state until its search has ended, without a draw.
    pub(super) fn explores_to_the_end(&self, session: &SessionPolicy) -> bool {
        let has_one_state = self.spec.indicators.indicators().is_empty();
        let offline = self.spec.policy.offline || has_one_state;
        offline && session.epsilon.is_none() && self.spec.policy.epsilon > 0.0
    }

    /// After how many trials a state's search is over for a session.
    pub(super) fn room_of(&self, session: &SessionPolicy) -> usize {
        session.trials_per_state.unwrap_or(self.spec.policy.trials_per_state) as usize
    }

    /// Whether a state's search is over for a session, and confirmed.
    pub(super) fn is_finished_for(&self, session: &SessionPolicy, state: StateId) -> bool {
        self.is_spent_for(session, state) && !self.standings().is_to_be_confirmed(state)
    }

    /// Whether a state's search has spent a session's number of trials, confirmed or not.
    pub(super) fn is_spent_for(&self, session: &SessionPolicy, state: StateId) -> bool {
        self.standings().is_spent_within(self.room_of(session), state)
    }

    /// Whether the last decision for a client was taken under another session policy.
    pub(super) fn has_other_wishes(&self, client_id: &str, session: &SessionPolicy) -> bool {
        self.visits.account(client_id).map_or(SessionPolicy::default(), |account| account.policy) != *session
    }
}
