//! Trials that are excluded from all that is learnt, and count again.
//!
//! The mark is one column of the trial, whose measurements stay as they are. The tuner drops what rests on
//! the trial and is kept in rows of its own, and the study is read again from the trials that count.

use treewright_core::trial::{RawTrial, TrialState};
use treewright_core::tuner::TunerError;
use treewright_store::Store;

use super::{Live, Tuning};
use crate::convert::names::TrialName;
use crate::error::{Error, Result};

impl Tuning {
    /// Excludes a completed trial for a reason, or counts it again without one, and returns it. No checkpoint
    /// is saved meanwhile: one from before the change would bring the trial back.
    pub async fn exclude_trial(&self, name: &TrialName, reason: Option<&str>) -> Result<RawTrial> {
        let _alone = self.pause_checkpoints().await?;
        let mark = self
            .with_tuner(&name.study.id, |live, store, _| {
                live.knows(name)?;
                if live.tuner.clients().open_trial(name.number).is_some() {
                    let (number, state) = (name.number, TrialState::Open);
                    return Err(Error::from(TunerError::NotCompleted { number, state }));
                }
                Ok::<_, Error>(live.mark(store))
            })
            .await??;
        let known = |stored: &RawTrial| {
            if stored.state != TrialState::Completed {
                let (number, state) = (stored.number, stored.state);
                return Err(Error::from(TunerError::NotCompleted { number, state }));
            }
            Ok((stored.exclusion.as_deref() == reason).then(|| Err(Box::new(stored.clone()))))
        };
        // Both are to be durable: what the tuner dropped, and the mark.
        let exclude = |live: &mut Live, store: &dyn Store, stored: RawTrial, _: i64| {
            let dropped = live.tuner.disown(stored.state_id);
            let dropped = live.commit(store, &[dropped]);
            live.is_stale = true;
            Ok::<_, Error>(Ok([dropped, store.exclude_trial(live.fence(), name.number, reason)]))
        };
        let receipts = match self.change_closed(name, mark, known, exclude).await? {
            Ok(receipts) => receipts,
            Err(unchanged) => return Ok(*unchanged),
        };
        for receipt in receipts {
            self.metrics().durable(receipt).await?;
        }
        let (study, trial) = (&name.study.id, name.number);
        let reason = reason.unwrap_or_default();
        tracing::info!(study, trial, reason, "trial excluded, or counted again without a reason");
        let study = self.find(name.study.clone()).await?;
        self.get_trial(&TrialName { study, number: name.number }).await
    }
}
