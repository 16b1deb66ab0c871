//! Reports on their way, and the trials that this client holds. One lock guards both, because both decide
//! whether a trial may be handed to the program, is given back, or must wait.
//!
//! The service hands a worker that already holds an open trial for a state that same trial again. So a new
//! suggestion waits until the reports of its worker's earlier trials have arrived. Otherwise it could get a
//! trial that is being reported at that moment.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

use tokio::sync::watch;

use crate::{Measurements, Outcome};

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Message {
    Report(Measurements, Outcome),
    Abandon,
}

#[derive(Debug, Clone)]
pub(crate) struct OutboxItem {
    pub(crate) study: Arc<str>,
    /// The worker that ran the trial; see [`crate::workers`].
    pub(crate) worker: Arc<str>,
    pub(crate) trial: Arc<str>,
    pub(crate) message: Message,
    pub(crate) attempts: u32,
}

/// Counts of messages that a full or closed outbox lost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Lost {
    pub(crate) reports: usize,
    pub(crate) abandons: usize,
}

/// The queue and the held trials.
#[derive(Debug)]
pub(crate) struct Outbox {
    state: watch::Sender<OutboxState>,
    capacity: usize,
}

#[derive(Debug, Default)]
struct OutboxState {
    queue: VecDeque<OutboxItem>,
    sending: Option<OutboxItem>,
    held: HashMap<Arc<str>, HeldTrial>,
    /// Suggestions asked for and not yet answered.
    answers_due: usize,
    /// Reports that travel on a stream and are not yet acknowledged.
    reports_on_streams: usize,
    phase: OutboxPhase,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum OutboxPhase {
    #[default]
    Open,
    /// The last handle is gone; queued items are still sent.
    Closing,
    /// Nothing is sent any more.
    Closed,
}

#[derive(Debug, Default)]
struct HeldTrial {
    handles: usize,
    reported: bool,
}

impl Outbox {
    pub(crate) fn new(capacity: usize) -> Self {
        Self { state: watch::Sender::new(OutboxState::default()), capacity }
    }

    /// Takes hold of a trial. False when it is being reported or given back, so that it is no longer ours.
    pub(crate) fn hold(&self, trial: &Arc<str>) -> bool {
        self.change_perhaps(|state| {
            let queued = state.queue.len();
            state.queue.retain(|item| item.trial != *trial || item.message != Message::Abandon);
            let leaving = state.sending.as_ref().is_some_and(|sent| sent.trial == *trial)
                || state.queue.iter().any(|item| item.trial == *trial)
                || state.held.get(trial).is_some_and(|held| held.reported);
            if !leaving {
                state.held.entry(Arc::clone(trial)).or_default().handles += 1;
            }
            (!leaving, state.queue.len() != queued)
        })
    }

    /// The trial has its result, whichever way that goes to the daemon.
    pub(crate) fn mark_reported(&self, trial: &Arc<str>) {
        self.change_perhaps(|state| {
            if let Some(held) = state.held.get_mut(trial) {
                held.reported = true;
            }
            ((), false)
        });
    }

    /// Lets go of a trial; without a result it is given back.
    pub(crate) fn release(&self, study: &Arc<str>, worker: &Arc<str>, trial: &Arc<str>) -> Lost {
        self.change_perhaps(|state| {
            let Some(held) = state.held.get_mut(trial) else {
                return (Lost::default(), false);
            };
            held.handles -= 1;
            if held.handles > 0 {
                return (Lost::default(), false);
            }
            let reported = held.reported;
            state.held.remove(trial);
            if reported {
                return (Lost::default(), false);
            }
            let (study, worker, trial) = (Arc::clone(study), Arc::clone(worker), Arc::clone(trial));
            let item = OutboxItem { study, worker, trial, message: Message::Abandon, attempts: 0 };
            (state.put(item, self.capacity), true)
        })
    }

    pub(crate) fn report(&self, item: OutboxItem) -> Lost {
        self.change(|state| state.put(item, self.capacity))
    }

    /// The next item to be sent. `None` when closing, everything is sent, and no answer is due that could
    /// bring a trial to be given back.
    pub(crate) async fn next(&self) -> Option<OutboxItem> {
        let mut changes = self.state.subscribe();
        loop {
            let over = |state: &OutboxState| state.phase != OutboxPhase::Open && state.answers_due == 0;
            // The sender lives as long as `self`, so that waiting cannot fail.
            let _ = changes.wait_for(|state| !state.queue.is_empty() || over(state)).await;
            let (item, over) = self.change(|state| {
                let item = state.queue.pop_front();
                state.sending.clone_from(&item);
                (item, over(state))
            });
            if item.is_some() || over {
                return item;
            }
        }
    }

    /// The item that was being sent is done with.
    pub(crate) fn done(&self) {
        self.change(|state| state.sending = None);
    }

    /// The item that was being sent has to be sent again, before all others.
    pub(crate) fn put_back(&self, item: OutboxItem) -> Lost {
        self.change(|state| {
            state.sending = None;
            let taken_up_again = item.message == Message::Abandon && state.held.contains_key(&item.trial);
            if taken_up_again {
                return Lost::default();
            }
            if state.queue.len() >= self.capacity {
                return Lost::of(&item);
            }
            state.queue.push_front(item);
            Lost::default()
        })
    }

    /// Waits until nothing about the worker's trials of the study is queued or being sent.
    pub(crate) async fn wait_until_sent(&self, study: &str, worker: &str) {
        let is_sent = |state: &OutboxState| {
            let is_other = |of: &str, by: &str| of != study || by != worker;
            state.queue.iter().all(|item| is_other(&item.study, &item.worker))
                && state.sending.as_ref().is_none_or(|sent| is_other(&sent.study, &sent.worker))
        };
        let _ = self.state.subscribe().wait_for(is_sent).await;
    }

    /// Waits until nothing is queued or on its way and no answer is due.
    pub(crate) async fn wait_until_quiet(&self) {
        let _ = self.state.subscribe().wait_for(|state| state.waiting() == 0 && state.answers_due == 0).await;
    }

    /// Reports and abandoned trials that are not acknowledged.
    pub(crate) fn waiting(&self) -> usize {
        self.state.borrow().waiting()
    }

    /// Reports and abandoned trials that wait to be sent, other than with a frame.
    pub(crate) fn queued(&self) -> u32 {
        u32::try_from(self.state.borrow().queue.len()).unwrap_or(u32::MAX)
    }

    /// Notes that an answer is due, until the guard is dropped.
    pub(crate) fn expect_answer(self: &Arc<Self>, with_report: bool) -> AnswerDue {
        // Nobody waits for more to be due.
        self.change_perhaps(|state| {
            state.answers_due += 1;
            state.reports_on_streams += usize::from(with_report);
            ((), false)
        });
        AnswerDue { outbox: Arc::clone(self), with_report }
    }

    /// No handle is left: queued items are sent, then no more.
    pub(crate) fn close(&self) {
        self.change(|state| {
            if state.phase == OutboxPhase::Open {
                state.phase = OutboxPhase::Closing;
            }
        });
    }

    /// Waits until [`Outbox::close`] was called.
    pub(crate) async fn closing(&self) {
        let _ = self.state.subscribe().wait_for(|state| state.phase != OutboxPhase::Open).await;
    }

    /// Sends nothing any more. Returns the counts of items that were still waiting.
    pub(crate) fn give_up(&self) -> Lost {
        self.change(|state| {
            state.phase = OutboxPhase::Closed;
            state.sending = None;
            state.queue.drain(..).map(|item| Lost::of(&item)).fold(Lost::default(), Lost::and)
        })
    }

    fn change<T>(&self, change: impl FnOnce(&mut OutboxState) -> T) -> T {
        self.change_perhaps(|state| (change(state), true))
    }

    /// Changes the state, and wakes waiting threads only where the second value of `change` says so. A
    /// renderer's frame calls this, and waking a thread is a call of the system.
    fn change_perhaps<T>(&self, change: impl FnOnce(&mut OutboxState) -> (T, bool)) -> T {
        let mut result = None;
        self.state.send_if_modified(|state| {
            let (done, concerns_others) = change(state);
            result = Some(done);
            concerns_others
        });
        result.expect("send_if_modified calls the closure once")
    }
}

impl OutboxState {
    /// Appends. A full queue first loses abandoned trials, whose leases run out by themselves, and then its
    /// oldest report. That lease is the likeliest to be gone, and the newest says most of the present.
    fn put(&mut self, item: OutboxItem, capacity: usize) -> Lost {
        if self.phase == OutboxPhase::Closed {
            return Lost::of(&item);
        }
        let mut lost = Lost::default();
        if self.queue.len() >= capacity {
            let abandon = self.queue.iter().position(|other| other.message == Message::Abandon);
            if abandon.is_none() && item.message == Message::Abandon {
                return Lost::of(&item);
            }
            if let Some(victim) = self.queue.remove(abandon.unwrap_or(0)) {
                lost = Lost::of(&victim);
            }
        }
        self.queue.push_back(item);
        lost
    }

    fn waiting(&self) -> usize {
        self.queue.len() + usize::from(self.sending.is_some()) + self.reports_on_streams
    }
}

impl Lost {
    pub(crate) fn of(item: &OutboxItem) -> Self {
        match item.message {
            Message::Report(..) => Self { reports: 1, abandons: 0 },
            Message::Abandon => Self { reports: 0, abandons: 1 },
        }
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self { reports: self.reports + other.reports, abandons: self.abandons + other.abandons }
    }
}

/// An answer is due as long as this lives.
#[derive(Debug)]
pub(crate) struct AnswerDue {
    outbox: Arc<Outbox>,
    with_report: bool,
}

impl Drop for AnswerDue {
    fn drop(&mut self) {
        self.outbox.change(|state| {
            state.answers_due -= 1;
            state.reports_on_streams -= usize::from(self.with_report);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> Arc<str> {
        Arc::from(text)
    }

    fn report(trial: &str) -> OutboxItem {
        let message = Message::Report(Measurements::from([("render_ms", 1.0)]), Outcome::Ok);
        OutboxItem { study: name("s"), worker: name("w"), trial: name(trial), message, attempts: 0 }
    }

    fn queued(outbox: &Outbox) -> Vec<String> {
        outbox.state.borrow().queue.iter().map(|item| item.trial.to_string()).collect()
    }

    #[test]
    fn a_full_queue_loses_abandons_first_and_then_the_oldest_report() {
        let outbox = Outbox::new(2);
        assert!(outbox.hold(&name("a")));
        assert_eq!(outbox.release(&name("s"), &name("w"), &name("a")), Lost::default());
        assert_eq!(outbox.report(report("b")), Lost::default());
        assert_eq!(outbox.report(report("c")), Lost { reports: 0, abandons: 1 });
        assert_eq!(outbox.report(report("d")), Lost { reports: 1, abandons: 0 });
        assert_eq!(queued(&outbox), ["c", "d"]);
        assert!(outbox.hold(&name("e")));
        assert_eq!(outbox.release(&name("s"), &name("w"), &name("e")), Lost { reports: 0, abandons: 1 });
        assert_eq!(outbox.give_up(), Lost { reports: 2, abandons: 0 });
        assert_eq!(outbox.report(report("f")), Lost { reports: 1, abandons: 0 });
    }

    #[test]
    fn a_trial_is_given_back_by_its_last_handle_only() {
        let outbox = Outbox::new(9);
        assert!(outbox.hold(&name("a")) && outbox.hold(&name("a")));
        outbox.release(&name("s"), &name("w"), &name("a"));
        assert!(queued(&outbox).is_empty());
        outbox.release(&name("s"), &name("w"), &name("a"));
        assert_eq!(queued(&outbox), ["a"]);
    }

    #[test]
    fn a_trial_handed_out_again_is_not_given_back() {
        let outbox = Outbox::new(9);
        outbox.hold(&name("a"));
        outbox.release(&name("s"), &name("w"), &name("a"));
        assert!(outbox.hold(&name("a")), "the queued message is withdrawn");
        assert!(queued(&outbox).is_empty());
    }

    #[tokio::test]
    async fn a_trial_that_is_being_reported_is_no_longer_ours() {
        let outbox = Outbox::new(9);
        outbox.hold(&name("a"));
        outbox.mark_reported(&name("a"));
        assert!(!outbox.hold(&name("a")), "held with its result");
        outbox.report(report("a"));
        outbox.release(&name("s"), &name("w"), &name("a"));
        assert!(!outbox.hold(&name("a")), "queued");
        outbox.wait_until_sent("s", "another").await;
        let item = outbox.next().await.unwrap();
        assert!(!outbox.hold(&name("a")), "being sent");
        outbox.wait_until_sent("s", "another").await;
        assert_eq!(outbox.waiting(), 1);
        outbox.put_back(item);
        assert_eq!(queued(&outbox), ["a"]);
        outbox.next().await.unwrap();
        outbox.done();
        outbox.wait_until_sent("s", "w").await;
        outbox.wait_until_quiet().await;
        assert!(outbox.hold(&name("a")));
    }
}
