//! The configuration of the lowest confidence bound in one state.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::gp::acquisition::confidence_bound;
use crate::gp::local_search::{Leaders, Radii, RandomAxes, ScoredPoint, best, climb};
use crate::gp::{Covariances, Posterior, Process, SharedFeatures};
use crate::search::layout::Layout;

/// Random points to begin with.
const ANYWHERE: usize = 32;
/// Numbers of points that climb, and of changes that each tries.
const CLIMBERS: usize = 3;
const CHANGES: usize = 40;
/// Steps along a continuous axis over the climb.
const RADII: Radii = Radii { first: 0.2, last: 0.01 };

/// The target: the least mean less `optimism` deviations, in the state of the context. Above zero it finds
/// points that may be good, below zero surely good ones.
pub(super) struct LowestBound<'a> {
    pub(super) process: &'a Process,
    pub(super) layout: &'a Layout,
    /// The asked state.
    pub(super) context: &'a SharedFeatures,
    pub(super) optimism: f64,
}

impl LowestBound<'_> {
    /// Judges a point; the score is minus infinity when it cannot rise above `floor`.
    fn judge(&self, mut x: Vec<f64>, floor: f64, covariances: &mut Covariances) -> ScoredPoint<Posterior> {
        let active = self.layout.canonical(&mut x);
        let features = self.layout.features(&x, &active);
        self.process.covariances(self.context, &features, covariances);
        let mean = self.process.mean(covariances);
        let at_most = Posterior { mean, deviation: self.process.deviation_max(covariances) };
        if -confidence_bound(at_most, self.optimism.max(0.0)) <= floor {
            return ScoredPoint { x, score: f64::NEG_INFINITY, detail: at_most };
        }
        let belief = Posterior { mean, deviation: self.process.deviation(covariances) };
        ScoredPoint { x, score: -confidence_bound(belief, self.optimism), detail: belief }
    }

    /// The best of `known`, of random points and of the climbs from the best of both, without the points that
    /// `excludes` names: canonical coordinates, and their posterior.
    pub(super) fn search(
        &self,
        known: impl Iterator<Item = Vec<f64>>,
        random: &mut ChaCha8Rng,
        excludes: impl Fn(&[f64]) -> bool,
    ) -> Option<(Vec<f64>, Posterior)> {
        let dimension = self.layout.dimension();
        let mut covariances = Covariances::default();
        let mut leaders = Leaders::new(CLIMBERS);
        let anywhere: Vec<Vec<f64>> =
            (0..ANYWHERE).map(|_| (0..dimension).map(|_| random.random()).collect()).collect();
        for x in known.chain(anywhere) {
            let floor = leaders.floor();
            let candidate = self.judge(x, floor, &mut covariances);
            if candidate.score > floor && !leaders.contains(&candidate.x) && !excludes(&candidate.x) {
                leaders.offer(candidate);
            }
        }
        let mut moves = RandomAxes::new(self.layout, RADII, random);
        let climbed = leaders.into_candidates().into_iter().map(|start| {
            climb(start, CHANGES, &mut moves, |x, floor| {
                let changed = self.judge(x, floor, &mut covariances);
                (changed.score > floor && !excludes(&changed.x)).then_some(changed)
            })
        });
        best(climbed).map(|candidate| (candidate.x, candidate.detail))
    }
}
