//! Trials and visits whose configurations are plain maps: what is only shown need not be checked against the
//! study's space again, and what is of an earlier space of the study is read in the present one.

use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{RawVisit, Visit, VisitDecision};

/// Forgets that the configuration has been checked.
pub(crate) fn raw_trial(trial: Trial) -> RawTrial {
    RawTrial {
        number: trial.number,
        client_id: trial.client_id,
        state_id: trial.state_id,
        indicators: trial.indicators,
        configuration: trial.configuration.into(),
        decision: trial.decision,
        predicted_cost: trial.predicted_cost,
        lease_expire_ms: trial.lease_expire_ms,
        state: trial.state,
        measurements: trial.measurements,
        standard_errors: trial.standard_errors,
        cost: trial.cost,
        outcome: trial.outcome,
        late: trial.late,
        create_ms: trial.create_ms,
        complete_ms: trial.complete_ms,
        completion: trial.completion,
        fingerprint: trial.fingerprint,
        exclusion: trial.exclusion,
    }
}

/// Forgets that the kept configuration has been checked.
pub(crate) fn raw_visit(visit: Visit) -> RawVisit {
    let decision = match visit.decision {
        VisitDecision::Explore { rule, estimate } => VisitDecision::Explore { rule, estimate },
        VisitDecision::Exploit { configuration, predicted_cost, exploit, said } => {
            VisitDecision::Exploit { configuration: configuration.into(), predicted_cost, exploit, said }
        }
    };
    RawVisit {
        client_id: visit.client_id,
        state_id: visit.state_id,
        number: visit.number,
        since: visit.since,
        decision,
        account: visit.account,
    }
}
