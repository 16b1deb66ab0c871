//! Answers as the daemon gives them. How types of the model become messages stands in
//! `treewright_proto::convert`.

use treewright_core::configuration::{Configuration, RawConfiguration};
use treewright_core::trial::{Reason, Trial};
use treewright_core::tuner::{Best, Prediction};
use treewright_proto::convert::{
    WireEnum, configuration_to_wire, fingerprint_to_wire, outcome_to_wire, spec_to_wire, standing_to_wire,
    timestamp_to_wire,
};
use treewright_proto::v1;
use treewright_store::StudyRecord;

use super::insight;
use super::names::{study_name, trial_name};
use super::numbers::signed;

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
    let statistics = &record.statistics;
    v1::Study {
        name: study_name(&record.id),
        create_time: Some(timestamp_to_wire(record.create_ms)),
        statistics: Some(v1::StudyStatistics {
            states: signed(statistics.states),
            trials: signed(statistics.trials),
            completed_trials: signed(statistics.completed_trials),
            open_trials: signed(statistics.open_trials),
        }),
        ..spec_to_wire(&record.spec)
    }
}

/// A configuration.
#[must_use]
pub fn configuration(configuration: &impl Values) -> v1::Configuration {
    configuration_to_wire(configuration.values())
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
        mode: trial.mode().number(),
        predicted_cost: trial.predicted_cost,
        reason: Some(reason(&trial.reason())),
        lease_expire_time: Some(timestamp_to_wire(trial.lease_expire_ms)),
        state: trial.state.number(),
        measurements: trial.measurements.clone(),
        cost: trial.cost,
        outcome: trial.outcome.as_ref().map(outcome_to_wire),
        late: trial.late,
        create_time: Some(timestamp_to_wire(trial.create_ms)),
        complete_time: trial.complete_ms.map(timestamp_to_wire),
        fingerprint: trial.fingerprint.as_ref().map(fingerprint_to_wire),
        abort_above: trial.decision.abort_above(),
        origin: trial.decision.origin.clone().unwrap_or_default(),
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

/// What would be exploited.
#[must_use]
pub fn prediction(prediction: &Prediction) -> v1::PredictResponse {
    v1::PredictResponse {
        configuration: Some(configuration(&prediction.configuration)),
        mode: prediction.mode().number(),
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
        last_measure_time: Some(timestamp_to_wire(best.last_measure_ms)),
        standing: Some(standing_to_wire(&best.standing)),
    }
}
