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

/// The states among which the nearest are looked for. What they are may change with every report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Among {
    /// Those in which something ran that can be run still.
    Ran,
    /// Those of them in which a search was begun.
    Explored,
    /// Those in which something was tried and nothing ran.
    Failed,
}

impl Among {
    const ALL: [Among; 3] = [Among::Ran, Among::Explored, Among::Failed];

    /// Whether a state is among them.
    pub(crate) fn has(self, state: &KnownState) -> bool {
        let ran = state.results.best().is_some();
        match self {
            Among::Ran => ran,
            Among::Explored => ran && state.explored,
            Among::Failed => !ran && !state.results.records().is_empty(),
        }
    }
}

/// An index over the anchors of the known states. States are named by their places in the tuner's list.
#[derive(Clone, Debug, PartialEq)]
pub struct StateIndex {
    /// All states of each machine that may be met again, in which states are recognised.
    all: BTreeMap<MachineId, KdTree>,
    /// The states of each kind, in the order of `Among::ALL`: no question about a few looks at all others.
    kinds: [KdTree; 3],
    /// For each state, whether the tree of each kind holds it.
    held: Vec<[bool; 3]>,
    /// Over the measured states.
    statistics: IndicatorStatistics,
    /// The weights of the indicators in squared distances, which follow from the statistics.
    weights: Vec<f64>,
}

impl StateIndex {
    /// An empty index over states of `indicators` indicators.
    pub fn new(indicators: usize) -> Self {
        StateIndex {
            all: BTreeMap::new(),
            kinds: Among::ALL.map(|_| KdTree::new(indicators)),
            held: Vec::new(),
            statistics: IndicatorStatistics::new(indicators),
            weights: vec![1.0; indicators],
        }
    }

    /// Takes a new state, or notes what a known one is now. States come in the order of their ids; a second
    /// call changes nothing.
    pub fn note(&mut self, state: &KnownState) {
        let place = state.id.0 as u32 - 1;
        if self.held.len() == place as usize {
            let tree = self.all.entry(state.machine).or_insert_with(|| KdTree::new(self.weights.len()));
            tree.insert(place, &state.anchor);
            self.held.push([false; 3]);
        }
        assert!((place as usize) < self.held.len(), "{:?} comes before its time", state.id);
        let kinds = self.kinds.iter_mut().zip(Among::ALL);
        for ((tree, among), is_held) in kinds.zip(&mut self.held[place as usize]) {
            match (*is_held, among.has(state)) {
                (false, true) => tree.insert(place, &state.anchor),
                (true, false) => tree.remove(place, &state.anchor),
                (false, false) | (true, true) => {}
            }
            *is_held = among.has(state);
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

    /// The `count` nearest states among some, nearest first. `further` gives the square of an additional
    /// distance, and `None` for states to leave out.
    pub(crate) fn nearest(
        &self,
        state: &[f64],
        count: usize,
        among: Among,
        mut further: impl FnMut(usize) -> Option<f64>,
    ) -> Vec<IndexEntry> {
        let tree = &self.kinds[among as usize];
        tree.nearest(state, &self.weights, count, &mut |name| further(name as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::tests::World;
    use crate::trial::Outcome;

    /// The nearest states in which nothing ran, and the number of states that were looked at.
    fn failed(world: &World) -> (Vec<u32>, usize) {
        let mut looked_at = 0;
        let further = |_| {
            looked_at += 1;
            Some(0.0)
        };
        let found = world.state_index.nearest(&[0.5, 0.5], 16, Among::Failed, further);
        (found.iter().map(|found| found.name).collect(), looked_at)
    }

    #[test]
    fn states_in_which_nothing_ran_are_found_without_a_look_at_the_others() {
        let mut world = World::new(1, 2);
        let at = |number: u32| [f64::from(number) / 60.0, 0.5];
        let fails = |world: &mut World, number: u32| {
            world.take(&at(number), &[0.5], Outcome::infeasible("too deep"), None, 1);
        };
        for number in 0..60 {
            match number % 25 {
                7 => fails(&mut world, number),
                _ => world.measure(&at(number), &[0.5], 1.0),
            }
        }
        assert_eq!(failed(&world), (vec![32, 7, 57], 3));
        world.measure(&at(32), &[0.5], 1.0);
        assert_eq!(failed(&world), (vec![7, 57], 2), "it runs now");
        assert_eq!(world.state_index.held[32], [true, true, false]);
        (0..2).for_each(|_| fails(&mut world, 32));
        assert_eq!(failed(&world), (vec![32, 7, 57], 3), "it fails more often than it runs");
        assert_eq!(world.state_index.held[32], [false, false, true]);
    }
}
