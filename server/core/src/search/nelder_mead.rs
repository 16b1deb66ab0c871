//! The stochastic Nelder-Mead simplex of Chang.
//!
//! The source is Chang, "Stochastic Nelder-Mead simplex method: a new globally convergent direct search
//! method for simulation optimization", European Journal of Operational Research 220, 2012. The search starts
//! with a Latin hypercube and takes the moves of Nelder and Mead ("A simplex method for function
//! minimization", The Computer Journal 7(4), 1965). Their shrink step loses good vertices under noise. An
//! adaptive random search, local and global, takes its place until a point beats the worst vertex. The paper
//! (section 6) explores with a variant of this search.
//!
//! All axes are continuous here, switches and whole numbers among them; points are rounded to configurations
//! outside of the search. The simplex keeps its whole extent until it contracts, so that it changes switches
//! as it moves.
//!
//! Where this differs from Chang, and why:
//! - *Sample size.* Chang measures each point more often as the search proceeds, so that the method converges
//!   under noise. Here the policy's `replicates` fixes the number of measurements of every result; the search
//!   itself never asks twice. That suits budgets of about 80 frames with a noise of a few percent; raise
//!   `replicates` for noisier metrics.
//! - *Start.* One vertex is the default configuration. Where half the budget does not pay for
//!   `dimension + 1` vertices, there are fewer, and the simplex searches the subspace that they span while
//!   the random search still reaches everything.
//! - *Lists of numbers.* Their values lie along the axis by size, in whatever order a study has them.
//! - *Plateaus.* When answers stop being fresh, or the simplex has collapsed, the random search takes over,
//!   with longer and longer steps.
//!
//! Only comparisons of scores are used, so that the points do not change when all costs are multiplied by
//! one number. Infeasible points are worse than all others, and move out of the simplex first.

use std::cmp::Ordering;
use std::collections::VecDeque;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::randomness::{Purpose, stream};
use crate::search::latin_hypercube::design;
use crate::search::pending::PendingPoints;
use crate::search::{Feedback, Point, Search, SearchSetup, Step, Verdict};

/// The lengths of the moves, in distances of the worst vertex from the centroid: the values of Nelder and
/// Mead, and of Chang.
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
/// Half the width of the box of local random steps: at first, least, most.
const RADIUS_START: f64 = 0.25;
const RADIUS_MIN: f64 = 0.02;
const RADIUS_MAX: f64 = 0.5;
/// Factors on the radius after a local step that is the best so far, after one that is not, and after one
/// that fell on a known configuration and so was shorter than the grid.
const RADIUS_GAIN: f64 = 1.3;
const RADIUS_LOSS: f64 = 0.85;
const RADIUS_KNOWN: f64 = 1.5;
/// Probability of a global random step while answers are fresh; each answer that is not adds as much.
const GLOBAL_PROBABILITY: f64 = 0.1;
const GLOBAL_PROBABILITY_MAX: f64 = 0.9;
/// Probability that a local step changes an axis, beside the one that it always changes.
const CHANGE_PROBABILITY: f64 = 1.0 / 3.0;
/// Probability that a local step draws a coordinate it changes from the whole axis, so that switches and
/// choices, whose values are far apart in the cube, can change too.
const AXIS_PROBABILITY: f64 = 0.1;

/// The rank of a vertex: costs by size, finite, then everything that cannot be run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Score {
    Cost(f64),
    Infeasible,
}

impl Score {
    /// Best first.
    fn compare(&self, other: &Score) -> Ordering {
        let [one, other] = [self, other].map(|score| match score {
            Score::Cost(cost) => *cost,
            Score::Infeasible => f64::INFINITY,
        });
        one.total_cmp(&other)
    }

    fn beats(&self, other: &Score) -> bool {
        self.compare(other) == Ordering::Less
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SimplexVertex {
    x: Vec<f64>,
    score: Score,
}

/// The phase of the search, with the points to measure or being measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SimplexPhase {
    /// The vertices of the first simplex; they do not depend on each other and may be out together.
    Design { queue: VecDeque<(Vec<f64>, Step)> },
    /// The worst vertex mirrored at the centroid of the others.
    Reflect,
    /// The reflection was the best so far: twice as far.
    Expand { reflected: SimplexVertex },
    /// The reflection was no gain: between the centroid and the better of worst and reflected vertex.
    Contract { reflected: SimplexVertex },
    /// The contraction was no gain either: random points, until one beats the worst vertex.
    #[serde(alias = "switch")]
    Random,
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
    /// The number of answers in a row that taught nothing.
    stale: u32,
    /// Random streams used so far.
    draws: u64,
    /// Vertices are [`sized`](crate::search::Layout); those of searches that earlier versions stored are not.
    #[serde(default)]
    by_size: bool,
}

impl NelderMead {
    /// A fresh search: the default configuration, then a Latin hypercube of one point for each axis.
    pub fn new(setup: SearchSetup) -> Self {
        let mut search = NelderMead {
            pending: PendingPoints::default(),
            phase: SimplexPhase::Reflect,
            simplex: Vec::new(),
            radius: RADIUS_START,
            stale: 0,
            draws: 0,
            by_size: true,
            setup,
        };
        let affordable = (search.setup.budget as usize / 2).clamp(3, VERTICES_MAX);
        let vertices = (search.setup.dimension() + 1).min(affordable);
        let mut queue = VecDeque::from([(search.setup.start.clone(), Step::Default)]);
        let points = design(vertices - 1, search.setup.dimension(), &mut search.random());
        queue.extend(points.into_iter().map(|x| (search.listed(x), Step::LatinHypercube)));
        search.phase = SimplexPhase::Design { queue };
        search
    }

    /// The point of the space for one of the simplex.
    fn listed(&self, x: Vec<f64>) -> Vec<f64> {
        if self.by_size { self.setup.layout.listed(&x) } else { x }
    }

    /// The point of the simplex for one of the space.
    fn sized(&self, x: Vec<f64>) -> Vec<f64> {
        if self.by_size { self.setup.layout.sized(&x) } else { x }
    }

    fn random(&mut self) -> ChaCha8Rng {
        self.draws += 1;
        stream(self.setup.seed, Purpose::Search, self.setup.state_id, self.draws)
    }

    fn score(&self, verdict: Verdict) -> Score {
        match (verdict, self.simplex.first().map(|best| best.score)) {
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

    /// Takes `vertex` in the place of the worst and goes on with a reflection.
    fn accept(&mut self, vertex: SimplexVertex) {
        self.simplex.pop();
        self.simplex.push(vertex);
        self.sort();
        self.phase = SimplexPhase::Reflect;
    }

    fn has_collapsed(&self) -> bool {
        let best = &self.simplex[0];
        self.simplex
            .iter()
            .all(|vertex| vertex.x.iter().zip(&best.x).all(|(x, best)| (x - best).abs() < EXTENT_MIN))
    }

    /// Chang's adaptive random search. Local steps change some coordinates of the best vertex within a radius
    /// that follows success. Global steps are uniform over the cube and keep every point reachable.
    fn random_point(&mut self) -> Vec<f64> {
        let mut random = self.random();
        let dimension = self.setup.dimension();
        let global = (GLOBAL_PROBABILITY * f64::from(1 + self.stale)).min(GLOBAL_PROBABILITY_MAX);
        let is_global = random.random::<f64>() < global;
        let best = &self.simplex[0];
        if is_global || best.score == Score::Infeasible {
            return (0..dimension).map(|_| random.random()).collect();
        }
        let always = random.random_range(0..dimension);
        let step = |(axis, &x): (usize, &f64)| {
            let (change, whole, at) =
                (random.random::<f64>(), random.random::<f64>(), random.random::<f64>());
            match () {
                () if axis != always && change > CHANGE_PROBABILITY => x,
                () if whole < AXIS_PROBABILITY => at,
                () => (x + self.radius * (2.0 * at - 1.0)).clamp(0.0, 1.0),
            }
        };
        best.x.iter().enumerate().map(step).collect()
    }

    /// A point on the line from the centroid of all vertices but the worst through `target`. Its distance
    /// from the centroid is `along` times that of `target`, on the other side where negative. It is clamped
    /// to the cube, because the best value of a parameter often is an end of its range.
    fn on_line(&self, target: &[f64], along: f64) -> Vec<f64> {
        let kept = &self.simplex[..self.simplex.len() - 1];
        assert!(!kept.is_empty(), "a simplex of one vertex has no centroid");
        let centroid =
            |axis: usize| kept.iter().map(|vertex| vertex.x[axis]).sum::<f64>() / kept.len() as f64;
        let at = |(axis, t): (usize, &f64)| {
            let c = centroid(axis);
            (c + along * (t - c)).clamp(0.0, 1.0)
        };
        target.iter().enumerate().map(at).collect()
    }

    /// Decides on the next step after `vertex` was measured. The simplex is complete and sorted.
    fn moved(&mut self, phase: SimplexPhase, vertex: SimplexVertex, fresh: bool) {
        let last = self.simplex.len() - 1;
        let [best, second_worst, worst] =
            [0, last.saturating_sub(1), last].map(|place| self.simplex[place].score);
        match phase {
            SimplexPhase::Design { .. } => unreachable!("answered in `tell`"),
            SimplexPhase::Reflect if vertex.score.beats(&best) => {
                self.phase = SimplexPhase::Expand { reflected: vertex };
            }
            SimplexPhase::Reflect if vertex.score.beats(&second_worst) => self.accept(vertex),
            SimplexPhase::Reflect => self.phase = SimplexPhase::Contract { reflected: vertex },
            SimplexPhase::Expand { reflected } => {
                let expanded_wins = vertex.score.beats(&reflected.score);
                self.accept(if expanded_wins { vertex } else { reflected });
            }
            SimplexPhase::Contract { reflected } => {
                let to_beat = if reflected.score.beats(&worst) { reflected.score } else { worst };
                match vertex.score.beats(&to_beat) {
                    true => self.accept(vertex),
                    false => self.phase = SimplexPhase::Random,
                }
            }
            SimplexPhase::Random => {
                let factor = match (vertex.score.beats(&best), fresh) {
                    (true, _) => RADIUS_GAIN,
                    (false, true) => RADIUS_LOSS,
                    (false, false) => RADIUS_KNOWN,
                };
                self.radius = (self.radius * factor).clamp(RADIUS_MIN, RADIUS_MAX);
                if vertex.score.beats(&worst) {
                    self.accept(vertex);
                }
            }
        }
        if self.phase == SimplexPhase::Reflect && (self.stale >= STALE_MAX || self.has_collapsed()) {
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
        if self.simplex.len() < 2 {
            // A stored search of one vertex cannot move.
            self.phase = SimplexPhase::Random;
        }
        let worst = self.simplex.last()?;
        let (x, step) = match &self.phase {
            SimplexPhase::Design { .. } => return None,
            SimplexPhase::Reflect => (self.on_line(&worst.x, -REFLECTION), Step::Reflect),
            SimplexPhase::Expand { .. } => (self.on_line(&worst.x, -EXPANSION), Step::Expand),
            SimplexPhase::Contract { reflected } => {
                let is_outside = reflected.score.beats(&worst.score);
                let target = if is_outside { &reflected.x } else { &worst.x };
                (self.on_line(target, CONTRACTION), Step::Contract)
            }
            SimplexPhase::Random => (self.random_point(), Step::RandomSearch),
        };
        let x = self.listed(x);
        Some(self.pending.add(x, step))
    }

    fn tell(&mut self, id: u64, feedback: Feedback) {
        let Some(Point { x, .. }) = self.pending.finish(id) else { return };
        let vertex = SimplexVertex { x: self.sized(x), score: self.score(feedback.verdict) };
        self.stale = if feedback.fresh { 0 } else { self.stale.saturating_add(1) };
        match std::mem::replace(&mut self.phase, SimplexPhase::Random) {
            SimplexPhase::Design { queue } => {
                self.simplex.push(vertex);
                self.sort();
                let done = queue.is_empty() && self.pending.is_empty();
                self.phase = if done { SimplexPhase::Reflect } else { SimplexPhase::Design { queue } };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Space;
    use crate::value::Value;

    /// The values that are tried where one parameter has listed numbers: the cost wants 8, and 0.3 of the
    /// other.
    fn tried(sizes: [i64; 6]) -> Vec<(Value, f64)> {
        let space = Space::builder().categorical("size", sizes).default(64);
        let space = space.float("share", 0.0..=1.0).default(0.75).build().expect("a valid space");
        let mut search = NelderMead::new(SearchSetup::of(&space, 5, 1, 40));
        let one = |_| {
            let point = search.ask().expect("nothing is out");
            let size = space.parameters()[0].domain.decode(point.x[0]);
            let off = size.as_number().map_or(0.0, |size| (libm::log2(size) - 3.0).abs());
            let cost = 1.0 + off + (point.x[1] - 0.3).abs();
            search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
            (size, point.x[1])
        };
        (0..40).map(one).collect()
    }

    #[test]
    fn the_order_in_which_numbers_are_listed_does_not_matter() {
        let (listed, sorted) = (tried([8, 2, 64, 4, 32, 16]), tried([2, 4, 8, 16, 32, 64]));
        for (number, (one, other)) in listed.iter().zip(&sorted).enumerate() {
            assert_eq!(one.0, other.0, "{number}");
            assert!((one.1 - other.1).abs() < 1e-9, "{number}: {} and {}", one.1, other.1);
        }
    }
}
