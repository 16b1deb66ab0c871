//! Points that are out: asked and not told.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::search::{Point, Step};

/// The points of one search that are out, and those that came back unmeasured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Flight {
    next_id: u64,
    out: BTreeMap<u64, Point>,
    back: BTreeMap<u64, Point>,
}

impl Flight {
    /// Sends a new point out.
    pub(super) fn launch(&mut self, x: Vec<f64>, step: Step) -> Point {
        let point = Point { id: self.next_id, x, step };
        self.next_id += 1;
        self.out.insert(point.id, point.clone());
        point
    }

    /// Sends the oldest point out again that came back.
    pub(super) fn relaunch(&mut self) -> Option<Point> {
        let (id, point) = self.back.pop_first()?;
        self.out.insert(id, point.clone());
        Some(point)
    }

    /// Takes a point that was told; `None` if it is not out.
    pub(super) fn land(&mut self, id: u64) -> Option<Point> {
        self.out.remove(&id)
    }

    /// Puts a point back that is out.
    pub(super) fn withdraw(&mut self, id: u64) {
        if let Some(point) = self.out.remove(&id) {
            self.back.insert(id, point);
        }
    }

    /// Whether a point that came back waits to go out again.
    pub(super) fn has_returned(&self) -> bool {
        !self.back.is_empty()
    }

    /// How many points were ever launched.
    pub(super) fn launched(&self) -> u64 {
        self.next_id
    }

    /// The points that are out.
    pub(super) fn points(&self) -> impl Iterator<Item = &Point> {
        self.out.values()
    }

    /// Whether no point is out or waiting to go out again.
    pub(super) fn is_empty(&self) -> bool {
        self.out.is_empty() && self.back.is_empty()
    }
}
