//! Conversions of trials and of questions about them.

use treewright_proto::convert::{
    fingerprint_from_wire, outcome_from_wire, readable_configuration, standing_from_wire,
};
use treewright_proto::v1;

use super::{Problem, insight, time_from_wire, usable_configuration, word};
use crate::{Best, Indicators, Neighbour, OpenEnum, Prediction, Reason, TrialRecord};

pub(crate) fn trial_from_wire(trial: v1::Trial) -> Result<TrialRecord, Problem> {
    if trial.name.is_empty() {
        return Err("a trial without a name".into());
    }
    let (configuration, unreadable) = readable_configuration(trial.configuration.unwrap_or_default());
    Ok(TrialRecord {
        client_id: trial.client_id,
        state_id: trial.state_id,
        indicators: Indicators(trial.indicators),
        configuration: configuration.into(),
        unreadable,
        mode: word(trial.mode),
        predicted_cost: trial.predicted_cost,
        reason: reason_from_wire(trial.reason),
        lease_expire_time: time_from_wire(trial.lease_expire_time),
        state: word(trial.state),
        measurements: trial.measurements.into_iter().collect(),
        standard_errors: trial.standard_errors.into_iter().collect(),
        cost: trial.cost,
        outcome: trial
            .outcome
            .map(|outcome| outcome_from_wire(outcome).map_or(OpenEnum::Unrecognised(0), OpenEnum::Known)),
        late: trial.late,
        create_time: time_from_wire(trial.create_time),
        complete_time: time_from_wire(trial.complete_time),
        fingerprint: trial.fingerprint.and_then(|fingerprint| fingerprint_from_wire(fingerprint).ok()),
        abort_above: trial.abort_above.filter(|cost| cost.is_finite() && *cost >= 0.0),
        origin: Some(trial.origin).filter(|origin| !origin.is_empty()),
        fidelity: Some(trial.fidelity).filter(|level| !level.is_empty()),
        exclusion: Some(trial.exclusion).filter(|reason| !reason.is_empty()),
        name: trial.name,
    })
}

pub(crate) fn prediction_from_wire(prediction: v1::PredictResponse) -> Result<Prediction, Problem> {
    Ok(Prediction {
        configuration: usable_configuration(prediction.configuration)?,
        mode: word(prediction.mode),
        predicted_cost: prediction.predicted_cost,
        reason: reason_from_wire(prediction.reason),
        state: prediction.state.map(insight::state_from_wire),
    })
}

pub(crate) fn best_from_wire(best: v1::Best) -> Result<Best, Problem> {
    Ok(Best {
        configuration: usable_configuration(best.configuration)?,
        cost: best.cost,
        default_cost: best.default_cost,
        measurements: best.measurements,
        state_id: best.state_id,
        trial: best.trial,
        last_measure_time: time_from_wire(best.last_measure_time),
        standing: best.standing.map(standing_from_wire),
    })
}

fn reason_from_wire(reason: Option<v1::Reason>) -> Reason {
    let reason = reason.unwrap_or_default();
    let neighbour = |each: v1::Neighbour| Neighbour {
        state_id: each.state_id,
        distance: each.distance,
        best_cost: each.best_cost,
    };
    Reason {
        summary: reason.summary,
        source: reason.source,
        step: reason.step,
        neighbours: reason.neighbours.into_iter().map(neighbour).collect(),
        explanation: reason.explanation.map(insight::explanation_from_wire).unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trial_must_say_what_it_is() {
        assert_eq!(trial_from_wire(v1::Trial::default()).unwrap_err(), "a trial without a name");
        let trial = v1::Trial { name: "studies/s/trials/7".into(), state: 1, ..v1::Trial::default() };
        assert_eq!(trial_from_wire(trial).unwrap().number(), Some(7));
    }
}
