//! The function approximation of paper section 6.2: radial basis functions whose coefficients are trained
//! by Greedy-GQ with gamma = 0.
//!
//! The value of running action `a` in state `s` is `Q(s, a) = theta . phi(s, a)` with features
//! `phi_i(x) = exp(-omega |x - c_i|)` of the concatenation `x = (s, a)` (the paper calls them Gaussians but
//! prints the norm without a square, and so do we), `omega = 1`, and centres `c_i` from a Latin hypercube.
//! There are 3.5 times as many features as parameters and indicators. With gamma = 0 the update of
//! Greedy-GQ (Maei, Szepesvári, Bhatnagar and Sutton, ICML 2010) becomes
//! `theta += alpha (R - theta . phi) phi`, where the reward `R` is the inverse of the cost. Memory and time
//! are linear in the features and do not grow with the number of trials.

use std::collections::HashMap;

use crate::configuration::Configuration;
use crate::limits::{CANDIDATES_MAX, REWARD_COST_MIN};
use crate::predict::nearest::neighbours;
use crate::predict::{Answer, Lesson, Predictor, Query};
use crate::randomness::{Purpose, stream};
use crate::search::Verdict;
use crate::search::latin_hypercube::design;

/// The widths of all features.
const OMEGA: f64 = 1.0;

/// The learning rate; the paper names none. A step never exceeds `1 / |phi|^2`, at which an update would
/// reproduce the reward exactly; beyond twice that, updates diverge. Of the rates 0.03, 0.1, 0.3, 0.5 and 1,
/// this is the smallest that learns a smooth cost from 6,000 trials about as well as the largest (mean errors
/// of the reward 0.108 and 0.106).
const ALPHA: f64 = 0.3;

/// A configuration that was seen to work, and may be chosen.
#[derive(Clone, Debug, PartialEq)]
struct Candidate {
    configuration: Configuration,
    /// The best cost it reached anywhere, over that of the default configuration in the same state.
    ratio: f64,
    /// The action's part of the squared distance to each centre.
    distances_2: Vec<f64>,
}

/// The model. See the head of this module.
#[derive(Clone, Debug, PartialEq)]
pub struct Rbf {
    /// The state's part and the action's part of each centre.
    centres: Vec<(Vec<f64>, Vec<f64>)>,
    theta: Vec<f64>,
    candidates: Vec<Candidate>,
    /// Only looked up, never walked, so its order does not matter.
    index: HashMap<Configuration, usize>,
}

/// `ceil(3.5 (parameters + indicators))`, in whole numbers.
pub fn feature_count(parameters: usize, indicators: usize) -> usize {
    (7 * (parameters + indicators)).div_ceil(2)
}

impl Rbf {
    /// An untrained model for `parameters` and `indicators`, its centres drawn from the study's seed.
    pub fn new(parameters: usize, indicators: usize, seed: u64) -> Self {
        let features = feature_count(parameters, indicators);
        let mut random = stream(seed, Purpose::Centres, 0, 0);
        let centres = design(features, indicators + parameters, &mut random);
        let halves = centres.into_iter().map(|mut state| {
            let action = state.split_off(indicators);
            (state, action)
        });
        Rbf {
            centres: halves.collect(),
            theta: vec![0.0; features],
            candidates: Vec::new(),
            index: HashMap::new(),
        }
    }

    /// The state's part of the squared distance to each centre.
    fn state_distances_2(&self, state: &[f64]) -> Vec<f64> {
        self.centres.iter().map(|(centre, _)| distance_2(state, centre)).collect()
    }

    fn action_distances_2(&self, point: &[f64]) -> Vec<f64> {
        self.centres.iter().map(|(_, centre)| distance_2(point, centre)).collect()
    }

    /// The value of a state and an action: the inverse of the cost to expect.
    fn value(&self, state_2: &[f64], action_2: &[f64]) -> f64 {
        self.theta.iter().zip(features(state_2, action_2)).map(|(theta, phi)| theta * phi).sum()
    }

    /// Keeps the configuration among those to choose from. When full, the one goes that fared worst
    /// against the default.
    fn keep(&mut self, lesson: &Lesson<'_>, cost: f64, distances_2: Vec<f64>) {
        let ratio = match lesson.default_cost {
            Some(default) if default > 0.0 => cost / default,
            _ => 1.0,
        };
        if let Some(&index) = self.index.get(lesson.configuration) {
            let candidate = &mut self.candidates[index];
            candidate.ratio = candidate.ratio.min(ratio);
            return;
        }
        let candidate = Candidate { configuration: lesson.configuration.clone(), ratio, distances_2 };
        let place = if self.candidates.len() < CANDIDATES_MAX {
            self.candidates.push(candidate);
            self.candidates.len() - 1
        } else {
            let by_ratio = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
            let ratios = self.candidates.iter().map(|candidate| candidate.ratio).enumerate();
            match ratios.max_by(by_ratio) {
                Some((worst, worst_ratio)) if ratio < worst_ratio => {
                    self.index.remove(&self.candidates[worst].configuration);
                    self.candidates[worst] = candidate;
                    worst
                }
                _ => return,
            }
        };
        self.index.insert(lesson.configuration.clone(), place);
    }
}

fn distance_2(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn features(state_2: &[f64], action_2: &[f64]) -> impl Iterator<Item = f64> {
    state_2.iter().zip(action_2).map(|(state, action)| (-OMEGA * (state + action).sqrt()).exp())
}

/// The inverse of the cost, held where sums of rewards stay finite.
fn reward(cost: f64) -> f64 {
    1.0 / cost.max(REWARD_COST_MIN)
}

impl Predictor for Rbf {
    fn learn(&mut self, lesson: &Lesson<'_>) {
        let (state_2, action_2) =
            (self.state_distances_2(lesson.state), self.action_distances_2(lesson.point));
        let phi: Vec<f64> = features(&state_2, &action_2).collect();
        let value: f64 = self.theta.iter().zip(&phi).map(|(theta, phi)| theta * phi).sum();
        let target = match lesson.verdict {
            Verdict::Cost(cost) => reward(cost),
            Verdict::Infeasible => 0.0,
            // The reward is at most this: there is nothing to learn while the model says so too.
            Verdict::AtLeast(bound) => value.min(reward(bound)),
        };
        let square: f64 = phi.iter().map(|phi| phi * phi).sum();
        // Far from all centres every feature is zero, and the trial teaches nothing.
        if square > f64::MIN_POSITIVE {
            let step = ALPHA.min(1.0 / square) * (target - value);
            for (theta, phi) in self.theta.iter_mut().zip(&phi) {
                *theta += step * phi;
            }
        }
        if let Verdict::Cost(cost) = lesson.verdict {
            self.keep(lesson, cost, action_2);
        }
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let state_2 = self.state_distances_2(query.state);
        let mut best: Option<(&Candidate, f64)> = None;
        for candidate in self.candidates.iter().filter(|candidate| !query.excludes(&candidate.configuration))
        {
            let value = self.value(&state_2, &candidate.distances_2);
            if best.is_none_or(|(_, best_value)| value > best_value) {
                best = Some((candidate, value));
            }
        }
        // A value that is not positive belongs to no cost: the model knows nothing here.
        let (candidate, value) = best.filter(|(_, value)| *value > 0.0)?;
        Some(Answer {
            configuration: candidate.configuration.clone(),
            predicted_cost: Some(1.0 / value).filter(|cost| cost.is_finite()),
            neighbours: neighbours(query),
        })
    }
}

#[cfg(test)]
impl Rbf {
    /// Whether every coefficient is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.theta.iter().all(|theta| theta.is_finite())
    }

    /// The value of a state and a point.
    pub(super) fn value_at(&self, state: &[f64], point: &[f64]) -> f64 {
        self.value(&self.state_distances_2(state), &self.action_distances_2(point))
    }
}
