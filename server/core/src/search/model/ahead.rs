//! The next point of a model-based search, planned on a copy of it.
//!
//! Fitting the models takes a thousand times as long as all other steps of a search. A copy can do it while
//! the search itself receives results. The point is used unless another client has measured it meanwhile.

use rand::RngExt;

use crate::gp::Hyperparameters;
use crate::gp::local_search::Neighbourhood;
use crate::search::Step;
use crate::search::model::{MeasuredPoint, ModelSearch, Proposed, acquire, coordinates, steps};

/// A guess is near one of the best points: their number, the mean number of changed parameters, and the
/// greatest change as a share of an axis.
const GUESSED_NEAR: usize = 4;
const GUESSED_CHANGES: f64 = 2.0;
const GUESSED_RADIUS: f64 = 0.2;

/// A point by the models, and the state of the models after the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedPoint {
    /// The point to measure, and why; `None` where there is nothing to model.
    pub(super) point: Option<Proposed>,
    /// More points, chosen as if those before were pending, for clients that ask while no fit is possible.
    reserve: Vec<Proposed>,
    cost: Hyperparameters,
    failure: Hyperparameters,
    trended: Option<Hyperparameters>,
    fitted: u64,
    draws: u64,
}

impl PlannedPoint {
    /// Computes the next point of a search, which is a copy because its models move, and `reserve` more. The
    /// search takes over only the state after the first point, so that it goes on as without a reserve.
    pub(super) fn of(mut search: ModelSearch, reserve: usize) -> PlannedPoint {
        search.leave_doubted();
        let point = search.propose();
        let ModelSearch { cost, failure, trended, fitted, draws, .. } = search.clone();
        let mut more = Vec::new();
        let mut last = point.clone();
        while more.len() < reserve
            && let Some(proposed) = last
        {
            search.make_pending(proposed);
            last = search.propose();
            more.extend(last.clone());
        }
        PlannedPoint { point, reserve: more, cost, failure, trended, fitted, draws }
    }
}

impl ModelSearch {
    /// Takes over the plan of a copy. A plan with fewer measurements than the last fit, or with other
    /// features (new levels), is ignored.
    pub(super) fn take_over(&mut self, plan: PlannedPoint) {
        if plan.fitted < self.fitted || !plan.cost.fits(self.setup.layout.kinds().len()) {
            return;
        }
        self.cost = plan.cost.clone();
        self.failure = plan.failure.clone();
        self.trended = plan.trended.clone();
        self.fitted = plan.fitted;
        self.draws = self.draws.max(plan.draws);
        assert!(self.draws >= plan.draws, "streams are used once");
        if !plan.reserve.is_empty() {
            self.reserve = plan.reserve.iter().cloned().collect();
        }
        self.planned = Some(plan);
    }

    /// Whether the planned point is still worth a measurement.
    pub(super) fn is_good(&self, plan: &PlannedPoint) -> bool {
        plan.point.as_ref().is_none_or(|(x, step, _)| self.is_worth(x, *step))
    }

    /// Whether a point was not measured meanwhile, and is not pending.
    pub(super) fn is_worth(&self, x: &[f64], step: Step) -> bool {
        let grid = steps(x);
        let is_pending = self.pending.points().any(|point| self.grid(&point.x).0 == grid);
        !is_pending && (step == Step::Replicate || self.seen.iter().all(|seen| seen.x != grid))
    }

    /// The next of the reserve that is still of use, else a guess near one of the best.
    pub(super) fn next_at_once(&mut self) -> Proposed {
        while let Some((x, step, level)) = self.reserve.pop_front() {
            if step != Step::Replicate && self.is_worth(&x, step) {
                return (x, step, level);
            }
        }
        let mut random = self.random();
        let mut best: Vec<&MeasuredPoint> =
            self.seen.iter().filter(|seen| seen.observed.cost().is_finite()).collect();
        best.sort_by(|a, b| a.observed.cost().total_cmp(&b.observed.cost()));
        best.truncate(GUESSED_NEAR);
        let dimension = self.setup.dimension();
        let x = match best.len() {
            0 => acquire::anywhere(dimension, &mut random),
            count => {
                let near = best[random.random_range(0..count)];
                let mut x = coordinates(&near.x);
                let always = random.random_range(0..dimension);
                for (axis, x) in x.iter_mut().enumerate() {
                    if axis == always || random.random::<f64>() * (dimension as f64) < GUESSED_CHANGES {
                        *x = self.setup.layout.moved(axis, *x, GUESSED_RADIUS, &mut random);
                    }
                }
                x
            }
        };
        (x, Step::RandomSearch, None)
    }
}
