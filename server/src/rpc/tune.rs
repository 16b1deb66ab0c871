//! The Tune stream: a report and the next suggestion in one round trip, frame after frame.

use std::sync::Arc;

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Status, Streaming};
use treewright_proto::v1 as wire;

use super::frames::{Attempt, Frames};
use super::{note_refusal, trials};
use crate::convert::{from_proto, to_proto};
use crate::error::Error;
use crate::gate::{Entered, Gate};
use crate::limits;
use crate::peers::Fate;
use crate::tuning::Tuning;

/// The answers of one stream.
pub(super) type Answers = ReceiverStream<Result<wire::TuneResponse, Status>>;

/// Serves a stream until the client ends it or the daemon drains. The work is a task of its own, so that
/// a client that vanishes does not cut a frame in two.
pub(super) fn serve(
    tuning: Arc<Tuning>,
    gate: Gate,
    entered: Entered,
    way: Frames,
    mut frames: Streaming<wire::TuneRequest>,
) -> Answers {
    let (answers, stream) = mpsc::channel(limits::TUNE_ANSWERS_WAITING);
    tokio::spawn(async move {
        let _entered = entered;
        let draining = gate.draining();
        let here = Here { tuning, gate: gate.clone() };
        tokio::pin!(draining);
        loop {
            let frame = tokio::select! {
                // First, so that a client that never pauses does not keep the daemon from draining.
                biased;
                () = &mut draining => Err(Error::Draining.into()),
                frame = frames.message() => frame,
            };
            let answer = match frame {
                Ok(Some(frame)) => way.answer(frame, &here).await,
                Ok(None) => break,
                Err(status) => Err(status),
            };
            let last = answer.is_err();
            // A client that no longer listens wants no more answers.
            if answers.send(answer).await.is_err() || last {
                break;
            }
        }
    });
    ReceiverStream::new(stream)
}

/// What is at hand in this replica.
struct Here {
    tuning: Arc<Tuning>,
    gate: Gate,
}

impl Attempt for Here {
    async fn attempt(&self, frame: wire::TuneRequest) -> Result<(wire::TuneResponse, Option<Fate>), Status> {
        Ok(answer(&self.tuning, &self.gate, frame).await)
    }
}

/// The answer to a frame, and where to try again if not everything of it could be done here.
async fn answer(
    tuning: &Tuning,
    gate: &Gate,
    frame: wire::TuneRequest,
) -> (wire::TuneResponse, Option<Fate>) {
    let wire::TuneRequest { report, suggest } = frame;
    let entered = gate.request();
    if let Err(error) = &entered {
        note_refusal("Tune", error);
        let response = wire::TuneResponse {
            report_error: report.map(|_| error.clone().into()),
            suggest_error: suggest.map(|_| error.clone().into()),
            ..wire::TuneResponse::default()
        };
        return (response, None);
    }
    let (report, report_error) = split(report.map(from_proto::report));
    let (suggest, suggest_error) = split(suggest.map(from_proto::suggest));
    let report_study = report.as_ref().map(|report| report.trial.study.clone());
    let suggest_study = suggest.as_ref().map(|suggest| suggest.study.clone());

    let done = tuning.frame(report, suggest).await;
    let fate = done.fate();
    let (reported, taking_error) = split(done.reported);
    let (trial, suggesting_error) = split(done.suggested);
    let response = wire::TuneResponse {
        reported: reported.zip(report_study).map(|(reported, study)| trials::reported(&study, &reported)),
        trial: trial.zip(suggest_study).map(|(trial, study)| to_proto::trial(&study, &trial)),
        report_error: report_error.or(taking_error),
        suggest_error: suggest_error.or(suggesting_error),
    };
    (response, fate)
}

/// Parts what went well from what did not.
fn split<T>(result: Option<Result<T, Error>>) -> (Option<T>, Option<wire::TuneError>) {
    match result {
        None => (None, None),
        Some(Ok(value)) => (Some(value), None),
        Some(Err(error)) => {
            note_refusal("Tune", &error);
            (None, Some(error.into()))
        }
    }
}
