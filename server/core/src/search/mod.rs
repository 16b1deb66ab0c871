//! Searches inside one state: ask for a point of the unit cube, tell what came of it.
//!
//! A search is a small value: its state goes through serde exactly, and its randomness is derived from
//! `(seed, state, step)` (see [`SearchSetup`]), so a search that is stored and read back goes on with the
//! same points. Points that are out (asked and not told) are part of the state; a point whose client went
//! away is withdrawn and asked again.

pub mod auto;
mod flight;
pub mod guide;
pub mod latin_hypercube;
pub(crate) mod layout;
mod levels;
pub mod model;
pub mod nelder_mead;
pub mod random;

use std::cmp::Ordering;

use serde::{Deserialize, Serialize};

use crate::policy::SearchMethod;
pub use auto::AutoSearch;
pub use guide::{Elsewhere, Guide};
pub use latin_hypercube::LatinHypercubeSearch;
pub use layout::Layout;
pub use levels::levels;
pub use model::{ModelSearch, Plan};
pub use nelder_mead::NelderMead;
pub use random::RandomSearch;

/// A point that a search wants measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Names the point within its search.
    pub id: u64,
    /// Coordinates in 0..1.
    pub x: Vec<f64>,
    /// Which step of the search asks.
    pub step: Step,
}

/// The steps of the searches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// The default configuration: the first point of every search.
    Default,
    /// A point of a Latin hypercube design.
    LatinHypercube,
    /// What did well in other states of the study.
    Elsewhere,
    /// The best point so far, one step along one axis: the design of a continuous space.
    Coordinate,
    /// The worst vertex of a simplex mirrored at the centre of the others.
    Reflect,
    /// Further in the direction of a reflection that paid off.
    Expand,
    /// Between the centre and the worst or the reflected vertex.
    Contract,
    /// The best point with another value of one choice.
    Switch,
    /// A random point, near the best or anywhere.
    RandomSearch,
    /// A vertex of a new simplex around the best point.
    Restart,
    /// The point that a model expects most of.
    Model,
    /// The point that a model of the measurements around the best expects most of.
    Local,
    /// A configuration that was measured before and looks best: once more, to tell luck from merit.
    Replicate,
}

impl Step {
    /// The name that reasons carry.
    pub fn name(self) -> &'static str {
        match self {
            Step::Default => "default",
            Step::LatinHypercube => "latin_hypercube",
            Step::Elsewhere => "elsewhere",
            Step::Coordinate => "coordinate",
            Step::Reflect => "reflect",
            Step::Expand => "expand",
            Step::Contract => "contract",
            Step::Switch => "switch",
            Step::RandomSearch => "random_search",
            Step::Restart => "restart",
            Step::Model => "model",
            Step::Local => "local",
            Step::Replicate => "replicate",
        }
    }
}

/// How good a point is. The order is total: costs by size, then everything that is infeasible.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Score {
    /// Measured: finite, less is better.
    Cost(f64),
    /// Cannot be run: worse than any cost.
    Infeasible,
}

impl Score {
    /// Total order, best first.
    pub fn compare(&self, other: &Score) -> Ordering {
        match (self, other) {
            (Score::Cost(a), Score::Cost(b)) => a.total_cmp(b),
            (Score::Cost(_), Score::Infeasible) => Ordering::Less,
            (Score::Infeasible, Score::Cost(_)) => Ordering::Greater,
            (Score::Infeasible, Score::Infeasible) => Ordering::Equal,
        }
    }

    /// Strictly better.
    pub fn beats(&self, other: &Score) -> bool {
        self.compare(other) == Ordering::Less
    }
}

/// What came of a point.
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
    /// What came of it.
    pub verdict: Verdict,
    /// `false` when the point fell on a configuration that was known already, so that nothing was learnt:
    /// searches on integer plateaus take longer steps then.
    pub fresh: bool,
}

/// An explorer of one state. Lengths of points are the setup's dimension; costs are finite.
pub trait Search {
    /// The next point to measure. `None` while the search waits for points that are out.
    fn ask(&mut self) -> Option<Point>;

    /// Answers a point. An id that is not out is passed over: the answer came twice.
    fn tell(&mut self, id: u64, feedback: Feedback);

    /// Takes a point back whose client went away; it is the next to be asked, under the same id.
    fn withdraw(&mut self, id: u64);

    /// How many of the answers were to [`Step::Replicate`], and so added no configuration.
    fn repeats(&self) -> u64 {
        0
    }
}

/// What a search is made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SearchSetup {
    /// Seed of the study.
    pub seed: u64,
    /// The state, so that states of one study draw different points.
    pub state_id: u64,
    /// The default configuration's point: the first that is asked. Its length is the dimension.
    pub start: Vec<f64>,
    /// How many measurements are planned; initial designs are sized by it.
    pub budget: u32,
    /// How many values each axis stands for, where they are few and hold equal shares of the axis, as
    /// [`levels()`] counts them; 0 for every other axis. May be shorter than the dimension: the rest counts
    /// as 0, and so do searches that were stored before this was known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub levels: Vec<u32>,
    /// What each axis stands for, for searches with a model. May be empty.
    #[serde(default, skip_serializing_if = "Layout::is_empty")]
    pub layout: Layout,
}

impl SearchSetup {
    fn dimension(&self) -> usize {
        self.start.len()
    }

    fn levels_of(&self, axis: usize) -> u32 {
        self.levels.get(axis).copied().unwrap_or(0)
    }
}

/// One of the searches, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AnySearch {
    /// See [`nelder_mead`].
    NelderMead(NelderMead),
    /// See [`latin_hypercube`].
    LatinHypercube(LatinHypercubeSearch),
    /// See [`random`].
    Random(RandomSearch),
    /// See [`model`].
    Model(ModelSearch),
    /// See [`auto`].
    Auto(AutoSearch),
}

impl AnySearch {
    /// A fresh search.
    pub fn new(method: SearchMethod, setup: SearchSetup) -> Self {
        match method {
            SearchMethod::NelderMead => AnySearch::NelderMead(NelderMead::new(setup)),
            SearchMethod::LatinHypercube => AnySearch::LatinHypercube(LatinHypercubeSearch::new(setup)),
            SearchMethod::Random => AnySearch::Random(RandomSearch::new(setup)),
            SearchMethod::Model => AnySearch::Model(ModelSearch::new(setup)),
            SearchMethod::Auto => AnySearch::Auto(AutoSearch::new(setup)),
        }
    }

    /// Which search it is.
    pub fn method(&self) -> SearchMethod {
        match self {
            AnySearch::NelderMead(_) => SearchMethod::NelderMead,
            AnySearch::LatinHypercube(_) => SearchMethod::LatinHypercube,
            AnySearch::Random(_) => SearchMethod::Random,
            AnySearch::Model(_) => SearchMethod::Model,
            AnySearch::Auto(_) => SearchMethod::Auto,
        }
    }

    /// Leaves axes where they are, from the next point on: places in the space, and coordinates in 0..1. `false` when
    /// the search cannot; its points must then be moved by whoever asks.
    pub fn hold(&mut self, held: &[(usize, f64)]) -> bool {
        match self {
            AnySearch::Model(search) => search.hold(held),
            AnySearch::Auto(search) => search.hold(held),
            _ => return false,
        }
        true
    }

    /// Tells of a point that was measured before the search began. Searches without a model pass it over: what
    /// they ask and is known is answered at once.
    pub fn know(&mut self, x: Vec<f64>, verdict: Verdict) {
        match self {
            AnySearch::Model(search) => search.know(x, verdict),
            AnySearch::Auto(search) => search.know(x, verdict),
            _ => {}
        }
    }

    /// Tells of a point that was measured beside the search; whatever was planned goes on.
    pub fn hear(&mut self, x: Vec<f64>, verdict: Verdict) {
        match self {
            AnySearch::Model(search) => search.hear(x, verdict),
            AnySearch::Auto(search) => search.hear(x, verdict),
            _ => {}
        }
    }

    /// Has a search that has just begun profit from other states: `first` are points to begin with, after the default.
    /// Searches without a model pass it over.
    pub fn follow(&mut self, guide: Guide, first: Vec<Vec<f64>>) {
        match self {
            AnySearch::Model(search) => search.follow(guide, first),
            AnySearch::Auto(search) => search.follow(guide, first),
            _ => {}
        }
    }

    /// Whether the next [`ask`](Search::ask) is a matter of microseconds: no model has to be fitted for it.
    pub fn is_ready(&self) -> bool {
        match self {
            AnySearch::Model(search) => search.is_ready(),
            AnySearch::Auto(search) => search.is_ready(),
            _ => true,
        }
    }

    /// Thinks of the next point, without changing the search that this is a copy of. `None` where there is nothing to
    /// think about.
    pub fn plan(self) -> Option<Plan> {
        match self {
            AnySearch::Model(search) => Some(search.plan()),
            AnySearch::Auto(search) => Some(search.plan()),
            _ => None,
        }
    }

    /// Takes over what a copy of this search has [found](AnySearch::plan), if it is still worth something. Asked next,
    /// a search that was not told anything since gives the same point as if it had thought of it itself.
    pub fn adopt(&mut self, plan: Plan) {
        match self {
            AnySearch::Model(search) => search.adopt(plan),
            AnySearch::Auto(search) => search.adopt(plan),
            _ => {}
        }
    }

    fn inner(&mut self) -> &mut dyn Search {
        match self {
            AnySearch::NelderMead(search) => search,
            AnySearch::LatinHypercube(search) => search,
            AnySearch::Random(search) => search,
            AnySearch::Model(search) => search,
            AnySearch::Auto(search) => search,
        }
    }
}

impl Search for AnySearch {
    fn ask(&mut self) -> Option<Point> {
        self.inner().ask()
    }

    fn tell(&mut self, id: u64, feedback: Feedback) {
        self.inner().tell(id, feedback);
    }

    fn withdraw(&mut self, id: u64) {
        self.inner().withdraw(id);
    }

    fn repeats(&self) -> u64 {
        match self {
            AnySearch::Model(search) => search.repeats(),
            AnySearch::Auto(search) => search.repeats(),
            _ => 0,
        }
    }
}

#[cfg(test)]
mod contract;
#[cfg(test)]
mod mixed;
#[cfg(test)]
mod quality;
#[cfg(test)]
mod stiff;
