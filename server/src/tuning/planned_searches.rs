//! The states whose searches are being planned for.

use std::collections::HashMap;
use std::sync::{Arc, Weak};

use treewright_core::ids::StateId;

/// The states of a study whose search is being planned for: each as long as a request holds its token.
#[derive(Debug, Default)]
pub(super) struct PlannedSearches(HashMap<StateId, Weak<()>>);

impl PlannedSearches {
    pub(super) fn is_free(&self, state: StateId) -> bool {
        self.0.get(&state).is_none_or(|token| token.strong_count() == 0)
    }

    pub(super) fn take(&mut self, state: StateId) -> Arc<()> {
        self.0.retain(|_, token| token.strong_count() > 0);
        let token = Arc::new(());
        self.0.insert(state, Arc::downgrade(&token));
        assert!(!self.is_free(state), "somebody plans for state {state}");
        token
    }
}
