//! The function approximation of paper section 6.2: features whose coefficients are trained by Greedy-GQ with
//! gamma = 0.
//!
//! The value of running action `a` in state `s` is `Q(s, a) = theta . phi(s, a)`. With gamma = 0 the update
//! of Greedy-GQ (Maei, Szepesvári, Bhatnagar and Sutton, ICML 2010) becomes
//! `theta += alpha (R - theta . phi) phi`, where the reward `R` is the inverse of the cost. Memory and time
//! are linear in the features and do not grow with the number of trials.

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::REWARD_COST_MIN;
use crate::matrix::dot;
use crate::predict::nearest::neighbours;
use crate::predict::rbf::Basis;
use crate::predict::rbf::candidates::{CandidateConfiguration, Candidates};
use crate::predict::{Answer, Estimate, Lesson, Predictor, PredictorSetup, Query};
use crate::search::Verdict;
use crate::space::Space;

/// The learning rate; the paper names none. A step never exceeds `1 / |phi|^2`, at which an update would
/// reproduce the reward exactly. Beyond twice this length updates diverge. Of the rates 0.03, 0.1, 0.3, 0.5
/// and 1, this is the smallest that learns a smooth cost from 6,000 trials about as well as the largest (mean
/// errors of the reward 0.108 and 0.106).
const ALPHA: f64 = 0.3;
/// Features whose squares sum to less than this lie beyond all centres, and teach nothing.
const SQUARE_MIN: f64 = 1e-200;

/// The model. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rbf {
    basis: Basis,
    theta: Vec<f64>,
    candidates: Candidates,
    /// Rewards learnt from, and the mean square by which they were missed before.
    tested: u64,
    miss_2: f64,
}

impl Rbf {
    /// An untrained model for `parameters` and `indicators`, its centres drawn from the study's seed.
    /// `omitted` are the places of indicators that it does not look at.
    pub fn new(parameters: usize, indicators: usize, seed: u64, omitted: &[usize]) -> Self {
        let basis = Basis::new(parameters, indicators, seed, omitted);
        let theta = vec![0.0; basis.len()];
        Rbf { basis, theta, candidates: Candidates::default(), tested: 0, miss_2: 0.0 }
    }

    pub(crate) fn for_study(setup: PredictorSetup<'_>) -> Self {
        Self::new(setup.space.dimension(), setup.indicators, setup.seed, setup.omitted)
    }

    /// The value of a state and an action: the inverse of the expected cost.
    fn value(&self, state_2: &[f64], action_2: &[f64], phi: &mut Vec<f64>) -> f64 {
        self.basis.features(state_2, action_2, phi);
        dot(&self.theta, phi)
    }

    /// The estimate of a value. A value that is not positive belongs to no cost: the model knows nothing. The
    /// deviation of the reward becomes that of its inverse to first order.
    fn expected(&self, value: f64) -> Option<Estimate> {
        let share = self.miss_2.sqrt() / value;
        let cost = 1.0 / value;
        (value > 0.0).then(|| Estimate::new(cost, cost * share))
    }
}

/// The inverse of the cost, held where sums of rewards stay finite.
fn reward(cost: f64) -> f64 {
    1.0 / cost.max(REWARD_COST_MIN)
}

impl Predictor for Rbf {
    fn has_features(&self) -> bool {
        true
    }

    fn settle(&mut self, space: &Space) -> bool {
        self.candidates.settle(space)
    }

    fn learn(&mut self, lesson: &Lesson<'_>) {
        let (state_2, action_2) = (self.basis.state_2(lesson.state), self.basis.action_2(lesson.point));
        let mut phi = Vec::with_capacity(self.basis.len());
        let value = self.value(&state_2, &action_2, &mut phi);
        let target = match lesson.verdict {
            Verdict::Cost(cost) => reward(cost),
            Verdict::Infeasible => 0.0,
            // The reward is at most this bound. A model whose value is below it learns nothing.
            Verdict::AtLeast(bound) => value.min(reward(bound)),
        };
        let square = dot(&phi, &phi);
        if square > SQUARE_MIN {
            let step = ALPHA.min(1.0 / square) * (target - value);
            self.theta.iter_mut().zip(&phi).for_each(|(theta, phi)| *theta += step * phi);
        }
        if let Verdict::Cost(cost) = lesson.verdict {
            self.tested += 1;
            self.miss_2 += ((target - value).powi(2) - self.miss_2) / self.tested as f64;
            self.candidates.keep(lesson, cost, action_2);
        }
    }

    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate> {
        let action_2 = self.basis.action_2(&query.space.encode(configuration));
        self.expected(self.value(&self.basis.state_2(query.state), &action_2, &mut Vec::new()))
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let state_2 = self.basis.state_2(query.state);
        let mut phi = Vec::with_capacity(self.basis.len());
        let mut best: Option<(&CandidateConfiguration, f64)> = None;
        for candidate in self.candidates.iter().filter(|candidate| !query.excludes(&candidate.configuration))
        {
            let value = self.value(&state_2, &candidate.action_2, &mut phi);
            if best.is_none_or(|(_, best_value)| value > best_value) {
                best = Some((candidate, value));
            }
        }
        let (candidate, value) = best?;
        let (configuration, expected) = (candidate.configuration.clone(), self.expected(value)?);
        Some(Answer { configuration, expected, neighbours: neighbours(query) })
    }
}

#[cfg(test)]
impl Rbf {
    pub(in crate::predict) fn is_finite(&self) -> bool {
        self.theta.iter().all(|theta| theta.is_finite()) && self.miss_2.is_finite()
    }

    pub(in crate::predict) fn value_at(&self, state: &[f64], point: &[f64]) -> f64 {
        self.value(&self.basis.state_2(state), &self.basis.action_2(point), &mut Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::limits::CANDIDATES_MAX;
    use crate::policy::PredictorMethod;
    use crate::predict::tests::{World, cost};

    fn lesson<'a>(
        state: &'a [f64],
        configuration: &'a Configuration,
        point: &'a [f64],
        verdict: Verdict,
    ) -> Lesson<'a> {
        Lesson { state, configuration, point, verdict, default_cost: None, machine: 0 }
    }

    fn space() -> Space {
        crate::predict::tests::space(3)
    }

    /// A second implementation, slow and plain: coefficients are trained one trial after the other, and the
    /// answer is the tried configuration of the highest value.
    #[test]
    fn answers_are_those_of_a_plain_walk_through_the_trials() {
        let centres = Rbf::new(3, 3, 11, &[]).basis.centres;
        let features = |state: &[f64; 3], point: &[f64]| -> Vec<f64> {
            let norm = |(s, a): &(Vec<f64>, Vec<f64>)| {
                let pairs = state.iter().zip(s).chain(point.iter().zip(a));
                pairs.map(|(x, c)| (x - c).powi(2)).sum::<f64>().sqrt()
            };
            centres.iter().map(|centre| (-norm(centre)).exp()).collect()
        };
        let (mut world, mut random) = (World::new(3, 3), ChaCha8Rng::seed_from_u64(9));
        let mut theta = vec![0.0; centres.len()];
        let mut tried: Vec<[f64; 3]> = Vec::new();
        let value = |theta: &[f64], phi: &[f64]| theta.iter().zip(phi).map(|(t, p)| t * p).sum::<f64>();
        for _ in 0..CANDIDATES_MAX / 4 {
            let state: [f64; 3] = std::array::from_fn(|_| random.random());
            for _ in 0..4 {
                let point: [f64; 3] = std::array::from_fn(|_| random.random());
                let cost = cost(&state, &point);
                world.measure(&state, &point, cost);
                let phi = features(&state, &point);
                let rate = 0.3_f64.min(1.0 / value(&phi, &phi));
                let step = rate * (1.0 / cost - value(&theta, &phi));
                theta.iter_mut().zip(&phi).for_each(|(theta, phi)| *theta += step * phi);
                tried.push(point);
            }
        }
        for _ in 0..200 {
            let asked: [f64; 3] = std::array::from_fn(|_| random.random());
            let of = |point: &[f64; 3]| value(&theta, &features(&asked, point));
            let best = tried.iter().max_by(|a, b| of(a).total_cmp(&of(b))).expect("some were tried");
            let answer = world.ask(PredictorMethod::RbfGreedyGq, &asked).expect("an answer");
            assert_eq!(answer.configuration, world.space.decode(best), "for {asked:?}");
            assert!((answer.expected.cost * of(best) - 1.0).abs() < 1e-9, "{:?}", answer.expected);
        }
    }

    #[test]
    fn infeasible_configurations_lose_their_value() {
        let (space, mut model) = (space(), Rbf::new(3, 2, 1, &[]));
        let (state, point) = ([0.2, 0.8], [0.4, 0.4, 0.4]);
        let configuration = space.decode(&point);
        for _ in 0..50 {
            model.learn(&lesson(&state, &configuration, &point, Verdict::Cost(2.0)));
        }
        let value = model.value_at(&state, &point);
        assert!((value - 0.5).abs() < 1e-3, "{value}");
        for _ in 0..20 {
            model.learn(&lesson(&state, &configuration, &point, Verdict::Infeasible));
        }
        assert!(model.value_at(&state, &point) < 0.3 * value);
        // A bound that the model respects already changes nothing.
        let untouched = model.clone();
        model.learn(&lesson(&state, &configuration, &point, Verdict::AtLeast(1e-9)));
        assert_eq!(model, untouched);
    }

    /// A plain step diverges beyond `2 / |phi|²`. With a hundred indicators and parameters all features are
    /// near one another, and with few they sum to dozens.
    #[test]
    fn no_step_diverges_whatever_the_features_sum_to() {
        for dimension in [1, 3, 60] {
            let space = crate::predict::tests::space(dimension);
            let mut model = Rbf::new(dimension, 40, 1, &[]);
            let (state, point) = (vec![0.5; 40], vec![0.5; dimension]);
            let configuration = space.decode(&point);
            let mut last = f64::INFINITY;
            for _ in 0..200 {
                model.learn(&lesson(&state, &configuration, &point, Verdict::Cost(1e-6)));
                let miss = (model.value_at(&state, &point) - 1e6).abs();
                assert!(miss <= last * (1.0 + 1e-9) + 1e-3, "{dimension}: {miss} after {last}");
                last = miss;
            }
            assert!(last < 0.9e6 && model.is_finite(), "{dimension}: {last}");
        }
    }
}
