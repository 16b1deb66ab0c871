//! Suggest and report, as two requests or as one: the requests of a client's frame.

use treewright_core::trial::{RawTrial, Trial, TrialState};
use treewright_core::tuner::{Change, DecisionStep, TunerError, gave_up};
use treewright_store::{Fence, Receipt, Store};

use super::loading::misfit;
use super::planning::{Preparation, Prepared};
use super::{Live, Tuning};
use crate::convert::from_proto::{Report, Suggest};
use crate::error::{Error, Result};
use crate::redirect::Redirect;

/// A report that was taken now or before.
#[derive(Clone, Debug, PartialEq)]
pub enum Reported {
    /// The trial as this report completed it.
    Taken(Box<Trial>),
    /// The trial as an earlier report completed it.
    Duplicate(Box<RawTrial>),
}

/// The answers to the requested parts of a frame.
pub struct FrameAnswer {
    /// To the report.
    pub reported: Option<Result<Reported>>,
    /// To the suggestion.
    pub suggested: Option<Result<Trial>>,
}

impl FrameAnswer {
    /// The place for another try of the rest.
    pub fn redirect(&self) -> Option<Redirect> {
        let reported = self.reported.as_ref().and_then(|result| result.as_ref().err());
        let suggested = self.suggested.as_ref().and_then(|result| result.as_ref().err());
        reported.into_iter().chain(suggested).find_map(Redirect::of)
    }
}

enum ReportOutcome {
    /// It completes an open trial.
    Now(Box<Trial>, Change),
    /// The trial is not open; the store has its record.
    Closed,
    /// It is refused.
    Refused(Error),
}

impl Tuning {
    /// Hands out the next trial.
    pub async fn suggest(&self, suggest: Suggest) -> Result<Trial> {
        self.suggest_after(suggest, None).await
    }

    /// Answers a suggestion, with a preparation that is known to be needed, if any.
    async fn suggest_after(&self, suggest: Suggest, begun: Option<Preparation>) -> Result<Trial> {
        let (trial, receipt) = self
            .with_plan(&suggest.study.id, begun, |live, store, prepared, now_ms| {
                // The name may have gone to another study meanwhile.
                if let Err(another) = live.is_meant(&suggest.study) {
                    return Ok(Err(another));
                }
                let suggested = live.suggest(&suggest, prepared, now_ms)?.map(|(trial, change)| {
                    note(&suggest, &trial, &change);
                    (trial, live.commit(store, &[change]))
                });
                Ok(suggested.map_err(Error::from))
            })
            .await??;
        self.metrics().durable(receipt).await?;
        Ok(trial)
    }

    /// Takes a result.
    pub async fn report(&self, report: Report) -> Result<Reported> {
        let answer = self
            .with_tuner(&report.trial.study.id, |live, store, now_ms| {
                let outcome = take(live, &report, now_ms);
                queue(live, store, outcome)
            })
            .await?;
        self.reported(report, answer).await
    }

    /// Takes a result and hands out the next trial, in one write where both are of one study.
    pub async fn frame(&self, report: Option<Report>, suggest: Option<Suggest>) -> FrameAnswer {
        match (report, suggest) {
            (Some(report), Some(suggest)) if report.trial.study.id == suggest.study.id => {
                self.joint_frame(report, suggest).await
            }
            (report, suggest) => FrameAnswer {
                reported: match report {
                    Some(report) => Some(self.report(report).await),
                    None => None,
                },
                suggested: match suggest {
                    Some(suggest) => Some(self.suggest(suggest).await),
                    None => None,
                },
            },
        }
    }

    async fn joint_frame(&self, report: Report, suggest: Suggest) -> FrameAnswer {
        /// The reported trial, the suggestion or its preparation, the receipt of both, and whether updates of
        /// the models were deferred.
        type Joint = (Box<Trial>, Result<Result<Trial, TunerError>, Preparation>, Receipt, bool);
        let study = suggest.study.id.clone();
        let computed: Result<Option<Joint>> = self
            .with_tuner(&study, |live, store, now_ms| {
                live.is_meant(&suggest.study).ok()?;
                let ReportOutcome::Now(completed, change) = take(live, &report, now_ms) else {
                    return None;
                };
                let mut changes = vec![change];
                let suggested = live.suggest(&suggest, Prepared::default(), now_ms).map(|answer| {
                    answer.map(|(trial, change)| {
                        note(&suggest, &trial, &change);
                        assert_ne!(trial.number, completed.number, "what was just measured is handed out");
                        changes.push(change);
                        trial
                    })
                });
                let receipt = live.commit(store, &changes);
                Some((completed, suggested, receipt, live.tuner.knowledge().has_deferred_updates()))
            })
            .await;
        match computed {
            Ok(Some((completed, Err(preparation), receipt, _))) => {
                let suggested = self.suggest_after(suggest, Some(preparation));
                let (durable, suggested) = tokio::join!(self.metrics().durable(receipt), suggested);
                let reported = durable.map(|()| Reported::Taken(completed)).map_err(Error::from);
                FrameAnswer { reported: Some(reported), suggested: Some(suggested) }
            }
            Ok(Some((completed, Ok(suggested), receipt, deferred))) => {
                match self.durable(&study, receipt, deferred).await {
                    Ok(()) => FrameAnswer {
                        reported: Some(Ok(Reported::Taken(completed))),
                        suggested: Some(suggested.map_err(Error::from)),
                    },
                    Err(error) => FrameAnswer {
                        reported: Some(Err(error.clone().into())),
                        suggested: Some(Err(error.into())),
                    },
                }
            }
            // A late, repeated or wrong report and the suggestion are handled separately.
            Ok(None) => FrameAnswer {
                reported: Some(self.report(report).await),
                suggested: Some(self.suggest(suggest).await),
            },
            Err(error) => FrameAnswer { reported: Some(Err(error.clone())), suggested: Some(Err(error)) },
        }
    }

    async fn reported(&self, report: Report, answer: Queued) -> Result<Reported> {
        let (completed, receipt, deferred) = match answer {
            Queued::Taken(taken) => taken,
            Queued::Refused(error) => return Err(error),
            Queued::Closed(mark) => match self.report_closed(&report, mark).await? {
                Ok(taken) => taken,
                Err(stored) => return Ok(Reported::Duplicate(stored)),
            },
        };
        self.durable(&report.trial.study.id, receipt, deferred).await?;
        Ok(Reported::Taken(completed))
    }

    /// Takes a result for a trial that is not open; an error inside is a trial that was reported before.
    async fn report_closed(&self, report: &Report, mark: ClosedMark) -> Result<Result<Taken, Box<RawTrial>>> {
        let known = |stored: &RawTrial| match stored.state {
            // The client that reports must not believe that it is stored.
            _ if gave_up(stored) => Err(Error::from(TunerError::GivenUp(stored.number))),
            TrialState::Completed => Ok(Some(Err(Box::new(stored.clone())))),
            _ => Ok(None),
        };
        let take = |live: &mut Live, store: &dyn Store, stored: RawTrial, now_ms: i64| {
            let trial = live.check(stored)?;
            let (completed, change) = completed(live, &trial, report, now_ms)?;
            assert_eq!((completed.number, completed.state), (report.trial.number, TrialState::Completed));
            live.closed_changes += 1;
            Ok::<_, Error>(Ok(taken(live, store, Box::new(completed), change)))
        };
        self.change_closed(&report.trial, mark, known, take).await
    }
}

/// A completed trial, the receipt of its report, and whether updates of the models were deferred.
type Taken = (Box<Trial>, Receipt, bool);

enum Queued {
    Taken(Taken),
    Closed(ClosedMark),
    Refused(Error),
}

/// A point in a study's life at which a trial was not open.
pub(super) struct ClosedMark {
    /// Durable, and so readable, once every write before that point is.
    pub(super) receipt: Receipt,
    pub(super) fence: Fence,
    pub(super) closed_changes: u64,
}

impl Live {
    /// Marks this point. All writes before it are awaited by the mark's receipt.
    pub(super) fn mark(&mut self, store: &dyn Store) -> ClosedMark {
        let receipt = self.commit(store, &[]);
        ClosedMark { receipt, fence: self.fence().clone(), closed_changes: self.closed_changes }
    }

    /// Answers a question with a trial that its client can run, or returns its preparation.
    fn suggest(
        &mut self,
        suggest: &Suggest,
        prepared: Prepared,
        now_ms: i64,
    ) -> Result<Result<(Trial, Change), TunerError>, Preparation> {
        match self.outdated(suggest.space_revision) {
            None => self.decide(suggest, prepared, now_ms),
            Some(revision) => self.suggest_outdated(suggest, revision, prepared, now_ms),
        }
    }

    /// Answers a question with a trial of the present space, or returns its preparation.
    pub(super) fn decide(
        &mut self,
        suggest: &Suggest,
        prepared: Prepared,
        now_ms: i64,
    ) -> Result<Result<(Trial, Change), TunerError>, Preparation> {
        let Suggest { ask, wanted, .. } = suggest;
        let ask = &ask.at(now_ms);
        assert!(suggest.ask.origin.is_none() || wanted.is_some(), "an origin of what is not decided yet");
        if let Some(wanted) = wanted {
            debug_assert!(prepared.plan.is_none(), "a wish needs no plan");
            return Ok(self.tuner.suggest_wanted(ask, wanted.clone(), None, now_ms));
        }
        let may_plan = |state| self.planned_searches.is_free(state);
        match self.tuner.suggest_step(ask, prepared.plan, may_plan, now_ms) {
            Ok(DecisionStep::Need(request)) => Err(self.preparation(request, prepared.is_updated)),
            Ok(DecisionStep::Done(answer)) => Ok(Ok(answer)),
            Err(refused) => Ok(Err(refused)),
        }
    }

    /// Whether no closed trial has changed since a mark.
    pub(super) fn is_at(&self, fence: &Fence, closed_changes: u64) -> bool {
        self.fence().is_same(fence) && self.closed_changes == closed_changes
    }

    /// Checks a closed trial that comes from the store. A trial that is open there, or that this copy of the
    /// study never handed out, shows that another replica holds the study now. The copy is then dropped, and
    /// the next request loads a fresh one.
    pub(super) fn check(&self, trial: RawTrial) -> Result<Trial> {
        if trial.state == TrialState::Open || trial.number > self.tuner.statistics().trials {
            self.fence().break_up();
            let study = self.fence().study().to_owned();
            return Err(treewright_store::StoreError::Fenced(study).into());
        }
        let number = trial.number;
        let adopted = trial.adopt(&self.earlier, &self.tuner.spec().space);
        let adopted = adopted.map_err(|error| misfit(self.fence().study(), error))?;
        adopted.ok_or_else(|| TunerError::OutsideSpace(number).into())
    }
}

fn take(live: &mut Live, report: &Report, now_ms: i64) -> ReportOutcome {
    if let Err(error) = live.knows(&report.trial) {
        return ReportOutcome::Refused(error);
    }
    let Some(open) = live.tuner.clients().open_trial(report.trial.number).cloned() else {
        return ReportOutcome::Closed;
    };
    match completed(live, &open, report, now_ms) {
        Ok((completed, change)) => {
            assert_eq!((completed.number, completed.state), (report.trial.number, TrialState::Completed));
            let is_stored = change.trials.iter().any(|trial| trial.number == completed.number);
            assert!(is_stored, "trial {} would be acknowledged and not stored", completed.number);
            ReportOutcome::Now(Box::new(completed), change)
        }
        Err(error) => ReportOutcome::Refused(error.into()),
    }
}

fn completed(
    live: &mut Live,
    trial: &Trial,
    report: &Report,
    now_ms: i64,
) -> Result<(Trial, Change), TunerError> {
    let Report { measurements, standard_errors, outcome, .. } = report.clone();
    live.tuner.report_estimates(trial, measurements, standard_errors, outcome, now_ms)
}

fn taken(live: &mut Live, store: &dyn Store, completed: Box<Trial>, change: Change) -> Taken {
    (completed, live.commit(store, &[change]), live.tuner.knowledge().has_deferred_updates())
}

fn queue(live: &mut Live, store: &dyn Store, outcome: ReportOutcome) -> Queued {
    match outcome {
        ReportOutcome::Now(completed, change) => Queued::Taken(taken(live, store, completed, change)),
        ReportOutcome::Closed => Queued::Closed(live.mark(store)),
        ReportOutcome::Refused(error) => Queued::Refused(error),
    }
}

/// Logs each change of a client's state, and at a finer level each trial.
fn note(suggest: &Suggest, trial: &Trial, change: &Change) {
    let last = change.trials.last().map(|trial| trial.number);
    assert_eq!((last, trial.state), (Some(trial.number), TrialState::Open), "what is handed out is stored");
    assert_eq!(trial.client_id, suggest.ask.client_id, "trial {} is another's", trial.number);
    let (study, client) = (suggest.study.id.as_str(), trial.client_id.as_str());
    if !change.visits.is_empty() {
        let (state, mode) = (trial.state_id, trial.mode());
        tracing::debug!(study, client, state, ?mode, "client came to a state: {}", trial.reason().summary);
    }
    tracing::trace!(study, client, trial = trial.number, "suggested");
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use treewright_core::trial::Outcome;
    use treewright_core::tuner::Ask;
    use treewright_store::MemoryStore;

    use super::super::checkpoints::tests::{alive, explore, in_memory, spec, suggested, sweep_a_minute};
    use super::*;
    use crate::clock::ManualClock;
    use crate::convert::names::{StudyName, TrialName};

    fn report_of(trial: &TrialName) -> Report {
        let measurements = [("render_ms".to_owned(), 2.0)].into();
        let standard_errors = BTreeMap::new();
        Report { trial: trial.clone(), measurements, standard_errors, outcome: Outcome::Ok }
    }

    /// Two studies, each with a trial 1 that is expired or reported, of which the second takes the first
    /// one's name while a request for that trial waits for the disk. Returns the use cases, the trial, and
    /// the waiting mark.
    async fn replaced(is_reported: bool) -> (Tuning, TrialName, ClosedMark) {
        let clock = Arc::new(ManualClock::at(1_000));
        let tuning = Tuning::new(Arc::new(MemoryStore::new()), Arc::clone(&clock) as _);
        for study in ["hall", "attic"] {
            tuning.create_study(study, &spec()).await.expect("created");
            let indicators = [("x".to_owned(), 0.5)].into();
            let ask = Ask { client_id: "one".to_owned(), indicators, ..Ask::default() };
            let suggest = Suggest { study: study.into(), ask, wanted: None, space_revision: 0 };
            assert_eq!(tuning.suggest(suggest).await.expect("a trial").number, 1);
            if is_reported {
                let report = report_of(&TrialName { study: study.into(), number: 1 });
                assert!(matches!(tuning.report(report).await, Ok(Reported::Taken(_))));
            }
        }
        clock.advance_ms(3_600_000);
        tuning.sweep_leases().await.expect("swept");
        let mark = tuning.with_tuner("hall", |live, store, _| live.mark(store)).await.expect("in memory");
        tuning.delete_study(&"hall".into()).await.expect("deleted");
        tuning.rename_study(&"attic".into(), "hall").await.expect("renamed");
        (tuning, TrialName { study: "hall".into(), number: 1 }, mark)
    }

    #[tokio::test]
    async fn a_late_report_never_reaches_another_study_that_got_the_name_meanwhile() {
        for (is_reported, state) in [(false, TrialState::Expired), (true, TrialState::Completed)] {
            let (tuning, trial, mark) = replaced(is_reported).await;
            let answer = tuning.reported(report_of(&trial), Queued::Closed(mark)).await;
            let refused = answer.expect_err("it is another's, and no duplicate");
            assert!(matches!(refused, Error::EarlierTrial { number: 1, .. }), "{refused}");
            assert_eq!(tuning.get_trial(&trial).await.expect("there").state, state);
        }
    }

    #[tokio::test]
    async fn another_study_that_got_the_name_meanwhile_answers_no_question() {
        let tuning = in_memory();
        let uid = tuning.create_study("hall", &spec()).await.expect("created").study.uid;
        tuning.delete_study(&"hall".into()).await.expect("deleted");
        tuning.create_study("hall", &spec()).await.expect("created");
        let number = suggested(&tuning, "one", 0.5).await.number;

        let study = StudyName { id: "hall".to_owned(), uid: Some(uid) };
        let indicators: BTreeMap<_, _> = [("x".to_owned(), 0.5)].into();
        let ask = Ask { client_id: "one".to_owned(), indicators: indicators.clone(), ..Ask::default() };
        let suggest = Suggest { study: study.clone(), ask, wanted: None, space_revision: 0 };
        let trial = TrialName { study: study.clone(), number };
        let refused = [
            tuning.suggest(suggest).await.err(),
            tuning.predict(&study, &indicators, None, None, 0).await.err(),
            tuning.best(&study, None, None, None, 0).await.err(),
            tuning.get_trial(&trial).await.err(),
        ];
        for error in refused {
            assert!(matches!(error, Some(Error::Replaced { .. })), "{error:?}");
        }
    }

    #[tokio::test]
    async fn a_report_of_a_trial_that_the_daemon_gave_up_is_refused_and_called_no_duplicate() {
        let (store, clock) = (Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)));
        let start = || Tuning::new(Arc::clone(&store) as _, Arc::clone(&clock) as _);
        let mut tuning = start();
        explore(&tuning).await;
        let mut trials = Vec::new();
        for client in ["one", "two"] {
            trials.push(alive(&tuning, client).await);
            sweep_a_minute(&tuning, &clock).await;
        }
        assert!(matches!(tuning.report(report_of(&trials[0])).await, Ok(Reported::Taken(_))), "late");
        assert!(matches!(tuning.report(report_of(&trials[0])).await, Ok(Reported::Duplicate(_))));
        for _ in 0..2 {
            let refused = tuning.report(report_of(&trials[1])).await.expect_err("it is given up");
            assert_eq!(refused, Error::from(TunerError::GivenUp(trials[1].number)));
            let stored = tuning.get_trial(&trials[1]).await.expect("there");
            assert!(matches!(stored.outcome, Some(Outcome::Infeasible { .. })), "{stored:?}");
            tuning = start();
        }
    }
}
