//! A per-frame loop that never waits. Each call hands in the last result, asks for the next frame's
//! suggestion, and returns at once with the one that was asked for a frame ago.
//!
//! While a frame runs one trial the next is already asked for, so the loop has two workers, whose frames
//! alternate.

use std::sync::{Arc, Weak};
use std::time::{Duration, SystemTime};

use tokio::sync::mpsc;
use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;
use tokio::time::{Instant, sleep, timeout_at};

use crate::answer::Outstanding;
use crate::stream::{self, Frame};
use crate::{ClientError, Finished, Indicators, SharedError, Study, Suggestion, checks, limits};

/// A per-frame loop of one study whose calls return at once; see [`Study::prefetching_tuner`].
///
/// Its answer was asked for a frame ago and rests on the results of that time. It is a trial only while the
/// state lasts. When the indicators have moved further than the study's state tolerance, the trial is given
/// back, and the frame runs its configuration as a fallback. A program that knows the next frame's indicators
/// early says them ([`PrefetchingTuner::next_before`]), and then loses no frame to a moving camera.
///
/// ```no_run
/// # use treewright_client::blocking::Study;
/// # use treewright_client::{Indicators, Measurements, Outcome};
/// # fn frames(study: &Study, indicators: Indicators) -> Result<(), treewright_client::ClientError> {
/// let mut tuner = study.prefetching_tuner();
/// let mut previous = None;
/// for _frame in 0..100 {
///     let suggestion = tuner.next(&indicators, previous.take()); // some microseconds, whatever the daemon does
///     let render_ms = 12.5; // build and render with suggestion.configuration(), with a stopwatch
///     previous = Some(suggestion.finished(Measurements::from([("render_ms", render_ms)]), Outcome::Ok)?);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct PrefetchingTuner {
    outstanding: Option<Outstanding>,
    /// The state of a trial that has frames left; nothing once it has ended.
    under_way: Weak<Indicators>,
    frames: mpsc::Sender<Frame>,
    // The last field: fields dropped before it still find the outbox open.
    study: Study,
}

impl PrefetchingTuner {
    pub(crate) fn new(study: &Study) -> Self {
        let (frames, taken) = mpsc::channel(limits::UNANSWERED_FRAMES);
        tokio::spawn(stream::run(study.shared.clone(), taken));
        Self { outstanding: None, under_way: Weak::new(), frames, study: study.clone() }
    }

    /// The study that is tuned.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// The suggestion for this frame. Hands in the previous frame's result, and asks for the next frame as if
    /// it had these indicators, too.
    ///
    /// It never waits and never fails: where no answer is there yet it is a fallback, and
    /// [`Suggestion::problem`] says why. So is the first frame. Trials of several frames are kept as by
    /// [`crate::Tuner::next`], and the next one is asked for with their last frame. So the frame after one
    /// that ended early is a fallback, too.
    pub fn next(&mut self, indicators: &Indicators, previous: Option<Finished>) -> Suggestion {
        self.next_before(indicators, indicators, previous)
    }

    /// [`PrefetchingTuner::next`] where the indicators of the frame after this one are known already.
    pub fn next_before(
        &mut self,
        indicators: &Indicators,
        upcoming: &Indicators,
        previous: Option<Finished>,
    ) -> Suggestion {
        let suggestion = self.frame(indicators, upcoming, previous);
        self.under_way = suggestion.state_of_next_frames();
        suggestion
    }

    fn frame(
        &mut self,
        indicators: &Indicators,
        upcoming: &Indicators,
        mut previous: Option<Finished>,
    ) -> Suggestion {
        let context = &self.study.shared.context;
        if let Some(frame) = Finished::next_frame(&mut previous, context, indicators) {
            if frame.is_last_frame() {
                self.ask(upcoming, None);
            }
            return frame;
        }
        let answer = self.answered(indicators).map(|suggestion| suggestion.first_frame(indicators));
        if answer.as_ref().is_ok_and(|first| !first.is_last_frame()) {
            // Into the outbox: the next question is some frames away.
            drop(previous);
        } else {
            self.ask(upcoming, previous);
        }
        let shared = &self.study.shared;
        match answer {
            Ok(suggestion) => shared.deliver(suggestion),
            Err(problem) => shared.fall_back(indicators, problem),
        }
    }

    /// Whether a trial has frames left in this state, or a suggestion for it has come. Any other answer is
    /// dropped, so that it is asked for again.
    fn has_answer(&mut self, indicators: &Indicators) -> bool {
        let spec = &self.study.shared.context.spec;
        if self.under_way.upgrade().is_some_and(|state| checks::are_one_state(spec, &state, indicators)) {
            return true;
        }
        let Some(mut question) = self.outstanding.take() else { return false };
        let is_this = checks::are_one_state(spec, &question.indicators, indicators);
        match question.answer.try_recv() {
            Ok(Ok(suggestion)) if is_this && suggestion.lease_is_live(SystemTime::now()) => {
                // Back to where the next frame takes it from.
                let (reply, answer) = oneshot::channel();
                drop(reply.send(Ok(suggestion)));
                self.outstanding = Some(Outstanding { answer, ..question });
                true
            }
            Err(TryRecvError::Empty) => {
                self.outstanding = Some(question);
                false
            }
            Ok(_) | Err(TryRecvError::Closed) => false,
        }
    }

    /// Waits for at most `patience` until the answer for the next frame of this state is there, and asks for
    /// it where no question is open. Returns whether it is there; [`PrefetchingTuner::next`] then returns it.
    /// For programs that would rather wait for a slow daemon than run a frame that measures nothing new.
    /// Between the frames of a trial the next one is there.
    pub async fn wait(&mut self, indicators: &Indicators, patience: Duration) -> bool {
        let deadline = Instant::now() + patience;
        loop {
            if self.has_answer(indicators) {
                return true;
            }
            self.ask(indicators, None);
            if let Some(question) = &mut self.outstanding {
                let Ok(came) = timeout_at(deadline, &mut question.answer).await else { return false };
                let (reply, answer) = oneshot::channel();
                if let Ok(came) = came {
                    // The other half is at hand below.
                    drop(reply.send(came));
                }
                question.answer = answer;
                if self.has_answer(indicators) {
                    return true;
                }
            }
            if checks::state(&self.study.shared.context.spec, indicators).is_err()
                || Instant::now() >= deadline
            {
                return false;
            }
            // The daemon is away or refuses: it is looked for in the background, and asked again.
            sleep(limits::WAIT_PAUSE.min(deadline - Instant::now())).await;
        }
    }

    /// The answer to the question before, if it is there and about this state. One that is about another is
    /// given back, as soon as it comes.
    fn answered(&mut self, indicators: &Indicators) -> Result<Suggestion, SharedError> {
        let spec = &self.study.shared.context.spec;
        checks::state(spec, indicators)?;
        let not_yet = |why| Arc::new(ClientError::NotYet { why });
        let Some(mut question) = self.outstanding.take() else {
            return Err(self.study.shared.problem().unwrap_or_else(|| not_yet("it was only now asked for")));
        };
        if !checks::are_one_state(spec, &question.indicators, indicators) {
            return Err(not_yet("it was asked for another state"));
        }
        match question.answer.try_recv() {
            Ok(Ok(suggestion)) if suggestion.lease_is_live(SystemTime::now()) => Ok(suggestion),
            Ok(Ok(_expired)) => Err(not_yet("the lease of the one that came has run out")),
            Ok(Err(problem)) => Err(Arc::new(problem)),
            Err(TryRecvError::Empty) => {
                self.outstanding = Some(question);
                Err(not_yet("the daemon's answer is on its way"))
            }
            Err(TryRecvError::Closed) => Err(not_yet("the connection ended before it came")),
        }
    }

    /// Sends the result and the next question, if one may be asked; else the result goes to the outbox.
    fn ask(&mut self, upcoming: &Indicators, previous: Option<Finished>) {
        let shared = &self.study.shared;
        if self.outstanding.is_some()
            || shared.problem().is_some()
            || checks::state(&shared.context.spec, upcoming).is_err()
        {
            return;
        }
        let Ok(worker) = shared.worker(upcoming, previous.as_ref()) else {
            return;
        };
        let (reply, answer) = oneshot::channel();
        let due = shared.context.core.outbox.expect_answer(previous.is_some());
        let frame = Frame { finished: previous, indicators: upcoming.clone(), worker, reply, due };
        // A frame that finds no room is dropped here: its result goes to the outbox, and the closed reply is
        // a fallback.
        drop(self.frames.try_send(frame));
        self.outstanding = Some(Outstanding { indicators: upcoming.clone(), answer });
    }
}
