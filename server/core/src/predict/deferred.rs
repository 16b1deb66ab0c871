//! Deferred updates: what learning a trial leaves to be computed later, because it takes a fit.
//!
//! A trial is noted at once. What it has to say of the contextual model's lengths, and how far that model would have
//! been off it, takes a fit each; these are deferred, in the order of the trials. Whoever has the time computes them,
//! on a copy, and the result is applied. Since they are computed in order, and each holds what it rests on, the
//! outcome is the same whenever that is.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::gp::Hyperparameters;
use crate::policy::PredictorMethod;
use crate::predict::blend::{Tallies, Word};
use crate::predict::contextual::{Exercise, Question};
use crate::space::Space;

/// One of them.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum DeferredUpdate {
    /// To tell how far the predictors were off a measured cost. The words are complete but for that of the contextual
    /// model, which is yet to be asked.
    Test { words: Vec<Word>, question: Option<Question>, configuration: Configuration, cost: f64 },
    /// To move the contextual model's lengths.
    Exercise(Exercise),
}

/// Deferred updates, oldest first, with what they change, on a copy.
#[derive(Clone, Debug)]
pub struct DeferredUpdates {
    pub(super) updates: Vec<Arc<DeferredUpdate>>,
    pub(super) hyper: Option<Hyperparameters>,
    pub(super) tallies: Tallies,
}

impl DeferredUpdates {
    /// Computes them, each in some tenths of a millisecond.
    #[must_use = "what was computed is to be applied"]
    pub fn compute(mut self, space: &Space) -> ComputedUpdates {
        for update in &self.updates {
            match &**update {
                DeferredUpdate::Test { words, question, configuration, cost } => {
                    let mut words = words.clone();
                    if let (Some(question), Some(hyper)) = (question, &self.hyper) {
                        let said = question.estimate(hyper, space, configuration);
                        let own =
                            words.iter_mut().filter(|(method, _)| *method == PredictorMethod::Contextual);
                        own.for_each(|(_, word)| *word = said);
                    }
                    self.tallies.take(&words, *cost);
                }
                DeferredUpdate::Exercise(exercise) => {
                    if let Some(hyper) = &mut self.hyper {
                        exercise.carry_out(hyper);
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
