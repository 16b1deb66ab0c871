//! The background task that empties the outbox. It sends one item after the other, and repeats each until the
//! daemon has taken or refused it. Repeats are harmless, because the service takes only the first report of a
//! trial.

use std::sync::Arc;

use tonic::Code;
use treewright_proto::convert::outcome_to_wire;
use treewright_proto::v1;

use crate::core::Core;
use crate::outbox::{Message, OutboxItem};
use crate::{ClientError, Measurements, Outcome, limits};

/// Delivers until the outbox is closed and empty, or for a bounded time after it is closed.
pub(crate) async fn run(core: Arc<Core>) {
    let out_of_time = async {
        core.outbox.closing().await;
        tokio::time::sleep(limits::FLUSH_ON_DROP).await;
    };
    tokio::select! {
        () = deliver(&core) => {}
        () = out_of_time => {}
    }
    core.count_lost(core.outbox.give_up());
}

async fn deliver(core: &Core) {
    let mut failures = 0;
    while let Some(mut item) = core.outbox.next().await {
        match send(core, &item).await {
            Ok(()) => {
                failures = 0;
                core.outbox.done();
            }
            Err(problem) => {
                core.counters.note(&problem);
                item.attempts += 1;
                if worth_repeating(&problem, item.attempts) {
                    failures += 1;
                    core.count_lost(core.outbox.put_back(item));
                    core.back_off().sleep_at_least(failures, problem.retry_after()).await;
                    core.circuit_breaker.wait_until_worth_asking().await;
                } else {
                    if let Message::Report(..) = item.message {
                        tracing::warn!(trial = %item.trial, %problem, "a report is given up");
                        core.counters.refused.add(1);
                    }
                    core.outbox.done();
                }
            }
        }
    }
}

async fn send(core: &Core, item: &OutboxItem) -> Result<(), ClientError> {
    match &item.message {
        Message::Report(measurements, outcome) => {
            core.counters.sent.add(1);
            core.counters.resent.add(usize::from(item.attempts > 0));
            let request = report_request(&item.trial, measurements, outcome);
            let response = core.call("Report", limits::DELIVERY_ATTEMPT, core.rpc().report(request)).await?;
            core.counters.acknowledged.add(1);
            core.counters.duplicates.add(usize::from(response.duplicate));
        }
        Message::Abandon => {
            let request = v1::AbandonTrialRequest { trial: item.trial.to_string() };
            core.call("AbandonTrial", limits::DELIVERY_ATTEMPT, core.rpc().abandon_trial(request)).await?;
            core.counters.abandoned.add(1);
        }
    }
    Ok(())
}

pub(crate) fn report_request(
    trial: &str,
    measurements: &Measurements,
    outcome: &Outcome,
) -> v1::ReportRequest {
    v1::ReportRequest {
        trial: trial.to_owned(),
        measurements: measurements.0.clone(),
        outcome: Some(outcome_to_wire(outcome)),
        standard_errors: measurements.1.clone(),
    }
}

/// Whether another attempt may succeed.
pub(crate) fn worth_repeating(problem: &ClientError, attempts: u32) -> bool {
    match problem {
        // A defect of the daemon: it may pass, but must not hold up the queue for ever.
        ClientError::Refused { code: Code::Internal | Code::Unknown, .. } => {
            attempts < limits::ATTEMPTS_AFTER_INTERNAL_ERROR
        }
        _ => problem.may_pass(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_may_pass_is_repeated() {
        let refused =
            |code| ClientError::from_status("http://x", "Report", &tonic::Status::new(code, String::new()));
        assert!(worth_repeating(&ClientError::away("", ""), 1_000_000));
        assert!(worth_repeating(&refused(Code::ResourceExhausted), 1_000_000));
        assert!(worth_repeating(&refused(Code::Internal), 7));
        assert!(!worth_repeating(&refused(Code::Internal), 8));
        for code in [Code::NotFound, Code::InvalidArgument, Code::FailedPrecondition, Code::Unimplemented] {
            assert!(!worth_repeating(&refused(code), 1));
        }
    }
}
