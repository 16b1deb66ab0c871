//! The search that a study gets when it names none.
//!
//! For budgets of 20 to 80 trials one method came out ahead on the suites of `examples/search_quality`, whatever the
//! kind of the axes, but for one recorded landscape of trees, where Nelder-Mead was level: [`ModelSearch`]. So there is
//! nothing to choose yet, and this is where a choice by dimension, budget and parallelism has its place when another
//! method earns it.

use serde::{Deserialize, Serialize};

use crate::search::{Feedback, Guide, ModelSearch, Plan, Point, Search, SearchSetup, Verdict};

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

    /// Tells of a point that was measured before the search began.
    pub fn know(&mut self, x: Vec<f64>, verdict: Verdict) {
        self.model.know(x, verdict);
    }

    /// Tells of a point that was measured beside the search.
    pub fn hear(&mut self, x: Vec<f64>, verdict: Verdict) {
        self.model.hear(x, verdict);
    }

    /// Has it profit from other states.
    pub fn follow(&mut self, guide: Guide, first: Vec<Vec<f64>>) {
        self.model.follow(guide, first);
    }

    /// Leaves axes where they are, from the next point on.
    pub fn hold(&mut self, held: &[(usize, f64)]) {
        self.model.hold(held);
    }

    /// Whether the next point is at hand.
    pub fn is_ready(&self) -> bool {
        self.model.is_ready()
    }

    /// Thinks of the next point. Takes the search, which is a copy.
    pub fn plan(self) -> Plan {
        self.model.plan()
    }

    /// Takes over what a copy has found.
    pub fn adopt(&mut self, plan: Plan) {
        self.model.adopt(plan);
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
