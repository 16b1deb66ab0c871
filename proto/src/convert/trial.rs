//! Outcomes and machines.

use treewright_model::trial::{Fingerprint, Outcome};

use super::Malformed;
use crate::v1;

/// How a trial ended.
#[must_use]
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

/// Reads how a trial ended; `None` for a kind that is not known here, or none at all.
#[must_use]
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
#[must_use]
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
