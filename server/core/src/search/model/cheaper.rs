//! Cheaper levels as an input of the models.
//!
//! A cost at a cheaper level is an observation of the process of full costs, some way apart from full
//! measurements. Each level is a feature, and its weight is learnt like a length. So the covariance of a
//! level with full measurements is a factor between 0 and 1, which falls where the two disagree. A level has
//! an offset of its own in the logarithm of the cost, from the configurations that ran at both, corrected by
//! generalised least squares in the fit. Its measurements count for less than full ones.
//!
//! The next configuration is the one of highest expected improvement in full. It is measured at the level of
//! most value for its cost, as in Huang, Allen, Notz and Miller, "Sequential kriging optimization using
//! multiple-fidelity evaluations" (Structural and Multidisciplinary Optimization 32, 2006). The value of a
//! full measurement is its expected improvement. That of a cheaper one is the expected gain by knowing better
//! which configuration is best, as in the knowledge gradient (Frazier, Powell and Dayanik, INFORMS Journal on
//! Computing 21, 2009). A level that says nothing of full costs moves no belief, and is of no value.
//!
//! The best so far, at first the default, runs at each level first. Then the rest of the design runs at the
//! cheapest.

use serde::{Deserialize, Serialize};

use super::acquire::EstimatedPoint;
use super::{FITTED_THEN, ModelSearch, ModelledPoint, Observed, coordinates, steps};
use crate::gp::acquisition::log_expected_improvement;
use crate::gp::{Posterior, Process};
use crate::limits::{CHEAPER_RUNS_MAX, REWARD_COST_MIN};
use crate::search::{Feedback, Search, Verdict};

/// The most that is spent at cheaper levels between two full measurements, in full ones. It bounds the loss
/// by a level that says nothing, until that is known. The design, which runs at the cheapest level as a
/// whole, may spend more.
const SPENT_MAX: f64 = 1.0;

/// The knowledge of cheaper levels. The default knows of none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct CheaperLevels {
    /// The cost of a measurement at each level, as a share of a full one.
    pub(super) shares: Vec<f64>,
    /// Whether the client that asks measures at them.
    pub(super) is_open: bool,
    /// The cost of all measurements there since the last full one, in full ones.
    pub(super) spent: f64,
    pub(super) runs: Vec<CheaperRun>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CheaperRun {
    /// Canonical coordinates, in steps of the grid.
    x: Vec<u32>,
    level: u32,
    /// `None` where it was not measured to its end.
    cost: Option<f64>,
}

/// A measurement at a cheaper level, in the form that the models use: as a cost in full, features too.
pub(super) struct CheaperPoint {
    pub(super) place: ModelledPoint,
    pub(super) level: usize,
    /// Its weight, in full measurements.
    pub(super) count: f64,
}

impl ModelSearch {
    /// Takes over the levels at which the client that asks measures; none where there are none.
    pub(super) fn open(&mut self, shares: &[f64]) {
        self.cheaper.is_open = !shares.is_empty();
        if self.cheaper.is_open && self.cheaper.shares != shares {
            assert!(shares.iter().all(|share| *share > 0.0 && *share < 1.0), "shares of {shares:?}");
            self.cheaper.shares = shares.to_vec();
            self.cheaper.runs.clear();
            self.setup.layout.cheaper = shares.len();
            self.begin_models();
        }
    }

    /// The next level at which nothing was measured yet. The best so far is: it ties the level to full costs.
    pub(super) fn unseen_level(&self) -> Option<u32> {
        let has_cost = || self.seen.iter().any(|seen| matches!(seen.observed, Observed::Cost { .. }));
        let is_seen = |level: u32| {
            self.cheaper.runs.iter().any(|run| run.level == level)
                || self.pending.points().any(|point| point.level == Some(level))
        };
        let unseen =
            (0..).zip(&self.cheaper.shares).map(|(level, _)| level).find(|level| !is_seen(*level))?;
        (self.cheaper.is_open && has_cost()).then_some(unseen)
    }

    /// The level of the design: the cheapest that is of use.
    pub(super) fn design_level(&self) -> Option<u32> {
        (self.cheaper.is_open && self.offset(0).is_some()).then_some(0)
    }

    /// The best so far, or the default, a step further; the other way where the cube ends. The best is that
    /// of a level, if anything was measured there.
    pub(super) fn stepped(&self, step: &[f64], level: Option<u32>) -> Vec<f64> {
        let of_level = self.cheaper.runs.iter().filter(|run| Some(run.level) == level);
        let of_level = of_level.filter_map(|run| Some((run.cost?, &run.x)));
        let in_full = self.seen.iter().filter(|seen| matches!(seen.observed, Observed::Cost { .. }));
        let in_full = in_full.map(|seen| (seen.observed.cost(), &seen.x));
        let best = of_level.min_by(|a, b| a.0.total_cmp(&b.0));
        let best = best.or_else(|| in_full.min_by(|a, b| a.0.total_cmp(&b.0)));
        let from = best.map_or_else(|| self.setup.start.clone(), |(_, x)| coordinates(x));
        let to = |(x, step): (f64, f64)| if (0.0..=1.0).contains(&(x + step)) { x + step } else { x - step };
        from.into_iter().zip(step.iter().copied()).map(to).collect()
    }

    /// The mean logarithm of the ratio of a full cost to that at a level; `None` where nothing ran at both.
    fn offset(&self, level: u32) -> Option<f64> {
        let log = |cost: f64| libm::log(cost.max(REWARD_COST_MIN));
        let ratio = |run: &CheaperRun| {
            let seen = self.seen.iter().find(|seen| seen.x == run.x)?;
            match (seen.observed, run.cost) {
                (Observed::Cost { mean, .. }, Some(cost)) => Some(log(mean) - log(cost)),
                _ => None,
            }
        };
        let ratios = self.cheaper.runs.iter().filter(|run| run.level == level).filter_map(ratio);
        let (sum, count) = ratios.fold((0.0, 0.0), |(sum, count), ratio| (sum + ratio, count + 1.0));
        (count > 0.0).then_some(sum / count)
    }

    /// The latest measurements at levels that are tied to full costs.
    pub(super) fn cheaper_points(&self) -> Vec<CheaperPoint> {
        let offsets: Vec<Option<f64>> =
            (0..).zip(&self.cheaper.shares).map(|(level, _)| self.offset(level)).collect();
        let point = |run: &CheaperRun| {
            let level = run.level as usize;
            let mean = (run.cost? * libm::exp(offsets[level]?)).min(f64::MAX);
            let place = self.modelled(&run.x, Observed::Cost { mean, count: 1 });
            // Between one that scatters like a full one and one that is that much shorter.
            Some(CheaperPoint { place, level, count: self.cheaper.shares[level].sqrt() })
        };
        let mut points: Vec<CheaperPoint> =
            self.cheaper.runs.iter().rev().filter_map(point).take(FITTED_THEN).collect();
        points.reverse();
        points
    }

    /// The configurations that ran at cheaper levels only, as a model of cost sees them in full.
    pub(super) fn only_cheaper(
        &self,
        points: &[CheaperPoint],
        cost: Option<&Process>,
    ) -> Vec<EstimatedPoint> {
        let in_full = |place: &ModelledPoint| {
            let grid = steps(&place.x);
            self.seen.iter().any(|seen| seen.x == grid)
        };
        let only = points.iter().map(|point| &point.place).filter(|place| !in_full(place));
        let believed = |place: &ModelledPoint| cost.map_or(0.0, |cost| cost.predict(&place.features).mean);
        let points = only.map(|place| (place.x.clone(), believed(place)));
        points.map(|(x, believed)| EstimatedPoint { x, believed, in_full: false }).collect()
    }

    /// The level at which a point is worth most for its cost; `None` for in full. `known` are all
    /// configurations that ran.
    pub(super) fn level_for(&self, x: &[f64], cost: &Process, known: &[EstimatedPoint]) -> Option<u32> {
        let CheaperLevels { shares, is_open, spent, runs } = &self.cheaper;
        let least = |only_full: bool| {
            let known = known.iter().filter(|known| known.in_full || !only_full);
            known.map(|known| known.believed).fold(f64::INFINITY, f64::min)
        };
        let best = least(true);
        if !is_open || !best.is_finite() {
            return None;
        }
        let features = self.setup.layout.features(x, &self.setup.layout.active(x));
        let (grid, belief) = (steps(x), cost.predict(&features));
        // What is believed to be the best is not known to be until it ran in full.
        let apart = (least(false) - belief.mean).abs();
        let (mut level, mut value) = (None, log_expected_improvement(best, belief));
        for (place, share) in (0..).zip(shares) {
            let has_run = runs.iter().any(|run| run.level == place && run.x == grid);
            if has_run || spent + share > SPENT_MAX || self.offset(place).is_none() {
                continue;
            }
            let there = self.setup.layout.at_cheaper(place as usize, &features);
            let deviation = cost.moved_by(&features, &there, share.sqrt());
            if deviation > 0.0 {
                let moved = Posterior { mean: 0.0, deviation };
                let worth = log_expected_improvement(-apart, moved) - libm::log(*share);
                if worth > value {
                    (level, value) = (Some(place), worth);
                }
            }
        }
        level
    }

    /// Takes the result of a point at its level. What cannot run there cannot run. A point without a level,
    /// as earlier versions stored it, is asked again.
    pub(super) fn take_cheaper(&mut self, id: u64, verdict: Option<Verdict>) {
        let Some(point) = self.pending.points().find(|point| point.id == id) else { return };
        let Some(level) = point.level else {
            self.pending.withdraw(id);
            return;
        };
        let x = self.grid(&point.x).0;
        let share = self.cheaper.shares.get(level as usize).copied().unwrap_or_default();
        let spent = self.cheaper.spent + share;
        let is_known = self.seen.iter().any(|seen| seen.x == x);
        let cost = match verdict {
            Some(Verdict::Cost(cost)) => Some(cost),
            _ => None,
        };
        if self.cheaper.runs.len() >= CHEAPER_RUNS_MAX {
            self.cheaper.runs.remove(0);
        }
        self.cheaper.runs.push(CheaperRun { x, level, cost });
        match verdict {
            Some(Verdict::Infeasible) => {
                self.tell(id, Feedback { verdict: Verdict::Infeasible, fresh: true })
            }
            None if !is_known => self.pending.withdraw_in_full(id),
            _ => {
                self.pending.finish(id);
            }
        }
        self.cheaper.spent = spent;
    }
}

#[cfg(test)]
mod tests {
    use super::super::PlannedPoint;
    use super::*;
    use crate::search::{Point, SearchSetup, Step};

    const SHARES: [f64; 2] = [0.1, 0.4];

    fn search() -> ModelSearch {
        ModelSearch::new(SearchSetup::plain(3, vec![0.5; 4], 40, Vec::new()))
    }

    fn ask(search: &mut ModelSearch) -> Point {
        search.open_levels(&SHARES);
        search.ask().expect("nothing is out")
    }

    /// Measures `steps` points. A level agrees with full costs but for its share.
    fn walk(search: &mut ModelSearch, steps: usize) -> Vec<Point> {
        let one = |_| {
            let point = ask(search);
            let cost = 1.0 + point.x.iter().map(|x| (x - 0.3).powi(2)).sum::<f64>();
            match point.level {
                Some(level) => {
                    let verdict = Verdict::Cost(SHARES[level as usize] * cost);
                    search.tell_cheaper(point.id, Some(verdict));
                }
                None => search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true }),
            }
            point
        };
        (0..steps).map(one).collect()
    }

    #[test]
    fn the_default_runs_at_every_level_and_the_design_at_the_cheapest() {
        let mut search = search();
        let points = walk(&mut search, 7);
        let levels: Vec<Option<u32>> = points.iter().map(|point| point.level).collect();
        assert_eq!(levels, [None, Some(0), Some(1), Some(0), Some(0), Some(0), Some(0)]);
        assert_eq!((&points[1].x, &points[2].x), (&points[0].x, &points[0].x));
        let offset = search.offset(1).expect("the default ran at both");
        assert!((offset + libm::log(0.4)).abs() < 1e-12, "{offset}");
        assert_eq!((search.told, search.cheaper.runs.len()), (1, 6));
        assert!((search.cheaper.spent - 0.9).abs() < 1e-12, "{}", search.cheaper.spent);
    }

    #[test]
    fn a_full_trial_comes_before_more_is_spent_than_one() {
        let mut search = search();
        let mut spent = 0.0;
        for point in walk(&mut search, 40) {
            spent = point.level.map_or(0.0, |level| spent + SHARES[level as usize]);
            assert!(spent < SPENT_MAX + 1e-9, "{spent} at cheaper levels");
        }
        assert!(search.cheaper.runs.len() > 6, "more than the design");
        assert!(search.told > 1, "full trials");
    }

    #[test]
    fn a_search_with_levels_that_is_stored_or_planned_for_goes_on() {
        let mut search = search();
        for steps in [0, 2, 6, 4] {
            walk(&mut search, steps);
            let text = serde_json::to_string(&search).expect("plain data");
            let mut copy: ModelSearch = serde_json::from_str(&text).expect("own output");
            assert_eq!(copy, search);
            if !search.is_ready() {
                let plan = search.plan(0).expect("a model to fit");
                copy.adopt(plan);
            }
            assert_eq!(walk(&mut copy, 3), walk(&mut search, 3));
        }
    }

    #[test]
    fn what_cannot_run_is_no_more_asked_and_what_failed_is_asked_in_full() {
        let mut search = search();
        walk(&mut search, 3);
        let (crashes, fails) = (ask(&mut search), ask(&mut search));
        assert_eq!((crashes.level, fails.level), (Some(0), Some(0)));
        search.tell_cheaper(crashes.id, Some(Verdict::Infeasible));
        search.tell_cheaper(fails.id, None);
        let again = ask(&mut search);
        assert_eq!((again.id, again.level), (fails.id, None));
        let crashed = search.grid(&crashes.x).0;
        let seen = search.seen.iter().find(|seen| seen.x == crashed);
        assert_eq!(seen.map(|seen| seen.observed), Some(Observed::Infeasible));
        assert_eq!(search.design_level(), Some(0), "the level is still of use");
    }

    #[test]
    fn a_point_at_a_level_is_in_full_for_a_client_without_levels() {
        let mut search = search();
        walk(&mut search, 1);
        let cheap = ask(&mut search);
        search.withdraw(cheap.id);
        search.open_levels(&[]);
        let again = search.ask().expect("the withdrawn one");
        assert_eq!((cheap.level, again.id, again.level), (Some(0), cheap.id, None));
        search.tell(again.id, Feedback { verdict: Verdict::Cost(1.16), fresh: false });
        walk(&mut search, 7);
        let at_level = |plan: &PlannedPoint| plan.point.as_ref().is_some_and(|(_, _, level)| level.is_some());
        let plan = (0..40).find_map(|_| {
            search.open_levels(&SHARES);
            let plan = search.plan(0).filter(at_level);
            if plan.is_none() {
                walk(&mut search, 1);
            }
            plan
        });
        search.open_levels(&[]);
        search.adopt(plan.expect("a point at a level"));
        assert_eq!(search.ask().expect("the planned one").level, None);
    }

    #[test]
    fn a_client_without_levels_measures_in_full() {
        let (mut knows, mut plain) = (search(), search());
        for _ in 0..12 {
            knows.open_levels(&[]);
            let (point, other) = (knows.ask().expect("one"), plain.ask().expect("one"));
            assert_eq!((&point, point.level), (&other, None));
            let verdict = Verdict::Cost(1.0 + point.x[0]);
            knows.tell(point.id, Feedback { verdict, fresh: true });
            plain.tell(point.id, Feedback { verdict, fresh: true });
        }
        assert_eq!(knows, plain);
        knows.open_levels(&SHARES);
        let point = knows.ask().expect("one");
        assert_eq!((point.step, point.level), (Step::Coordinate, Some(0)), "the best so far");
    }
}
