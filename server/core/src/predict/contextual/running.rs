//! The probability that a configuration can be run in a state, by the configurations that ran and that failed
//! near by.
//!
//! A Gaussian process over states and configurations is fitted to 1 for failures and 0 for successes, as in
//! the search of one state ([`model`](crate::search::ModelSearch)). A configuration that fails in one state
//! is likely to fail in similar ones. Without failures there is nothing to fit, and the probability follows
//! from the number of configurations that ran. It says nothing of those beyond the range of all that ran.

use std::cmp::Ordering;

use crate::gp::acquisition::probability_below;
use crate::gp::kernel::{FeatureKind, INACTIVE};
use crate::gp::{Hyperparameters, Prior, Process, Sample, Schedule, SharedFeatures};
use crate::predict::contextual::FeatureMap;
use crate::predict::runs_after;

/// Steps of ascent of the process' likelihood.
const STEPS: usize = 10;
/// Limits of feasibility are sharp. Their relevant features differ from study to study.
const PRIOR: Prior = Prior { noise_mean: 0.01, noise_spread: 1.0, noise_range: [1e-6, 0.25], ..Prior::WEAK };

/// A point of the process that was tried near by, whether it failed, and its weight.
pub(super) type NearRun = (Vec<f64>, bool, f64);

/// The belief about points in one state.
pub(super) struct Running {
    model: Option<(Process, SharedFeatures)>,
    /// The kinds of a configuration's features, and the configurations that ran, each once.
    kinds: Vec<FeatureKind>,
    ran: Vec<Vec<f64>>,
    /// Whether anything failed near by.
    pub(super) failed: bool,
}

impl Running {
    /// Fits the process where anything failed. `state` are the features that all asked points share.
    pub(super) fn of(features: &FeatureMap, runs: &[NearRun], state: &[f64]) -> Self {
        // The first feature of every axis. The others say again which of some numbers it is.
        let mut kinds = features.layout.kinds();
        kinds.truncate(features.layout.dimension());
        let ran = runs.iter().filter(|(_, failed, _)| !failed);
        let mut ran: Vec<Vec<f64>> = ran.map(|(point, ..)| point[state.len()..].to_vec()).collect();
        if ran.len() == runs.len() {
            // That one configuration runs in many states says little of others.
            ran.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
            ran.dedup();
            return Running { model: None, kinds, ran, failed: false };
        }
        let labels: Vec<f64> = runs.iter().map(|(_, failed, _)| f64::from(u8::from(*failed))).collect();
        let points: Vec<&[f64]> = runs.iter().map(|(point, ..)| point.as_slice()).collect();
        let counts = runs.iter().map(|(.., count)| *count).collect();
        let sample = Sample::new(features.kinds.clone(), &points, counts).prepared();
        let mut hyper = Hyperparameters::new(&features.kinds, &PRIOR);
        let schedule = Schedule { steps: STEPS, ahead: false };
        let fit = Process::learn(sample, &[(labels, 0.0)], &mut hyper, &PRIOR, schedule);
        let model = fit.map(|(process, _)| {
            let context = process.context(state);
            (process, context)
        });
        // A process that cannot be fitted vouches for no configuration.
        Running { model, kinds, ran: Vec::new(), failed: true }
    }

    pub(super) fn probability(&self, features: &[f64]) -> f64 {
        match &self.model {
            Some((process, context)) => probability_below(0.5, process.at(context, features), process.noise),
            None => runs_after(self.ran.len()),
        }
    }

    /// Whether a configuration lies within the range of all that ran, parameter by parameter: numbers between
    /// two that ran, choices among those that ran, and inactive only what was inactive before.
    pub(super) fn encloses(&self, features: &[f64]) -> bool {
        let is_met = |(axis, kind): (usize, &FeatureKind)| {
            let (x, ran) = (features[axis], || self.ran.iter().map(move |ran| ran[axis]));
            if *kind != FeatureKind::Ordered || x == INACTIVE {
                return ran().any(|other| other == x);
            }
            // An inactive number lies below all others.
            let is_below = |other: f64| other != INACTIVE && other <= x;
            ran().any(is_below) && ran().any(|other| other >= x)
        };
        self.kinds.iter().enumerate().all(is_met)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::space::Space;

    /// A choice, a number that only its second value has, and a number that all have.
    fn features() -> Arc<FeatureMap> {
        let space = Space::builder()
            .categorical("kind", ["flat", "deep", "other"])
            .default("flat")
            .integer("depth", 1..=9)
            .default(1)
            .active_if("kind", ["deep"])
            .float("x", 0.0..=1.0)
            .default(0.5)
            .build();
        FeatureMap::of(&space.expect("it is sound"), 1)
    }

    /// The belief after each of these points of the cube ran in some states.
    fn after(features: &FeatureMap, ran: &[[f64; 3]], states: usize) -> Running {
        let mut runs = Vec::new();
        for (point, state) in ran.iter().flat_map(|point| (0..states).map(move |state| (point, state))) {
            let point = [&[state as f64, 0.0][..], &features.features(point)[..]].concat();
            runs.push((point, false, 1.0));
        }
        Running::of(features, &runs, &[0.5, 0.0])
    }

    #[test]
    fn one_configuration_in_many_states_says_little_of_others() {
        let features = features();
        let asked = features.features(&[0.1, 0.5, 0.5]);
        let probability = |ran: &[[f64; 3]], states| after(&features, ran, states).probability(&asked);
        assert_eq!(probability(&[[0.1, 0.5, 0.2]], 9), runs_after(1));
        // What is inactive makes no other configuration.
        assert_eq!(probability(&[[0.1, 0.2, 0.2], [0.1, 0.9, 0.2], [0.1, 0.9, 0.3]], 3), runs_after(2));
    }

    #[test]
    fn what_ran_encloses_what_lies_between_parameter_by_parameter() {
        let features = features();
        let ran = [[0.1, 0.5, 0.2], [0.5, 0.3, 0.4], [0.5, 0.7, 0.3]];
        let encloses = |point: [f64; 3]| after(&features, &ran, 1).encloses(&features.features(&point));
        for inside in [[0.1, 0.5, 0.4], [0.5, 0.5, 0.2], [0.5, 0.3, 0.3], [0.5, 0.7, 0.25]] {
            assert!(encloses(inside), "{inside:?}");
        }
        for outside in
            [[0.1, 0.5, 0.41], [0.1, 0.5, 0.19], [0.9, 0.5, 0.3], [0.5, 0.05, 0.3], [0.5, 0.95, 0.3]]
        {
            assert!(!encloses(outside), "{outside:?}");
        }
        assert!(!after(&features, &[], 1).encloses(&features.features(&[0.1, 0.5, 0.2])), "nothing ran");
    }
}
