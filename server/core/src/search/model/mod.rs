//! A model-based search for few, dear and noisy measurements of mixed, conditional spaces.
//!
//! The frame is that of Jones, Schonlau and Welch, "Efficient global optimization of expensive black-box
//! functions" (Journal of Global Optimization 13, 1998). A small design (`begin`) comes first. Then a
//! Gaussian process (`gp`) is fitted to all measurements, and the point of highest expected improvement is
//! measured next, again and again. The additions, with their sources:
//! - *Mixed, conditional spaces.* The model sees configurations, not points of the cube (see
//!   [`Layout`](crate::search::Layout)), and the improvement is climbed by changing one parameter at a time
//!   from the best known configurations, as in SMAC (Hutter, Hoos and Leyton-Brown, LION 5, 2011; Lindauer et
//!   al., JMLR 23, 2022).
//! - *Infeasible regions.* A second process predicts whether a point can be run at all; the expected
//!   improvement is multiplied by that probability, as in BaCO (Hellsten et al., ASPLOS 2024). A design is
//!   left early where most of it cannot be run.
//! - *Noise.* Improvement is counted against the model's best mean, not the luckiest sample, and uncertainty
//!   is that of the mean, without noise. A new best point is measured again before it is believed.
//! - *Precision.* Every other point comes from a separate model of the measurements around the best (see
//!   `local`), so that the search converges where the global model is too coarse.
//! - *Grids.* Without a continuous axis, every other point comes from a model with a quadratic trend, if the
//!   measurements support one: costs of kernels and trees are near products of powers of their parameters. A
//!   wrong trend misleads, so it needs evidence and gives only half of the points.
//! - *Doubt.* Where there are choices the model is too sure of itself: cliffs and interactions that it has
//!   not met make it keep to the surroundings of a poor default. There deviations count more at every other
//!   point, the longer no better point was found.
//! - *Trials that were stopped early.* They count as measured at the model's mean above the bound (Schmee and
//!   Hahn, "A simple method for regression analysis with censored data", Technometrics 21, 1979; for
//!   model-based search Hutter, Hoos and Leyton-Brown, 2011), and never as best.
//! - *Other states.* A [`MainEffects`] sums up the other states of the study. The search begins with its best
//!   point and the best of the others, and costs may depend on it linearly. Its weight is learnt like a
//!   length, and each parameter's part in it is weighed by the measurements here. While no better point is
//!   found, their further winners are tried now and then: no sum of effects shows values that pay only
//!   together. A few early points open branches of the space that they speak against (see `looks`).
//! - *Known errors.* A point whose client knows the standard error of its measurements counts for less than
//!   others, by its share in the variance.
//! - *Scale.* Costs are seen through a logarithm whose origin is chosen by likelihood (see `gp::warping`).
//! - *Cheaper levels.* Measurements there are inputs of the model of cost, and points may be measured there
//!   first (see `cheaper`).
//! - *Set-ups.* After a point with a new set-up a client that is alone measures some more that keep it (see
//!   `held`).
//! - *Several clients.* Pending points count as measured at their expected cost (the "kriging believer" of
//!   Ginsbourger, Le Riche and Carraro, 2010), and nearly without noise. With the noise of a measurement
//!   their surroundings would stay attractive, and several clients would measure almost one point.

mod acquire;
mod ahead;
mod begin;
mod cheaper;
mod cost;
mod doubt;
mod failure;
mod held;
mod local;
mod looks;

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use treewright_model::plain::is_default;

use crate::gp::{Hyperparameters, Prior};
use crate::randomness::{Purpose, stream};
use crate::search::pending::PendingPoints;
use crate::search::{Feedback, MainEffects, Point, Search, SearchSetup, SourceRun, Step, Verdict};
use crate::space::Space;
use acquire::Acquisition;
pub use ahead::PlannedPoint;
use cheaper::CheaperLevels;
use failure::RunElsewhere;
use local::Near;
use looks::Looks;

/// Steps of a canonical coordinate that are distinguished.
const GRID: f64 = (1u32 << 24) as f64;
/// Most points that a model is fitted to, and their number once there are more. A suggestion must take no
/// more than a few milliseconds, and the chosen points include the best.
const FITTED_MAX: usize = 96;
const FITTED_THEN: usize = 64;
const KEPT_MAX: usize = 512;
/// Weight of a pending point, in measurements.
const PENDING_COUNT: f64 = 20.0;
/// The prior of all models of the search, for few measurements in many dimensions.
const PRIOR: Prior = Prior { weight_range: [0.0, f64::INFINITY], ..Prior::WEAK };
/// Number of runnable points that suffice to leave a mostly infeasible design.
const FEASIBLE_ENOUGH: usize = 3;
/// The greatest share of repeats of the best among the measurements, and the most measurements of one point.
const REPEAT_SHARE: f64 = 0.04;
const REPEATS_MAX: f64 = 5.0;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct MeasuredPoint {
    /// Canonical coordinates, in steps of the grid.
    x: Vec<u32>,
    #[serde(rename = "found")]
    observed: Observed,
    /// The share of a usual measurement that each of its own does not count for.
    #[serde(default, skip_serializing_if = "is_default")]
    lacks: f64,
}

/// The measurements of a point, as observations of its cost.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Observed {
    /// Mean of `count` measurements.
    Cost {
        mean: f64,
        count: u32,
    },
    AtLeast(f64),
    Infeasible,
}

impl Observed {
    /// A bound counts as a cost; what cannot be run costs infinitely much.
    fn cost(self) -> f64 {
        match self {
            Observed::Cost { mean, .. } => mean,
            Observed::AtLeast(bound) => bound,
            Observed::Infeasible => f64::INFINITY,
        }
    }

    fn count(self) -> f64 {
        match self {
            Observed::Cost { count, .. } => f64::from(count),
            _ => 1.0,
        }
    }
}

/// The search. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelSearch {
    setup: SearchSetup,
    #[serde(rename = "flight")]
    pending: PendingPoints,
    /// Points of the initial design that were not asked yet.
    queue: VecDeque<Vec<f64>>,
    /// Good points of other states, which come before the design.
    #[serde(default, skip_serializing_if = "VecDeque::is_empty")]
    elsewhere: VecDeque<Vec<f64>>,
    /// Further winners of other states, canonical and in steps of the grid. They are tried while no better
    /// point is found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    winners: Vec<Vec<u32>>,
    #[serde(default, skip_serializing_if = "is_default")]
    looks: Looks,
    /// Configurations that ran and that failed in other states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    runs_elsewhere: Vec<RunElsewhere>,
    /// The default was not asked yet, because other points came before it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    default_is_due: bool,
    /// Whether the queue holds steps from the best so far, not places.
    #[serde(default)]
    queue_of_steps: bool,
    seen: Vec<MeasuredPoint>,
    /// Whether the last of these was measured elsewhere; only in a space with set-ups.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    last_is_heard: bool,
    cost: Hyperparameters,
    failure: Hyperparameters,
    /// The hyperparameters of the model with a trend, once it was fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    trended: Option<Hyperparameters>,
    /// Measurements at the last fit.
    fitted: u64,
    /// Measurements so far.
    told: u64,
    /// Random streams used so far.
    draws: u64,
    /// Replicates, and the sum of the squares of their relative deviations from the means before.
    scatter: (u64, f64),
    #[serde(default, skip_serializing_if = "is_default")]
    cheaper: CheaperLevels,
    /// The next point, where a copy has planned it. Not stored: it would be planned again.
    #[serde(skip)]
    planned: Option<PlannedPoint>,
    /// The reserve of that plan, for clients that ask while no fit is possible. Not stored either.
    #[serde(skip)]
    reserve: VecDeque<Proposed>,
}

/// A point, the step that proposes it, and the cheaper level at which it is to be measured, if at one.
type Proposed = (Vec<f64>, Step, Option<u32>);

/// A known configuration, in the form that the models use.
struct ModelledPoint {
    x: Vec<f64>,
    features: Vec<f64>,
    observed: Observed,
    /// The number of its measurements, in usual ones.
    count: f64,
}

impl ModelSearch {
    /// A fresh search: the default configuration, then a design.
    pub fn new(setup: SearchSetup) -> Self {
        let kinds = setup.layout.kinds();
        let mut search = ModelSearch {
            pending: PendingPoints::default(),
            queue: VecDeque::new(),
            elsewhere: VecDeque::new(),
            winners: Vec::new(),
            looks: Looks::default(),
            runs_elsewhere: Vec::new(),
            default_is_due: false,
            queue_of_steps: false,
            seen: Vec::new(),
            last_is_heard: false,
            cost: Hyperparameters::new(&kinds, &PRIOR),
            failure: Hyperparameters::new(&kinds, &PRIOR),
            trended: None,
            fitted: 0,
            told: 0,
            draws: 0,
            scatter: (0, 0.0),
            cheaper: CheaperLevels::default(),
            planned: None,
            reserve: VecDeque::new(),
            setup,
        };
        let random = &mut search.random();
        search.queue_of_steps = begin::takes_steps(&search.setup);
        search.queue = match search.queue_of_steps {
            true => begin::steps(&search.setup, random),
            false => begin::places(&search.setup, random),
        };
        search
    }

    fn random(&mut self) -> ChaCha8Rng {
        self.draws += 1;
        stream(self.setup.seed, Purpose::Search, self.setup.state_id, self.draws)
    }

    /// Makes a point pending at the place of its configuration, on the grid, so that its result can be
    /// matched to it. The default is not moved. A plan's level may be unknown to the client that asks.
    fn make_pending(&mut self, (mut x, step, level): Proposed) -> Point {
        self.setup.layout.canonical(&mut x);
        let grid = steps(&x);
        assert!(grid.iter().all(|&x| f64::from(x) <= GRID), "{grid:?} leaves the cube");
        let x = if grid == self.grid(&self.setup.start).0 {
            self.setup.start.clone()
        } else {
            coordinates(&grid)
        };
        self.pending.add_at(x, step, level.filter(|_| self.cheaper.is_open))
    }

    /// Canonical coordinates of a point in steps of the grid, and its features.
    fn grid(&self, x: &[f64]) -> (Vec<u32>, Vec<f64>) {
        let mut x = x.to_vec();
        let active = self.setup.layout.canonical(&mut x);
        let features = self.setup.layout.features(&x, &active);
        (steps(&x), features)
    }

    /// Whether a design would waste measurements: most of its points so far could not be run, but enough
    /// could to begin a model.
    fn is_mostly_infeasible(&self) -> bool {
        let failed = self.seen.iter().filter(|seen| seen.observed == Observed::Infeasible).count();
        2 * failed >= self.seen.len() && self.seen.len() - failed >= FEASIBLE_ENOUGH
    }

    /// A known configuration, in the form that the models use.
    fn place(&self, index: usize) -> ModelledPoint {
        let seen = &self.seen[index];
        let place = self.modelled(&seen.x, seen.observed);
        ModelledPoint { count: place.count * (1.0 - seen.lacks), ..place }
    }

    /// A result at a place of the grid, in that form.
    fn modelled(&self, x: &[u32], observed: Observed) -> ModelledPoint {
        let mut x = coordinates(x);
        let active = self.setup.layout.canonical(&mut x);
        let features = self.setup.layout.features(&x, &active);
        ModelledPoint { features, x, observed, count: observed.count() }
    }

    /// The points that the models are fitted to: all, or the best and the latest.
    fn chosen(&self) -> Vec<usize> {
        let n = self.seen.len();
        if n <= FITTED_MAX {
            return (0..n).collect();
        }
        let mut by_cost: Vec<usize> = (0..n).collect();
        by_cost.sort_by(|&a, &b| self.seen[a].observed.cost().total_cmp(&self.seen[b].observed.cost()));
        let mut chosen = vec![false; n];
        by_cost[..FITTED_THEN / 2].iter().for_each(|&index| chosen[index] = true);
        let mut left = FITTED_THEN - FITTED_THEN / 2;
        for index in (0..n).rev() {
            if left > 0 && !chosen[index] {
                chosen[index] = true;
                left -= 1;
            }
        }
        let chosen: Vec<usize> = (0..n).filter(|&index| chosen[index]).collect();
        assert_eq!(chosen.len(), FITTED_THEN, "the best and the latest of {n}");
        chosen
    }

    /// The next point by the models; `None` while there is nothing to model.
    fn propose(&mut self) -> Option<Proposed> {
        let chosen = self.chosen();
        let places: Vec<ModelledPoint> = chosen.iter().map(|&index| self.place(index)).collect();
        if places.is_empty() {
            return None;
        }
        let measured: Vec<&ModelledPoint> =
            places.iter().filter(|place| place.observed != Observed::Infeasible).collect();
        let cheaper = self.cheaper_points();
        let schedule = self.schedule(places.len());
        let fails_elsewhere = self.runs_elsewhere.iter().any(|run| run.failed);
        let has_failures = fails_elsewhere || measured.len() < places.len();
        let failure = if has_failures { self.failures(&places, &cheaper, schedule) } else { None };
        let mut hyper = self.cost.clone();
        let is_too_few = measured.len() + cheaper.len() < 2;
        let mut fit = if is_too_few { None } else { self.costs((&measured, &cheaper), &mut hyper, schedule) };
        self.cost = hyper;
        if let Some(again) = self.doubtful(&measured, fit.as_ref().map_or(0.0, |fit| fit.noise)) {
            return Some((again, Step::Replicate, None));
        }
        if let Some(winner) = fit.as_ref().and_then(|fit| self.next_winner(&fit.process)) {
            return Some((winner, Step::Elsewhere, None));
        }
        let mut known = cost::known(&measured, fit.as_ref().map(|fit| &fit.process));
        // Every other point comes from a closer look around the best or, on grids, from a model with a trend.
        let is_other = self.pending.added().is_multiple_of(2);
        let held = self.held();
        let near = match &fit {
            Some(fit) if is_other && held.is_empty() => {
                Near::of(&self.setup.layout, &measured, &known, &fit.process)
            }
            _ => None,
        };
        if is_other
            && near.is_none()
            && let Some(plain) = &fit
            && let Some(trended) = self.trended((&measured, &cheaper), plain.evidence, schedule)
        {
            known = cost::known(&measured, Some(&trended.process));
            fit = Some(trended);
        }
        let cost = fit.as_ref().map(|fit| &fit.process);
        known.extend(self.only_cheaper(&cheaper, cost));
        let mut random = self.random();
        let acquisition = Acquisition {
            layout: &self.setup.layout,
            cost,
            failure: failure.as_ref(),
            doubt: if is_other { 1.0 } else { 1.0 + self.doubt() },
        };
        let pending: Vec<Vec<u32>> = self.pending.points().map(|point| self.grid(&point.x).0).collect();
        let taken = |x: &[f64]| {
            let x = steps(x);
            pending.contains(&x) || self.seen.iter().any(|seen| seen.x == x)
        };
        let near = near.and_then(|near| {
            let places: Vec<Vec<f64>> = pending.iter().map(|x| coordinates(x)).collect();
            near.propose(&acquisition, &places, &mut random).filter(|x| !taken(x))
        });
        let (x, step) = match near {
            Some(x) => (x, Step::Local),
            None => (acquisition.best(&known, &held, &mut random, taken)?, Step::Model),
        };
        let level = cost.map_or_else(|| self.design_level(), |cost| self.level_for(&x, cost, &known));
        Some((x, step, level))
    }

    /// The best measured configuration, if rivals are so close that it may have been lucky. `noise` is the
    /// model's estimate of the relative deviation of a measurement. The model takes roughness of the cost
    /// surface for noise, so the evidence of replicates soon outweighs its estimate.
    fn doubtful(&self, measured: &[&ModelledPoint], noise: f64) -> Option<Vec<f64>> {
        assert!((0.0..=1.0).contains(&noise), "a relative deviation of {noise}");
        let (repeats, squares) = self.scatter;
        let deviation = ((squares + noise * noise) / (repeats as f64 + 1.0)).sqrt();
        let measured: Vec<_> =
            measured.iter().filter(|place| matches!(place.observed, Observed::Cost { .. })).collect();
        let leader = measured.iter().min_by(|a, b| a.observed.cost().total_cmp(&b.observed.cost()))?;
        let (least, count) = (leader.observed.cost(), leader.count);
        // A poor measurement may have been luckier.
        let reach = least.abs() * deviation / count.min(1.0).sqrt();
        let close = |place: &&&&ModelledPoint| place.observed.cost() - least <= reach;
        let rivals = measured.iter().filter(close).count() - 1;
        let grid = steps(&leader.x);
        let is_pending = self.pending.points().any(|point| self.grid(&point.x).0 == grid);
        let affordable = REPEAT_SHARE * self.told as f64 >= repeats as f64 + 1.0;
        (rivals > 0 && count < REPEATS_MAX && affordable && !is_pending && reach > 0.0)
            .then(|| leader.x.clone())
    }
}

/// A point rounded to the precision of the search.
pub(crate) fn on_grid(x: &[f64]) -> Vec<f64> {
    coordinates(&steps(x))
}

/// Coordinates by steps of the grid.
fn coordinates(steps: &[u32]) -> Vec<f64> {
    steps.iter().map(|&x| f64::from(x) / GRID).collect()
}

/// Canonical coordinates in steps of the grid.
fn steps(x: &[f64]) -> Vec<u32> {
    x.iter().map(|x| (x * GRID).round() as u32).collect()
}

impl Search for ModelSearch {
    fn ask(&mut self) -> Option<Point> {
        let planned = self.planned.take();
        // In full where the client that asks measures at no level.
        let is_open = self.cheaper.is_open;
        let resumed = if is_open { self.pending.resume() } else { self.pending.resume_in_full() };
        if resumed.is_some() {
            return resumed;
        }
        // The best point from elsewhere comes first, then the default, by which states are compared, then the
        // others.
        if self.pending.added() == 0
            && let Some(x) = self.elsewhere.pop_front()
        {
            self.default_is_due = true;
            return Some(self.make_pending((x, Step::Elsewhere, None)));
        }
        if self.pending.added() == 0 || std::mem::take(&mut self.default_is_due) {
            return Some(self.pending.add(self.setup.start.clone(), Step::Default));
        }
        if let Some(x) = self.next_look().or_else(|| self.next_from_elsewhere()) {
            return Some(self.make_pending((x, Step::Elsewhere, None)));
        }
        if self.is_mostly_infeasible() {
            self.queue.clear();
        }
        if let Some(level) = self.unseen_level() {
            let best = self.stepped(&vec![0.0; self.setup.dimension()], None);
            return Some(self.make_pending((best, Step::Coordinate, Some(level))));
        }
        if let Some(x) = self.queue.pop_front() {
            let level = self.design_level();
            let (x, step) = if self.queue_of_steps {
                (self.stepped(&x, level), Step::Coordinate)
            } else {
                (x, Step::LatinHypercube)
            };
            return Some(self.make_pending((x, step, level)));
        }
        let planned = planned.filter(|plan| self.is_good(plan));
        if let Some(proposed) = planned.map_or_else(|| self.propose(), |plan| plan.point) {
            return Some(self.make_pending(proposed));
        }
        let mut random = self.random();
        let x = acquire::anywhere(self.setup.dimension(), &mut random);
        Some(self.make_pending((x, Step::RandomSearch, None)))
    }

    fn tell(&mut self, id: u64, feedback: Feedback) {
        let Some(point) = self.pending.finish(id) else { return };
        let (x, _) = self.grid(&point.x);
        let known = self.seen.iter().position(|seen| seen.x == x);
        if point.step == Step::Replicate {
            self.scatter.0 += 1;
        }
        let observed = match feedback.verdict {
            Verdict::Cost(cost) => Observed::Cost { mean: cost, count: 1 },
            Verdict::AtLeast(bound) => Observed::AtLeast(bound),
            Verdict::Infeasible => Observed::Infeasible,
        };
        match known.map(|index| &mut self.seen[index].observed) {
            None => {
                self.seen.push(MeasuredPoint { x, observed, lacks: 0.0 });
                self.last_is_heard = point.step == Step::Restart && !self.setup.layout.setup.is_empty();
            }
            Some(_) if !feedback.fresh => return,
            Some(Observed::Cost { mean, count }) => {
                if let Observed::Cost { mean: cost, .. } = observed {
                    let before = f64::from(*count);
                    if *mean != 0.0 {
                        self.scatter.1 += (cost / *mean - 1.0).powi(2).min(1.0) * before / (before + 1.0);
                    }
                    *count += 1;
                    // Divided before they are subtracted: the difference of large costs may overflow.
                    *mean += cost / f64::from(*count) - *mean / f64::from(*count);
                }
            }
            Some(old) => *old = observed,
        }
        self.told += 1;
        self.cheaper.spent = 0.0;
        self.test_elsewhere();
        if self.seen.len() > KEPT_MAX {
            let worst = (0..self.seen.len() / 2)
                .max_by(|&a, &b| self.seen[a].observed.cost().total_cmp(&self.seen[b].observed.cost()));
            worst.map(|index| self.seen.remove(index));
        }
    }

    fn withdraw(&mut self, id: u64) {
        self.pending.withdraw(id);
    }

    fn open_levels(&mut self, shares: &[f64]) {
        self.open(shares);
    }

    fn level_of(&self, id: u64) -> Option<u32> {
        self.pending.points().find(|point| point.id == id)?.level
    }

    fn tell_cheaper(&mut self, id: u64, verdict: Option<Verdict>) {
        self.take_cheaper(id, verdict);
    }

    fn repeats(&self) -> u64 {
        self.scatter.0
    }

    fn set_space(&mut self, space: &Space) {
        self.setup.layout.set_space(space);
    }

    /// It then goes on without a design.
    fn know(&mut self, x: Vec<f64>, verdict: Verdict) {
        self.hear(x, verdict);
        self.queue.clear();
    }

    /// The rest of the initial design is still asked.
    fn hear(&mut self, x: Vec<f64>, verdict: Verdict) {
        let is_begun = self.pending.added() > 0 && !self.default_is_due;
        let point = self.make_pending((x, Step::Restart, None));
        self.tell(point.id, Feedback { verdict, fresh: true });
        self.default_is_due = !is_begun && self.default_seen().is_none();
    }

    fn weigh(&mut self, x: &[f64], weight: f64) {
        assert!(weight > 0.0 && weight <= 1.0, "a weight of {weight}");
        let (x, _) = self.grid(x);
        if let Some(seen) = self.seen.iter_mut().find(|seen| seen.x == x) {
            seen.lacks = 1.0 - weight;
        }
    }

    fn hears_others() -> bool {
        true
    }

    fn follow(
        &mut self,
        main_effects: MainEffects,
        first: Vec<Vec<f64>>,
        winners: Vec<Vec<f64>>,
        runs: Vec<SourceRun>,
    ) {
        self.setup.layout.main_effects = Some(main_effects);
        self.begin_models();
        self.elsewhere = first.into();
        self.winners = winners.iter().map(|x| self.grid(x).0).collect();
        let run = |run: &SourceRun| RunElsewhere { x: self.grid(&run.x).0, failed: run.failed };
        self.runs_elsewhere = runs.iter().map(run).collect();
    }

    fn look_at(&mut self, looks: Vec<Vec<f64>>) {
        self.looks.left = looks;
    }

    /// The next point is at hand: a withdrawn one, one of the design, or a planned one.
    fn is_ready(&self) -> bool {
        let begins = self.pending.added() == 0 || self.default_is_due || self.pending.has_withdrawn();
        let looks = self.due_look().is_some();
        let designs = self.believes_others() || !self.queue.is_empty() && !self.is_mostly_infeasible();
        let probes = self.unseen_level().is_some();
        begins || looks || designs || probes || self.planned.as_ref().is_some_and(|plan| self.is_good(plan))
    }

    fn ask_at_once(&mut self) -> Option<Point> {
        if self.is_ready() {
            return self.ask();
        }
        let next = self.next_at_once();
        Some(self.make_pending(next))
    }

    fn plan(&self, reserve: usize) -> Option<PlannedPoint> {
        let copy = ModelSearch { planned: None, reserve: VecDeque::new(), ..self.clone() };
        Some(PlannedPoint::of(copy, reserve))
    }

    fn adopt(&mut self, plan: PlannedPoint) {
        self.take_over(plan);
    }
}
