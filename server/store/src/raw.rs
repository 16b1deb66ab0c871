//! A trial for readers: its configuration is a plain map, because a trial that is only shown need not be
//! checked against the study's space again.

use treewright_core::trial::{RawTrial, Trial};

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
        cost: trial.cost,
        outcome: trial.outcome,
        late: trial.late,
        create_ms: trial.create_ms,
        complete_ms: trial.complete_ms,
        completion: trial.completion,
        fingerprint: trial.fingerprint,
    }
}
