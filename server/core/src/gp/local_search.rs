//! Local search for the point of highest score: the best of many starts climb by small changes, and each
//! change that scores higher is kept.
//!
//! Changing one parameter at a time suits mixed and conditional spaces, where there is no gradient to follow
//! (SMAC: Hutter, Hoos and Leyton-Brown, "Sequential model-based optimization for general algorithm
//! configuration", LION 5, 2011).

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::randomness::standard_normal;

/// A point, its score (more is better), and further data about it.
#[derive(Clone, Debug)]
pub(crate) struct ScoredPoint<T> {
    pub(crate) x: Vec<f64>,
    pub(crate) score: f64,
    pub(crate) detail: T,
}

/// The best few of the candidates that were offered, best first, the earlier first among equals.
#[derive(Clone, Debug)]
pub(crate) struct Leaders<T> {
    size: usize,
    candidates: Vec<ScoredPoint<T>>,
}

impl<T> Leaders<T> {
    pub(crate) fn new(size: usize) -> Self {
        assert!(size > 0, "somebody leads");
        Leaders { size, candidates: Vec::with_capacity(size + 1) }
    }

    /// The score that a candidate must exceed to get in.
    pub(crate) fn floor(&self) -> f64 {
        match self.candidates.get(self.size - 1) {
            Some(last) => last.score,
            None => f64::NEG_INFINITY,
        }
    }

    pub(crate) fn offer(&mut self, candidate: ScoredPoint<T>) {
        let place = self.candidates.partition_point(|other| other.score >= candidate.score);
        if place < self.size {
            self.candidates.insert(place, candidate);
            self.candidates.truncate(self.size);
        }
    }

    pub(crate) fn contains(&self, x: &[f64]) -> bool {
        self.candidates.iter().any(|candidate| candidate.x == x)
    }

    pub(crate) fn into_candidates(self) -> Vec<ScoredPoint<T>> {
        self.candidates
    }
}

/// The best of some candidates, the first among equals; `None` where no score is above minus infinity.
pub(crate) fn best<T>(candidates: impl IntoIterator<Item = ScoredPoint<T>>) -> Option<ScoredPoint<T>> {
    let mut best: Option<ScoredPoint<T>> = None;
    for candidate in candidates {
        let floor = best.as_ref().map_or(f64::NEG_INFINITY, |best| best.score);
        if candidate.score > floor {
            best = Some(candidate);
        }
    }
    best
}

/// The space of the search: the values of each axis.
pub(crate) trait Neighbourhood {
    /// Another value of one axis: near by along a scale (`radius` is a share of it), or any other.
    fn moved(&self, axis: usize, x: f64, radius: f64, random: &mut ChaCha8Rng) -> f64;
}

pub(crate) trait Moves {
    /// Another candidate begins to climb.
    fn begin(&mut self) {}

    /// A changed point; `progress` of all changes, from 0 to 1, were tried before.
    fn change(&mut self, x: &[f64], progress: f64) -> Vec<f64>;

    fn kept(&mut self, _kept: bool) {}
}

/// Tries `changes` changes of a candidate, one after the other. `judge` receives a changed point and the
/// score to beat. It answers `None` where the point does not beat it or is not wanted.
pub(crate) fn climb<T>(
    from: ScoredPoint<T>,
    changes: usize,
    moves: &mut impl Moves,
    mut judge: impl FnMut(Vec<f64>, f64) -> Option<ScoredPoint<T>>,
) -> ScoredPoint<T> {
    let mut climber = from;
    if climber.x.is_empty() {
        return climber;
    }
    moves.begin();
    for tried in 0..changes {
        let changed = moves.change(&climber.x, tried as f64 / changes as f64);
        assert_eq!(changed.len(), climber.x.len(), "a change keeps all axes");
        let better = judge(changed, climber.score).filter(|changed| changed.score > climber.score);
        moves.kept(better.is_some());
        if let Some(better) = better {
            climber = better;
        }
    }
    climber
}

/// Step sizes along an axis, as shares of it, at the beginning and at the end of a climb. They shrink
/// geometrically.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radii {
    pub(crate) first: f64,
    pub(crate) last: f64,
}

impl Radii {
    fn at(self, progress: f64) -> f64 {
        assert!((0.0..=1.0).contains(&progress), "a progress of {progress}");
        self.first * libm::pow(self.last / self.first, progress)
    }
}

/// One axis after the other, each once in a random order before any comes again.
#[derive(Debug)]
pub(crate) struct AxisSweeps<'a, N> {
    neighbourhood: &'a N,
    radii: Radii,
    random: &'a mut ChaCha8Rng,
    axes: Vec<usize>,
    next: usize,
}

impl<'a, N> AxisSweeps<'a, N> {
    pub(crate) fn new(
        neighbourhood: &'a N,
        dimension: usize,
        radii: Radii,
        random: &'a mut ChaCha8Rng,
    ) -> Self {
        AxisSweeps { neighbourhood, radii, random, axes: (0..dimension).collect(), next: dimension }
    }
}

impl<N: Neighbourhood> Moves for AxisSweeps<'_, N> {
    fn begin(&mut self) {
        self.next = self.axes.len();
    }

    fn change(&mut self, x: &[f64], progress: f64) -> Vec<f64> {
        assert_eq!(x.len(), self.axes.len(), "a point of other axes");
        if self.next == self.axes.len() {
            self.axes.shuffle(self.random);
            self.next = 0;
        }
        let axis = self.axes[self.next];
        self.next += 1;
        let mut x = x.to_vec();
        x[axis] = self.neighbourhood.moved(axis, x[axis], self.radii.at(progress), self.random);
        x
    }
}

/// One random axis and two in turn: along a ridge one parameter alone leads nowhere.
#[derive(Debug)]
pub(crate) struct RandomAxes<'a, N> {
    neighbourhood: &'a N,
    radii: Radii,
    random: &'a mut ChaCha8Rng,
    two: bool,
}

impl<'a, N> RandomAxes<'a, N> {
    pub(crate) fn new(neighbourhood: &'a N, radii: Radii, random: &'a mut ChaCha8Rng) -> Self {
        RandomAxes { neighbourhood, radii, random, two: false }
    }
}

impl<N: Neighbourhood> Moves for RandomAxes<'_, N> {
    fn begin(&mut self) {
        self.two = false;
    }

    fn change(&mut self, x: &[f64], progress: f64) -> Vec<f64> {
        let (dimension, radius) = (x.len(), self.radii.at(progress));
        let mut x = x.to_vec();
        let axis = self.random.random_range(0..dimension);
        x[axis] = self.neighbourhood.moved(axis, x[axis], radius, self.random);
        if dimension > 1 && self.two {
            let other = (axis + self.random.random_range(1..dimension)) % dimension;
            x[other] = self.neighbourhood.moved(other, x[other], radius, self.random);
        }
        self.two = !self.two;
        x
    }
}

/// Normal steps along all axes, now and then along one, which grow with success and shrink without: for
/// coordinates without bounds in which all axes are alike.
#[derive(Debug)]
pub(crate) struct NormalSteps<'a> {
    start: f64,
    step: f64,
    random: &'a mut ChaCha8Rng,
}

/// The share of normal steps along one axis only, and the factors by which steps grow and shrink.
const ONE_AXIS: f64 = 0.3;
const GROWTH: f64 = 1.5;
const SHRINKAGE: f64 = 0.92;

impl<'a> NormalSteps<'a> {
    /// `step` is the standard deviation of the first steps.
    pub(crate) fn new(step: f64, random: &'a mut ChaCha8Rng) -> Self {
        NormalSteps { start: step, step, random }
    }
}

impl Moves for NormalSteps<'_> {
    fn begin(&mut self) {
        self.step = self.start;
    }

    fn change(&mut self, x: &[f64], _progress: f64) -> Vec<f64> {
        let only = (self.random.random::<f64>() < ONE_AXIS).then(|| self.random.random_range(0..x.len()));
        let moves = |axis: usize| only.is_none_or(|only| only == axis);
        let mut x = x.to_vec();
        for (_, x) in x.iter_mut().enumerate().filter(|(axis, _)| moves(*axis)) {
            *x += self.step * standard_normal(self.random);
        }
        x
    }

    fn kept(&mut self, kept: bool) {
        self.step *= if kept { GROWTH } else { SHRINKAGE };
    }
}
