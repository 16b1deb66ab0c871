//! A per-frame loop over one stream: the last result and the next question travel together, so that a
//! frame costs one round trip.

use tokio::sync::{mpsc, oneshot};

use crate::answer::{self, Outstanding};
use crate::stream::{self, Frame};
use crate::{Finished, Indicators, Study, Suggestion, limits};

/// A per-frame loop of one study; see [`Study::tuner`].
///
/// ```no_run
/// # use treewright_client::{Indicators, Measurements, Outcome, Study};
/// # async fn frames(study: &Study, indicators: Indicators) -> Result<(), treewright_client::ClientError> {
/// let mut tuner = study.tuner();
/// let mut previous = None;
/// for _frame in 0..100 {
///     let suggestion = tuner.next(&indicators, previous.take()).await;
///     let render_ms = 12.5; // build and render with suggestion.configuration(), with a stopwatch
///     previous = Some(suggestion.finished(Measurements::from([("render_ms", render_ms)]), Outcome::Ok)?);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Tuner {
    outstanding: Option<Outstanding>,
    frames: mpsc::Sender<Frame>,
    // The last field: fields dropped before it still find the outbox open.
    study: Study,
}

impl Tuner {
    pub(crate) fn new(study: &Study) -> Self {
        let (frames, taken) = mpsc::channel(limits::UNANSWERED_FRAMES);
        tokio::spawn(stream::run(study.shared.clone(), taken));
        Self { outstanding: None, frames, study: study.clone() }
    }

    /// The study that is tuned.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// Reports the previous frame's trial and answers what to run next, within the client's deadline.
    ///
    /// Where the study's trials have several frames ([`crate::StudyBuilder::episode_frames`]), a trial that
    /// has frames left is answered again, at once and without the network. It is reported after its last
    /// frame with the means of all, or ends early once its mean must be above its bound. Its lease is renewed
    /// meanwhile. Indicators of another state give it up: it is handed back unmeasured.
    ///
    /// It never fails, like [`Study::suggest`]. When the stream is broken the result goes to the outbox, and
    /// the answer is the fallback. The stream is opened again as soon as the daemon is back.
    pub async fn next(&mut self, indicators: &Indicators, mut previous: Option<Finished>) -> Suggestion {
        let shared = &self.study.shared;
        if let Some(frame) = Finished::next_frame(&mut previous, &shared.context, indicators) {
            return frame;
        }
        let frames = &self.frames;
        let ask = move || {
            let (reply, answer) = oneshot::channel();
            let due = shared.context.core.outbox.expect_answer(previous.is_some());
            match shared.worker(indicators, previous.as_ref()) {
                Ok(worker) => {
                    let indicators = indicators.clone();
                    let frame = Frame { finished: previous, indicators, worker, reply, due };
                    // A frame that finds no room is dropped here: its result goes to the outbox, and the
                    // closed reply makes the caller fall back.
                    drop(frames.try_send(frame));
                }
                // The receiver is still in this function, so that sending cannot fail.
                Err(problem) => drop(reply.send(Err(problem))),
            }
            answer
        };
        let suggestion = answer::within_deadline(shared, &mut self.outstanding, indicators, ask).await;
        suggestion.first_frame(indicators)
    }
}
