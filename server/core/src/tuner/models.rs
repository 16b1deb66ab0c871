//! The models of a study's predictor: teaching them trials, and the updates that are deferred.
//!
//! Invariants: only the models of the policy's predictor are kept; they know the trials that were completed
//! after [`Models::since`], and the last ones before. Learning a trial is quick. Long fits are deferred
//! updates, which any caller with time computes apart, on a copy. They are computed in the order of the
//! trials, and each holds its own inputs, so the outcome does not depend on the moment.

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{DEFERRED_UPDATES_MAX, RELEARNT_MAX};
use crate::machines::FIRST;
use crate::policy::PredictorMethod;
use crate::predict::prequential::ErrorInterval;
use crate::predict::{ComputedUpdates, DeferredUpdates, Lesson, Predictors, Query};
use crate::search::Verdict;
use crate::space::Space;
use crate::study::StudySpec;
use crate::tuner::states::States;

/// The models of a study.
#[derive(Clone, Debug)]
pub(super) struct Models {
    predictors: Predictors,
    /// The completion after which they were begun.
    since: u64,
    /// Whether another caller computes deferred updates.
    defers: bool,
}

/// The lesson of a completed trial for a model.
pub(super) struct Result<'a> {
    /// The normalised indicators the trial ran under.
    pub(super) normalised: &'a [f64],
    pub(super) state: StateId,
    pub(super) configuration: &'a Configuration,
    pub(super) verdict: Verdict,
}

impl Models {
    /// The models that a predictor needs, before they are taught anything.
    pub(super) fn new(spec: &StudySpec, predictor: PredictorMethod, states: &States, since: u64) -> Self {
        Models { predictors: untaught(spec, predictor, states), since, defers: false }
    }

    /// Begins the models of a predictor from nothing, after a completion.
    pub(super) fn begin(
        &mut self,
        spec: &StudySpec,
        predictor: PredictorMethod,
        states: &States,
        since: u64,
    ) {
        self.predictors = untaught(spec, predictor, states);
        self.since = since;
    }

    /// Takes over models that were begun after the same completion and taught since.
    pub(super) fn take_over(&mut self, predictors: Predictors) {
        self.predictors = predictors;
    }

    /// The predictors, which answer and propose.
    pub(super) fn predictors(&self) -> &Predictors {
        &self.predictors
    }

    /// The completion after which the models were begun.
    pub(super) fn since(&self) -> u64 {
        self.since
    }

    /// The mean error of each predictor, with its 95 % interval.
    pub(super) fn errors(&self) -> Vec<(PredictorMethod, ErrorInterval)> {
        self.predictors.errors()
    }

    /// From now on another caller computes deferred updates.
    pub(super) fn defer(&mut self) {
        self.defers = true;
    }

    /// Whether another caller computes deferred updates.
    #[cfg(test)]
    pub(super) fn defers(&self) -> bool {
        self.defers
    }

    /// The updates that were put off, to be computed apart; `None` where there are none.
    pub(super) fn deferred(&self) -> Option<DeferredUpdates> {
        self.predictors.deferred()
    }

    /// Whether updates were put off.
    pub(super) fn has_deferred(&self) -> bool {
        self.predictors.deferred_count() > 0
    }

    /// Takes over updates that were computed apart, unless another caller was faster.
    pub(super) fn apply(&mut self, updates: ComputedUpdates) {
        self.predictors.apply(updates);
    }

    /// Computes deferred updates at once if no other caller does, or if too many are waiting.
    pub(super) fn catch_up(&mut self, space: &Space) {
        if !self.defers || self.predictors.deferred_count() > DEFERRED_UPDATES_MAX {
            self.predictors.apply_all(space);
        }
    }

    /// Compares a measured cost with each predictor's prediction, before the trial is learnt.
    pub(super) fn test(&mut self, query: &Query<'_>, configuration: &Configuration, cost: f64) {
        self.predictors.test(query, configuration, cost);
    }

    /// Teaches the models a completed trial whose result the table of its state holds.
    pub(super) fn teach(&mut self, spec: &StudySpec, states: &States, result: &Result<'_>) {
        let machine = states[result.state].machine;
        let at_home = |cost: f64| states.machines().translate(machine, FIRST, cost);
        self.predictors.learn(&Lesson {
            state: result.normalised,
            configuration: result.configuration,
            point: &spec.space.encode(result.configuration),
            verdict: match result.verdict {
                Verdict::Cost(cost) => Verdict::Cost(at_home(cost)),
                Verdict::AtLeast(bound) => Verdict::AtLeast(at_home(bound)),
                Verdict::Infeasible => Verdict::Infeasible,
            },
            default_cost: states.default_cost(result.state).map(at_home),
            origin: states.machines().origin(machine),
        });
    }

    /// Rebuilds the models of features where the omitted indicators have changed, and teaches them the tables
    /// of the states that were met last.
    pub(super) fn begin_features(&mut self, spec: &StudySpec, states: &States) {
        if !self.predictors.have_features() {
            return;
        }
        self.predictors.begin_features(untaught(spec, spec.policy.predictor, states));
        for state in states.latest(RELEARNT_MAX).into_iter().rev() {
            let known = &states[state];
            let at_home = |cost: f64| states.machines().translate(known.machine, FIRST, cost);
            let default = states.default_cost(state).map(at_home);
            for record in known.results.ranked() {
                self.predictors.learn_features(&Lesson {
                    state: &known.anchor,
                    configuration: &record.configuration,
                    point: &spec.space.encode(&record.configuration),
                    verdict: Verdict::Cost(at_home(record.mean_cost)),
                    default_cost: default,
                    origin: states.machines().origin(known.machine),
                });
            }
        }
    }
}

fn untaught(spec: &StudySpec, predictor: PredictorMethod, states: &States) -> Predictors {
    let indicators = spec.indicators.indicators().len();
    let omitted: Vec<usize> = states.omitted_indicators().iter().map(|omitted| omitted.axis).collect();
    Predictors::new(predictor, &spec.space, indicators, spec.seed, &omitted)
}
