//! Trials that are excluded from all that is learnt, and count again.
//!
//! The mark is one column of the trial, whose measurements stay as they are. The tuner drops what rests on
//! the trial and is kept in rows of its own, and the study is read again from the trials that count.

use treewright_core::trial::{RawTrial, TrialState};
use treewright_core::tuner::TunerError;
use treewright_store::Receipt;

use super::Tuning;
use super::frames::ClosedMark;
use crate::convert::names::TrialName;
use crate::error::Error;

/// The number of tries while other requests change closed trials.
const TRIES: usize = 8;

/// The result of a try under the tuner's lock.
enum Exclusion {
    /// Both are to be durable: what the tuner dropped, and the mark.
    Queued([Receipt; 2]),
    /// The trial has to be read again.
    Read(ClosedMark),
}

impl Tuning {
    /// Excludes a completed trial for a reason, or counts it again without one, and returns it. No checkpoint
    /// is saved meanwhile: one from before the change would bring the trial back.
    ///
    /// # Errors
    /// As the wire contract names them.
    pub async fn exclude_trial(&self, name: &TrialName, reason: Option<&str>) -> Result<RawTrial, Error> {
        let _alone = self.pause_checkpoints().await?;
        let mut found = self
            .with_tuner(&name.study.id, |live, store, _| {
                live.knows(name)?;
                if live.tuner.open_trial(name.number).is_some() {
                    let (number, state) = (name.number, TrialState::Open);
                    return Err(Error::from(TunerError::NotCompleted { number, state }));
                }
                Ok::<_, Error>(Exclusion::Read(live.mark(store)))
            })
            .await??;
        for _ in 0..TRIES {
            let mark = match found {
                Exclusion::Read(mark) => mark,
                Exclusion::Queued(receipts) => {
                    for receipt in receipts {
                        self.metrics().durable(receipt).await?;
                    }
                    let (study, trial) = (&name.study.id, name.number);
                    let reason = reason.unwrap_or_default();
                    tracing::info!(study, trial, reason, "trial excluded, or counted again without a reason");
                    let study = self.find(name.study.clone()).await?;
                    return self.get_trial(&TrialName { study, number: name.number }).await;
                }
            };
            let stored = self.closed_trial(name, mark.receipt).await?;
            if stored.state != TrialState::Completed {
                return Err(TunerError::NotCompleted { number: stored.number, state: stored.state }.into());
            }
            if stored.exclusion.as_deref() == reason {
                return Ok(stored);
            }
            let (fence, closed_changes) = (mark.fence, mark.closed_changes);
            found = self
                .with_tuner(&name.study.id, |live, store, _| {
                    // The name may have gone to another study meanwhile.
                    live.knows(name)?;
                    if !live.is_at(&fence, closed_changes) {
                        return Ok(Exclusion::Read(live.mark(store)));
                    }
                    let dropped = live.tuner.disown(stored.state_id);
                    let dropped = live.commit(store, &[dropped]);
                    live.is_stale = true;
                    let marked = store.exclude_trial(live.fence(), name.number, reason);
                    Ok::<_, Error>(Exclusion::Queued([dropped, marked]))
                })
                .await??;
        }
        Err(Error::Reloading { study: name.study.id.clone() })
    }
}
