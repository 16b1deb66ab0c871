//! The searches of a study's states, and which of their rows are to be written.
//!
//! Invariant: whoever changes a search counts the change, so that comparing two counts tells whether the state's row
//! is still what is stored.

use crate::ids::StateId;
use crate::search::AnySearch;
use crate::tuner::Exploration;
use crate::tuner::states::place;

/// The search of each state, in the order of their ids.
#[derive(Clone, Debug, Default)]
pub(super) struct Searches(Vec<StateSearch>);

/// The search of one state.
#[derive(Clone, Debug, Default)]
struct StateSearch {
    exploration: Option<Exploration>,
    /// Rises whenever the exploration may have changed.
    changes: u64,
}

impl Searches {
    /// Notes a new state, with the search that was begun in it, if it was.
    pub(super) fn found(&mut self, exploration: Option<Exploration>) {
        self.0.push(StateSearch { exploration, changes: 0 });
    }

    /// The search of a state, if one was begun; whether it goes on is told by itself.
    pub(super) fn of(&self, state: StateId) -> Option<&Exploration> {
        self.0[place(state)].exploration.as_ref()
    }

    /// The same, to be changed.
    pub(super) fn change(&mut self, state: StateId) -> Option<&mut Exploration> {
        let StateSearch { exploration, changes } = &mut self.0[place(state)];
        *changes += u64::from(exploration.is_some());
        exploration.as_mut()
    }

    /// Begins a search in a state; one that was there before is dropped, and what it confirmed stays.
    pub(super) fn begin(&mut self, state: StateId, search: AnySearch) {
        let own = &mut self.0[place(state)];
        let mut exploration = Exploration::new(search);
        if let Some(before) = own.exploration.take() {
            exploration.confirming = before.confirming;
            exploration.confirmed = before.confirmed;
        }
        own.exploration = Some(exploration);
        own.changes += 1;
    }

    /// How often the search of a state has changed.
    pub(super) fn changes(&self, state: StateId) -> u64 {
        self.0[place(state)].changes
    }

    /// Every search that was begun.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = &mut Exploration> {
        self.0.iter_mut().filter_map(|own| own.exploration.as_mut())
    }
}
