//! A closer look around the best: a model of the nearest measurements, in coordinates of their own.
//!
//! A process over the whole space is too coarse for the last digits, and its distances follow the axes, while
//! valleys rarely do. So every other point comes from a second process. It is fitted to the measurements next
//! to the best only, in axes along which the better half of them is spread evenly, and has a quadratic trend.
//! The search for its highest expected improvement goes no further out than the nearer half of these
//! measurements.
//!
//! The local models are those of TuRBO (Eriksson et al., "Scalable global optimization via local Bayesian
//! optimization", NeurIPS 2019). The metric is the spread of the better half, weighted by ranks, from CMA-ES
//! (Hansen, "The CMA evolution strategy: a tutorial", 2016, section 3). Quadratic models of noisy
//! measurements around the best come from Hansen, "A global surrogate assisted CMA-ES" (GECCO 2019). The
//! region needs no state: it shrinks as measurements gather.

use rand_chacha::ChaCha8Rng;

use super::acquire::{Acquisition, EstimatedPoint};
use super::{ModelledPoint, PENDING_COUNT, PRIOR};
use crate::gp::acquisition::log_expected_improvement;
use crate::gp::kernel::FeatureKind;
use crate::gp::local_search::{Leaders, NormalSteps, ScoredPoint, best, climb};
use crate::gp::warping::ShiftedLog;
use crate::gp::{Hyperparameters, Process, Sample, Schedule};
use crate::matrix::{Factor, distance_2};
use crate::randomness::standard_normal;
use crate::search::layout::Layout;

/// Numbers of nearest measurements in a fit: those for each axis, and those in addition.
const NEAREST_PER_AXIS: usize = 4;
const NEAREST: usize = 6;
/// Steps of ascent of the process' likelihood.
const STEPS: usize = 12;
/// Points closer to a measurement than this share of the radius teach nothing.
const APART_MIN: f64 = 0.05;
/// The least distance from a pending point, whose result is unknown.
const APART_PENDING_MIN: f64 = 0.3;
/// Numbers of random points at the beginning, of those that climb, and of their steps.
const BEGIN: usize = 100;
const CLIMBERS: usize = 3;
const CLIMB: usize = 80;
/// Axes with at least this number of cells count as continuous.
const CELLS_MIN: u32 = 32;

struct LocalMeasurement {
    x: Vec<f64>,
    cost: f64,
    count: f64,
}

/// The measurements that agree with the best in every parameter that is not continuous.
pub(super) struct Near {
    /// Canonical coordinates of the best.
    best: Vec<f64>,
    /// The searched axes.
    axes: Vec<usize>,
    measured: Vec<LocalMeasurement>,
    /// The weights of the global process along these axes.
    weights: Vec<f64>,
}

/// Coordinates in which the better half of the nearest measurements is spread evenly around the best:
/// whitened ones.
struct Whitening {
    centre: Vec<f64>,
    factor: Factor,
}

impl Whitening {
    /// The coordinates of some measurements. `None` where they all coincide.
    fn of(measured: &[LocalMeasurement], nearest: &[usize], centre: &[f64]) -> Option<Whitening> {
        let d = centre.len();
        let mut by_cost = nearest.to_vec();
        by_cost.sort_by(|&a, &b| measured[a].cost.total_cmp(&measured[b].cost));
        let better = nearest.len().div_ceil(2);
        let weights: Vec<f64> =
            (1..=better).map(|rank| libm::log((better as f64 + 0.5) / rank as f64)).collect();
        let total: f64 = weights.iter().sum();
        assert!(total > 0.0, "the better half weighs {total}");
        let mut spread = vec![0.0; d * d];
        for (&index, weight) in by_cost.iter().zip(&weights) {
            let apart: Vec<f64> = measured[index].x.iter().zip(centre).map(|(x, c)| x - c).collect();
            for (i, row) in spread.chunks_exact_mut(d).enumerate() {
                row.iter_mut().zip(&apart).for_each(|(sum, other)| *sum += weight / total * apart[i] * other);
            }
        }
        let diagonal: Vec<f64> = (0..d).map(|i| spread[i * d + i]).collect();
        let mean = diagonal.iter().sum::<f64>() / d as f64;
        // Few measurements say little of how axes go together, and must not flatten one.
        let shrink = d as f64 / (d + better) as f64;
        spread.iter_mut().for_each(|entry| *entry *= 1.0 - shrink);
        for i in 0..d {
            spread[i * d + i] += shrink * (0.9 * diagonal[i] + 0.1 * mean);
        }
        let factor = (mean > 0.0).then(|| Factor::of(&spread, d)).flatten()?;
        Some(Whitening { centre: centre.to_vec(), factor })
    }

    fn enter(&self, x: &[f64]) -> Vec<f64> {
        let mut u: Vec<f64> = x.iter().zip(&self.centre).map(|(x, c)| x - c).collect();
        self.factor.forward(&mut u);
        u
    }

    fn leave(&self, u: &[f64]) -> Vec<f64> {
        let place = |(i, c): (usize, &f64)| (c + self.factor.times_row(i, u)).clamp(0.0, 1.0);
        self.centre.iter().enumerate().map(place).collect()
    }
}

/// The `count` indices of least distance, nearest first.
fn nearest(total: usize, count: usize, distance: impl Fn(usize) -> f64) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> = (0..total).map(|index| (distance(index), index)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().take(count).map(|(_, index)| index).collect()
}

fn square(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum()
}

impl Near {
    /// Gathers the measurements around the best of `known`, whose costs are `measured` in their order. `None`
    /// where there is nothing continuous to search, or where there are too few measurements.
    pub(super) fn of(
        layout: &Layout,
        measured: &[&ModelledPoint],
        known: &[EstimatedPoint],
        cost: &Process,
    ) -> Option<Near> {
        assert_eq!(known.len(), measured.len(), "what is known of what was measured");
        let best = (0..known.len()).min_by(|&a, &b| known[a].believed.total_cmp(&known[b].believed))?;
        let best = known[best].x.clone();
        let active = layout.active(&best);
        let continuous =
            |axis: &usize| active[*axis] && (layout.cells(*axis) == 0 || layout.cells(*axis) >= CELLS_MIN);
        let axes: Vec<usize> = (0..best.len()).filter(continuous).collect();
        let agrees = |place: &&&ModelledPoint| {
            let mut others = (0..best.len()).filter(|axis| axes.binary_search(axis).is_err());
            others.all(|axis| place.x[axis] == best[axis])
        };
        let of = |place: &&ModelledPoint| LocalMeasurement {
            x: axes.iter().map(|&axis| place.x[axis]).collect(),
            cost: place.observed.cost(),
            count: place.count,
        };
        let measured: Vec<LocalMeasurement> = measured.iter().filter(agrees).map(of).collect();
        let weights = axes.iter().map(|&axis| cost.weights[axis]).collect();
        let enough = !axes.is_empty() && measured.len() >= NEAREST.min(axes.len() + 2);
        enough.then_some(Near { best, axes, measured, weights })
    }

    /// The point of highest expected improvement around the best, canonical but for rounding. `pending` are
    /// points that count as measured at their expected cost.
    pub(super) fn propose(
        &self,
        acquisition: &Acquisition,
        pending: &[Vec<f64>],
        random: &mut ChaCha8Rng,
    ) -> Option<Vec<f64>> {
        let (d, measured) = (self.axes.len(), &self.measured);
        let pick = |x: &[f64]| -> Vec<f64> { self.axes.iter().map(|&axis| x[axis]).collect() };
        let centre = pick(&self.best);
        let count = NEAREST_PER_AXIS * d + NEAREST;
        let weighted = |index: usize| -> f64 {
            let apart = measured[index].x.iter().zip(&centre).zip(&self.weights);
            apart.map(|((x, c), weight)| weight * (x - c) * (x - c)).sum()
        };
        // The nearest measurements depend on these coordinates, which depend on the nearest measurements: two
        // rounds are enough.
        let whitening = Whitening::of(measured, &nearest(measured.len(), count, weighted), &centre)?;
        let chosen = nearest(measured.len(), count, |index| square(&whitening.enter(&measured[index].x)));
        let whitening = Whitening::of(measured, &chosen, &centre)?;
        let places: Vec<Vec<f64>> = chosen.iter().map(|&index| whitening.enter(&measured[index].x)).collect();
        let mut lengths: Vec<f64> = places.iter().map(|u| square(u).sqrt()).collect();
        lengths.sort_by(f64::total_cmp);
        let radius = lengths[lengths.len() / 2];
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let feature = |u: &[f64]| -> Vec<f64> { u.iter().map(|u| 0.5 + 0.5 * u / radius).collect() };
        let features: Vec<Vec<f64>> = places.iter().map(|u| feature(u)).collect();
        let pending: Vec<Vec<f64>> = pending.iter().map(|x| whitening.enter(&pick(x))).collect();
        let pending_features: Vec<Vec<f64>> = pending.iter().map(|u| feature(u)).collect();
        let process = self.fit(&chosen, &features, &pending_features)?;
        let least = features.iter().map(|f| process.predict(f).mean).fold(f64::INFINITY, f64::min);
        let judge = |mut u: Vec<f64>, floor: f64| {
            let length = square(&u).sqrt();
            if length > radius {
                u.iter_mut().for_each(|u| *u *= radius / length);
            }
            let mut x = self.best.clone();
            self.axes.iter().zip(whitening.leave(&u)).for_each(|(&axis, place)| x[axis] = place);
            let active = acquisition.layout.canonical(&mut x);
            // A point that the cube or a cell moves counts at its final place.
            let u = whitening.enter(&pick(&x));
            let apart = |v: &Vec<f64>| distance_2(v, &u);
            let closest = |to: &[Vec<f64>]| to.iter().map(apart).fold(f64::INFINITY, f64::min).sqrt();
            if closest(&places) < APART_MIN * radius || closest(&pending) < APART_PENDING_MIN * radius {
                return ScoredPoint { x: u, score: f64::NEG_INFINITY, detail: x };
            }
            let gain = log_expected_improvement(least, process.predict(&feature(&u)));
            // The probability of failure can only lower the gain.
            if gain <= floor {
                return ScoredPoint { x: u, score: f64::NEG_INFINITY, detail: x };
            }
            let feasible = acquisition.log_feasible(&acquisition.layout.features(&x, &active));
            ScoredPoint { x: u, score: gain + feasible, detail: x }
        };
        let scale = radius / (d as f64).sqrt();
        let mut leaders = Leaders::new(CLIMBERS);
        for index in 0..BEGIN {
            let scale = scale * 0.5f64.powi((index % 5) as i32);
            leaders.offer(judge((0..d).map(|_| scale * standard_normal(random)).collect(), leaders.floor()));
        }
        let mut moves = NormalSteps::new(0.3 * scale, random);
        let starts = leaders.into_candidates().into_iter();
        let climbed = starts.map(|start| climb(start, CLIMB, &mut moves, |u, floor| Some(judge(u, floor))));
        best(climbed).map(|candidate| candidate.detail)
    }

    fn fit(&self, chosen: &[usize], features: &[Vec<f64>], pending: &[Vec<f64>]) -> Option<Process> {
        let d = self.axes.len();
        let costs: Vec<f64> = chosen.iter().map(|&index| self.measured[index].cost).collect();
        let mut counts: Vec<f64> = chosen.iter().map(|&index| self.measured[index].count).collect();
        let mut points: Vec<&[f64]> = features.iter().map(Vec::as_slice).collect();
        let kinds = vec![FeatureKind::Ordered; d];
        let mut hyper = Hyperparameters::with_trend(&kinds, &PRIOR);
        let views = ShiftedLog::new(&costs).views();
        let sample = Sample::new(kinds.clone(), &points, counts.clone()).prepared();
        let schedule = Schedule { steps: STEPS, ahead: false };
        let (process, view) = Process::learn(sample, &views, &mut hyper, &PRIOR, schedule)?;
        if pending.is_empty() {
            return Some(process);
        }
        let mut values = views[view].0.clone();
        values.extend(pending.iter().map(|features| process.predict(features).mean));
        counts.extend(pending.iter().map(|_| PENDING_COUNT));
        points.extend(pending.iter().map(Vec::as_slice));
        Process::fit(Sample::new(kinds, &points, counts).prepared(), values, &hyper, &PRIOR)
    }
}
