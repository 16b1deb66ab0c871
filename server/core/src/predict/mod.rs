//! Predictors: a configuration for one state from the measurements of others.
//!
//! A predictor is a file here and a row of the registry (`model/src/policy/registry.rs`).

mod choice;
pub mod contextual;
mod deferred;
mod errors;
pub mod nearest;
pub mod prequential;
pub mod rbf;
mod registry;
pub mod state_index;

use crate::configuration::Configuration;
use crate::ids::MachineId;
use crate::machines::{Machines, distance_2};
use crate::results::KnownState;
use crate::search::Verdict;
use crate::space::Space;
use crate::trial::Neighbour;
pub(crate) use choice::FitTime;
pub use choice::Predictors;
pub use contextual::Contextual;
pub use deferred::{ComputedUpdates, DeferredUpdates};
pub use nearest::Nearest;
pub use rbf::Rbf;
pub use registry::METHODS;
pub use state_index::StateIndex;
use state_index::{Among, IndexEntry};

#[derive(Clone, Copy, Debug)]
pub(crate) struct PredictorSetup<'a> {
    pub(crate) space: &'a Space,
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
    /// The mean cost of the default configuration in that state, where it is known; also as on the first
    /// machine.
    pub default_cost: Option<f64>,
    /// The number of the machine that measured it.
    pub machine: u64,
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
    /// The machine that asks. Costs in answers are those expected there.
    pub machine: MachineId,
    /// A measured configuration, which is the answer if the predictor has none that is worth its risk.
    pub rival: Option<&'a Configuration>,
}

impl Query<'_> {
    /// The `count` states nearest to the asked one among some that pass `filter`, nearest first. Those of
    /// other machines count as further away. The work grows with the number that `filter` leaves out.
    pub(crate) fn nearest(
        &self,
        count: usize,
        among: Among,
        filter: impl Fn(&KnownState) -> bool,
    ) -> Vec<IndexEntry> {
        let found = self.state_index.nearest(self.state, count, among, |place| {
            let passes = |known: &&KnownState| among.has(known) && filter(known);
            let known = self.known.get(place).filter(passes)?;
            Some(distance_2(self.machines.level(self.machine, known.machine)))
        });
        assert!(found.len() <= count, "{} of {count} states", found.len());
        found
    }

    /// The `ran` nearest states in which something ran and the `failed` nearest in which something was tried
    /// and nothing ran, nearest first.
    pub(crate) fn nearest_tried(&self, ran: usize, failed: usize) -> Vec<IndexEntry> {
        let mut found = self.nearest(ran, Among::Ran, |_| true);
        found.extend(self.nearest(failed, Among::Failed, |_| true));
        found.sort_by(|a, b| a.distance_2.total_cmp(&b.distance_2).then(a.name.cmp(&b.name)));
        found
    }

    /// The `count` states of the asking machine nearest to the asked one in which something ran, nearest
    /// first.
    pub(crate) fn nearest_own(&self, count: usize) -> Vec<IndexEntry> {
        let ran = |place: usize| self.known.get(place).is_some_and(|known| known.results.best().is_some());
        self.state_index.nearest_own(self.machine, self.state, count, ran)
    }

    /// A cost measured in a state, converted to the asking machine.
    pub(crate) fn translate(&self, known: &KnownState, cost: f64) -> f64 {
        self.machines.translate(known.machine, self.machine, cost)
    }

    /// Whether the configuration was tried in the asked state and did not run to its end.
    pub fn excludes(&self, configuration: &Configuration) -> bool {
        self.here.is_some_and(|here| here.results.fails(configuration))
    }
}

/// Least ratio of an answer's expected gain, over an incumbent or a measured rival, to its expected loss.
pub(crate) const WORTH: f64 = 20.0;
/// Least probability that such an answer can be run.
pub(crate) const RUNS_LEAST: f64 = 0.99;

/// The probability that one more configuration can be run after `successes` others ran and none failed. The
/// prior: half of all programs run every configuration; in the others every share of runnable ones is equally
/// likely.
pub(crate) fn runs_after(successes: usize) -> f64 {
    1.0 - (successes as f64 + 2.0).powi(-2)
}

/// The expected value of a single measurement, in the objective's units. Both are finite and not negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The cost.
    pub cost: f64,
    /// One standard deviation of a measurement from the cost, upwards.
    pub deviation: f64,
}

impl Estimate {
    /// Makes both finite; NaN becomes the largest number.
    pub fn new(cost: f64, deviation: f64) -> Self {
        let hold = |x: f64| if x.is_nan() { f64::MAX } else { x.clamp(0.0, f64::MAX) };
        Estimate { cost: hold(cost), deviation: hold(deviation) }
    }
}

/// A predictor's answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The configuration to run.
    pub configuration: Configuration,
    /// The expected cost.
    pub expected: Estimate,
    /// The known states nearest to the asked one, nearest first.
    pub neighbours: Vec<Neighbour>,
}

/// Maps states to configurations. All methods are deterministic, and their answers do not change when all
/// costs are multiplied by one positive number (but for rounding).
///
/// The first two methods are required. Each other method adds a further role and says what its default means.
/// Answers take microseconds. Only those of [`Contextual`] take longer: they are asked for ahead, and their
/// learning is deferred.
pub trait Predictor {
    /// Its estimate of one configuration in the asked state. `None` when nothing is known.
    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate>;

    /// The configuration to exploit; never one that is known to be infeasible in the asked state. `None`
    /// when nothing is known.
    fn predict(&self, query: &Query<'_>) -> Option<Answer>;

    /// A configuration that teaches much in the asked state at a small loss. `number` makes answers differ
    /// from one question to the next. A predictor that only knows tried configurations has none.
    fn propose(&self, _query: &Query<'_>, _number: u64) -> Option<Answer> {
        None
    }

    /// Whether predictors of this kind [learn](Predictor::learn). One that does not is always at hand.
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
    /// ones makes it begin again. Such a model learns costs as they are on the first machine, so that its
    /// estimates have to be converted for others. A predictor that reads tables weighs indicators and
    /// converts costs at each question.
    fn has_features(&self) -> bool {
        false
    }

    /// Completes a predictor that was read from a checkpoint. `false` when a configuration does not fit the
    /// space. A predictor that stores all it needs is whole.
    fn settle(&mut self, _space: &Space) -> bool {
        true
    }
}

/// Normalised indicators further out of 0..1 than this are drawn in.
const OUT_OF_RANGE: f64 = 1.0;

/// Leaves 0..1 and its surroundings as they are and draws in values further out, in order.
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
