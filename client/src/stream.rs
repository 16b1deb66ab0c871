//! The background task behind a tuner: it owns the stream, sends frames, and matches answers to them by
//! order, which the wire contract guarantees. Reports that a broken stream leaves unacknowledged go to the
//! outbox.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::{Instant, timeout, timeout_at};
use tokio_stream::wrappers::ReceiverStream;
use treewright_proto::v1;

use crate::delivery::worth_repeating;
use crate::outbox::AnswerDue;
use crate::shared::{Shared, SuggestAnswer};
use crate::workers::Worker;
use crate::{ClientError, Finished, Indicators, limits};

/// One question of a tuner, with the result of the frame before.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) finished: Option<Finished>,
    pub(crate) indicators: Indicators,
    pub(crate) worker: Arc<Worker>,
    pub(crate) reply: oneshot::Sender<SuggestAnswer>,
    /// Lets a flush wait for this frame. The last field, so that a result that is dropped with the frame
    /// is in the outbox before the frame is no longer waited for.
    pub(crate) due: AnswerDue,
}

/// Serves a tuner until it is dropped, over as many streams as it takes.
pub(crate) async fn run(shared: Arc<Shared>, mut frames: mpsc::Receiver<Frame>) {
    while let Some(first) = frames.recv().await {
        let mut stream = Stream { shared: &shared, waiting: VecDeque::new() };
        if let Err(problem) = stream.serve(first, &mut frames).await {
            tracing::debug!(%problem, "the stream broke");
            stream.shared.context.core.counters.note(&problem);
            if problem.is_unreachable() {
                stream.shared.context.core.circuit_breaker.failure(Arc::new(problem.clone()));
            }
            stream.fail(&problem);
        }
    }
}

/// One stream and the frames that were sent on it and not answered yet, oldest first.
struct Stream<'a> {
    shared: &'a Arc<Shared>,
    waiting: VecDeque<(Frame, Instant)>,
}

impl Stream<'_> {
    /// Opens the stream with the first frame and serves it until the tuner is gone or the stream breaks.
    async fn serve(&mut self, first: Frame, frames: &mut mpsc::Receiver<Frame>) -> Result<(), ClientError> {
        let core = &self.shared.context.core;
        let (requests, outgoing) = mpsc::channel(limits::UNANSWERED_FRAMES);
        self.send(first, &requests).await?;
        if self.waiting.is_empty() {
            return Ok(());
        }
        let mut rpc = core.rpc();
        let opened = timeout(limits::LATE_ANSWER, rpc.tune(ReceiverStream::new(outgoing))).await;
        let mut answers = match opened {
            Ok(Ok(response)) => response.into_inner(),
            Ok(Err(status)) => return Err(ClientError::from_status(&core.url, "Tune", &status)),
            Err(_) => return Err(core.late("Tune", limits::LATE_ANSWER)),
        };
        let mut requests = Some(requests);
        loop {
            if requests.is_none() && self.waiting.is_empty() {
                return Ok(());
            }
            let oldest = self.waiting.front().map(|(_, sent)| *sent + limits::LATE_ANSWER);
            let answer = async {
                match oldest {
                    Some(oldest) => timeout_at(oldest, answers.message()).await.ok(),
                    None => Some(answers.message().await),
                }
            };
            tokio::select! {
                frame = frames.recv(), if requests.is_some() => match (frame, &requests) {
                    (Some(frame), Some(open)) => self.send(frame, open).await?,
                    // The tuner is gone: close the sending side, and take the answers still on their way.
                    _ => requests = None,
                },
                answer = answer => match answer {
                    Some(Ok(Some(response))) => self.answered(response)?,
                    Some(Ok(None)) => return Err(self.ended()),
                    Some(Err(status)) => return Err(ClientError::from_status(&core.url, "Tune", &status)),
                    None => return Err(core.late("Tune", limits::LATE_ANSWER)),
                },
            }
        }
    }

    /// Sends a frame, once everything that was said about its worker's trials outside the stream has arrived.
    async fn send(
        &mut self,
        mut frame: Frame,
        requests: &mpsc::Sender<v1::TuneRequest>,
    ) -> Result<(), ClientError> {
        let core = &self.shared.context.core;
        let sent = core.outbox.wait_until_sent(&self.shared.context.name, frame.worker.name());
        let sent = timeout(core.options.deadline, sent).await;
        if sent.is_err() {
            self.turn_away(frame, core.late("Report", core.options.deadline));
            return Ok(());
        }
        if self.waiting.len() >= limits::UNANSWERED_FRAMES {
            let limit = limits::UNANSWERED_FRAMES;
            self.turn_away(frame, ClientError::Busy { what: "frames without an answer", limit });
            return Ok(());
        }
        let report = frame.finished.as_ref().and_then(Finished::request);
        let suggest = Some(self.shared.suggest_request(&frame.worker, &frame.indicators));
        if let Some(finished) = &mut frame.finished {
            finished.note_attempt();
        }
        self.waiting.push_back((frame, Instant::now()));
        requests.try_send(v1::TuneRequest { report, suggest }).map_err(|_| self.ended())
    }

    /// The answer to the oldest frame.
    fn answered(&mut self, response: v1::TuneResponse) -> Result<(), ClientError> {
        let core = &self.shared.context.core;
        let Some((frame, _)) = self.waiting.pop_front() else {
            return Err(core.malformed("Tune", "an answer without a request".into()));
        };
        let Frame { finished, worker, reply, due, .. } = frame;
        core.circuit_breaker.success();
        if let Some(finished) = finished {
            match (response.reported, response.report_error) {
                (Some(reported), _) => finished.acknowledged(reported.duplicate),
                (None, Some(error)) => {
                    let problem = self.refusal("Report", &error);
                    if worth_repeating(&problem, 1) {
                        core.counters.note(&problem);
                        drop(finished); // into the outbox
                    } else {
                        finished.refused(&problem);
                    }
                }
                (None, None) => drop(finished), // not a word about it: the outbox will find out
            }
        }
        let answer = match (response.trial, response.suggest_error) {
            (Some(trial), _) => self.shared.accept(trial, &worker),
            (None, Some(error)) => Err(self.refusal("Suggest", &error)),
            (None, None) => Err(core.malformed("Tune", "neither a trial nor an error".into())),
        };
        if let Err(problem) = &answer {
            self.shared.look_at_refusal(problem);
        }
        // A caller with its answer may be done with the trial at once, and ask again.
        drop(worker);
        // A suggestion that nobody waits for comes back from here and gives its trial back.
        drop(reply.send(answer));
        drop(due);
        Ok(())
    }

    fn refusal(&self, call: &'static str, error: &v1::TuneError) -> ClientError {
        use tonic_types::StatusExt as _;
        let wait = error.retry_after_ms.and_then(|ms| u64::try_from(ms).ok()).map(Duration::from_millis);
        let details = tonic_types::ErrorDetails::with_retry_info(wait);
        let status = tonic::Status::with_error_details(error.code.into(), error.message.clone(), details);
        let problem = ClientError::from_status(&self.shared.context.core.url, call, &status);
        self.shared.context.core.circuit_breaker.note_hint(&problem);
        problem
    }

    fn ended(&self) -> ClientError {
        ClientError::away(&self.shared.context.core.url, "the daemon ended the stream")
    }

    /// Answers a frame that cannot be sent; its result goes to the outbox.
    fn turn_away(&self, frame: Frame, problem: ClientError) {
        let Frame { finished, worker, reply, due, .. } = frame;
        drop((finished, worker));
        drop(reply.send(Err(problem)));
        drop(due);
    }

    /// Answers every frame that was sent in vain; the results go to the outbox.
    fn fail(mut self, problem: &ClientError) {
        for (frame, _) in std::mem::take(&mut self.waiting) {
            self.turn_away(frame, problem.clone());
        }
    }
}
