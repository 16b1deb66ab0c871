//! Pending points: those that a search has proposed and has no result of.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::search::{Point, Step};

/// The pending points of one search, and those that came back unmeasured. Field names are those of stored
/// rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct PendingPoints {
    next_id: u64,
    #[serde(rename = "out")]
    pending: BTreeMap<u64, Point>,
    #[serde(rename = "back")]
    withdrawn: BTreeMap<u64, Point>,
}

impl PendingPoints {
    /// A point to be measured in full.
    pub(super) fn add(&mut self, x: Vec<f64>, step: Step) -> Point {
        self.add_at(x, step, None)
    }

    /// A point to be measured at a cheaper level, or in full.
    pub(super) fn add_at(&mut self, x: Vec<f64>, step: Step, level: Option<u32>) -> Point {
        let point = Point { id: self.next_id, x, step, level };
        self.next_id += 1;
        self.pending.insert(point.id, point.clone());
        point
    }

    /// Takes the oldest withdrawn point up again.
    pub(super) fn resume(&mut self) -> Option<Point> {
        let (id, point) = self.withdrawn.pop_first()?;
        self.pending.insert(id, point.clone());
        Some(point)
    }

    /// Takes the oldest withdrawn point up again, to be measured in full.
    pub(super) fn resume_in_full(&mut self) -> Option<Point> {
        self.withdrawn.first_entry()?.get_mut().level = None;
        self.resume()
    }

    /// Removes a point that has its result; `None` if it is not pending.
    pub(super) fn finish(&mut self, id: u64) -> Option<Point> {
        self.pending.remove(&id)
    }

    pub(super) fn withdraw(&mut self, id: u64) {
        if let Some(point) = self.pending.remove(&id) {
            self.withdrawn.insert(id, point);
        }
    }

    pub(super) fn withdraw_in_full(&mut self, id: u64) {
        if let Some(point) = self.pending.get_mut(&id) {
            point.level = None;
        }
        self.withdraw(id);
    }

    pub(super) fn has_withdrawn(&self) -> bool {
        !self.withdrawn.is_empty()
    }

    pub(super) fn added(&self) -> u64 {
        self.next_id
    }

    pub(super) fn points(&self) -> impl Iterator<Item = &Point> {
        self.pending.values()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.pending.is_empty() && self.withdrawn.is_empty()
    }
}
