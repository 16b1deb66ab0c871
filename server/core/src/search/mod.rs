//! Searches inside one state: ask for a point of the unit cube, and report its result.
//!
//! A search is a small value. Its state goes through serde exactly, and its randomness is derived from
//! `(seed, state, step)` (see [`SearchSetup`]). So a search that is stored and read back goes on with equal
//! points. Pending points (asked for, without a result) are part of the state. A point whose client is lost
//! is withdrawn and asked again. A search is a file here and a row of the registry
//! (`model/src/policy/registry.rs`).

pub mod latin_hypercube;
pub(crate) mod layout;
pub mod model;
pub mod nelder_mead;
mod pending;
pub mod random;
mod registry;

use serde::{Deserialize, Serialize};

pub use crate::decision::Step;
pub use latin_hypercube::LatinHypercubeSearch;
pub use layout::Layout;
pub use layout::main_effects::{MainEffects, SourceMeasurement};
pub(crate) use model::on_grid;
pub use model::{ModelSearch, PlannedPoint};
pub use nelder_mead::NelderMead;
pub use random::RandomSearch;
pub use registry::{AnySearch, hears_others, resolved};

use crate::space::Space;

/// A point that a search wants measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Names the point within its search.
    pub id: u64,
    /// Coordinates in 0..1.
    pub x: Vec<f64>,
    /// The step of the search that asks.
    pub step: Step,
    /// The place, from the cheapest, of the cheaper level at which it is to be measured; `None` for in full.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<u32>,
}

/// The result of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// Measured: a finite cost.
    Cost(f64),
    /// Stopped early: the cost is at least this. Searches never take it for an improvement.
    AtLeast(f64),
    /// Cannot be run.
    Infeasible,
}

/// The answer to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feedback {
    /// Its result.
    pub verdict: Verdict,
    /// `false` when the point fell on a known configuration and taught nothing: searches then take longer
    /// steps on integer plateaus.
    pub fresh: bool,
}

/// Whether a configuration failed in another state.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceRun {
    /// Its point in the unit cube.
    pub x: Vec<f64>,
    /// It could not be run.
    pub failed: bool,
}

/// An explorer of one state. Lengths of points are the setup's dimension; costs are finite.
///
/// The first three methods make a search. All others are optional, and each says what its default means.
pub trait Search {
    /// The next point to measure. `None` while the search waits for points that are pending.
    fn ask(&mut self) -> Option<Point>;

    /// Answers a point. An id that is not pending is ignored, because its answer came twice.
    fn tell(&mut self, id: u64, feedback: Feedback);

    /// Takes back the point of a lost client; it is the next to be asked, under that id.
    fn withdraw(&mut self, id: u64);

    /// Names the cheaper levels at which the next points may be measured: the cost of each as a share of a
    /// full measurement, cheapest first. A search without a model wants all in full.
    fn open_levels(&mut self, _shares: &[f64]) {}

    /// The level of a pending point; `None` for in full.
    fn level_of(&self, _id: u64) -> Option<u32> {
        None
    }

    /// Answers a point that was measured at its level. Without a verdict the measurement failed, and the
    /// point is asked for in full. A point without a level is asked again: of a search without a model, or as
    /// earlier versions stored it.
    fn tell_cheaper(&mut self, id: u64, _verdict: Option<Verdict>) {
        self.withdraw(id);
    }

    /// The number of answers to [`Step::Replicate`], which added no configuration. A search without
    /// replicates has none.
    fn repeats(&self) -> u64 {
        0
    }

    /// Adds a point that was measured before the search began. A search without a model ignores it: a known
    /// point that it asks for is answered at once.
    fn know(&mut self, _x: Vec<f64>, _verdict: Verdict) {}

    /// Adds a point that was measured beside the search; its plan goes on. A search without a model ignores
    /// it.
    fn hear(&mut self, _x: Vec<f64>, _verdict: Verdict) {}

    /// Names what each measurement of a known point counts for, in usual ones: above 0, at most 1. A search
    /// without a model ignores it.
    fn weigh(&mut self, _x: &[f64], _weight: f64) {}

    /// Whether searches of this kind [follow](Search::follow) other states.
    fn hears_others() -> bool
    where
        Self: Sized,
    {
        false
    }

    /// Gives a new search the results of other states: `first` are its first points after the default,
    /// `winners` are further good points, and `runs` show what runs and what fails. A search that does not
    /// hear others begins as always.
    fn follow(
        &mut self,
        _main_effects: MainEffects,
        _first: Vec<Vec<f64>>,
        _winners: Vec<Vec<f64>>,
        _runs: Vec<SourceRun>,
    ) {
    }

    /// Gives a new search points of other states that may be looked at because parameters act there that act
    /// in no other point, the most promising first. A search that does not hear others ignores it.
    fn look_at(&mut self, _looks: Vec<Vec<f64>>) {}

    /// Names the space to a search that was read from its row. A search without a model ignores it.
    fn set_space(&mut self, _space: &Space) {}

    /// Whether the next [`ask`](Search::ask) takes microseconds, because no model has to be fitted. A search
    /// without a model is always ready.
    fn is_ready(&self) -> bool {
        true
    }

    /// A next point in microseconds, for a client that cannot wait for another plan of this search: one from
    /// the reserve, else a guess. A search without a model asks as always.
    fn ask_at_once(&mut self) -> Option<Point> {
        self.ask()
    }

    /// Computes the next point on a copy, and `reserve` more. This takes milliseconds. `None` where there is
    /// nothing to compute.
    fn plan(&self, _reserve: usize) -> Option<PlannedPoint> {
        None
    }

    /// Takes over the [plan](Search::plan) of a copy of this search, if it is still of use. Without a new
    /// result since, the search then asks for the point that it would have computed itself.
    fn adopt(&mut self, _plan: PlannedPoint) {}
}

/// The inputs of a new search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SearchSetup {
    /// Seed of the study.
    pub seed: u64,
    /// The state, so that states of one study draw different points.
    pub state_id: u64,
    /// The default configuration's point: the first that is asked. Its length is the dimension.
    pub start: Vec<f64>,
    /// The number of planned measurements; initial designs are sized by it.
    pub budget: u32,
    /// The meaning of each axis.
    #[serde(default)]
    pub layout: Layout,
}

impl SearchSetup {
    /// The setup of a search of a space.
    pub fn of(space: &Space, seed: u64, state_id: u64, budget: u32) -> Self {
        let (start, layout) = (space.encode(space.default_ref()), Layout::of(space));
        SearchSetup { seed, state_id, start, budget, layout }
    }

    fn dimension(&self) -> usize {
        self.start.len()
    }

    /// A setup of [plain](Layout::plain) axes.
    #[cfg(test)]
    fn plain(seed: u64, start: Vec<f64>, budget: u32, levels: Vec<u32>) -> Self {
        let layout = Layout::plain(start.clone(), &levels);
        SearchSetup { seed, state_id: 1, start, budget, layout }
    }
}

#[cfg(test)]
mod agreement;
#[cfg(test)]
mod chang;
#[cfg(test)]
mod contract;
#[cfg(test)]
mod mixed;
#[cfg(test)]
mod stiff;
