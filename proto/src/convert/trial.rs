//! Trials, outcomes and machines.

use treewright_model::trial::{Fingerprint, Outcome, Trial};

use super::{Malformed, Values, WireEnum, configuration_to_wire, reason_to_wire, signed, timestamp_to_wire};
use crate::v1;

/// A trial under its resource name.
pub fn trial_to_wire<C: Values>(name: String, trial: &Trial<C>) -> v1::Trial {
    v1::Trial {
        name,
        client_id: trial.client_id.clone(),
        state_id: signed(trial.state_id),
        indicators: trial.indicators.clone(),
        configuration: Some(configuration_to_wire(&trial.configuration)),
        mode: trial.mode().number(),
        predicted_cost: trial.predicted_cost,
        reason: Some(reason_to_wire(&trial.reason())),
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
        fidelity: trial.decision.fidelity.clone().unwrap_or_default(),
        exclusion: trial.exclusion.clone().unwrap_or_default(),
        standard_errors: trial.standard_errors.clone(),
    }
}

/// The outcome of a trial.
pub fn outcome_to_wire(outcome: &Outcome) -> v1::Outcome {
    use v1::outcome::Kind;
    let kind = match outcome {
        Outcome::Ok => Kind::Ok(v1::Ok {}),
        Outcome::Infeasible { reason } => Kind::Infeasible(v1::Infeasible { reason: reason.clone() }),
        Outcome::Aborted { lower_bound } => Kind::Aborted(v1::Aborted { lower_bound: *lower_bound }),
        Outcome::Failed { reason } => Kind::Failed(v1::Failed { reason: reason.clone() }),
    };
    v1::Outcome { kind: Some(kind) }
}

/// Reads the outcome of a trial; `None` for an unknown kind, or none.
pub fn outcome_from_wire(outcome: v1::Outcome) -> Option<Outcome> {
    use v1::outcome::Kind;
    Some(match outcome.kind? {
        Kind::Ok(v1::Ok {}) => Outcome::Ok,
        Kind::Infeasible(v1::Infeasible { reason }) => Outcome::Infeasible { reason },
        Kind::Aborted(v1::Aborted { lower_bound }) => Outcome::Aborted { lower_bound },
        Kind::Failed(v1::Failed { reason }) => Outcome::Failed { reason },
    })
}

/// A machine and its software.
pub fn fingerprint_to_wire(fingerprint: &Fingerprint) -> v1::Fingerprint {
    v1::Fingerprint {
        cpu_model: fingerprint.cpu_model.clone(),
        isa: fingerprint.isa.clone(),
        threads: i32::try_from(fingerprint.threads).unwrap_or(i32::MAX),
        software: fingerprint.software.clone(),
    }
}

/// Reads a machine and its software.
///
/// # Errors
/// [`Malformed`] when the number of threads is negative.
pub fn fingerprint_from_wire(wire: v1::Fingerprint) -> Result<Fingerprint, Malformed> {
    let threads = u32::try_from(wire.threads)
        .map_err(|_| Malformed::new("fingerprint.threads", "must not be negative"))?;
    Ok(Fingerprint { cpu_model: wire.cpu_model, isa: wire.isa, threads, software: wire.software })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_survive_the_wire() {
        for outcome in
            [Outcome::Ok, Outcome::infeasible("deep"), Outcome::aborted(2.5), Outcome::failed("power cut")]
        {
            assert_eq!(outcome_from_wire(outcome_to_wire(&outcome)), Some(outcome));
        }
        assert_eq!(outcome_from_wire(v1::Outcome::default()), None);
    }
}
