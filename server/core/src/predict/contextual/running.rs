//! The probability that a configuration can be run in a state, by the configurations that ran and that failed
//! near by.
//!
//! A Gaussian process over states and configurations is fitted to 1 for failures and 0 for successes, as in
//! the search of one state ([`model`](crate::search::ModelSearch)): a configuration that fails in one state
//! is likely to fail in similar ones. Without failures there is nothing to fit, and the probability follows
//! from the number of successes.

use crate::gp::acquisition::probability_below;
use crate::gp::{Hyperparameters, Prior, Process, Sample, Schedule, SharedFeatures};
use crate::predict::contextual::FeatureMap;
use crate::predict::runs_after;

/// Steps of ascent of the process' likelihood.
const STEPS: usize = 10;
/// Limits of feasibility are sharp. Their relevant features differ from study to study.
const PRIOR: Prior = Prior {
    length_mean: 0.5,
    length_spread: 1.0,
    weight_range: [1e-6, 1e6],
    noise_mean: 0.01,
    noise_spread: 1.0,
    noise_range: [1e-6, 0.25],
    squares: 1e-3,
    step_max: 1.0,
};

/// The successes and failures near by, as points of a process.
#[derive(Debug, Default)]
pub(super) struct Runs {
    pub(super) points: Vec<Vec<f64>>,
    pub(super) failed: Vec<bool>,
    pub(super) counts: Vec<f64>,
}

/// The belief about points in one state.
pub(super) struct Running {
    model: Option<(Process, SharedFeatures)>,
    ran: usize,
    failed: bool,
}

impl Running {
    /// Fits the process where anything failed. `state` are the features that all asked points share.
    pub(super) fn of(features: &FeatureMap, runs: Runs, state: &[f64]) -> Self {
        let Runs { points, failed, counts } = runs;
        assert!(points.len() == failed.len() && counts.len() == failed.len(), "{} points", failed.len());
        let ran = failed.iter().filter(|failed| !**failed).count();
        if ran == failed.len() {
            return Running { model: None, ran, failed: false };
        }
        let labels: Vec<f64> = failed.iter().map(|&failed| f64::from(u8::from(failed))).collect();
        let points: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
        let sample = Sample::new(features.kinds.clone(), &points, counts).prepared();
        let mut hyper = Hyperparameters::new(&features.kinds, &PRIOR);
        let schedule = Schedule { steps: STEPS, ahead: false };
        let fit = Process::learn(sample, &[(labels, 0.0)], &mut hyper, &PRIOR, schedule);
        let model = fit.map(|(process, _)| {
            let context = process.context(state);
            (process, context)
        });
        // A process that cannot be fitted vouches for no configuration.
        Running { ran: if model.is_some() { ran } else { 0 }, model, failed: true }
    }

    /// Whether anything failed near by.
    pub(super) fn knows_failures(&self) -> bool {
        self.failed
    }

    /// The probability that a point can be run.
    pub(super) fn probability(&self, features: &[f64]) -> f64 {
        match &self.model {
            Some((process, context)) => {
                probability_below(0.5, process.at(context, features), process.noise())
            }
            None => runs_after(self.ran),
        }
    }
}
