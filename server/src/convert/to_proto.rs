//! Domain to wire.

use prost_types::Timestamp;
use treewright_core::configuration::{Configuration, RawConfiguration};
use treewright_core::indicator::Indicator;
use treewright_core::policy::{Operation, Policy, PredictorMethod, SearchMethod};
use treewright_core::space::{Condition, Domain, Parameter, Scale, Space};
use treewright_core::trial::{Fingerprint, Mode, Outcome, Reason, Trial, TrialState};
use treewright_core::tuner::{Best, Prediction};
use treewright_core::value::Value;
use treewright_proto::v1;
use treewright_store::StudyRecord;

use super::insight;
use super::names::{study_name, trial_name};

/// A configuration's values, checked or not.
pub trait Values {
    /// The values by parameter.
    fn values(&self) -> &RawConfiguration;
}

impl Values for Configuration {
    fn values(&self) -> &RawConfiguration {
        Configuration::values(self)
    }
}

impl Values for RawConfiguration {
    fn values(&self) -> &RawConfiguration {
        self
    }
}

/// A study with its counts.
#[must_use]
pub fn study(record: &StudyRecord) -> v1::Study {
    let spec = &record.spec;
    let terms = spec.objective.terms().iter();
    let statistics = &record.statistics;
    v1::Study {
        name: study_name(&record.id),
        display_name: spec.display_name.clone(),
        space: Some(space(&spec.space)),
        indicators: spec.indicators.indicators().iter().map(indicator).collect(),
        objective: Some(v1::Objective {
            terms: terms
                .map(|term| v1::ObjectiveTerm { metric: term.metric.clone(), weight: term.weight })
                .collect(),
        }),
        state_tolerance: Some(spec.state_tolerance),
        policy: Some(policy(&spec.policy)),
        seed: spec.seed,
        create_time: Some(timestamp(record.create_ms)),
        statistics: Some(v1::StudyStatistics {
            states: signed(statistics.states),
            trials: signed(statistics.trials),
            completed_trials: signed(statistics.completed_trials),
            open_trials: signed(statistics.open_trials),
        }),
        policy_differs: Vec::new(),
    }
}

fn space(space: &Space) -> v1::Space {
    let constraints = space.constraints().iter();
    v1::Space {
        parameters: space.parameters().iter().map(parameter).collect(),
        constraints: constraints
            .map(|constraint| v1::Constraint {
                lesser: constraint.lesser.clone(),
                greater: constraint.greater.clone(),
            })
            .collect(),
    }
}

fn parameter(parameter: &Parameter) -> v1::Parameter {
    use v1::parameter::Domain as Wire;
    let domain = match &parameter.domain {
        Domain::Integer { min, max, scale } => {
            Wire::Integer(v1::IntegerDomain { min: *min, max: *max, scale: self::scale(*scale).into() })
        }
        Domain::Float { min, max, scale } => {
            Wire::Float(v1::FloatDomain { min: *min, max: *max, scale: self::scale(*scale).into() })
        }
        Domain::Categorical { values } => {
            Wire::Categorical(v1::CategoricalDomain { values: values.iter().map(value).collect() })
        }
        Domain::Boolean => Wire::Boolean(v1::BooleanDomain {}),
    };
    v1::Parameter {
        name: parameter.name.clone(),
        domain: Some(domain),
        default_value: Some(value(&parameter.default)),
        active_if: parameter.active_if.as_ref().map(condition),
    }
}

fn condition(condition: &Condition) -> v1::Condition {
    v1::Condition {
        parameter: condition.parameter.clone(),
        any_of: condition.any_of.iter().map(value).collect(),
    }
}

fn indicator(indicator: &Indicator) -> v1::Indicator {
    v1::Indicator {
        name: indicator.name.clone(),
        min: indicator.min,
        max: indicator.max,
        scale: scale(indicator.scale).into(),
    }
}

fn scale(scale: Scale) -> v1::Scale {
    match scale {
        Scale::Linear => v1::Scale::Linear,
        Scale::Log => v1::Scale::Log,
    }
}

pub(super) fn policy(policy: &Policy) -> v1::Policy {
    v1::Policy {
        epsilon: Some(policy.epsilon),
        search: match policy.search {
            SearchMethod::NelderMead => v1::SearchMethod::NelderMead,
            SearchMethod::LatinHypercube => v1::SearchMethod::LatinHypercube,
            SearchMethod::Random => v1::SearchMethod::Random,
            SearchMethod::Model => v1::SearchMethod::Model,
            SearchMethod::Auto => v1::SearchMethod::Auto,
        }
        .into(),
        predictor: match policy.predictor {
            PredictorMethod::NearestNeighbour => v1::PredictorMethod::NearestNeighbour,
            PredictorMethod::RbfGreedyGq => v1::PredictorMethod::RbfGreedyGq,
            PredictorMethod::Auto => v1::PredictorMethod::Auto,
            PredictorMethod::WeightedNeighbours => v1::PredictorMethod::WeightedNeighbours,
            PredictorMethod::GaussianGreedyGq => v1::PredictorMethod::GaussianGreedyGq,
            PredictorMethod::LeastSquares => v1::PredictorMethod::LeastSquares,
            PredictorMethod::Contextual => v1::PredictorMethod::Contextual,
        }
        .into(),
        trials_per_state: small(policy.trials_per_state),
        replicates: small(policy.replicates),
        lease_s: small(policy.lease_s),
        pinned: policy.pinned.as_ref().map(configuration),
        epsilon_halves_after: small(policy.epsilon_halves_after),
        regret_budget: policy.regret_budget,
        abort_above: policy.abort_above,
        worst_factor: Some(policy.worst_factor),
        operation: match policy.operation {
            Operation::Tune => v1::Operation::Tune,
            Operation::Freeze => v1::Operation::Freeze,
            Operation::Shadow => v1::Operation::Shadow,
        }
        .into(),
        weigh_gain: policy.weigh_gain,
        freeze_risk: policy.freeze_risk,
        warm_up: small(policy.warm_up),
        roll_back: Some(policy.roll_back),
    }
}

/// A value of a parameter.
#[must_use]
pub fn value(value: &Value) -> v1::Value {
    use v1::value::Kind;
    let kind = match value {
        Value::Integer(integer) => Kind::Integer(*integer),
        Value::Float(float) => Kind::Float(*float),
        Value::Text(text) => Kind::Text(text.clone()),
        Value::Boolean(boolean) => Kind::Boolean(*boolean),
    };
    v1::Value { kind: Some(kind) }
}

/// A configuration.
#[must_use]
pub fn configuration(configuration: &impl Values) -> v1::Configuration {
    let values = configuration.values().iter();
    v1::Configuration { values: values.map(|(name, v)| (name.clone(), value(v))).collect() }
}

/// A trial of a study.
#[must_use]
pub fn trial<C: Values>(study: &str, trial: &Trial<C>) -> v1::Trial {
    v1::Trial {
        name: trial_name(study, trial.number),
        client_id: trial.client_id.clone(),
        state_id: signed(trial.state_id),
        indicators: trial.indicators.clone(),
        configuration: Some(configuration(&trial.configuration)),
        mode: mode(trial.mode()).into(),
        predicted_cost: trial.predicted_cost,
        reason: Some(reason(&trial.reason())),
        lease_expire_time: Some(timestamp(trial.lease_expire_ms)),
        state: match trial.state {
            TrialState::Open => v1::TrialState::Open,
            TrialState::Completed => v1::TrialState::Completed,
            TrialState::Abandoned => v1::TrialState::Abandoned,
            TrialState::Expired => v1::TrialState::Expired,
        }
        .into(),
        measurements: trial.measurements.clone(),
        cost: trial.cost,
        outcome: trial.outcome.as_ref().map(outcome),
        late: trial.late,
        create_time: Some(timestamp(trial.create_ms)),
        complete_time: trial.complete_ms.map(timestamp),
        fingerprint: trial.fingerprint.as_ref().map(fingerprint),
        abort_above: trial.decision.abort_above(),
    }
}

fn mode(mode: Mode) -> v1::Mode {
    match mode {
        Mode::Default => v1::Mode::Default,
        Mode::Explore => v1::Mode::Explore,
        Mode::Exploit => v1::Mode::Exploit,
        Mode::Pinned => v1::Mode::Pinned,
    }
}

fn reason(reason: &Reason) -> v1::Reason {
    let neighbours = reason.neighbours.iter();
    v1::Reason {
        summary: reason.summary.clone(),
        source: reason.source.clone(),
        step: reason.step.clone(),
        neighbours: neighbours
            .map(|neighbour| v1::Neighbour {
                state_id: signed(neighbour.state_id),
                distance: neighbour.distance,
                best_cost: neighbour.best_cost,
            })
            .collect(),
        explanation: (!reason.explanation.is_empty()).then(|| insight::explanation(&reason.explanation)),
    }
}

fn outcome(outcome: &Outcome) -> v1::Outcome {
    use v1::outcome::Kind;
    let kind = match outcome {
        Outcome::Ok => Kind::Ok(v1::Ok {}),
        Outcome::Infeasible { reason } => Kind::Infeasible(v1::Infeasible { reason: reason.clone() }),
        Outcome::Aborted { lower_bound } => Kind::Aborted(v1::Aborted { lower_bound: *lower_bound }),
        Outcome::Failed { reason } => Kind::Failed(v1::Failed { reason: reason.clone() }),
    };
    v1::Outcome { kind: Some(kind) }
}

fn fingerprint(fingerprint: &Fingerprint) -> v1::Fingerprint {
    v1::Fingerprint {
        cpu_model: fingerprint.cpu_model.clone(),
        isa: fingerprint.isa.clone(),
        threads: small(fingerprint.threads),
        software: fingerprint.software.clone(),
    }
}

/// What would be exploited.
#[must_use]
pub fn prediction(prediction: &Prediction) -> v1::PredictResponse {
    v1::PredictResponse {
        configuration: Some(configuration(&prediction.configuration)),
        mode: mode(prediction.mode()).into(),
        predicted_cost: prediction.predicted_cost,
        reason: Some(reason(&prediction.reason())),
        state: prediction.insight.as_ref().map(insight::state),
    }
}

/// The best known configuration.
#[must_use]
pub fn best(study: &str, best: &Best) -> v1::Best {
    v1::Best {
        configuration: Some(configuration(&best.configuration)),
        cost: best.cost,
        default_cost: best.default_cost,
        measurements: i32::try_from(best.measurements).unwrap_or(i32::MAX),
        state_id: signed(best.state_id),
        trial: trial_name(study, best.trial),
        last_measure_time: Some(timestamp(best.last_measure_ms)),
    }
}

/// Milliseconds since 1970 as the wire has them.
fn timestamp(ms: i64) -> Timestamp {
    Timestamp {
        seconds: ms.div_euclid(1000),
        // Below 10^9.
        nanos: (ms.rem_euclid(1000) * 1_000_000) as i32,
    }
}

/// Counts and ids never come near the end of the range.
pub(super) fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

fn small(number: u32) -> i32 {
    i32::try_from(number).unwrap_or(i32::MAX)
}
