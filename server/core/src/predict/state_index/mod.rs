//! The state index: it finds the known states nearest to a question, and recognises a state that is met
//! again.
//!
//! A k-d tree (Bentley, "Multidimensional binary search trees used for associative searching", CACM 18, 1975)
//! for each kind of query, with distances scaled by the range that each indicator has in the states so far.

mod indicator_statistics;
mod tree;

use std::collections::BTreeMap;

use crate::ids::MachineId;
use crate::results::KnownState;
pub(crate) use indicator_statistics::{IndicatorStatistics, OmittedIndicator};
use tree::KdTree;
pub(crate) use tree::{IndexEntry, match_distance_2};

/// An index over the anchors of the known states. States are named by their places in the tuner's list.
#[derive(Clone, Debug, PartialEq)]
pub struct StateIndex {
    /// All states of each machine that may be met again, in which states are recognised.
    all: BTreeMap<MachineId, KdTree>,
    /// States in which something was tried, whether or not it ran.
    tried: KdTree,
    /// Those of them in which a search was begun.
    explored: KdTree,
    /// For each state, whether the tried and the explored tree hold it.
    held: Vec<(bool, bool)>,
    /// Over the measured states.
    statistics: IndicatorStatistics,
    /// The weights of the indicators in squared distances, which follow from the statistics.
    weights: Vec<f64>,
}

impl StateIndex {
    /// An empty index over states of `indicators` indicators.
    pub fn new(indicators: usize) -> Self {
        let tree = KdTree::new(indicators);
        StateIndex {
            all: BTreeMap::new(),
            tried: tree.clone(),
            explored: tree,
            held: Vec::new(),
            statistics: IndicatorStatistics::new(indicators),
            weights: vec![1.0; indicators],
        }
    }

    /// Takes a new state, or notes that a known one was tried or explored. States come in the order of
    /// their ids; a second call changes nothing.
    pub fn note(&mut self, state: &KnownState) {
        let place = state.id.0 as u32 - 1;
        if self.held.len() == place as usize {
            let tree = self.all.entry(state.machine).or_insert_with(|| KdTree::new(self.weights.len()));
            tree.insert(place, &state.anchor);
            self.held.push((false, false));
        }
        assert!((place as usize) < self.held.len(), "{:?} comes before its time", state.id);
        let (tried, explored) = &mut self.held[place as usize];
        if state.results.records().is_empty() {
            return;
        }
        if !*tried {
            *tried = true;
            self.tried.insert(place, &state.anchor);
        }
        if state.explored && !*explored {
            *explored = true;
            self.explored.insert(place, &state.anchor);
        }
    }

    /// Adds a state's indicators to the statistics of their reach. Called once for each state, in the order
    /// of their first measurements, so that a replay gives an equal result. Returns `true` where the omitted
    /// indicators have changed.
    pub(crate) fn weigh(&mut self, anchor: &[f64]) -> bool {
        let before = self.statistics.omitted();
        self.statistics.take(anchor);
        self.weights = self.statistics.weights();
        before != self.statistics.omitted()
    }

    /// The indicators that are left out of distances and features.
    pub(crate) fn omitted_indicators(&self) -> Vec<OmittedIndicator> {
        self.statistics.omitted()
    }

    /// The statistics of the indicators over the measured states.
    pub(crate) fn indicator_statistics(&self) -> &IndicatorStatistics {
        &self.statistics
    }

    /// Takes over statistics of as many indicators that were gathered before.
    pub(crate) fn take_over(&mut self, statistics: IndicatorStatistics) {
        assert_eq!(statistics.width(), self.statistics.width(), "as many indicators");
        self.weights = statistics.weights();
        self.statistics = statistics;
    }

    /// The number of states.
    pub(crate) fn len(&self) -> usize {
        self.held.len()
    }

    pub(crate) fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        let terms = a.iter().zip(b).zip(&self.weights).map(|((a, b), weight)| weight * (a - b) * (a - b));
        terms.sum::<f64>().sqrt()
    }

    /// From now on no state of the machine is recognised. Its measurements still count.
    pub fn displace(&mut self, machine: MachineId) {
        self.all.remove(&machine);
    }

    /// The place of a machine's nearest state with all indicators within `tolerance` of `state`.
    pub(crate) fn within(&self, machine: MachineId, state: &[f64], tolerance: f64) -> Option<usize> {
        self.all.get(&machine)?.within(state, tolerance).map(|found| found.name as usize)
    }

    /// The place of a machine's nearest state, however far.
    pub(crate) fn nearest_of(&self, machine: MachineId, state: &[f64]) -> Option<usize> {
        let nearest = self.all.get(&machine)?.nearest(state, &self.weights, 1, &mut |_| Some(0.0));
        nearest.first().map(|found| found.name as usize)
    }

    /// The `count` nearest states of a machine that pass `filter`, nearest first.
    pub(crate) fn nearest_own(
        &self,
        machine: MachineId,
        state: &[f64],
        count: usize,
        filter: impl Fn(usize) -> bool,
    ) -> Vec<IndexEntry> {
        let Some(tree) = self.all.get(&machine) else { return Vec::new() };
        tree.nearest(state, &self.weights, count, &mut |name| filter(name as usize).then_some(0.0))
    }

    /// The nearest state within a tolerance for each machine, the first one first.
    pub(crate) fn within_each(&self, state: &[f64], tolerance: f64) -> impl Iterator<Item = usize> {
        self.all.values().filter_map(move |tree| Some(tree.within(state, tolerance)?.name as usize))
    }

    /// The `count` nearest states in which something was tried, nearest first. `further` gives the square
    /// of an additional distance, and `None` for states to leave out. `explored` leaves out those without a
    /// search.
    pub(crate) fn nearest(
        &self,
        state: &[f64],
        count: usize,
        explored: bool,
        mut further: impl FnMut(usize) -> Option<f64>,
    ) -> Vec<IndexEntry> {
        let tree = if explored { &self.explored } else { &self.tried };
        tree.nearest(state, &self.weights, count, &mut |name| further(name as usize))
    }
}
