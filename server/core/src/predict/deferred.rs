//! Deferred updates: the parts of learning a trial that take a fit, and are computed later.
//!
//! A trial is noted at once. Two things take a fit of the contextual model each: the update of its lengths,
//! and its error on the trial's cost. Both are deferred, in the order of the trials, and computed on a copy
//! while no client waits; then the result is applied. The outcome does not depend on the moment, because
//! updates are computed in order and each holds its inputs.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::gp::Hyperparameters;
use crate::policy::PredictorMethod;
use crate::predict::contextual::{HyperparameterUpdate, LocalData};
use crate::predict::errors::{MethodEstimate, PredictorErrors};
use crate::space::Space;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum DeferredUpdate {
    /// To add the predictors' errors on a measured cost to their tallies. The prediction of the contextual
    /// model is still to be computed, the others are complete.
    Test {
        words: Vec<MethodEstimate>,
        local_data: Option<LocalData>,
        configuration: Configuration,
        cost: f64,
    },
    Hyperparameters(HyperparameterUpdate),
}

/// Deferred updates, oldest first, with a copy of the predictors that they change.
#[derive(Clone, Debug)]
pub struct DeferredUpdates {
    pub(super) updates: Vec<Arc<DeferredUpdate>>,
    pub(super) hyper: Option<Hyperparameters>,
    pub(super) tallies: PredictorErrors,
}

impl DeferredUpdates {
    /// Computes them, each in some tenths of a millisecond.
    #[must_use = "what was computed is to be applied"]
    pub fn compute(mut self, space: &Space) -> ComputedUpdates {
        for update in &self.updates {
            match &**update {
                DeferredUpdate::Test { words, local_data, configuration, cost } => {
                    let mut words = words.clone();
                    if let (Some(local_data), Some(hyper)) = (local_data, &self.hyper) {
                        let said = local_data.estimate(hyper, space, configuration);
                        let own =
                            words.iter_mut().filter(|(method, _)| *method == PredictorMethod::Contextual);
                        own.for_each(|(_, word)| *word = said);
                    }
                    self.tallies.take(&words, *cost);
                }
                DeferredUpdate::Hyperparameters(update) => {
                    if let Some(hyper) = &mut self.hyper {
                        update.apply(hyper);
                    }
                }
            }
        }
        ComputedUpdates(self)
    }
}

/// Deferred updates that were computed, to be applied.
#[derive(Clone, Debug)]
pub struct ComputedUpdates(pub(super) DeferredUpdates);
