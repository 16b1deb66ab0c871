//! The search of one state together with the trials that carry its points.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::packed::{PackedError, pack, unpack};
use crate::search::{AnySearch, Feedback};
use crate::space::Space;
use crate::tuner::confirmation::{Confirming, Stored};
use crate::tuner::screening::HeldParameters;

/// The search of one state and its points in flight. Once its budget is spent the search itself is dropped: what it
/// found stands in the state's table. Opaque, exact through serde.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exploration {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) search: Option<AnySearch>,
    /// How many answers to a search that was dropped added no configuration.
    #[serde(default, skip_serializing_if = "is_zero")]
    repeats: u64,
    /// The most measured configurations that a session wanted the search to go on for, beyond the policy.
    #[serde(default, skip_serializing_if = "is_no_room")]
    room: u32,
    /// Which point of the search each open trial measures, by trial number.
    pub(super) open: BTreeMap<u64, u64>,
    /// What is left out, where the policy allows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) held: Option<HeldParameters>,
    /// The race of the best few against the incumbent, once the search is over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) confirming: Option<Confirming>,
    /// What was proven better than the default configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) confirmed: Option<Stored>,
}

impl Exploration {
    pub(super) fn new(search: AnySearch) -> Self {
        Exploration {
            search: Some(search),
            repeats: 0,
            room: 0,
            open: BTreeMap::new(),
            held: None,
            confirming: None,
            confirmed: None,
        }
    }

    /// Notes that a session wants the search to go on until so many configurations are measured.
    pub(super) fn make_room(&mut self, room: usize) {
        self.room = self.room.max(u32::try_from(room).unwrap_or(u32::MAX));
    }

    /// The most that a session wanted.
    pub(super) fn room(&self) -> usize {
        self.room as usize
    }

    /// How many of the answers added no configuration.
    pub(super) fn repeats(&self) -> u64 {
        self.search.as_ref().map_or(self.repeats, |search| search.repeats())
    }

    /// Drops the search.
    pub(super) fn end(&mut self) {
        self.repeats = self.repeats();
        self.search = None;
    }

    /// Whether the configurations that it names are of the space.
    pub(super) fn fits(&self, space: &Space) -> bool {
        self.confirming.as_ref().is_none_or(|race| race.fits(space))
            && self.confirmed.as_ref().is_none_or(|confirmed| space.owns(&confirmed.0))
    }

    /// Whether a trial runs a contender of the race.
    pub(super) fn confirms(&self, trial: u64) -> bool {
        self.confirming.as_ref().is_some_and(|race| race.runs(trial))
    }

    /// As few bytes, exact to the bit.
    pub fn pack(&self) -> Vec<u8> {
        pack(self)
    }

    /// Reads what [`pack`](Exploration::pack) wrote.
    pub fn unpack(bytes: &[u8]) -> Result<Self, PackedError> {
        unpack(bytes)
    }

    /// Ends the trial's hold on its point: the point is answered, or without feedback goes back and is
    /// asked again. `false` when the trial carried no point.
    pub(super) fn release(&mut self, trial: u64, feedback: Option<Feedback>) -> bool {
        if let Some(race) = &mut self.confirming {
            race.release(trial, None);
        }
        let Some(point) = self.open.remove(&trial) else {
            return false;
        };
        match (&mut self.search, feedback) {
            (Some(search), Some(feedback)) => search.tell(point, feedback),
            (Some(search), None) => search.withdraw(point),
            (None, _) => {}
        }
        true
    }
}

fn is_no_room(room: &u32) -> bool {
    *room == 0
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}
