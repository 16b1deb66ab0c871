//! The configurations of a state that are measured again: to prove the best, to follow the speed of a
//! machine, and to find changes.

use crate::configuration::Configuration;
use crate::decision;
use crate::ids::StateId;
use crate::results::Record;
use crate::search::Step;
use crate::tuner::exploring::exploiting::Exploiting;
use crate::tuner::exploring::few;
use crate::tuner::exploring::standings::Standings;
use crate::tuner::exploring::transfer::Transfer;
use crate::tuner::knowledge::{Auxiliaries, Knowledge, Rechecks, Speeds};
use crate::tuner::proposal::ProposedTrial;

/// Where another configuration beats an incumbent of other states, the incumbent is measured again after
/// every `DOUBTED_EVERY` tried configurations, until it has `DOUBTED_UNTIL` measurements.
const DOUBTED_EVERY: u64 = 3;
const DOUBTED_UNTIL: u64 = 3;
/// Number of stopped configurations after which the incumbent is measured again, where nothing else was
/// measured.
const STOPPED_BESIDE: usize = 3;

/// The best [`LEADERS`] that are not yet clearly better than the incumbent are measured again once
/// [`LEADERS_FROM`] configurations were tried and the share [`LEADERS_LATE`] of the budget is spent. Earlier,
/// a new configuration is worth more than a repeat: late repeats find lucky results as well.
const LEADERS_FROM: usize = 8;
const LEADERS_LATE: f64 = 0.6;
const LEADERS: usize = 3;
/// A leader is clearly better by [`LEADERS_CLEAR`] deviations of their difference, and after
/// [`LEADERS_MEASURED_LEAST`] measurements.
const LEADERS_CLEAR: f64 = 2.5;
const LEADERS_MEASURED_LEAST: u64 = 3;
/// No leader is measured more often than [`LEADERS_MEASURED_MAX`] times, and repeats are at most the share
/// [`LEADERS_SHARE`] of the tried configurations.
const LEADERS_MEASURED_MAX: u64 = 8;
const LEADERS_SHARE: f64 = 0.3;

/// The knowledge that says which configurations are measured again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Repeats<'a> {
    standings: Standings<'a>,
    transfer: Transfer<'a>,
    speeds: &'a Speeds,
    rechecks: &'a Rechecks,
    auxiliaries: &'a Auxiliaries,
}

impl<'a> Repeats<'a> {
    pub(crate) fn of(exploiting: &Exploiting<'a>, knowledge: &'a Knowledge) -> Self {
        let Exploiting { standings, transfer, .. } = *exploiting;
        let Knowledge { speeds, rechecks, auxiliaries, .. } = knowledge;
        Repeats { standings, transfer, speeds, rechecks, auxiliaries }
    }

    /// The incumbent, where it is to be measured again while others are explored, because it shows the speed
    /// of the client's machine. An incumbent of other states that does badly here is measured again soon, so
    /// that it gives way. One whose single cost may be far too low is measured again where all others were
    /// stopped by it. Once the search is spent the confirmation measures it anyway.
    pub(crate) fn incumbent_again(
        &self,
        client_id: &str,
        room: usize,
        state: StateId,
    ) -> Option<ProposedTrial> {
        let (results, incumbent) = (self.standings.states.results(state), self.standings.incumbent(state));
        let goes_on = self.standings.searches.taken(state, results, &self.standings.spec.policy) < room
            && !results.is_exact();
        let hurried =
            !self.standings.spec.objective.auxiliary().is_empty() && !self.auxiliaries.explains(state);
        let record = results.ran(incumbent)?;
        let is_default = incumbent == self.standings.spec.space.default_ref();
        let is_beaten = results.best().is_some_and(|best| best.mean_cost < record.mean_cost);
        let is_doubtful = !is_default
            && is_beaten
            && record.measurements < DOUBTED_UNTIL
            && results.tried() as u64 >= DOUBTED_EVERY * record.measurements;
        let is_due = is_doubtful || self.speeds.is_due(client_id, state, hurried, results.wanders());
        let is_unsure = record.measurements < 2 || record.evidence.is_torn();
        let is_alone = is_unsure && results.ranked().len() == 1 && results.stopped() >= STOPPED_BESIDE;
        if !(goes_on && (is_alone || self.standings.spec.policy.track_speed && is_due)) {
            return None;
        }
        let point = decision::ExploredPoint::Incumbent { is_default, round: None };
        let predicted_cost = Some(record.mean_cost);
        Some(ProposedTrial { configuration: incumbent.clone(), predicted_cost, point })
    }

    /// The next configuration of a recheck, which finds whether the machine or the state has changed after a
    /// cost jumped.
    pub(crate) fn recheck(&self, client_id: &str, state: StateId) -> Option<ProposedTrial> {
        let results = self.standings.states.results(state);
        let wanted = self.rechecks.wanted(client_id, state);
        let record = wanted.and_then(|wanted| results.record(wanted)).filter(|record| !record.fails())?;
        let is_default = record.configuration == *self.standings.spec.space.default_ref();
        let point = decision::ExploredPoint::Incumbent { is_default, round: None };
        let predicted_cost = Some(record.mean_cost);
        Some(ProposedTrial { configuration: record.configuration.clone(), predicted_cost, point })
    }

    /// A leader that seems better than the incumbent without being clearly so. A challenger that ran once is
    /// never proven by other trials, so a part of the search's measurements goes to the leaders, as in the
    /// racing of Maron and Moore ("Hoeffding races", NIPS 1993). Lucky ones fall back behind others, which
    /// are measured again next. Nothing is repeated where the policy confirms nothing, or where a search is
    /// followed as it was published. A single measurement far from all others is repeated at once, at any
    /// stage of the search.
    pub(crate) fn leader_again(&self, room: usize, state: StateId) -> Option<ProposedTrial> {
        let (results, incumbent) = (self.standings.states.results(state), self.standings.incumbent(state));
        let (tried, taken) =
            (results.tried(), self.standings.searches.taken(state, results, &self.standings.spec.policy));
        let is_confirmed = self.standings.spec.policy.confirm_rounds > 0 && self.transfer.warms_up_searches();
        if is_confirmed
            && taken < room
            && let Some(doubtful) = results.doubtful(incumbent)
            && !self.transfer.trials.runs(state, &doubtful.configuration)
        {
            return Some(self.again(doubtful));
        }
        let beside = results.ran(incumbent)?;
        let is_late = taken < room && taken as f64 >= LEADERS_LATE * room as f64;
        if !is_confirmed || tried < LEADERS_FROM || !is_late || results.is_exact() {
            return None;
        }
        let others = results.ranked().filter(|record| record.configuration != *incumbent);
        assert!(results.ranked().all(|record| record.measurements > 0), "what is ranked was measured");
        let repeats: u64 = others.map(|record| record.measurements - 1).sum();
        // On a machine whose speed wanders, only neighbouring trials compare well with the incumbent.
        let is_apart = results.wanders() && !results.is_latest(beside);
        if repeats as f64 >= LEADERS_SHARE * tried as f64 || is_apart {
            return None;
        }
        let noise = results.assumed_noise();
        let is_open = |leader: &&Record| {
            let parts = 1.0 / leader.measurements as f64 + 1.0 / beside.measurements as f64;
            let deviations = libm::log(beside.mean_cost / leader.mean_cost) / (noise * parts.sqrt());
            let is_clear = deviations >= LEADERS_CLEAR && leader.measurements >= LEADERS_MEASURED_LEAST;
            leader.configuration != *incumbent
                && deviations > 0.0
                && !is_clear
                && leader.measurements < LEADERS_MEASURED_MAX
                && !self.transfer.trials.runs(state, &leader.configuration)
        };
        results.ranked().take(LEADERS).find(is_open).map(|leader| self.again(leader))
    }

    /// One of the few configurations of a space that were all tried, which may be the best.
    pub(crate) fn contender_again(&self, room: usize, state: StateId) -> Option<ProposedTrial> {
        let results = self.standings.states.results(state);
        let races = self.standings.spec.policy.confirm_rounds > 0 && self.transfer.warms_up_searches();
        if !races || self.standings.searches.taken(state, results, &self.standings.spec.policy) >= room {
            return None;
        }
        let is_running = |configuration: &Configuration| self.transfer.trials.runs(state, configuration);
        few::next_of_race(results, is_running).map(|record| self.again(record))
    }

    /// A configuration once more.
    fn again(&self, record: &Record) -> ProposedTrial {
        let (search, measurements) = (self.standings.spec.policy.search, record.measurements);
        let neighbours = Vec::new();
        let point =
            decision::ExploredPoint::Search { search, step: Step::Replicate, measurements, neighbours };
        let predicted_cost = Some(record.mean_cost);
        ProposedTrial { configuration: record.configuration.clone(), predicted_cost, point }
    }
}
