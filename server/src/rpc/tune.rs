//! The Tune stream: a report and the next suggestion in one round trip, frame after frame.

use std::sync::Arc;
use std::time::Instant;

use prost::Message as _;
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status, Streaming};
use tracing::Instrument as _;
use treewright_proto::v1 as wire;
use treewright_store::tokens::Scope;

use super::frames::{Attempt, FrameRouter};
use super::{Call, reach, trials};
use crate::access::caller::{Caller, Spent};
use crate::admission::{Admission, Admitted};
use crate::connections::UnderWay;
use crate::convert::from_proto::{self, Report, Suggest};
use crate::convert::to_proto;
use crate::error::{Error, Result};
use crate::limits;
use crate::redirect::Redirect;
use crate::refusals::Refusals;
use crate::status;
use crate::tuning::Tuning;

pub(super) type TuneAnswers = ReceiverStream<Result<wire::TuneResponse, Status>>;

pub(super) struct TuneStream {
    pub(super) tuning: Arc<Tuning>,
    pub(super) admission: Admission,
    pub(super) caller: Caller,
    /// The forwarding replica counted its frames.
    pub(super) is_counted: bool,
    /// Another replica may do a request that this one cannot.
    pub(super) has_peers: bool,
    pub(super) refusals: Refusals,
    /// Held until the stream ends: a place among the streams, and the connection's right to stay.
    pub(super) _inside: (Admitted, Option<Arc<UnderWay>>),
}

impl TuneStream {
    /// Serves until the client ends the stream, its token ends or the daemon drains. The work is a separate
    /// task, so that a vanished client does not interrupt a frame.
    pub(super) fn serve(self, way: FrameRouter, mut frames: Streaming<wire::TuneRequest>) -> TuneAnswers {
        let (answers, stream) = mpsc::channel(limits::TUNE_ANSWERS_WAITING);
        let work = async move {
            let draining = self.admission.draining();
            tokio::pin!(draining);
            loop {
                let frame = tokio::select! {
                    // First, so that a client that never pauses does not keep the daemon from draining.
                    biased;
                    () = &mut draining => Err(Error::Draining.into()),
                    frame = timeout(limits::TUNE_IDLE, frames.message()) => match frame {
                        Ok(frame) => frame,
                        Err(_) => Err(Error::Deadline(limits::TUNE_IDLE).into()),
                    },
                };
                let answer = match frame {
                    Ok(Some(frame)) => {
                        let since = Instant::now();
                        let answer = way.answer(frame, &self).await;
                        self.refusals.metrics().answered("Tune.frame", code(&answer), since.elapsed());
                        answer
                    }
                    Ok(None) => break,
                    Err(status) => Err(status::corrected(status)),
                };
                let last = answer.is_err();
                // A client that has left wants no more answers, and one that does not read them in time must
                // not keep a place among the streams.
                let patience = async {
                    tokio::select! {
                        () = sleep(limits::TUNE_UNREAD) => {}
                        () = self.admission.draining() => sleep(limits::DRAIN_UNREAD).await,
                    }
                };
                let sent = tokio::select! {
                    sent = answers.send(answer) => Ok(sent),
                    () = patience => Err(()),
                };
                if sent.is_err() {
                    tracing::info!("a Tune stream is ended: its client does not read the answers");
                }
                if last || !matches!(sent, Ok(Ok(()))) {
                    break;
                }
            }
        };
        tokio::spawn(work.in_current_span());
        ReceiverStream::new(stream)
    }

    fn split<T>(&self, result: Option<Result<T>>) -> (Option<T>, Option<wire::TuneError>) {
        match result {
            None => (None, None),
            Some(Ok(value)) => (Some(value), None),
            Some(Err(error)) => {
                self.refusals.note_here(&error, self.has_peers);
                (None, Some(error.into()))
            }
        }
    }

    fn call(&self) -> Call<'_> {
        Call { tuning: &self.tuning, caller: &self.caller }
    }

    async fn report(&self, report: wire::ReportRequest) -> Result<Report> {
        let mut report = from_proto::report(report)?;
        report.trial.study = reach::find(self.call(), report.trial.study).await?;
        Ok(report)
    }

    async fn suggest(&self, suggest: wire::SuggestRequest) -> Result<(Suggest, Spent<'_>)> {
        let mut suggest = from_proto::suggest(suggest)?;
        suggest.study = reach::find(self.call(), suggest.study).await?;
        Ok((suggest, self.caller.spend_trial()?))
    }

    /// The answer to a refused frame, of which nothing was done.
    fn refuse(&self, frame: &wire::TuneRequest, error: &Error) -> wire::TuneResponse {
        self.refusals.note(error);
        wire::TuneResponse {
            report_error: frame.report.as_ref().map(|_| error.clone().into()),
            suggest_error: frame.suggest.as_ref().map(|_| error.clone().into()),
            ..wire::TuneResponse::default()
        }
    }
}

impl Attempt for TuneStream {
    fn count(&self, frame: &wire::TuneRequest) -> Result<Option<wire::TuneResponse>, Status> {
        if self.is_counted {
            return Ok(None);
        }
        match self.caller.spend_request(frame.encoded_len()) {
            Ok(()) => Ok(None),
            Err(error @ Error::Unauthenticated(_)) => {
                self.refusals.note(&error);
                Err(error.into())
            }
            Err(error) => Ok(Some(self.refuse(frame, &error))),
        }
    }

    /// An error of one frame comes back in its answer; the end of a token ends the stream.
    async fn attempt(
        &self,
        frame: wire::TuneRequest,
    ) -> Result<(wire::TuneResponse, Option<Redirect>), Status> {
        if let Err(error) = self.caller.may(Scope::Tune) {
            self.refusals.note(&error);
            return Err(error.into());
        }
        let _entered = match self.admission.request() {
            Ok(entered) => entered,
            Err(error) => return Ok((self.refuse(&frame, &error), None)),
        };
        let wire::TuneRequest { report, suggest } = frame;
        let (is_reported, is_asked) = (report.is_some(), suggest.is_some());
        let reports_waiting = suggest.as_ref().map(|suggest| suggest.reports_waiting);
        let report = match report {
            Some(report) => Some(self.report(report).await),
            None => None,
        };
        let suggest = match suggest {
            Some(suggest) => Some(self.suggest(suggest).await),
            None => None,
        };
        let (report, report_error) = self.split(report);
        let (suggest, suggest_error) = self.split(suggest);
        let (suggest, spent) = suggest.unzip();
        let report_study = report.as_ref().map(|report| report.trial.study.clone());
        let suggest_study = suggest.as_ref().map(|suggest| suggest.study.clone());

        let done = self.tuning.frame(report, suggest).await;
        let redirect = done.redirect();
        if let (Some(Ok(_)), Some(spent)) = (&done.suggested, spent) {
            spent.keep();
            self.refusals.metrics().outbox_reported(reports_waiting.unwrap_or(0));
        }
        let (reported, taking_error) = self.split(done.reported);
        let (trial, suggesting_error) = self.split(done.suggested);
        let response = wire::TuneResponse {
            reported: reported.zip(report_study).map(|(reported, study)| trials::reported(&study, &reported)),
            trial: trial.zip(suggest_study).map(|(trial, study)| to_proto::trial(&study, &trial)),
            report_error: report_error.or(taking_error),
            suggest_error: suggest_error.or(suggesting_error),
        };
        // Each requested part has one answer, and no other part has one.
        assert_eq!(is_reported, response.reported.is_some() != response.report_error.is_some());
        assert_eq!(is_asked, response.trial.is_some() != response.suggest_error.is_some());
        Ok((response, redirect))
    }
}

/// The code of a frame: that of its first failed part.
fn code(answer: &Result<wire::TuneResponse, Status>) -> Code {
    match answer {
        Ok(answer) => {
            let error = answer.report_error.as_ref().or(answer.suggest_error.as_ref());
            error.map_or(Code::Ok, |error| Code::from_i32(error.code))
        }
        Err(status) => status.code(),
    }
}
