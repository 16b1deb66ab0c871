//! What the models owe to trials that were learnt: fits, which take too long to be made where others wait.
//!
//! A trial is noted at once. What it has to say of the contextual model's lengths, and how far that model would have
//! been off it, takes a fit each; these are debts, in the order of the trials. Whoever has the time settles them, on a
//! copy, and hands in the result. Since they are settled in order, and each holds what it rests on, the outcome is
//! the same whenever that is.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::policy::PredictorMethod;
use crate::predict::blend::{Tallies, Words};
use crate::predict::contextual::{Exercise, Hyper, Question};
use crate::space::Space;

/// One of them.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Debt {
    /// To tell how far the predictors were off a measured cost. The words are complete but for that of the contextual
    /// model, which is yet to be asked.
    Test { words: Box<Words>, question: Option<Question>, configuration: Configuration, cost: f64 },
    /// To move the contextual model's lengths.
    Exercise(Exercise),
}

/// Debts, oldest first, with what they change, on a copy.
#[derive(Clone, Debug)]
pub struct Debts {
    pub(super) debts: Vec<Arc<Debt>>,
    pub(super) hyper: Option<Hyper>,
    pub(super) tallies: Tallies,
}

impl Debts {
    /// Settles them, each in some tenths of a millisecond.
    #[must_use = "what was settled is to be handed in"]
    pub fn settle(mut self, space: &Space) -> Settled {
        for debt in &self.debts {
            match &**debt {
                Debt::Test { words, question, configuration, cost } => {
                    let mut words = Words::clone(words);
                    if let (Some(question), Some(hyper)) = (question, &self.hyper) {
                        let said = question.estimate(hyper, space, configuration);
                        let own =
                            words.iter_mut().filter(|(method, _)| *method == PredictorMethod::Contextual);
                        own.for_each(|(_, word)| *word = said);
                    }
                    self.tallies.take(&words, *cost);
                }
                Debt::Exercise(exercise) => {
                    if let Some(hyper) = &mut self.hyper {
                        exercise.carry_out(hyper);
                    }
                }
            }
        }
        Settled(self)
    }
}

/// Debts that are settled, to be handed in.
#[derive(Clone, Debug)]
pub struct Settled(pub(super) Debts);
