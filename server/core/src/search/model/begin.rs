//! The points that are measured before there is a model.
//!
//! Spaces with choices begin with a Latin hypercube of a few points. In a continuous space of several axes
//! these say next to nothing, and half of them lie near corners. There the design goes one step along each
//! axis in turn, from the best so far, as Powell's COBYLA builds its first simplex ("A direct search
//! optimization method that models the objective and constraint functions by linear interpolation", 1994).
//! The model then knows a slope along every axis, and successful steps add up. Where the default is far from
//! the middle of the cube, the middle is measured before the steps. The optimum is nearer to it than to most
//! other places.
//!
//! Where other states of the study are known, their good points come before either design. They replace the
//! Latin hypercube unless they do badly here: a random point costs twice as much as the best, and says
//! little.

use std::collections::VecDeque;

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::{MeasuredPoint, ModelSearch, PRIOR};
use crate::gp::Hyperparameters;
use crate::search::SearchSetup;
use crate::search::latin_hypercube::design;

/// The reach of a Latin hypercube along continuous axes, as a share of the cube, and the number of axes from
/// which on it is limited. A cube of many dimensions is mostly corners, which say nothing of the rest.
const REACH: f64 = 0.75;
const REACH_FROM: usize = 3;
/// The length of the steps, and the number of axes from which on they are taken.
const STEP: f64 = 0.25;
const STEPS_FROM: usize = 4;

/// Points from other states run until the clearly worse ones than the default outnumber the better ones by
/// this number.
const PATIENCE: usize = 2;
/// Multiple of the default's cost above which a point did clearly worse.
const CLEARLY_WORSE: f64 = 1.15;

impl ModelSearch {
    /// Begins the models again, after their features have changed.
    pub(super) fn begin_models(&mut self) {
        let kinds = self.setup.layout.kinds();
        (self.cost, self.failure) =
            (Hyperparameters::new(&kinds, &PRIOR), Hyperparameters::new(&kinds, &PRIOR));
        (self.trended, self.fitted) = (None, 0);
    }

    /// The default's measurements, which all others are compared with.
    pub(super) fn default_seen(&self) -> Option<&MeasuredPoint> {
        let start = self.grid(&self.setup.start).0;
        self.seen.iter().find(|seen| seen.x == start)
    }

    /// The numbers of points that did better than the default, and clearly worse; both are 0 before the
    /// default was measured. Where the default itself serves most states best, the others hardly beat it.
    /// Looks at other branches say nothing of them.
    fn against_default(&self) -> (usize, usize) {
        let Some(default) = self.default_seen().map(|seen| seen.observed.cost()) else { return (0, 0) };
        let counted = self.seen.iter().filter(|seen| !self.looks.has_asked(&seen.x));
        let costs: Vec<f64> = counted.map(|seen| seen.observed.cost()).collect();
        let better = costs.iter().filter(|cost| **cost < default).count();
        let worse = costs.iter().filter(|cost| **cost > CLEARLY_WORSE * default).count();
        (better, worse)
    }

    /// Whether good points of other states are left, and the first of them did well enough here.
    pub(super) fn believes_others(&self) -> bool {
        let (better, worse) = self.against_default();
        !self.elsewhere.is_empty() && worse < better + PATIENCE
    }

    /// Keeps what is left of other states' good points for later where the first of them did badly here.
    pub(super) fn leave_doubted(&mut self) {
        if !self.believes_others() {
            let left = std::mem::take(&mut self.elsewhere);
            let left: Vec<Vec<u32>> = left.iter().map(|x| self.grid(x).0).collect();
            self.winners.extend(left);
        }
    }

    pub(super) fn next_from_elsewhere(&mut self) -> Option<Vec<f64>> {
        self.leave_doubted();
        let next = self.elsewhere.pop_front()?;
        if self.elsewhere.is_empty() && !self.queue_of_steps {
            self.queue.clear();
        }
        Some(next)
    }
}

/// Whether a space is begun by [`steps`].
pub(super) fn takes_steps(setup: &SearchSetup) -> bool {
    let dimension = setup.dimension();
    dimension >= STEPS_FROM && (0..dimension).all(|axis| setup.layout.cells(axis) == 0)
}

/// A Latin hypercube, in a few points.
pub(super) fn places(setup: &SearchSetup, random: &mut ChaCha8Rng) -> VecDeque<Vec<f64>> {
    let dimension = setup.dimension();
    let count = (dimension + 2).clamp(4, (setup.budget as usize / 8).max(4));
    let mut points = design(count - 1, dimension, random);
    for (axis, x) in points.iter_mut().flat_map(|point| point.iter_mut().enumerate()) {
        if dimension >= REACH_FROM && setup.layout.cells(axis) == 0 {
            *x = 0.5 + REACH * (*x - 0.5);
        }
    }
    points.into()
}

/// Steps from the best so far. The first goes to the middle, unless the default is about there. Then one goes
/// along each axis in a random order, as far as a quarter of the budget lasts.
pub(super) fn steps(setup: &SearchSetup, random: &mut ChaCha8Rng) -> VecDeque<Vec<f64>> {
    let dimension = setup.dimension();
    let to_middle: Vec<f64> = setup.start.iter().map(|x| 0.5 - x).collect();
    let is_there = to_middle.iter().all(|step| step.abs() <= STEP / 2.0);
    let mut axes: Vec<usize> = (0..dimension).collect();
    axes.shuffle(random);
    let along = |axis: usize| {
        let mut step = vec![0.0; dimension];
        step[axis] = if random.random() { STEP } else { -STEP };
        step
    };
    let affordable = (setup.budget as usize / 4).max(4);
    let first = (!is_there).then_some(to_middle);
    first.into_iter().chain(axes.into_iter().map(along)).take(affordable).collect()
}

#[cfg(test)]
mod tests {
    use crate::search::{Feedback, MainEffects, Search, SourceMeasurement, Step, Verdict};

    use super::*;

    fn setup(start: f64, levels: Vec<u32>) -> SearchSetup {
        SearchSetup::plain(3, vec![start; 6], 80, levels)
    }

    #[test]
    fn a_continuous_space_is_begun_by_steps_from_the_best_that_add_up() {
        let mut search = ModelSearch::new(setup(0.5, Vec::new()));
        // Less towards the far corner: every step forwards is a gain.
        let cost = |x: &[f64]| 10.0 - x.iter().sum::<f64>();
        let mut best: Option<Vec<f64>> = None;
        for number in 0..7 {
            let point = search.ask().expect("nothing is out");
            search.tell(point.id, Feedback { verdict: Verdict::Cost(cost(&point.x)), fresh: true });
            let Some(from) = &best else {
                best = Some(point.x);
                continue;
            };
            assert_eq!(point.step, Step::Coordinate, "{number}");
            let moved: Vec<f64> = point.x.iter().zip(from).map(|(a, b)| (a - b).abs()).collect();
            assert_eq!(moved.iter().filter(|moved| **moved > 0.0).count(), 1, "{moved:?}");
            assert!((moved.iter().sum::<f64>() - STEP).abs() < 1e-6, "{moved:?}");
            if cost(&point.x) < cost(from) {
                best = Some(point.x);
            }
        }
        let point = search.ask().expect("nothing is out");
        assert_ne!(point.step, Step::Coordinate, "one step along each axis");
    }

    #[test]
    fn the_middle_comes_first_where_the_default_is_far_from_it() {
        let mut search = ModelSearch::new(setup(0.9, Vec::new()));
        let first = search.ask().expect("nothing is out");
        search.tell(first.id, Feedback { verdict: Verdict::Cost(1.0), fresh: true });
        let middle = search.ask().expect("nothing is out");
        assert!(middle.x.iter().all(|x| (x - 0.5).abs() < 1e-6), "{:?}", middle.x);
        // Steps that would leave the cube go the other way.
        search.tell(middle.id, Feedback { verdict: Verdict::Cost(2.0), fresh: true });
        for _ in 0..6 {
            let point = search.ask().expect("nothing is out");
            assert!(point.x.iter().all(|x| (0.0..=1.0).contains(x)));
            assert!(point.x.iter().any(|x| (x - 0.65).abs() < 1e-6), "{:?}", point.x);
            search.tell(point.id, Feedback { verdict: Verdict::Cost(3.0), fresh: true });
        }
    }

    #[test]
    fn spaces_with_choices_are_begun_by_a_latin_hypercube() {
        let mut search = ModelSearch::new(setup(0.5, vec![2]));
        search.ask().expect("the default");
        assert_eq!(search.ask().expect("a design").step, Step::LatinHypercube);
    }

    /// A search of six axes, the first a choice, with evidence that costs fall along the last axis.
    fn following(first: &[[f64; 6]]) -> ModelSearch {
        let setup = setup(0.5, vec![2]);
        let layout = setup.layout.clone();
        let measured = (0..40).map(|index| {
            let x: Vec<f64> = (0..6).map(|axis| f64::from(index * (axis + 3) % 7) / 7.0).collect();
            SourceMeasurement { state: 0, log_cost: -x[5], x }
        });
        let main_effects = MainEffects::fit(&layout, &measured.collect::<Vec<_>>()).expect("a slope");
        let mut search = ModelSearch::new(setup);
        search.follow(main_effects, first.iter().map(|x| x.to_vec()).collect(), Vec::new(), Vec::new());
        search
    }

    fn walk(search: &mut ModelSearch, steps: usize, cost: impl Fn(&[f64]) -> f64) -> Vec<(Step, f64)> {
        let one = |_| {
            let point = search.ask().expect("nothing is out");
            let cost = cost(&point.x);
            search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
            (point.step, cost)
        };
        (0..steps).map(one).collect()
    }

    const FIRST: [[f64; 6]; 3] =
        [[0.25, 0.5, 0.5, 0.5, 0.5, 1.0], [0.75, 0.5, 0.5, 0.5, 0.5, 0.9], [0.25, 0.1, 0.5, 0.5, 0.5, 0.8]];

    #[test]
    fn what_did_well_elsewhere_stands_in_for_a_design() {
        let mut search = following(&FIRST);
        let steps = walk(&mut search, 40, |x| 2.0 - x[5]);
        let of = |step: Step| steps.iter().filter(|(other, _)| *other == step).count();
        let begin: Vec<Step> = steps[..4].iter().map(|(step, _)| *step).collect();
        assert_eq!(begin, [Step::Elsewhere, Step::Default, Step::Elsewhere, Step::Elsewhere]);
        assert_eq!((of(Step::Elsewhere), of(Step::LatinHypercube)), (3, 0));
    }

    #[test]
    fn others_lose_their_say_where_they_are_wrong() {
        // Costs rise where they fell elsewhere.
        let opposite = |x: &[f64]| 1.0 + x[5] + (x[2] - 0.5).powi(2);
        let mut search = following(&FIRST);
        let steps = walk(&mut search, 40, opposite);
        let of = |step: Step| steps.iter().filter(|(other, _)| *other == step).count();
        let design = ModelSearch::new(setup(0.5, vec![2])).queue.len();
        assert_eq!(of(Step::LatinHypercube), design, "{steps:?}");
        // The third comes when nothing better is found, if at all.
        let begin = steps[..=PATIENCE + design].iter().filter(|(step, _)| *step == Step::Elsewhere);
        assert_eq!(begin.count(), PATIENCE, "{steps:?}");
        let best = steps.iter().map(|(_, cost)| *cost).fold(f64::INFINITY, f64::min);
        assert!(best < 1.05, "{best}");
    }

    /// Every gain of a state is one over its default.
    #[test]
    fn a_search_that_begins_with_results_measures_the_default_unless_it_is_among_them() {
        for is_among_them in [false, true] {
            let mut search = ModelSearch::new(setup(0.5, vec![2]));
            search.hear(vec![0.25; 6], Verdict::Cost(3.0));
            if is_among_them {
                search.hear(vec![0.5; 6], Verdict::Cost(2.0));
            }
            search.hear(vec![0.75; 6], Verdict::Cost(4.0));
            let steps = walk(&mut search, 6, |x| 1.0 + x[1]);
            let is_default = |at: usize| steps[at].0 == Step::Default;
            assert_eq!(is_default(0), !is_among_them, "{steps:?}");
            assert!(!(1..6).any(is_default), "{steps:?}");
        }
    }

    #[test]
    fn a_guided_search_that_is_stored_goes_on() {
        let mut search = following(&FIRST);
        let cost = |x: &[f64]| 2.0 - x[5] + (x[3] - 0.2).abs();
        for steps in [0, 2, 9, 20] {
            walk(&mut search, steps, cost);
            let text = serde_json::to_string(&search).expect("plain data");
            let mut copy: ModelSearch = serde_json::from_str(&text).expect("own output");
            assert_eq!(copy, search);
            // A plan on a copy gives an equal point.
            if !search.is_ready() {
                let plan = search.plan(0).expect("a model to fit");
                copy.adopt(plan);
            }
            assert_eq!(walk(&mut copy, 3, cost), walk(&mut search, 3, cost));
        }
    }
}
