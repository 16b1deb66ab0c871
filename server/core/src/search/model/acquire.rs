//! The next point to measure: the one of highest expected improvement that can probably be run.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::held::HeldAxis;
use crate::gp::acquisition::{log_expected_improvement, probability_below};
use crate::gp::local_search::{AxisSweeps, Leaders, Neighbourhood, Radii, ScoredPoint, best, climb};
use crate::gp::{Covariances, Posterior, Process};
use crate::search::layout::Layout;

/// A configuration that was measured, in full or at cheaper levels only.
pub(super) struct EstimatedPoint {
    /// Canonical coordinates.
    pub(super) x: Vec<f64>,
    /// Its cost in full by the model.
    pub(super) believed: f64,
    pub(super) in_full: bool,
}

/// The value of measuring a point.
pub(super) struct Acquisition<'a> {
    pub(super) layout: &'a Layout,
    /// `None` while there are not two costs to learn from.
    pub(super) cost: Option<&'a Process>,
    /// Predicts 1 for points that cannot be run; `None` while every point could.
    pub(super) failure: Option<&'a Process>,
    /// Factor on the model's deviations of cost.
    pub(super) doubt: f64,
}

/// Random points to begin with: anywhere, and near the best.
const ANYWHERE: usize = 40;
const NEAR: usize = 40;
/// Numbers of these that climb, of the best known that climb too, and of changes that all try between them.
const CLIMBERS: usize = 4;
const KNOWN_CLIMBERS: usize = 2;
const CHANGES: usize = 240;
/// Steps along a continuous axis over the climb.
const RADII: Radii = Radii { first: 0.15, last: 0.01 };
/// The least probability that is assumed for a point to run.
const FEASIBLE_MIN: f64 = 1e-3;
/// An improvement is multiplied by this power of the probability. A model of cost learns nothing from
/// failures and goes on to expect much of such points. With power 1 and without a wanted probability 38 of 80
/// trials of a recorded compressor failed, with these values 15, and the best that ran was no worse.
const FEASIBLE_WEIGHT: f64 = 2.0;
/// Points that can be run with this probability come before all others, by this much of a logarithm. Late
/// improvements are logarithms below −20.
const FEASIBLE_WANTED: f64 = 0.7;
const UNWANTED: f64 = 1e3;

pub(super) fn anywhere(dimension: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    (0..dimension).map(|_| random.random()).collect()
}

impl Acquisition<'_> {
    /// The logarithm of the expected improvement on `best` times the probability that the point can be run;
    /// minus infinity where it cannot exceed `floor`.
    fn value(&self, x: &[f64], active: &[bool], best: f64, floor: f64) -> f64 {
        let features = self.layout.features(x, active);
        let Some(cost) = self.cost else { return self.log_feasible(&features) };
        let mut covariances = Covariances::default();
        cost.covariances(&cost.context(&[]), &features, &mut covariances);
        let mean = cost.mean(&covariances);
        let improvement = |deviation: f64| {
            log_expected_improvement(best, Posterior { mean, deviation: self.doubt * deviation })
        };
        // No measurement could raise the improvement above this bound; most points end here.
        if improvement(cost.deviation_max(&covariances)) <= floor {
            return f64::NEG_INFINITY;
        }
        let improvement = improvement(cost.deviation(&mut covariances));
        if improvement <= floor { f64::NEG_INFINITY } else { improvement + self.log_feasible(&features) }
    }

    /// The weight of an improvement, as a logarithm, by the probability that it can be run.
    pub(super) fn log_feasible(&self, features: &[f64]) -> f64 {
        let runs = self.failure.map_or(1.0, |failure| {
            probability_below(0.5, failure.predict(features), failure.noise).max(FEASIBLE_MIN)
        });
        FEASIBLE_WEIGHT * libm::log(runs) - if runs < FEASIBLE_WANTED { UNWANTED } else { 0.0 }
    }

    /// The best point to measure that is not `taken`, with the axes that are `held` where there is one.
    pub(super) fn best(
        &self,
        known: &[EstimatedPoint],
        held: &[HeldAxis],
        random: &mut ChaCha8Rng,
        taken: impl Fn(&[f64]) -> bool,
    ) -> Option<Vec<f64>> {
        let kept = if held.is_empty() { None } else { self.best_at(known, held, random, &taken) };
        kept.or_else(|| self.best_at(known, &[], random, &taken))
    }

    fn best_at(
        &self,
        known: &[EstimatedPoint],
        held: &[HeldAxis],
        random: &mut ChaCha8Rng,
        taken: impl Fn(&[f64]) -> bool,
    ) -> Option<Vec<f64>> {
        let mut order: Vec<&EstimatedPoint> = known.iter().collect();
        order.sort_by(|a, b| a.believed.total_cmp(&b.believed));
        let least = order.iter().find(|known| known.in_full).map_or(0.0, |known| known.believed);
        let least = if least.is_finite() { least } else { 0.0 };
        let dimension = self.layout.dimension();
        let judge = |mut x: Vec<f64>, floor: f64| {
            held.iter().for_each(|one| x[one.axis] = one.at);
            let active = self.layout.canonical(&mut x);
            // A constraint or a condition may have moved what is held, or switched it.
            let holds = held.iter().all(|one| one.is_kept(&x, &active));
            let score = if holds { self.value(&x, &active, least, floor) } else { f64::NEG_INFINITY };
            ScoredPoint { x, score, detail: () }
        };
        let mut leaders = Leaders::new(CLIMBERS);
        let mut offer = |x: Vec<f64>| {
            let candidate = judge(x, leaders.floor());
            if !taken(&candidate.x) {
                leaders.offer(candidate);
            }
        };
        order.iter().filter(|known| !known.in_full).for_each(|known| offer(known.x.clone()));
        (0..ANYWHERE).for_each(|_| offer(anywhere(dimension, random)));
        for index in 0..if order.is_empty() { 0 } else { NEAR } {
            let centre = &order[index % order.len().min(CLIMBERS)].x;
            let radius = 0.3 * 0.5f64.powi((index / 8) as i32);
            let mut x = centre.clone();
            let always = random.random_range(0..dimension);
            for (axis, x) in x.iter_mut().enumerate() {
                if axis == always || random.random::<f64>() < 0.4 {
                    *x = self.layout.moved(axis, *x, radius, random);
                }
            }
            offer(x);
        }
        // The best of the known start too: their neighbours are the likeliest improvements.
        let known = order.iter().take(KNOWN_CLIMBERS);
        let known =
            known.map(|known| ScoredPoint { x: known.x.clone(), score: f64::NEG_INFINITY, detail: () });
        let starts: Vec<ScoredPoint<()>> = leaders.into_candidates().into_iter().chain(known).collect();
        let share = CHANGES / starts.len().max(1);
        let mut moves = AxisSweeps::new(self.layout, dimension, RADII, random);
        let climbed = starts.into_iter().map(|start| {
            climb(start, share, &mut moves, |x, floor| {
                let changed = judge(x, floor);
                (changed.score > floor && !taken(&changed.x)).then_some(changed)
            })
        });
        best(climbed).map(|candidate| candidate.x)
    }
}
