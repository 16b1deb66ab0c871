//! Leases that are lost: trials whose client never reported.
//!
//! One lost lease says little: networks fail and people end programs. A configuration of which nothing was
//! ever measured in a state and whose lease is lost there again is taken for one that crashes or hangs
//! whoever runs it, because to hand it out to one client after the other would stop them all. It then counts
//! as infeasible in that state, and its trial says why. A lease is also lost where its client comes back in
//! another session while it still runs. Of a client without sessions that never renewed a lease, as scripts
//! are, nobody knows whether it lives, so that its silence says nothing: somebody may have pressed Ctrl-C.
//! Who gives a trial back has said goodbye, and loses nothing. The default is never taken for one: clients
//! run it without asking anybody, and exploring would have nothing left to be weighed against.

use crate::ids::{StateId, TrialNumber};
use crate::limits::LEASES_LOST_MAX;
use crate::trial::{Outcome, TrialState};
use crate::tuner::{Ask, Change, Tuner};

impl Tuner {
    /// Ends an open trial whose lease was lost. The change has no states: they are the caller's to add.
    pub(super) fn lose(&mut self, number: TrialNumber, now_ms: i64) -> Change {
        let ended_ms = self.trials.get(number).map_or(i64::MAX, |trial| trial.lease_expire_ms);
        let lost_leases = if ended_ms <= self.pardoned_until_ms { 0 } else { self.note_lost(number) };
        let infeasible = (lost_leases >= LEASES_LOST_MAX).then(|| self.give_up(number, lost_leases, now_ms));
        infeasible.flatten().unwrap_or_else(|| {
            let expired = self.take_back(number, TrialState::Expired);
            Change { trials: expired.into_iter().collect(), ..Change::default() }
        })
    }

    /// Sees whether the client was started anew since it was handed the trial that it holds for a state.
    /// `None` where the trial is still its; else what became of that.
    pub(super) fn lose_to_restart(&mut self, ask: &Ask, state: StateId, now_ms: i64) -> Option<Change> {
        let held = self.trials.of_client(&ask.client_id, state)?;
        let (number, session) = (TrialNumber(held.number), held.decision.session);
        if session == ask.session || session == 0 || ask.session == 0 {
            return None;
        }
        let lost_leases = self.note_lost(number);
        if lost_leases >= LEASES_LOST_MAX {
            return self.give_up(number, lost_leases, now_ms);
        }
        self.trials.hold_by(number, ask.session, lost_leases);
        None
    }

    /// Counts a lost lease of an open trial's configuration: how many there were in the state; 0 for the
    /// default, where it was measured, and where the client's silence says nothing.
    fn note_lost(&mut self, number: TrialNumber) -> u32 {
        let Some(trial) = self.trials.get(number) else {
            return 0;
        };
        let (state, configuration) = (StateId(trial.state_id), trial.configuration.clone());
        let record = self.states.results(state).record(&configuration);
        let was_measured = record.is_some_and(|record| record.measurements > 0);
        let is_default = configuration == *self.spec.space.default_ref();
        let was_alive = trial.decision.session != 0 || trial.decision.heartbeat;
        if was_measured || is_default || !was_alive {
            0
        } else {
            self.searches.note_lost(state, &configuration)
        }
    }

    /// Completes an open trial as infeasible.
    fn give_up(&mut self, number: TrialNumber, lost_leases: u32, now_ms: i64) -> Option<Change> {
        self.trials.hold_by(number, self.trials.get(number)?.decision.session, lost_leases);
        let reason = format!(
            "{lost_leases} leases of this configuration were lost in this state and it was never measured there: \
             whoever runs it crashes or hangs"
        );
        let trial = self.trials.get(number)?;
        let completed =
            self.completed(trial, Default::default(), Outcome::infeasible(reason), now_ms).ok()?;
        Some(self.take(&completed))
    }
}
