//! A state with its table, and an even choice of its results.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::{Record, ResultTable};
use crate::configuration::Configuration;
use crate::ids::{MachineId, StateId};

/// A known state of the study with its measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownState {
    /// Rises by one from 1 within the study.
    pub id: StateId,
    /// The normalised indicators that founded it.
    pub anchor: Vec<f64>,
    /// The machine of these measurements: its place in the study's [`Machines`](crate::machines::Machines).
    pub machine: MachineId,
    /// A search was begun in it, or clients brought along the measurements of one.
    pub explored: bool,
    /// The table of its configurations.
    pub results: Arc<ResultTable>,
}

impl ResultTable {
    /// The `best` best of the ranked records, `others` of the rest, evenly spread over their ranks, and those
    /// of the named configurations, in the order of the ranking; all where there are no more.
    pub(crate) fn spread(&self, best: usize, others: usize, named: &[&Configuration]) -> Vec<&Record> {
        let ranked: Vec<&Record> = self.ranked().collect();
        if ranked.len() <= best + others + named.len() {
            return ranked;
        }
        let rest = ranked.len() - best;
        let mut places: BTreeSet<usize> = (0..best).collect();
        places.extend((0..others).map(|step| best + step * rest / others));
        let is_named = |place: &usize| named.contains(&&ranked[*place].configuration);
        places.extend((0..ranked.len()).filter(is_named));
        assert!(places.len() <= best + others + named.len(), "{} records", places.len());
        places.into_iter().map(|place| ranked[place]).collect()
    }
}
