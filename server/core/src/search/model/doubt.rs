//! Doubt of the model, which grows while no better point is found.

use super::{ModelSearch, coordinates};
use crate::gp::Process;
use crate::search::Step;

/// Where there are choices, deviations count more at every other point: once more per `DOUBT_EVERY`
/// configurations without a new best, and at most `DOUBT_MAX` times more.
const DOUBT_EVERY: f64 = 8.0;
const DOUBT_MAX: f64 = 2.0;
/// A further winner of other states runs whenever this number of configurations brought no better one.
const WINNER_EVERY: usize = 8;

impl ModelSearch {
    /// The number of configurations since the best was found.
    fn since_best(&self) -> usize {
        let newest_first = self.seen.iter().rev().enumerate();
        // Among equals the oldest counts.
        let best = newest_first.rev().min_by(|a, b| a.1.observed.cost().total_cmp(&b.1.observed.cost()));
        best.map_or(0, |(since, _)| since)
    }

    /// The factor on the model's deviations, which grows with the time since the best was found.
    pub(super) fn doubt(&self) -> f64 {
        let has_choices = (0..self.setup.dimension()).any(|axis| self.setup.layout.cells(axis) > 0);
        let since = self.since_best() as f64;
        if has_choices { (since / DOUBT_EVERY).min(DOUBT_MAX) } else { 0.0 }
    }

    /// The most promising winner of other states that was not measured here, where one is due.
    pub(super) fn next_winner(&self, cost: &Process) -> Option<Vec<f64>> {
        let since = self.since_best();
        let runs = self.pending.points().any(|point| point.step == Step::Elsewhere);
        if since == 0 || !since.is_multiple_of(WINNER_EVERY) || runs {
            return None;
        }
        let layout = &self.setup.layout;
        let expected = |x: &[f64]| cost.predict(&layout.features(x, &layout.active(x))).mean;
        let left = self.winners.iter().map(|winner| coordinates(winner));
        let left = left.filter(|x| self.is_worth(x, Step::Elsewhere)).map(|x| (expected(&x), x));
        left.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, x)| x)
    }
}
