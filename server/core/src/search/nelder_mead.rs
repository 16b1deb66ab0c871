//! A stochastic Nelder-Mead simplex search after Chang.
//!
//! Sources. Chang, "Stochastic Nelder-Mead simplex method: a new globally convergent direct search method
//! for simulation optimization", European Journal of Operational Research 220, 2012, gives the frame: a
//! Latin hypercube start, the moves of Nelder and Mead ("A simplex method for function minimization", The
//! Computer Journal 7(4), 1965), and an adaptive random search, local and global, in the place of the
//! shrink step, which under noise throws good vertices away. The paper (section 6) explores with a variant
//! of it.
//!
//! Where this differs from Chang, and why:
//! - *Sample size.* Chang measures each point more often as the search proceeds, which is what makes the
//!   method converge under noise. Here a result stands for as many measurements as the policy's `replicates`
//!   asks for, from the first point to the last; the search itself never asks twice. That suits budgets of
//!   about 80 frames with a noise of a few percent; raise `replicates` for noisier metrics.
//! - *Budget.* The initial design takes about a quarter of the budget, so that high dimensions leave
//!   measurements for the moves; the simplex has fewer than `dimension + 1` vertices then and searches the
//!   subspace they span, while the random search still reaches everything.
//! - *Plateaus.* Points are rounded to configurations outside of the search. When answers stop being fresh
//!   the random search takes longer and longer steps; when the simplex has collapsed (no extent, or equal
//!   scores everywhere) a new one is spread around the best point.
//!
//! - *Choices.* A simplex hardly ever changes a switch or a choice between few values, and those often matter
//!   most. Where the setup names such axes, the design is followed by one round of switches: from the best
//!   point each other value of each choice is tried once, the most promising by the design first, and a gain
//!   becomes the point to switch from. From then on the simplex spans the other axes only, and a move takes
//!   its value of each choice from one of the best measurements, drawn at random: a value that only looked
//!   good once is soon outnumbered among them, where copying the single best would keep its luck for ever.
//!   A design point that shares its score with another lies on a plateau, such as a switch that makes the
//!   other parameters meaningless. No single switch leads on from there, so the round does not begin there.
//!
//! Only comparisons of scores are used, so that the points do not change when all costs are multiplied by
//! one number. Infeasible points are worse than all others, and move out of the simplex first.

use std::collections::VecDeque;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::randomness::{Purpose, stream};
use crate::search::latin_hypercube::design;
use crate::search::pending::PendingPoints;
use crate::search::{Feedback, Point, Score, Search, SearchSetup, Step, Verdict};

/// How far the moves go, in distances of the worst vertex from the centroid: the values of Nelder and Mead.
/// Values that shrink with the dimension (Gao and Han, Computational Optimization and Applications 51, 2012)
/// need more than 80 measurements to pay off: on a noisy bowl in 11 dimensions they ended 2.6 times further
/// from the optimum.
const REFLECTION: f64 = 1.0;
const EXPANSION: f64 = 2.0;
const CONTRACTION: f64 = 0.5;
/// Most vertices. A larger simplex needs more measurements to turn round than any budget has, and its
/// coordinates are stored with every answer.
const VERTICES_MAX: usize = 33;
/// A simplex whose vertices all lie within this of the best one, on every axis, has collapsed.
const EXTENT_MIN: f64 = 1e-3;
/// Number of answers in a row without news after which a random step ends the simplex moves.
const STALE_MAX: u32 = 2;
/// Half the width of the box in which a new simplex is spread around the best point, by restart.
const RESTART_RADII: [f64; 3] = [0.25, 0.12, 0.5];
/// Half the width of the box of local random steps: at first, least, most.
const RADIUS_START: f64 = 0.25;
const RADIUS_MIN: f64 = 0.02;
const RADIUS_MAX: f64 = 0.5;
/// Probability of a global random step while answers are fresh.
const GLOBAL_PROBABILITY: f64 = 0.15;
/// Probability that a local step draws a coordinate it changes from the whole axis, so that switches and
/// choices, whose values are far apart in the cube, can change too.
const AXIS_PROBABILITY: f64 = 0.2;

/// Number of best measurements from which moves take their choices.
const ELITE_MAX: usize = 8;

/// A measured point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SimplexVertex {
    x: Vec<f64>,
    score: Score,
}

/// The phase of the search, with the points to measure or being measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SimplexPhase {
    /// Points of a design; they do not depend on each other and may be out together.
    Design { queue: VecDeque<(Vec<f64>, Step)> },
    /// The best point with another value of one choice.
    Switch,
    /// The worst vertex mirrored at the centroid of the others.
    Reflect,
    /// The reflection was the best so far: twice as far.
    Expand { reflected: SimplexVertex },
    /// The reflection was no gain: between the centroid and the better of worst and reflected vertex.
    Contract { reflected: SimplexVertex },
    /// The contraction was no gain either: a random point.
    Random,
}

/// The level of a choice that the coordinate `x` stands for.
fn level_at(x: f64, levels: u32) -> u32 {
    ((x * f64::from(levels)) as u32).min(levels - 1)
}

/// The search. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NelderMead {
    setup: SearchSetup,
    #[serde(rename = "flight")]
    pending: PendingPoints,
    phase: SimplexPhase,
    /// Best first.
    simplex: Vec<SimplexVertex>,
    /// Half the width of the box of the next local random step.
    radius: f64,
    /// Answers in a row that taught nothing.
    stale: u32,
    restarts: u32,
    /// Switches that are still to be tried, as axis and level: the most promising last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    switches: Vec<(usize, u32)>,
    /// The best measured points so far, best first. Empty where there are no choices.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    elite: Vec<SimplexVertex>,
    /// Random streams used so far.
    draws: u64,
}

impl NelderMead {
    /// A fresh search: the default configuration, then a Latin hypercube (Chang's initialisation), sized
    /// to about a quarter of the budget, within once the vertices of the simplex and twice those that it
    /// would have if it spanned the choices too.
    pub fn new(setup: SearchSetup) -> Self {
        let mut search = NelderMead {
            pending: PendingPoints::default(),
            phase: SimplexPhase::Reflect,
            simplex: Vec::new(),
            radius: RADIUS_START,
            stale: 0,
            restarts: 0,
            switches: Vec::new(),
            elite: Vec::new(),
            draws: 0,
            setup,
        };
        let quarter = search.setup.budget as usize / 4;
        let most = 2 * search.affordable(search.setup.dimension() + 1);
        let count = quarter.clamp(search.vertices(), most);
        let mut queue = VecDeque::from([(search.setup.start.clone(), Step::Default)]);
        let points = design(count - 1, search.setup.dimension(), &mut search.random());
        queue.extend(points.into_iter().map(|x| (x, Step::LatinHypercube)));
        search.phase = SimplexPhase::Design { queue };
        search
    }

    /// The number of vertices of the simplex: one more than the axes it spans where the budget allows.
    fn vertices(&self) -> usize {
        let spanned = (0..self.setup.dimension()).filter(|&axis| !self.is_choice(axis)).count();
        self.affordable(spanned + 1)
    }

    fn affordable(&self, vertices: usize) -> usize {
        vertices.min((self.setup.budget as usize / 2).clamp(3, VERTICES_MAX))
    }

    fn is_choice(&self, axis: usize) -> bool {
        self.setup.levels_of(axis) > 0
    }

    fn has_choices(&self) -> bool {
        (0..self.setup.dimension()).any(|axis| self.is_choice(axis))
    }

    /// Begins the round of switches, after the design.
    fn begin_switches(&mut self) {
        let shares_score =
            |vertex: &SimplexVertex| self.simplex.iter().filter(|v| v.score == vertex.score).count() > 1;
        let alone: Vec<SimplexVertex> =
            self.simplex.iter().filter(|vertex| !shares_score(vertex)).cloned().collect();
        if !alone.is_empty() {
            self.simplex = alone;
        }
        let mut switches = Vec::new();
        for axis in 0..self.setup.dimension() {
            let levels = self.setup.levels_of(axis);
            switches.extend((0..levels).map(|level| (self.mean_rank(axis, level), (axis, level))));
        }
        switches.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.switches = switches.into_iter().map(|(_, switch)| switch).collect();
        self.phase = SimplexPhase::Switch;
    }

    /// The mean rank of the points with this level of a choice, drawn to the middle where they are few.
    fn mean_rank(&self, axis: usize, level: u32) -> f64 {
        let has_level =
            |vertex: &SimplexVertex| level_at(vertex.x[axis], self.setup.levels_of(axis)) == level;
        let ranks = self.simplex.iter().enumerate().filter(|(_, vertex)| has_level(vertex));
        let (sum, count) = ranks.fold((0.0, 0.0), |(sum, count), (rank, _)| (sum + rank as f64, count + 1.0));
        (sum + self.simplex.len() as f64 / 2.0) / (count + 1.0)
    }

    /// The best point with the next switch of the round; `None` at the end of the round.
    fn switched(&mut self) -> Option<Vec<f64>> {
        let mut x = self.best()?.x.clone();
        while let Some((axis, level)) = self.switches.pop() {
            let levels = self.setup.levels_of(axis);
            if level_at(x[axis], levels) != level {
                x[axis] = (f64::from(level) + 0.5) / f64::from(levels);
                return Some(x);
            }
        }
        None
    }

    /// Gives each choice of `x` the value it has in one of the best measurements.
    fn take_choices(&mut self, x: &mut [f64]) {
        if self.elite.is_empty() {
            return;
        }
        let mut random = self.random();
        for axis in (0..x.len()).filter(|&axis| self.is_choice(axis)) {
            x[axis] = self.elite[random.random_range(0..self.elite.len())].x[axis];
        }
    }

    /// Remembers a measurement if it is one of the best.
    fn consider(&mut self, vertex: &SimplexVertex) {
        if vertex.score == Score::Infeasible || !self.has_choices() {
            return;
        }
        let at = self.elite.partition_point(|other| !vertex.score.beats(&other.score));
        self.elite.insert(at, vertex.clone());
        self.elite.truncate(ELITE_MAX);
    }

    fn random(&mut self) -> ChaCha8Rng {
        self.draws += 1;
        stream(self.setup.seed, Purpose::Search, self.setup.state_id, self.draws)
    }

    fn best(&self) -> Option<&SimplexVertex> {
        self.simplex.first()
    }

    fn score(&self, verdict: Verdict) -> Score {
        match (verdict, self.best().map(|best| best.score)) {
            (Verdict::Infeasible, _) => Score::Infeasible,
            // A bound is not a measurement: it may tie with the best vertex, never beat it.
            (Verdict::AtLeast(bound), Some(Score::Cost(best))) => Score::Cost(bound.max(best)),
            (Verdict::Cost(cost) | Verdict::AtLeast(cost), _) => Score::Cost(cost),
        }
    }

    fn sort(&mut self) {
        // Stable: of equal vertices the older stays in front.
        self.simplex.sort_by(|a, b| a.score.compare(&b.score));
    }

    /// The centre of all vertices but the worst.
    fn centroid(&self) -> Vec<f64> {
        let kept = &self.simplex[..self.simplex.len() - 1];
        let sum = |axis: usize| kept.iter().map(|vertex| vertex.x[axis]).sum::<f64>();
        (0..self.setup.dimension()).map(|axis| sum(axis) / kept.len() as f64).collect()
    }

    /// Takes `vertex` in the place of the worst and goes on with a reflection.
    fn accept(&mut self, vertex: SimplexVertex) {
        self.simplex.pop();
        self.simplex.push(vertex);
        self.sort();
        self.phase = SimplexPhase::Reflect;
        if self.has_collapsed() {
            self.restart();
        }
    }

    fn has_collapsed(&self) -> bool {
        let (Some(best), Some(worst)) = (self.simplex.first(), self.simplex.last()) else {
            return false;
        };
        let near = |vertex: &SimplexVertex| {
            let is_near = |axis: usize| (vertex.x[axis] - best.x[axis]).abs() < EXTENT_MIN;
            (0..best.x.len()).all(|axis| self.is_choice(axis) || is_near(axis))
        };
        !worst.score.compare(&best.score).is_gt() || self.simplex.iter().all(near)
    }

    /// Spreads a new simplex around the best vertex, which stays.
    fn restart(&mut self) {
        self.simplex.truncate(1);
        let radius = match self.best() {
            Some(SimplexVertex { score: Score::Cost(_), .. }) => {
                RESTART_RADII[self.restarts as usize % RESTART_RADII.len()]
            }
            // Nothing feasible is known: look everywhere.
            _ => 1.0,
        };
        let centre = self.best().map_or_else(|| self.setup.start.clone(), |best| best.x.clone());
        let mut points = design(self.vertices() - 1, self.setup.dimension(), &mut self.random());
        for point in &mut points {
            for (axis, c) in centre.iter().enumerate() {
                // The simplex does not span the choices, unless there is nothing yet to take them from.
                let radius = if self.is_choice(axis) && radius < 1.0 { 0.0 } else { radius };
                let (low, high) = ((c - radius).max(0.0), (c + radius).min(1.0));
                point[axis] = low + point[axis] * (high - low);
            }
        }
        self.restarts = self.restarts.wrapping_add(1);
        self.radius = RADIUS_START;
        self.phase = if points.is_empty() {
            SimplexPhase::Random
        } else {
            SimplexPhase::Design { queue: points.into_iter().map(|x| (x, Step::Restart)).collect() }
        };
    }

    /// Chang's adaptive random search. Local steps change some coordinates of the best point within a radius
    /// that follows success, with choices as the moves take them or now and then drawn at random; global
    /// steps are uniform over the cube and keep every point reachable. The fewer answers are fresh, the more
    /// steps are global.
    fn random_point(&mut self) -> Vec<f64> {
        let mut random = self.random();
        let dimension = self.setup.dimension();
        let global = (GLOBAL_PROBABILITY + 0.1 * f64::from(self.stale)).min(0.9);
        let is_global = random.random::<f64>() < global;
        let mut local = match self.best() {
            Some(best) if !is_global && best.score != Score::Infeasible => best.x.clone(),
            _ => return (0..dimension).map(|_| random.random()).collect(),
        };
        // About a third of the axes, one at least: a step along all of them at once is rarely a gain.
        let always = random.random_range(0..dimension);
        self.take_choices(&mut local);
        let step = |(axis, &x): (usize, &f64)| {
            let (change, whole, at) =
                (random.random::<f64>(), random.random::<f64>(), random.random::<f64>());
            match () {
                () if axis != always && change > 1.0 / 3.0 => x,
                () if whole < AXIS_PROBABILITY => at,
                () if self.is_choice(axis) => x,
                () => (x + self.radius * (2.0 * at - 1.0)).clamp(0.0, 1.0),
            }
        };
        local.iter().enumerate().map(step).collect()
    }

    /// A point on the line from the centroid through the worst vertex, `along` times as far from the
    /// centroid as the worst vertex and, where negative, on the other side; clamped to the cube, because
    /// the best value of a parameter often is an end of its range.
    fn on_line(&self, target: &[f64], along: f64) -> Vec<f64> {
        let centroid = self.centroid();
        centroid.iter().zip(target).map(|(c, t)| (c + along * (t - c)).clamp(0.0, 1.0)).collect()
    }

    /// Decides on the next step after `vertex` was measured. The simplex is complete and sorted.
    fn moved(&mut self, phase: SimplexPhase, vertex: SimplexVertex, fresh: bool) {
        let worst = self.simplex.len() - 1;
        let second_worst = worst.saturating_sub(1);
        match phase {
            SimplexPhase::Design { .. } | SimplexPhase::Switch => unreachable!("answered in `tell`"),
            SimplexPhase::Reflect => {
                if vertex.score.beats(&self.simplex[0].score) {
                    self.phase = SimplexPhase::Expand { reflected: vertex };
                } else if vertex.score.beats(&self.simplex[second_worst].score) {
                    self.accept(vertex);
                } else {
                    self.phase = SimplexPhase::Contract { reflected: vertex };
                }
            }
            SimplexPhase::Expand { reflected } => {
                let expanded_wins = vertex.score.beats(&reflected.score);
                self.accept(if expanded_wins { vertex } else { reflected });
            }
            SimplexPhase::Contract { reflected } => {
                let outside = reflected.score.beats(&self.simplex[worst].score);
                let to_beat = if outside { reflected.score } else { self.simplex[worst].score };
                if vertex.score.beats(&to_beat) {
                    self.accept(vertex);
                } else {
                    // An outside contraction that fails still leaves a reflection better than the worst.
                    if outside {
                        self.accept(reflected);
                    }
                    if matches!(self.phase, SimplexPhase::Reflect | SimplexPhase::Contract { .. }) {
                        self.phase = SimplexPhase::Random;
                    }
                }
            }
            SimplexPhase::Random => {
                let gain = vertex.score.beats(&self.simplex[0].score);
                let factor = match (gain, fresh) {
                    (true, _) => 1.3,
                    (false, true) => 0.85,
                    // The step was shorter than the grid of configurations.
                    (false, false) => 1.5,
                };
                self.radius = (self.radius * factor).clamp(RADIUS_MIN, RADIUS_MAX);
                // As in the round of switches, no known answer leads back onto a plateau.
                if (fresh || !self.has_choices()) && vertex.score.beats(&self.simplex[worst].score) {
                    self.accept(vertex);
                }
            }
        }
        if self.stale >= STALE_MAX && self.phase == SimplexPhase::Reflect {
            self.phase = SimplexPhase::Random;
        }
    }
}

impl Search for NelderMead {
    fn ask(&mut self) -> Option<Point> {
        if let Some(point) = self.pending.resume() {
            return Some(point);
        }
        if let SimplexPhase::Design { queue } = &mut self.phase {
            let (x, step) = queue.pop_front()?;
            return Some(self.pending.add(x, step));
        }
        if !self.pending.is_empty() {
            return None;
        }
        if self.phase == SimplexPhase::Switch {
            if let Some(x) = self.switched() {
                return Some(self.pending.add(x, Step::Switch));
            }
            self.restart();
            return self.ask();
        }
        if self.simplex.len() < 2 {
            // A simplex of one vertex cannot move: all axes are choices.
            self.phase = SimplexPhase::Random;
        }
        let worst = &self.simplex[self.simplex.len() - 1];
        let (mut x, step) = match &self.phase {
            SimplexPhase::Design { .. } | SimplexPhase::Switch => return None,
            SimplexPhase::Reflect => (self.on_line(&worst.x, -REFLECTION), Step::Reflect),
            SimplexPhase::Expand { .. } => (self.on_line(&worst.x, -EXPANSION), Step::Expand),
            SimplexPhase::Contract { reflected } => {
                let outside = reflected.score.beats(&worst.score);
                let target = if outside { &reflected.x } else { &worst.x };
                (self.on_line(target, CONTRACTION), Step::Contract)
            }
            SimplexPhase::Random => (self.random_point(), Step::RandomSearch),
        };
        if step != Step::RandomSearch {
            self.take_choices(&mut x);
        }
        Some(self.pending.add(x, step))
    }

    fn tell(&mut self, id: u64, feedback: Feedback) {
        let Some(Point { x, .. }) = self.pending.finish(id) else {
            return;
        };
        let vertex = SimplexVertex { x, score: self.score(feedback.verdict) };
        if feedback.fresh {
            self.consider(&vertex);
        }
        self.stale = if feedback.fresh { 0 } else { self.stale.saturating_add(1) };
        match std::mem::replace(&mut self.phase, SimplexPhase::Random) {
            SimplexPhase::Design { queue } => {
                self.simplex.push(vertex);
                self.sort();
                let done = queue.is_empty() && self.pending.is_empty();
                self.phase = if done { SimplexPhase::Reflect } else { SimplexPhase::Design { queue } };
                if done && self.restarts == 0 && self.has_choices() {
                    self.begin_switches();
                } else if done {
                    // The best of the design make the simplex.
                    self.simplex.truncate(self.vertices());
                    if self.has_collapsed() {
                        // Another simplex would not tell more than this one: step at random first.
                        self.phase = SimplexPhase::Random;
                    }
                }
            }
            SimplexPhase::Switch => {
                self.phase = SimplexPhase::Switch;
                // A known answer may be the plateau that the round was begun away from.
                if feedback.fresh {
                    self.simplex.push(vertex);
                    self.sort();
                }
            }
            phase => {
                self.phase = phase.clone();
                self.moved(phase, vertex, feedback.fresh);
            }
        }
    }

    fn withdraw(&mut self, id: u64) {
        self.pending.withdraw(id);
    }
}
