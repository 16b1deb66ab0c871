//! The searches of a study's states, and their rows that are to be written.
//!
//! Invariant: every change of a search is counted, so that two counts that differ mean a row to be stored
//! again.

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::LEASES_LOST_MAX;
use crate::policy::Policy;
use crate::results::{ResultTable, runs_start};
use crate::search::{AnySearch, hears_others};
use crate::space::Space;
use crate::trial::Trial;
use crate::tuner::exploring::few::{self, FewConfigurations};
use crate::tuner::knowledge::{Stored, place};
use crate::tuner::{Ask, Exploration};

/// The search of each state, in the order of their ids.
#[derive(Clone, Debug)]
pub(crate) struct Searches {
    of_states: Vec<StateSearch>,
    few: FewConfigurations,
}

/// See [`Searches::taken`].
pub(crate) fn taken(exploration: Option<&Exploration>, results: &ResultTable, replicates: u32) -> usize {
    let repeats = exploration.map_or(0, |own| own.repeats() as usize);
    let cheaper = exploration.map_or(0, |own| own.cheaper_trials as usize);
    (results.runs() / replicates.max(1) as usize).max(results.searched() + repeats) + cheaper
}

/// Whether a search with a budget of `room` trials has none left that adds a configuration.
pub(crate) fn is_spent(
    exploration: &Exploration,
    results: &ResultTable,
    policy: &Policy,
    room: usize,
) -> bool {
    taken(Some(exploration), results, policy.replicates) + exploration.open.len() >= room
}

#[derive(Clone, Debug, Default)]
struct StateSearch {
    exploration: Option<Exploration>,
    /// Rises whenever the exploration may have changed.
    changes: u64,
}

impl Searches {
    /// No searches yet, of configurations of a space.
    pub(crate) fn new(space: &Space) -> Self {
        Searches { of_states: Vec::new(), few: FewConfigurations::of(space) }
    }

    /// Every configuration that can be searched, where they are few.
    pub(crate) fn few(&self) -> &FewConfigurations {
        &self.few
    }

    /// Whether nothing is left to be searched in a state, within a budget of `room` trials.
    pub(crate) fn are_spent(
        &self,
        state: StateId,
        results: &ResultTable,
        policy: &Policy,
        room: usize,
    ) -> bool {
        let races = policy.confirm_rounds > 0 && hears_others(policy.search);
        let is_raced = || !races || few::next_of_race(results, |_| false).is_none();
        self.taken(state, results, policy) >= room || self.few.is_exhausted(results) && is_raced()
    }

    /// Notes a new state, with the search that was begun in it, if it was.
    pub(crate) fn found(&mut self, exploration: Option<Exploration>) {
        self.of_states.push(StateSearch { exploration, changes: 0 });
    }

    /// The search of a state, if one was begun. The search may be over.
    pub(crate) fn of(&self, state: StateId) -> Option<&Exploration> {
        self.record(state).filter(|exploration| exploration.is_begun())
    }

    /// The stored record of a state's search and lost leases, whether or not a search was begun.
    pub(crate) fn record(&self, state: StateId) -> Option<&Exploration> {
        self.of_states[place(state)].exploration.as_ref()
    }

    pub(crate) fn lost(&self, state: StateId, configuration: &Configuration) -> u32 {
        self.record(state).map_or(0, |exploration| exploration.lost(configuration, false))
    }

    /// The lost leases of a configuration that a trial of it names. One that names as many as make it
    /// infeasible was given up.
    pub(crate) fn lost_before(&self, state: StateId, configuration: &Configuration) -> u32 {
        self.lost(state, configuration).min(LEASES_LOST_MAX - 1)
    }

    /// The number of lost leases of a client's start.
    pub(crate) fn lost_starts(&self, state: StateId, start: &Configuration) -> u32 {
        self.record(state).map_or(0, |exploration| exploration.lost(start, true))
    }

    /// Notes a lost lease of a configuration in a state, and returns their number.
    pub(crate) fn note_lost(&mut self, state: StateId, configuration: &Configuration) -> u32 {
        self.count_lost(state, configuration, false)
    }

    /// Counts a lost lease of an open trial's configuration, and returns their number in the state, whose
    /// `results` these are. It is 0 for the default, for the client's own one, for a measured configuration,
    /// and where the client's silence says nothing: it never showed that it lives, and no session before was
    /// silent. Those of a start that is to be measured are counted by themselves.
    pub(crate) fn note_lost_lease(
        &mut self,
        trial: &Trial,
        results: &ResultTable,
        default: &Configuration,
        was_alive: bool,
    ) -> u32 {
        let (state, configuration) = (StateId(trial.state_id), &trial.configuration);
        let was_measured = results.record(configuration).is_some_and(|record| record.measurements > 0);
        let is_default = configuration == default || runs_start(trial, default);
        if trial.decision.measures_start() && !was_measured {
            self.count_lost(state, configuration, true);
        }
        if was_measured || is_default {
            return 0;
        }
        let session = trial.decision.session;
        let counts = was_alive || session != 0 && self.note_silence(state, configuration, session);
        if counts { self.note_lost(state, configuration) } else { 0 }
    }

    /// Whether a restarted client does not get its start again that it was to measure: it was lost too often.
    pub(crate) fn leaves_start(&self, ask: &Ask, held: &Trial) -> bool {
        let lost = self.lost_starts(StateId(held.state_id), &held.configuration);
        ask.is_restarted_since(held) && held.decision.measures_start() && lost + 1 >= LEASES_LOST_MAX
    }

    /// Notes a session that lost a lease of a configuration without having shown that it lives. Whether
    /// another one had before.
    fn note_silence(&mut self, state: StateId, configuration: &Configuration, session: u64) -> bool {
        let own = &mut self.of_states[place(state)];
        own.changes += 1;
        own.exploration.get_or_insert_with(Exploration::unbegun).note_silence(configuration, session)
    }

    fn count_lost(&mut self, state: StateId, configuration: &Configuration, is_start: bool) -> u32 {
        let own = &mut self.of_states[place(state)];
        own.changes += 1;
        own.exploration.get_or_insert_with(Exploration::unbegun).note_lost(configuration, is_start)
    }

    /// Forgets the lost leases of a configuration that has a result now.
    pub(crate) fn forgive(&mut self, state: StateId, configuration: &Configuration) {
        if self.record(state).is_some_and(|exploration| exploration.has_lost(configuration)) {
            let own = &mut self.of_states[place(state)];
            own.changes += 1;
            own.exploration.iter_mut().for_each(|exploration| exploration.forgive(configuration));
        }
    }

    /// The begun search of a state, to be changed. Counts the change.
    pub(crate) fn change(&mut self, state: StateId) -> Option<&mut Exploration> {
        let StateSearch { exploration, changes } = &mut self.of_states[place(state)];
        let begun = exploration.as_mut().filter(|exploration| exploration.is_begun());
        *changes += u64::from(begun.is_some());
        begun
    }

    /// Begins a search in a state. An earlier search is dropped, and its confirmed winner stays. Without one,
    /// `incumbent` takes its place: the configuration that other states expect to be best.
    pub(crate) fn begin(&mut self, state: StateId, search: AnySearch, incumbent: Option<Configuration>) {
        let own = &mut self.of_states[place(state)];
        let exploration = own.exploration.get_or_insert_with(Exploration::unbegun);
        exploration.restart(search);
        assert!(exploration.is_begun() && exploration.search.is_some(), "a search begins");
        exploration.confirmed = exploration.confirmed.take().or(incumbent.map(Stored));
        own.changes += 1;
    }

    /// Drops the search of a state with its confirmed winner, so that another one begins from nothing. Lost
    /// leases are remembered.
    pub(crate) fn begin_again(&mut self, state: StateId) {
        let own = &mut self.of_states[place(state)];
        own.changes += 1;
        own.exploration.iter_mut().for_each(Exploration::forget_search);
        assert!(self.of(state).is_none(), "nothing was begun");
    }

    /// The number of a state's trials that count towards the budget of its search: every one that explored
    /// it, with any configuration. Where the policy wants replicates, those of one configuration count as
    /// one. Trials at cheaper levels count as the share of a full one that they cost. Of states that an
    /// earlier version searched, only trials of new configurations and the search's own repeats are known.
    pub(crate) fn taken(&self, state: StateId, results: &ResultTable, policy: &Policy) -> usize {
        taken(self.of(state), results, policy.replicates)
    }

    pub(crate) fn changes(&self, state: StateId) -> u64 {
        self.of_states[place(state)].changes
    }

    /// Every search that was begun.
    pub(crate) fn all_mut(&mut self) -> impl Iterator<Item = &mut Exploration> {
        self.of_states.iter_mut().filter_map(|own| own.exploration.as_mut())
    }
}
