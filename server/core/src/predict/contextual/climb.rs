//! The configuration of which a process expects most in one state: from the best starts known, one parameter
//! at a time, as in SMAC's local search (Hutter, Hoos and Leyton-Brown, LION 5, 2011).

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::field::{Belief, Field};
use crate::search::layout::Layout;

/// Random points to begin with.
const ANYWHERE: usize = 32;
/// How many points climb, and how many changes each tries.
const CLIMBERS: usize = 3;
const CHANGES: usize = 40;
/// Steps along a continuous axis shrink from this to that over the climb.
const STEP_FIRST: f64 = 0.2;
const STEP_LAST: f64 = 0.01;

/// A configuration on the way down: canonical coordinates, and the score that falls.
#[derive(Clone, Debug)]
pub(super) struct Climber {
    pub(super) x: Vec<f64>,
    pub(super) belief: Belief,
    score: f64,
}

/// Where configurations are judged.
pub(super) struct Place<'a> {
    pub(super) field: &'a Field<'a>,
    pub(super) layout: &'a Layout,
    /// Distances from the asked state to the rows.
    pub(super) towards: &'a [f64],
    /// Deviations that are taken off the mean: more than zero looks for what may be good, less for what is
    /// surely good.
    pub(super) optimism: f64,
}

impl Place<'_> {
    /// Judges a point; the score is infinite when it cannot fall below `floor`.
    fn enter(&self, mut x: Vec<f64>, floor: f64, nearness: &mut Vec<f64>) -> Climber {
        let active = self.layout.canonical(&mut x);
        let features = self.layout.features(&x, &active);
        self.field.nearness(self.towards, &features, nearness);
        let mean = self.field.mean(nearness);
        let (least, none) = (self.field.variance.sqrt(), Belief { mean, deviation: 0.0 });
        if mean - self.optimism.max(0.0) * least >= floor {
            return Climber { x, belief: none, score: f64::INFINITY };
        }
        let deviation = self.field.deviation(nearness);
        Climber { x, belief: Belief { mean, deviation }, score: mean - self.optimism * deviation }
    }

    /// The best of `known`, of random points and of what the best of both lead to, but for points that
    /// `excludes` names.
    pub(super) fn best(
        &self,
        known: impl Iterator<Item = Vec<f64>>,
        random: &mut ChaCha8Rng,
        excludes: impl Fn(&[f64]) -> bool,
    ) -> Option<Climber> {
        let dimension = self.layout.dimension();
        let mut nearness = Vec::new();
        let mut climbers: Vec<Climber> = Vec::new();
        let anywhere: Vec<Vec<f64>> =
            (0..ANYWHERE).map(|_| (0..dimension).map(|_| random.random()).collect()).collect();
        for x in known.chain(anywhere) {
            let floor = if climbers.len() < CLIMBERS { f64::INFINITY } else { climbers[CLIMBERS - 1].score };
            let climber = self.enter(x, floor, &mut nearness);
            let place = climbers.partition_point(|other| other.score <= climber.score);
            let again = climbers.iter().any(|other| other.x == climber.x);
            if place < CLIMBERS && climber.score.is_finite() && !again && !excludes(&climber.x) {
                climbers.insert(place, climber);
                climbers.truncate(CLIMBERS);
            }
        }
        if dimension > 0 {
            for climber in &mut climbers {
                self.climb(climber, random, &excludes, &mut nearness);
            }
        }
        climbers.into_iter().min_by(|a, b| a.score.total_cmp(&b.score))
    }

    fn climb(
        &self,
        climber: &mut Climber,
        random: &mut ChaCha8Rng,
        excludes: &impl Fn(&[f64]) -> bool,
        nearness: &mut Vec<f64>,
    ) {
        let dimension = climber.x.len();
        for tried in 0..CHANGES {
            let radius = STEP_FIRST * libm::pow(STEP_LAST / STEP_FIRST, tried as f64 / CHANGES as f64);
            let mut x = climber.x.clone();
            let axis = random.random_range(0..dimension);
            x[axis] = self.layout.moved(axis, x[axis], radius, random);
            // Along a ridge one parameter alone leads nowhere.
            if dimension > 1 && tried % 2 == 1 {
                let other = (axis + random.random_range(1..dimension)) % dimension;
                x[other] = self.layout.moved(other, x[other], radius, random);
            }
            let changed = self.enter(x, climber.score, nearness);
            if changed.score < climber.score && !excludes(&changed.x) {
                *climber = changed;
            }
        }
    }
}
