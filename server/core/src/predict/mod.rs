//! Predictors: from what is known of other states to a configuration for this one.
//!
//! A predictor is a file here and a row of the registry (`model/src/policy/registry.rs`).

mod blend;
mod choice;
pub mod contextual;
mod deferred;
pub mod nearest;
pub mod prequential;
pub mod rbf;
mod registry;
pub mod state_index;

use crate::configuration::Configuration;
use crate::ids::MachineId;
use crate::machines::{Machines, Origin, distance_2};
use crate::results::KnownState;
use crate::search::Verdict;
use crate::space::Space;
use crate::trial::Neighbour;
pub use choice::Predictors;
pub use contextual::Contextual;
pub use deferred::{ComputedUpdates, DeferredUpdates};
pub use nearest::{Nearest, Weighted};
pub use rbf::{LeastSquares, Rbf, Shape};
pub use registry::METHODS;
use state_index::IndexEntry;
pub use state_index::StateIndex;

/// The inputs of a new predictor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PredictorSetup<'a> {
    /// The study's parameters.
    pub(crate) space: &'a Space,
    /// The number of indicators of a state.
    pub(crate) indicators: usize,
    /// The study's seed, from which centres and choices are drawn.
    pub(crate) seed: u64,
    /// The places of indicators that are left out of features.
    pub(crate) omitted: &'a [usize],
}

/// One completed trial, as a predictor sees it.
#[derive(Clone, Debug)]
pub struct Lesson<'a> {
    /// The normalised indicators the trial ran under.
    pub state: &'a [f64],
    /// The configuration that was run.
    pub configuration: &'a Configuration,
    /// Its point in the unit cube.
    pub point: &'a [f64],
    /// The result, with costs as they would be on the study's first machine.
    pub verdict: Verdict,
    /// The mean cost of the default configuration in the same state, where it is known; on the same terms.
    pub default_cost: Option<f64>,
    /// Which machine measured it.
    pub origin: Origin,
}

/// A question for a predictor.
#[derive(Clone, Copy, Debug)]
pub struct Query<'a> {
    /// The normalised indicators.
    pub state: &'a [f64],
    /// The known state they belong to.
    pub here: Option<&'a KnownState>,
    /// All known states, by rising id.
    pub known: &'a [KnownState],
    /// The index of them.
    pub state_index: &'a StateIndex,
    /// The study's parameters.
    pub space: &'a Space,
    /// The machines of the study.
    pub machines: &'a Machines,
    /// Which of them asks. Costs in answers are those to expect there.
    pub machine: MachineId,
    /// The answer if the predictor has nothing that is worth its risk: a configuration that was measured.
    pub rival: Option<&'a Configuration>,
}

impl Query<'_> {
    /// The `count` measured states nearest to the asked one that pass `filter`, nearest first. Those of other
    /// machines count as further away.
    pub(crate) fn nearest(
        &self,
        count: usize,
        explored: bool,
        filter: impl Fn(&KnownState) -> bool,
    ) -> Vec<IndexEntry> {
        let found = self.state_index.nearest(self.state, count, explored, |place| {
            let known = self.known.get(place).filter(|known| filter(known))?;
            Some(distance_2(self.machines.level(self.machine, known.machine)))
        });
        assert!(found.len() <= count, "{} of {count} states", found.len());
        found
    }

    /// Numbers for who asks.
    pub(crate) fn origin(&self) -> Origin {
        self.machines.origin(self.machine)
    }

    /// The expected cost on the asking machine of what was measured in a state.
    pub(crate) fn translate(&self, known: &KnownState, cost: f64) -> f64 {
        if known.machine == self.machine {
            return cost;
        }
        (cost * self.machines.factor(known.machine, self.machine)).min(f64::MAX)
    }

    /// Whether the configuration was tried in the asked state and did not run to its end.
    pub fn excludes(&self, configuration: &Configuration) -> bool {
        self.here.is_some_and(|here| here.results.fails(configuration))
    }
}

/// Least ratio of the expected gain to the expected loss of an answer that nobody measured.
pub(crate) const WORTH: f64 = 20.0;
/// It can be run with this probability at least.
pub(crate) const RUNS_LEAST: f64 = 0.99;

/// The probability that one more configuration can be run after `successes` that could and none that could
/// not. Half of all programs can run all of theirs; in the others any share is as likely as any other.
pub(crate) fn runs_after(successes: usize) -> f64 {
    let probability = 1.0 - (successes as f64 + 2.0).powi(-2);
    assert!((0.5..=1.0).contains(&probability), "a probability of {probability} after {successes}");
    probability
}

/// The expected value of a single measurement, in the objective's units. Both are finite and not negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The cost.
    pub cost: f64,
    /// How far a measurement may well be from it: one standard deviation, upwards.
    pub deviation: f64,
}

impl Estimate {
    /// Holds both within the finite numbers; what is no number is taken for the largest.
    pub fn new(cost: f64, deviation: f64) -> Self {
        let hold = |x: f64| if x.is_nan() { f64::MAX } else { x.clamp(0.0, f64::MAX) };
        let held = Estimate { cost: hold(cost), deviation: hold(deviation) };
        assert!(held.cost.is_finite() && held.deviation.is_finite(), "{held:?} stands for {cost}");
        held
    }
}

/// A predictor's answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The configuration to run.
    pub configuration: Configuration,
    /// The cost to expect.
    pub expected: Estimate,
    /// The known states nearest to the asked one, nearest first.
    pub neighbours: Vec<Neighbour>,
}

/// Maps states to configurations. All methods are deterministic, and their answers do not change when all
/// costs are multiplied by one positive number (but for rounding).
///
/// The first two methods are what makes a predictor. All others are ways in which it may take part in more
/// than answering; each says what it means not to. Answers are a matter of microseconds, but for those of
/// [`Contextual`], which are asked for ahead and whose learning is deferred.
pub trait Predictor {
    /// Its estimate of one configuration in the asked state. `None` when nothing is known.
    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate>;

    /// The configuration to exploit; never one that is known to be infeasible in the asked state. `None`
    /// when nothing is known.
    fn predict(&self, query: &Query<'_>) -> Option<Answer>;

    /// A configuration from which much can be learnt in the asked state without losing much, where the
    /// predictor can say. `number` makes answers differ from one question to the next. A predictor that only
    /// knows configurations that were tried has none.
    fn propose(&self, _query: &Query<'_>, _number: u64) -> Option<Answer> {
        None
    }

    /// Whether predictors of this kind [learn](Predictor::learn). One that does not is always at hand,
    /// whatever the policy names.
    fn learns() -> bool
    where
        Self: Sized,
    {
        true
    }

    /// Learns from a completed trial, whose result the table of its state holds already. A predictor that
    /// answers from the tables has nothing to learn.
    fn learn(&mut self, _lesson: &Lesson<'_>) {}

    /// Whether its features are indicators that are fixed when it begins, so that a change of the omitted
    /// ones makes it begin again. A predictor that weighs indicators at each question has none.
    fn has_features(&self) -> bool {
        false
    }

    /// Whether it learns costs as they are on the first machine, so that what it says has to be translated
    /// for others. A predictor that looks at tables has translated what it found there.
    fn speaks_of_first_machine(&self) -> bool {
        false
    }

    /// Makes what was read from a checkpoint whole. `false` when a configuration does not fit the space. A
    /// predictor that stores all it needs is whole.
    fn settle(&mut self, _space: &Space) -> bool {
        true
    }
}

/// Normalised indicators further out of 0..1 than this are drawn in.
const OUT_OF_RANGE: f64 = 1.0;

/// Leaves 0..1 and its surroundings as they are and draws in what lies further out, in order.
fn draw_in(x: f64) -> f64 {
    let (low, high) = (-OUT_OF_RANGE, 1.0 + OUT_OF_RANGE);
    if x > high {
        high + libm::log1p(x - high)
    } else if x < low {
        low - libm::log1p(low - x)
    } else {
        x
    }
}

#[cfg(test)]
mod tests;
