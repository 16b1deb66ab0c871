//! Predictors: from what is known of other states to a configuration for this one.

pub mod nearest;
pub mod rbf;

use crate::configuration::Configuration;
use crate::knowledge::KnownState;
use crate::search::Verdict;
use crate::trial::Neighbour;
pub use nearest::Nearest;
pub use rbf::Rbf;

/// One completed trial, as a predictor sees it.
#[derive(Clone, Debug)]
pub struct Lesson<'a> {
    /// The normalised indicators the trial ran under.
    pub state: &'a [f64],
    /// What was run.
    pub configuration: &'a Configuration,
    /// Its point in the unit cube.
    pub point: &'a [f64],
    /// What came of it.
    pub verdict: Verdict,
    /// The mean cost of the default configuration in the same state, where it is known.
    pub default_cost: Option<f64>,
}

/// What is asked of a predictor.
#[derive(Clone, Copy, Debug)]
pub struct Query<'a> {
    /// The normalised indicators.
    pub state: &'a [f64],
    /// The known state they belong to.
    pub here: Option<&'a KnownState>,
    /// All known states.
    pub known: &'a [KnownState],
}

impl Query<'_> {
    /// Whether the configuration is known not to work in the asked state.
    pub fn excludes(&self, configuration: &Configuration) -> bool {
        self.here.is_some_and(|here| here.knowledge.is_infeasible(configuration))
    }
}

/// A predictor's answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// What to run.
    pub configuration: Configuration,
    /// The cost to expect, in the objective's units: finite.
    pub predicted_cost: Option<f64>,
    /// The known states nearest to the asked one, nearest first.
    pub neighbours: Vec<Neighbour>,
}

/// Maps states to configurations. Both methods are deterministic, and their answers do not change when all
/// costs are multiplied by one positive number (but for rounding).
pub trait Predictor {
    /// Learns from a completed trial.
    fn learn(&mut self, lesson: &Lesson<'_>);

    /// The configuration to exploit; never one that is known to be infeasible in the asked state. `None`
    /// when nothing is known.
    fn predict(&self, query: &Query<'_>) -> Option<Answer>;
}

#[cfg(test)]
mod tests;
