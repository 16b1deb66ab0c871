//! Leases that are lost: trials whose client never reported.
//!
//! One lost lease says little: networks fail and people end programs. A configuration without any measurement
//! in a state whose lease is lost there again is taken to crash or hang its client. Handing it to one client
//! after the other would stop them all. It then counts as infeasible in that state, and its trial says why. A
//! lease is also lost where its client comes back in another session while it still runs.
//!
//! A lost lease counts only where the client had shown that it runs the trial, by renewing the lease. The
//! silence of any other client says nothing, with a session or without: a person may have pressed Ctrl-C. But
//! a configuration that one session after the other loses in silence counts from the second on, whether its
//! lease runs out or the next session asks. Else a program that it crashes at once would get it for ever. A
//! client that gives a trial back loses no lease. The default never counts as crashing: clients run it
//! without asking, and exploring would have nothing left to be weighed against. Neither does a client's own
//! default, its start. A start to be measured goes to the next client that asks with it, until as many of its
//! leases were lost. Then nobody measures it as a start any more.

use std::collections::BTreeMap;

use crate::ids::{StateId, TrialNumber};
use crate::limits::LEASES_LOST_MAX;
use crate::results::runs_start;
use crate::trial::{Outcome, Trial, TrialState};
use crate::tuner::report::completed;
use crate::tuner::{Ask, Change, Tuner};

impl Tuner {
    /// Counts a lost lease if the client was restarted since it received the trial that it holds for a state.
    /// Returns the change that ends the trial; `None` where the client still holds it.
    pub(super) fn lose_to_restart(&mut self, ask: &Ask, state: StateId, now_ms: i64) -> Option<Change> {
        let held = self.clients.trials.of_client(&ask.client_id, state)?;
        let (number, leaves_start) = (TrialNumber(held.number), self.leaves_start(ask, held));
        if !is_restarted(ask, held) {
            return None;
        }
        let was_alive = held.decision.heartbeat || held.decision.left_behind;
        let lost_leases = self.note_lost(number, was_alive);
        if lost_leases >= LEASES_LOST_MAX || leaves_start {
            return Some(self.end_lost(number, lost_leases, now_ms));
        }
        let all_lost =
            self.clients.trials.get(number).map_or(0, |held| self.searches.lost(state, &held.configuration));
        self.clients.trials.hold_by(number, ask.session, all_lost);
        None
    }

    /// Whether a restarted client does not get its start again that it was to measure: it was lost too often.
    pub(super) fn leaves_start(&self, ask: &Ask, held: &Trial) -> bool {
        let lost = self.searches.lost_starts(StateId(held.state_id), &held.configuration);
        is_restarted(ask, held) && held.decision.measures_start() && lost + 1 >= LEASES_LOST_MAX
    }

    /// Counts a lost lease of an open trial's configuration, and returns their number in the state. It is 0
    /// for the default, for the client's own one, for a measured configuration, and where the client's
    /// silence says nothing: it never showed that it lives, and no session before was silent. Those of a
    /// start that is to be measured are counted by themselves.
    pub(super) fn note_lost(&mut self, number: TrialNumber, was_alive: bool) -> u32 {
        let Some(trial) = self.clients.trials.get(number) else { return 0 };
        let (state, configuration) = (StateId(trial.state_id), trial.configuration.clone());
        let record = self.knowledge.states.results(state).record(&configuration);
        let was_measured = record.is_some_and(|record| record.measurements > 0);
        let default = self.spec.space.default_ref();
        let is_default = configuration == *default || runs_start(trial, default);
        if trial.decision.measures_start() && !was_measured {
            self.searches.note_lost_start(state, &configuration);
        }
        if was_measured || is_default {
            return 0;
        }
        let session = trial.decision.session;
        let counts = was_alive || session != 0 && self.searches.note_silence(state, &configuration, session);
        if counts { self.searches.note_lost(state, &configuration) } else { 0 }
    }

    /// Ends an open trial whose lease was lost: as infeasible after too many `lost_leases`. The change has no
    /// states: they are the caller's to add.
    pub(super) fn end_lost(&mut self, number: TrialNumber, lost_leases: u32, now_ms: i64) -> Change {
        if lost_leases >= LEASES_LOST_MAX
            && let Some(session) = self.clients.trials.get(number).map(|trial| trial.decision.session)
        {
            self.clients.trials.hold_by(number, session, lost_leases);
            let reason = format!(
                "{lost_leases} leases of this configuration were lost in this state and it was never \
                 measured there: a client that runs it crashes or hangs"
            );
            let (outcome, completion) = (Outcome::infeasible(reason), self.knowledge.last_completion + 1);
            let completed = self.clients.trials.get(number).and_then(|trial| {
                completed(&self.spec.objective, trial, BTreeMap::new(), outcome, completion, now_ms).ok()
            });
            if let Some(completed) = completed {
                return self.take(&completed);
            }
        }
        let expired = self.take_back(number, TrialState::Expired);
        Change { trials: expired.into_iter().collect(), ..Change::default() }
    }
}

/// Whether a trial was completed by [lost leases](LEASES_LOST_MAX), and by no report of its client.
pub fn gave_up<C>(trial: &Trial<C>) -> bool {
    let is_infeasible = matches!(trial.outcome, Some(Outcome::Infeasible { .. }));
    is_infeasible && trial.measurements.is_empty() && trial.decision.lost_leases >= LEASES_LOST_MAX
}

/// Whether the client was restarted since it received the trial that it holds.
fn is_restarted(ask: &Ask, held: &Trial) -> bool {
    let session = held.decision.session;
    session != ask.session && session != 0 && ask.session != 0
}
