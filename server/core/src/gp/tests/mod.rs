//! The process against independent references: a dense one by `nalgebra`, finite differences, random draws.

mod acquisition;
mod learning;
mod local_search;
mod reference;
mod warping;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::kernel::{FeatureKind, INACTIVE};
use super::{Hyperparameters, Prior};
use crate::randomness::standard_normal;

/// A prior that hardly holds anything back.
const PRIOR: Prior = Prior { noise_mean: 0.05, ..Prior::WEAK };

/// Every kind of feature, the linear one last, as a guided search has them.
const KINDS: [FeatureKind; 5] = [
    FeatureKind::Ordered,
    FeatureKind::Ordered,
    FeatureKind::Categorical,
    FeatureKind::Ordered,
    FeatureKind::Linear,
];

fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A point with features of these kinds, some of them inactive.
fn point(kinds: &[FeatureKind], random: &mut ChaCha8Rng) -> Vec<f64> {
    let of = |kind: &FeatureKind| match kind {
        FeatureKind::Linear => standard_normal(random),
        _ if random.random::<f64>() < 0.2 => INACTIVE,
        FeatureKind::Ordered => random.random(),
        FeatureKind::Categorical => f64::from(random.random_range(0..3u32)),
    };
    kinds.iter().map(of).collect()
}

fn points(kinds: &[FeatureKind], count: usize, seed: u64) -> Vec<Vec<f64>> {
    let random = &mut random(seed);
    (0..count).map(|_| point(kinds, random)).collect()
}

/// The points, with `parts` parts of their linear feature.
fn with_parts(mut points: Vec<Vec<f64>>, parts: usize, seed: u64) -> Vec<Vec<f64>> {
    let random = &mut random(seed);
    points.iter_mut().for_each(|point| point.extend((0..parts).map(|_| standard_normal(random))));
    points
}

/// Hyperparameters that are all different from each other and from the prior's middle.
fn uneven(kinds: &[FeatureKind], has_trend: bool) -> Hyperparameters {
    let mut hyper = match has_trend {
        true => Hyperparameters::with_trend(kinds, &PRIOR),
        false => Hyperparameters::new(kinds, &PRIOR),
    };
    for (index, log) in hyper.log_mut().iter_mut().enumerate() {
        *log += 0.3 * (index as f64 - 2.0);
    }
    hyper
}

fn slices(points: &[Vec<f64>]) -> Vec<&[f64]> {
    points.iter().map(Vec::as_slice).collect()
}
