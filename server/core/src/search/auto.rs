//! The search that a study gets when it names none.

use serde::{Deserialize, Serialize};

use crate::search::{Feedback, ModelSearch, Point, Search, SearchSetup};

/// The search. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutoSearch {
    model: ModelSearch,
}

impl AutoSearch {
    /// A fresh search.
    pub fn new(setup: SearchSetup) -> Self {
        AutoSearch { model: ModelSearch::new(setup) }
    }
}

impl Search for AutoSearch {
    fn ask(&mut self) -> Option<Point> {
        self.model.ask()
    }

    fn tell(&mut self, id: u64, feedback: Feedback) {
        self.model.tell(id, feedback);
    }

    fn withdraw(&mut self, id: u64) {
        self.model.withdraw(id);
    }

    fn repeats(&self) -> u64 {
        self.model.repeats()
    }
}
