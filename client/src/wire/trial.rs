//! Trials and what is asked about them.

use treewright_proto::v1;

use super::{Problem, configuration_from_wire, insight, time_from_wire};
use crate::{
    Best, Fingerprint, Indicators, Measurements, Mode, Neighbour, Outcome, Prediction, Reason, TrialRecord,
    TrialState, outcome,
};

pub(crate) fn trial_from_wire(trial: v1::Trial) -> Result<TrialRecord, Problem> {
    if trial.name.is_empty() {
        return Err("a trial without a name".into());
    }
    let state = match v1::TrialState::try_from(trial.state) {
        Ok(v1::TrialState::Open) => TrialState::Open,
        Ok(v1::TrialState::Completed) => TrialState::Completed,
        Ok(v1::TrialState::Abandoned) => TrialState::Abandoned,
        Ok(v1::TrialState::Expired) => TrialState::Expired,
        Ok(v1::TrialState::Unspecified) | Err(_) => {
            return Err(format!("{} is in an unknown state", trial.name));
        }
    };
    Ok(TrialRecord {
        client_id: trial.client_id,
        state_id: trial.state_id,
        indicators: Indicators(trial.indicators),
        configuration: configuration_from_wire(trial.configuration)?,
        mode: mode_from_wire(trial.mode)?,
        predicted_cost: trial.predicted_cost,
        reason: reason_from_wire(trial.reason)?,
        lease_expire_time: time_from_wire(trial.lease_expire_time),
        state,
        measurements: Measurements(trial.measurements),
        cost: trial.cost,
        outcome: trial.outcome.map(outcome_from_wire).transpose()?,
        late: trial.late,
        create_time: time_from_wire(trial.create_time),
        complete_time: time_from_wire(trial.complete_time),
        fingerprint: trial.fingerprint.map(fingerprint_from_wire),
        abort_above: trial.abort_above.filter(|cost| cost.is_finite() && *cost >= 0.0),
        name: trial.name,
    })
}

pub(crate) fn prediction_from_wire(prediction: v1::PredictResponse) -> Result<Prediction, Problem> {
    Ok(Prediction {
        configuration: configuration_from_wire(prediction.configuration)?,
        mode: mode_from_wire(prediction.mode)?,
        predicted_cost: prediction.predicted_cost,
        reason: reason_from_wire(prediction.reason)?,
        state: prediction.state.map(insight::state_from_wire),
    })
}

pub(crate) fn best_from_wire(best: v1::Best) -> Result<Best, Problem> {
    Ok(Best {
        configuration: configuration_from_wire(best.configuration)?,
        cost: best.cost,
        default_cost: best.default_cost,
        measurements: best.measurements,
        state_id: best.state_id,
        trial: best.trial,
        last_measure_time: time_from_wire(best.last_measure_time),
    })
}

fn mode_from_wire(mode: i32) -> Result<Mode, Problem> {
    match v1::Mode::try_from(mode) {
        Ok(v1::Mode::Default) => Ok(Mode::Default),
        Ok(v1::Mode::Explore) => Ok(Mode::Explore),
        Ok(v1::Mode::Exploit) => Ok(Mode::Exploit),
        Ok(v1::Mode::Pinned) => Ok(Mode::Pinned),
        Ok(v1::Mode::Unspecified) | Err(_) => Err(format!("an unknown mode ({mode})")),
    }
}

fn reason_from_wire(reason: Option<v1::Reason>) -> Result<Reason, Problem> {
    let reason = reason.unwrap_or_default();
    let neighbour = |each: v1::Neighbour| Neighbour {
        state_id: each.state_id,
        distance: each.distance,
        best_cost: each.best_cost,
    };
    Ok(Reason {
        summary: reason.summary,
        source: reason.source,
        step: reason.step,
        neighbours: reason.neighbours.into_iter().map(neighbour).collect(),
        explanation: reason.explanation.map(insight::explanation_from_wire).transpose()?.unwrap_or_default(),
    })
}

pub(crate) fn outcome_to_wire(outcome: &Outcome) -> v1::Outcome {
    use v1::outcome::Kind;
    let kind = match outcome {
        Outcome::Ok => Kind::Ok(v1::Ok {}),
        Outcome::Infeasible { reason } => {
            Kind::Infeasible(v1::Infeasible { reason: outcome::cut(reason.clone()) })
        }
        Outcome::Aborted { lower_bound } => Kind::Aborted(v1::Aborted { lower_bound: *lower_bound }),
        Outcome::Failed { reason } => Kind::Failed(v1::Failed { reason: outcome::cut(reason.clone()) }),
    };
    v1::Outcome { kind: Some(kind) }
}

fn outcome_from_wire(outcome: v1::Outcome) -> Result<Outcome, Problem> {
    use v1::outcome::Kind;
    match outcome.kind {
        Some(Kind::Ok(_)) => Ok(Outcome::Ok),
        Some(Kind::Infeasible(infeasible)) => Ok(Outcome::Infeasible { reason: infeasible.reason }),
        Some(Kind::Aborted(aborted)) => Ok(Outcome::Aborted { lower_bound: aborted.lower_bound }),
        Some(Kind::Failed(failed)) => Ok(Outcome::Failed { reason: failed.reason }),
        None => Err("an outcome without a kind".into()),
    }
}

pub(crate) fn fingerprint_to_wire(fingerprint: &Fingerprint) -> v1::Fingerprint {
    v1::Fingerprint {
        cpu_model: fingerprint.cpu_model.clone(),
        isa: fingerprint.isa.clone(),
        threads: i32::try_from(fingerprint.threads).unwrap_or(i32::MAX),
        software: fingerprint.software.clone(),
    }
}

fn fingerprint_from_wire(fingerprint: v1::Fingerprint) -> Fingerprint {
    Fingerprint {
        cpu_model: fingerprint.cpu_model,
        isa: fingerprint.isa,
        threads: u32::try_from(fingerprint.threads).unwrap_or(0),
        software: fingerprint.software,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_survive_the_wire() {
        for outcome in
            [Outcome::Ok, Outcome::infeasible("deep"), Outcome::aborted(2.5), Outcome::failed("power cut")]
        {
            assert_eq!(outcome_from_wire(outcome_to_wire(&outcome)).unwrap(), outcome);
        }
    }

    #[test]
    fn a_trial_must_say_what_it_is() {
        assert_eq!(trial_from_wire(v1::Trial::default()).unwrap_err(), "a trial without a name");
        let trial = v1::Trial { name: "studies/s/trials/7".into(), state: 1, ..v1::Trial::default() };
        assert_eq!(trial_from_wire(trial.clone()).unwrap_err(), "no configuration");
        let configuration = Some(v1::Configuration::default());
        let trial = v1::Trial { configuration, mode: v1::Mode::Explore.into(), ..trial };
        assert_eq!(trial_from_wire(trial).unwrap().number(), Some(7));
    }
}
