//! Spaces that are small enough for a search to try every configuration.
//!
//! Once every configuration has a verdict there is nothing to search for. The rest of the budget separates
//! the best of them, as in a race (Maron and Moore, "Hoeffding races", NIPS 1993). Each is measured again
//! until it is clearly dearer than the best, or was measured often enough for a confirmation to choose among
//! them.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::results::{Record, ResultTable};
use crate::robust::{FRAME_NOISE_PRIOR, NOISE_LEAST};
use crate::space::Space;

/// Number of measurements after which a configuration is clear enough for a confirmation.
const ENOUGH: u64 = 3;
/// Standard deviations above the best from which on a configuration is clearly worse.
const CLEAR: f64 = 2.5;
/// A single measurement below this multiple of the best cost may have been disturbed.
const NEAR: f64 = 2.0;
/// The most noise that is assumed.
const NOISE_MAX: f64 = 0.5;

/// Every configuration of a space, where they are few.
#[derive(Clone, Debug, Default)]
pub(crate) struct FewConfigurations(Option<Arc<[Configuration]>>);

impl FewConfigurations {
    pub(crate) fn of(space: &Space) -> Self {
        FewConfigurations(space.enumerate().map(Arc::from))
    }

    /// Their number, where they are few.
    pub(crate) fn count(&self) -> Option<usize> {
        self.0.as_ref().map(|all| all.len())
    }

    /// Whether every configuration has a verdict, or was given up.
    pub(crate) fn is_exhausted(&self, results: &ResultTable) -> bool {
        self.0.as_ref().is_some_and(|all| results.decided() >= all.len())
    }

    /// The first configuration that is neither tried nor running.
    pub(crate) fn untried(
        &self,
        results: &ResultTable,
        is_running: impl Fn(&Configuration) -> bool,
    ) -> Option<&Configuration> {
        let is_new = |one: &&Configuration| results.settled(one, 1).is_none() && !is_running(one);
        self.0.as_ref()?.iter().find(is_new)
    }
}

/// The next configuration of an exhausted space to measure again, among those that do not run now. `None`
/// where it is clear enough which are the best, and where costs are exact.
pub(crate) fn next_of_race(
    results: &ResultTable,
    is_running: impl Fn(&Configuration) -> bool,
) -> Option<&Record> {
    let best = results.best()?;
    if results.is_exact() || results.ranked().len() < 2 {
        return None;
    }
    assert!(best.measurements > 0 && !best.infeasible, "the best was measured");
    let noise = results.noise().unwrap_or(FRAME_NOISE_PRIOR).clamp(NOISE_LEAST, NOISE_MAX);
    let is_open = |record: &&Record| {
        let parts = 1.0 / record.measurements as f64 + 1.0 / best.measurements as f64;
        let deviations = libm::log(record.mean_cost / best.mean_cost) / (noise * parts.sqrt());
        let is_near = record.measurements == 1 && record.mean_cost <= NEAR * best.mean_cost;
        record.measurements < ENOUGH
            && (is_near || deviations.is_nan() || deviations < CLEAR)
            && !is_running(&record.configuration)
    };
    results.ranked().filter(is_open).min_by_key(|record| record.measurements)
}
