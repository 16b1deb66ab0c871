//! The order of a state's configurations.

use std::cmp::Ordering;

/// Place in the ranking: by cost, then by age.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rank {
    /// The mean of its measurements.
    pub(crate) cost: f64,
    /// Its place in the table, in the order in which configurations came.
    pub(crate) index: usize,
}

impl Eq for Rank {}

impl Ord for Rank {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost.total_cmp(&other.cost).then(self.index.cmp(&other.index))
    }
}

impl PartialOrd for Rank {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
