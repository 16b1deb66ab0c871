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
//!
//! Several programs may share one client id, such as the nodes of a farm. Each has a session of its own, and
//! none was started again where another one asks. A session that held the trial before and asks again lives:
//! no lease was lost. As long as each asks once, they look like one program that crashes at every start. So
//! where enough of them left a trial behind for its configuration to count as infeasible, the trial is put
//! aside. The client gets another one, and any of its sessions can report the first. The configuration counts
//! as infeasible once that lease has ended without a report. An answer that was never measured would be given
//! again at once, so it counts as infeasible without that wait.

use std::collections::BTreeMap;

use crate::ids::{StateId, TrialNumber};
use crate::limits::LEASES_LOST_MAX;
use crate::trial::{Outcome, Trial, TrialState};
use crate::tuner::report::completed;
use crate::tuner::{Ask, Change, Tuner};

impl Tuner {
    /// Counts a lost lease if the client was restarted since it received the trial that it holds for a state.
    /// Returns the change by which it holds the trial no more; `None` where it still does.
    pub(super) fn lose_to_restart(&mut self, ask: &Ask, state: StateId, now_ms: i64) -> Option<Change> {
        let held = self.clients.trials.of_client(&ask.client_id, state)?;
        let number = TrialNumber(held.number);
        if ask.is_back_to(held) {
            let session = held.decision.session;
            self.searches.forgive(state, &held.configuration);
            self.clients.trials.hold_by(number, session, 0);
            return None;
        }
        if !ask.is_restarted_since(held) {
            return None;
        }
        let leaves_start = self.searches.leaves_start(ask, held);
        let was_alive = held.decision.heartbeat || held.decision.left_behind;
        let (results, default) = (self.knowledge.states.results(state), self.spec.space.default_ref());
        let lost_leases = self.searches.note_lost_lease(held, results, default, was_alive);
        let all_lost = self.searches.lost_before(state, &held.configuration);
        let explores = held.decision.explores();
        if lost_leases >= LEASES_LOST_MAX {
            if !explores {
                let lost = self.end_lost(number, lost_leases, now_ms);
                return Some(Change { states: Vec::new(), ..lost });
            }
            if let Some(aside) = self.clients.put_aside(number) {
                return Some(Change { trials: vec![aside], ..Change::default() });
            }
        }
        if leaves_start {
            return Some(self.end_expired(number));
        }
        self.clients.trials.hold_by(number, ask.session, all_lost);
        None
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
        self.end_expired(number)
    }

    /// Ends an open trial as expired.
    fn end_expired(&mut self, number: TrialNumber) -> Change {
        let ended = self.clients.end(number);
        let expired = ended.map(|trial| self.racing().take_back(trial, TrialState::Expired));
        Change { trials: expired.into_iter().collect(), ..Change::default() }
    }
}

/// Whether a trial was completed by [lost leases](LEASES_LOST_MAX), and by no report of its client.
pub fn gave_up<C>(trial: &Trial<C>) -> bool {
    let is_infeasible = matches!(trial.outcome, Some(Outcome::Infeasible { .. }));
    is_infeasible && trial.measurements.is_empty() && trial.decision.lost_leases >= LEASES_LOST_MAX
}
