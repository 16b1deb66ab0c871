//! The next point of a model-based search, planned on a copy of it.
//!
//! Fitting the models takes a thousand times as long as all else that a search does. A copy can do it while the search
//! itself is told of other points. What it found is used unless somebody has measured that point meanwhile.

use crate::gp::Hyperparameters;
use crate::search::Step;
use crate::search::model::{ModelSearch, steps};

/// A point by the models, and what fitting them taught.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedPoint {
    /// Where to measure and why; `None` where there is nothing to model.
    pub(super) point: Option<(Vec<f64>, Step)>,
    cost: Hyperparameters,
    failure: Hyperparameters,
    trended: Option<Hyperparameters>,
    fitted: u64,
    draws: u64,
}

impl PlannedPoint {
    /// Thinks of the next point of a search, which is a copy: the models move in it.
    pub(super) fn of(mut search: ModelSearch) -> PlannedPoint {
        let point = search.propose();
        let ModelSearch { cost, failure, trended, fitted, draws, .. } = search;
        PlannedPoint { point, cost, failure, trended, fitted, draws }
    }
}

impl ModelSearch {
    /// Whether the next point is at hand: what came back, the design, or a plan that was taken over.
    pub(super) fn has_next(&self) -> bool {
        let begins = self.pending.added() == 0 || self.pending.has_withdrawn();
        let designs = self.believes_others() || !self.queue.is_empty() && !self.is_mostly_infeasible();
        begins || designs || self.planned.as_ref().is_some_and(|plan| self.is_good(plan))
    }

    /// Takes over what a copy has found. A plan that rests on fewer measurements than the last fit is passed over.
    pub(super) fn take_over(&mut self, plan: PlannedPoint) {
        if plan.fitted < self.fitted {
            return;
        }
        self.cost = plan.cost.clone();
        self.failure = plan.failure.clone();
        self.trended = plan.trended.clone();
        self.fitted = plan.fitted;
        self.draws = self.draws.max(plan.draws);
        self.planned = Some(plan);
    }

    /// Whether the planned point is still worth a measurement.
    pub(super) fn is_good(&self, plan: &PlannedPoint) -> bool {
        let Some((x, step)) = &plan.point else {
            return true;
        };
        let grid = steps(x);
        let is_pending = self.pending.points().any(|point| self.grid(&point.x).0 == grid);
        !is_pending && (*step == Step::Replicate || self.seen.iter().all(|seen| seen.x != grid))
    }
}
