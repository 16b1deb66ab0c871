//! Independent uniform points: the plainest search, and the yardstick for the others.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::randomness::{Purpose, stream};
use crate::search::pending::PendingPoints;
use crate::search::{Feedback, Point, Search, SearchSetup, Step};

/// The default first, then uniform points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RandomSearch {
    setup: SearchSetup,
    #[serde(rename = "flight")]
    pending: PendingPoints,
    asked: u64,
}

impl RandomSearch {
    /// A fresh search.
    pub fn new(setup: SearchSetup) -> Self {
        RandomSearch { setup, pending: PendingPoints::default(), asked: 0 }
    }
}

impl Search for RandomSearch {
    fn ask(&mut self) -> Option<Point> {
        if let Some(point) = self.pending.resume() {
            return Some(point);
        }
        let asked = self.asked;
        self.asked += 1;
        if asked == 0 {
            return Some(self.pending.add(self.setup.start.clone(), Step::Default));
        }
        let mut random = stream(self.setup.seed, Purpose::Search, self.setup.state_id, asked);
        let x = (0..self.setup.dimension()).map(|_| random.random()).collect();
        Some(self.pending.add(x, Step::RandomSearch))
    }

    fn tell(&mut self, id: u64, _feedback: Feedback) {
        self.pending.finish(id);
    }

    fn withdraw(&mut self, id: u64) {
        self.pending.withdraw(id);
    }
}
