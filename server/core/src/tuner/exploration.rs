//! The search of one state together with the trials that carry its points.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::packed::{PackedError, pack, unpack};
use crate::search::{AnySearch, Feedback, Search};
use crate::tuner::screening::Held;

/// The search of one state and its points in flight. Opaque, exact through serde.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exploration {
    pub(super) search: AnySearch,
    /// Which point of the search each open trial measures, by trial number.
    pub(super) open: BTreeMap<u64, u64>,
    /// What is left out, where the policy allows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) held: Option<Held>,
}

impl Exploration {
    pub(super) fn new(search: AnySearch) -> Self {
        Exploration { search, open: BTreeMap::new(), held: None }
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
        let Some(point) = self.open.remove(&trial) else {
            return false;
        };
        match feedback {
            Some(feedback) => self.search.tell(point, feedback),
            None => self.search.withdraw(point),
        }
        true
    }
}
