//! The daemon's answers, under their resource names. `treewright_proto::convert` converts types of the model
//! to messages.

use treewright_core::trial::Trial;
use treewright_core::tuner::{Best, Prediction};
use treewright_proto::convert::{
    Values, WireEnum, configuration_to_wire, reason_to_wire, signed, spec_to_wire, standing_to_wire,
    timestamp_to_wire, trial_to_wire,
};
use treewright_proto::v1;
use treewright_store::StudyRecord;

use super::insight;
use super::names::{StudyName, study_name, trial_name};

/// A study with its counts.
pub fn study(record: &StudyRecord) -> v1::Study {
    let statistics = &record.statistics;
    v1::Study {
        name: study_name(&record.id),
        uid: record.uid.to_string(),
        space_revision: record.earlier.revision(),
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

/// A trial of a study, under the request's name of the study.
pub fn trial<C: Values>(study: &StudyName, trial: &Trial<C>) -> v1::Trial {
    trial_to_wire(trial_name(study, trial.number), trial)
}

/// A prediction.
pub fn prediction(prediction: &Prediction) -> v1::PredictResponse {
    v1::PredictResponse {
        configuration: Some(configuration_to_wire(&prediction.configuration)),
        mode: prediction.mode().number(),
        predicted_cost: prediction.predicted_cost,
        reason: Some(reason_to_wire(&prediction.reason())),
        state: prediction.insight.as_ref().map(insight::state),
    }
}

/// The best known configuration, or without its standing what takes its place.
pub fn best(study: &StudyName, best: &Best, is_best: bool) -> v1::Best {
    v1::Best {
        configuration: Some(configuration_to_wire(&best.configuration)),
        cost: best.cost,
        default_cost: best.default_cost,
        measurements: i32::try_from(best.measurements).unwrap_or(i32::MAX),
        state_id: signed(best.state_id),
        trial: trial_name(study, best.trial),
        last_measure_time: Some(timestamp_to_wire(best.last_measure_ms)),
        standing: is_best.then(|| standing_to_wire(&best.standing)),
    }
}
