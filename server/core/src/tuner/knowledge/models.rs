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
use crate::predict::{Lesson, Predictors};
use crate::search::Verdict;
use crate::space::Space;
use crate::study::StudySpec;
use crate::tuner::knowledge::states::States;

/// The models of a study.
#[derive(Clone, Debug)]
pub(crate) struct Models {
    pub(crate) predictors: Predictors,
    /// The completion after which they were begun.
    pub(crate) since: u64,
    /// Whether another caller computes deferred updates.
    pub(crate) defers: bool,
}

/// The lesson of a completed trial for a model.
pub(crate) struct Result<'a> {
    /// The normalised indicators the trial ran under.
    pub(crate) normalised: &'a [f64],
    pub(crate) state: StateId,
    pub(crate) configuration: &'a Configuration,
    pub(crate) verdict: Verdict,
}

impl Models {
    /// The models that a predictor needs, before they are taught anything.
    pub(crate) fn new(spec: &StudySpec, predictor: PredictorMethod, states: &States, since: u64) -> Self {
        Models { predictors: untaught(spec, predictor, states), since, defers: false }
    }

    /// Begins the models of a predictor from nothing, after a completion.
    pub(crate) fn begin(
        &mut self,
        spec: &StudySpec,
        predictor: PredictorMethod,
        states: &States,
        since: u64,
    ) {
        self.predictors = untaught(spec, predictor, states);
        self.since = since;
    }

    /// Computes deferred updates at once if no other caller does, or if too many are waiting.
    pub(crate) fn catch_up(&mut self, space: &Space) {
        if !self.defers || self.predictors.deferred_count() > DEFERRED_UPDATES_MAX {
            self.predictors.apply_all(space);
        }
    }

    /// Teaches the models a completed trial whose result the table of its state holds.
    pub(crate) fn teach(&mut self, spec: &StudySpec, states: &States, result: &Result<'_>) {
        let machine = states[result.state].machine;
        let at_home = |cost: f64| states.machines.translate(machine, FIRST, cost);
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
            machine: states.machines.number(machine),
        });
    }

    /// Rebuilds the models of features where the omitted indicators have changed, and teaches them the tables
    /// of the states that were met last.
    pub(crate) fn begin_features(&mut self, spec: &StudySpec, states: &States) {
        if !self.predictors.have_features() {
            return;
        }
        self.predictors.begin_features(untaught(spec, spec.policy.predictor, states));
        for state in states.latest(RELEARNT_MAX).into_iter().rev() {
            let known = &states[state];
            let at_home = |cost: f64| states.machines.translate(known.machine, FIRST, cost);
            let default = states.default_cost(state).map(at_home);
            for record in known.results.ranked() {
                self.predictors.learn_features(&Lesson {
                    state: &known.anchor,
                    configuration: &record.configuration,
                    point: &spec.space.encode(&record.configuration),
                    verdict: Verdict::Cost(at_home(record.mean_cost)),
                    default_cost: default,
                    machine: states.machines.number(known.machine),
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
