//! Use cases of one trial, and those that read many: abandon, extend, read, predict, best.

use std::collections::BTreeMap;

use treewright_core::configuration::RawConfiguration;
use treewright_core::trial::{Fingerprint, RawTrial, Trial, TrialState};
use treewright_core::tuner::{Best, Change, DecisionStep, Prediction, Tuner, TunerError};
use treewright_store::{Receipt, Store, TrialPage, TrialQuery};

use super::frames::ClosedMark;
use super::{Live, Tuning};
use crate::convert::names::{StudyName, TrialName};
use crate::error::{Error, Result};

/// The number of reads of a closed trial while other requests change closed trials.
const TRIES: usize = 8;

impl Tuning {
    /// Takes a trial back unmeasured.
    pub async fn abandon(&self, name: &TrialName) -> Result<Trial> {
        let (trial, receipt) = match self.change_open(name, |tuner, open, _| tuner.abandon(open)).await? {
            Ok(abandoned) => abandoned,
            Err(mark) => {
                let abandon = |live: &mut Live, store: &dyn Store, stored: RawTrial, _: i64| {
                    let (trial, change) = live.tuner.abandon(&live.check(stored)?)?;
                    live.closed_changes += 1;
                    Ok::<_, Error>((trial, live.commit(store, &[change])))
                };
                self.change_closed(name, mark, |_| Ok(None), abandon).await?
            }
        };
        assert_eq!((trial.number, trial.state), (name.number, TrialState::Abandoned));
        self.metrics().durable(receipt).await?;
        Ok(trial)
    }

    /// Renews a lease.
    pub async fn extend_lease(&self, name: &TrialName) -> Result<Trial> {
        let extended = self.change_open(name, |tuner, open, now_ms| tuner.extend_lease(open, now_ms));
        match extended.await? {
            Ok((trial, receipt)) => {
                assert_eq!((trial.number, trial.state), (name.number, TrialState::Open));
                self.metrics().durable(receipt).await?;
                Ok(trial)
            }
            Err(mark) => {
                let stored = self.closed_trial(name, mark.receipt).await?;
                Err(TunerError::NotOpen { number: stored.number, state: stored.state }.into())
            }
        }
    }

    /// Changes an open trial; an error inside marks the point at which the trial was not open.
    async fn change_open(
        &self,
        name: &TrialName,
        change: impl FnOnce(&mut Tuner, &Trial, i64) -> Result<(Trial, Change), TunerError> + Send,
    ) -> Result<Result<(Trial, Receipt), ClosedMark>> {
        self.with_tuner(&name.study.id, |live, store, now_ms| {
            live.knows(name)?;
            let Some(open) = live.tuner.clients().open_trial(name.number).cloned() else {
                return Ok(Err(live.mark(store)));
            };
            let (trial, change) = change(&mut live.tuner, &open, now_ms)?;
            Ok::<_, Error>(Ok((trial, live.commit(store, &[change]))))
        })
        .await?
    }

    /// Changes a trial that is not open, as the store has it. `known` may answer from that alone; `change`
    /// works under the tuner's lock. Both are called again where a closed trial has changed meanwhile.
    pub(super) async fn change_closed<T: Send>(
        &self,
        name: &TrialName,
        mut mark: ClosedMark,
        known: impl Fn(&RawTrial) -> Result<Option<T>> + Send,
        mut change: impl FnMut(&mut Live, &dyn Store, RawTrial, i64) -> Result<T> + Send,
    ) -> Result<T> {
        for _ in 0..TRIES {
            let ClosedMark { receipt, fence, closed_changes } = mark;
            let stored = self.closed_trial(name, receipt).await?;
            if let Some(answer) = known(&stored)? {
                return Ok(answer);
            }
            let changed = self
                .with_tuner(&name.study.id, |live, store, now_ms| {
                    // The name may have gone to another study meanwhile.
                    live.knows(name)?;
                    if !live.is_at(&fence, closed_changes) {
                        return Ok(Err(live.mark(store)));
                    }
                    Ok::<_, Error>(Ok(change(live, store, stored, now_ms)?))
                })
                .await??;
            match changed {
                Ok(answer) => return Ok(answer),
                Err(later) => mark = later,
            }
        }
        Err(Error::Reloading(name.study.id.clone()))
    }

    /// Reads a trial that is not open, once all earlier writes are stored. The name may have gone to another
    /// study before the read, and another replica may have had the study meanwhile. So both are checked after
    /// the read.
    pub(super) async fn closed_trial(&self, name: &TrialName, before: Receipt) -> Result<RawTrial> {
        self.metrics().durable(before).await?;
        let stored = self.get_trial(name).await;
        let still_here = self
            .with_tuner(&name.study.id, |live, store, _| {
                live.knows(name)?;
                Ok::<_, Error>(live.commit(store, &[]))
            })
            .await??;
        self.metrics().durable(still_here).await?;
        stored
    }

    /// Reads a trial.
    pub async fn get_trial(&self, name: &TrialName) -> Result<RawTrial> {
        let trial = self.store().get_trial(&name.study.id, name.number).await?;
        assert_eq!(trial.number, name.number, "another trial was read");
        self.is_still(&name.study).await?;
        Ok(trial)
    }

    /// Reads a page of trials.
    pub async fn query_trials(&self, study: &StudyName, query: &TrialQuery) -> Result<TrialPage> {
        let page = self.store().query_trials(&study.id, query).await?;
        self.is_still(study).await?;
        Ok(page)
    }

    /// The prediction, for a client that knows a revision of the space, 0 for the present one, and runs its
    /// start by default. Writes nothing and waits for nothing.
    pub async fn predict(
        &self,
        study: &StudyName,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&RawConfiguration>,
        space_revision: u32,
    ) -> Result<Prediction> {
        self.with_plan(&study.id, None, |live, _, prepared, _| {
            if let Err(another) = live.is_meant(study) {
                return Ok(Err(another));
            }
            let start = live.present_start(space_revision, start.cloned());
            let predicted = live.tuner.predict_step(indicators, fingerprint, start.as_ref(), prepared.plan);
            let predicted = match predicted {
                Ok(DecisionStep::Need(request)) => {
                    return Err(live.preparation(request, prepared.is_updated));
                }
                Ok(DecisionStep::Done(prediction)) => {
                    live.in_revision(space_revision, start.as_ref(), prediction)
                }
                Err(refused) => Err(refused),
            };
            Ok(predicted.map_err(Error::from))
        })
        .await?
    }

    /// The best known configuration, in the state of the indicators or anywhere, for a client that knows a
    /// revision of the space, 0 for the present one, and runs its start by default. Also whether it is that
    /// one, and not another in place of one that the client does not know. The trials behind it are stored.
    pub async fn best(
        &self,
        study: &StudyName,
        indicators: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&RawConfiguration>,
        space_revision: u32,
    ) -> Result<(Best, bool)> {
        let (best, receipt) = self
            .with_plan(&study.id, None, |live, store, prepared, _| {
                if let Err(another) = live.is_meant(study) {
                    return Ok(Err(another));
                }
                let start = live.present_start(space_revision, start.cloned());
                let best = live.tuner.best_step(indicators, fingerprint, start.as_ref(), prepared.plan);
                let best = match best {
                    Ok(DecisionStep::Need(request)) => {
                        return Err(live.preparation(request, prepared.is_updated));
                    }
                    Ok(DecisionStep::Done(best)) => Ok(best),
                    Err(refused) => Err(refused),
                };
                let is_measured = |best: &Best| best.cost.is_finite() && best.measurements > 0;
                debug_assert!(best.iter().flatten().all(is_measured), "{best:?} was never measured");
                let in_revision = |best| live.best_in_revision(space_revision, best);
                let best = best.and_then(|best| best.map(in_revision).transpose());
                Ok(best.map(|best| (best, live.commit(store, &[]))).map_err(Error::from))
            })
            .await??;
        self.metrics().durable(receipt).await?;
        best.ok_or_else(|| Error::NothingMeasured {
            study: study.id.clone(),
            place: if indicators.is_some() { "in this state" } else { "in any state" },
        })
    }
}
