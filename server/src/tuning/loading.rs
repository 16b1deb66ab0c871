//! Reading a study into memory: its states, the last checkpoint, then the completed trials behind it in
//! stretches.

use std::sync::Arc;

use treewright_core::ids::StudyUid;
use treewright_core::limits::CHECKPOINT_BYTES_PER_TRIAL;
use treewright_core::space::{EarlierSpaces, Space};
use treewright_core::trial::{RawTrial, Trial, TrialState};
use treewright_core::tuner::{RestoreError, Restoring, Tuner};
use treewright_store::{Fence, Loaded, Store, StoreError};

use super::compute::compute;
use crate::error::{Error, Result};
use crate::limits;

/// The last checkpoint of a study: its coverage and its length.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Saved {
    /// The completion of the last attempt.
    pub(super) completion: u64,
    /// The completion up to which it surely covers the trials: it is on the disk, and this program can read
    /// it.
    pub(super) stored: u64,
    pub(super) bytes: u64,
}

impl Saved {
    /// Whether enough trials were completed since then to pay for another checkpoint.
    pub(super) fn is_due(self, completed: u64, after: u64) -> bool {
        let after = after.max(self.bytes / CHECKPOINT_BYTES_PER_TRIAL);
        completed.saturating_sub(self.completion) >= after
    }
}

/// The identity of a study, beside its name.
#[derive(Clone, Copy, Debug)]
pub(super) struct Identity {
    pub(super) uid: StudyUid,
    /// Trials up to this number were handed out before the study got its name.
    pub(super) named_after: u64,
    /// The number of trial numbers that other studies of the name used.
    pub(super) skipped: u64,
}

pub(super) struct Read {
    pub(super) tuner: Tuner,
    pub(super) identity: Identity,
    pub(super) fence: Fence,
    pub(super) saved: Saved,
    pub(super) earlier: EarlierSpaces,
}

/// Loads a study. Breaks earlier fences of it.
pub(super) async fn load(store: &dyn Store, study: &str, now_ms: i64) -> Result<Read> {
    let loaded = store.load(study).await?;
    read(store, loaded, now_ms).await
}

/// Reads the knowledge of a loaded study. Another daemon may take the study meanwhile. The copy then keeps
/// its state at loading, and its fence has broken or the store will refuse its changes.
async fn read(store: &dyn Store, loaded: Loaded, now_ms: i64) -> Result<Read> {
    let Loaded { fence, study: record, snapshot, mut open_trials, checkpoint } = loaded;
    let study = fence.study().to_owned();
    debug_assert!(open_trials.iter().all(|trial| trial.state == TrialState::Open), "only these are leased");
    // A lease from before the clock was set back must not last until that time comes again.
    for trial in &mut open_trials {
        let lease_ms = trial.lease_expire_ms.saturating_sub(trial.create_ms);
        trial.lease_expire_ms = trial.lease_expire_ms.min(now_ms.saturating_add(lease_ms));
    }
    let known = record.statistics.completed_trials;
    let skipped = record.last_trial.saturating_sub(record.statistics.trials);
    let identity = Identity { uid: record.uid, named_after: record.named_after, skipped };
    let (spec, earlier) = (Arc::new(record.spec), Arc::new(record.earlier));
    let failed = |problem| Error::Restore { study: study.clone(), problem };
    // A checkpoint from a partly restored database could be ahead of the trials.
    let checkpoint = checkpoint.filter(|one| one.completion <= known);
    let bytes = checkpoint.as_ref().map_or(0, |one| one.bytes.len() as u64);
    let begun = Arc::clone(&spec);
    let mut restoring =
        compute(move || Restoring::new(begun, snapshot, checkpoint.as_ref())).await?.map_err(failed)?;
    if let Some(reason) = restoring.passed_over() {
        tracing::info!(study, reason, "the checkpoint is passed over; all trials are read");
    }
    debug_assert!(restoring.after() <= known, "{} of {known} are learnt", restoring.after());
    let saved = Saved { completion: restoring.after(), stored: restoring.after(), bytes };
    loop {
        let mut trials = store.completed_trials(&fence, restoring.after(), limits::TRIALS_PER_READ).await?;
        // Later trials are of another daemon, which holds the study now: this copy must not mix with them.
        trials.retain(|trial| trial.completion.is_some_and(|at| at <= known));
        if trials.is_empty() {
            break;
        }
        let (of, space, earlier) = (study.clone(), Arc::clone(&spec), Arc::clone(&earlier));
        let trials = compute(move || adopt(&of, trials, &space.space, &earlier)).await??;
        restoring = compute(move || learn(restoring, &trials)).await?.map_err(failed)?;
    }
    let tuner = compute(move || restoring.finish(open_trials)).await?.map_err(failed)?;
    Ok(Read { tuner, identity, fence, saved, earlier: Arc::unwrap_or_clone(earlier) })
}

/// A completion, and its trial in the space that the study has by now; none where the trial is outside.
pub(super) type Adopted = (u64, Option<Trial>);

/// Learns consecutive trials while they are the next ones: a change of predictor goes back.
fn learn(mut restoring: Restoring, trials: &[Adopted]) -> Result<Restoring, RestoreError> {
    for (completion, trial) in trials {
        match trial {
            Some(trial) => restoring.learn(trial)?,
            None => restoring.pass_over(*completion)?,
        }
        if *completion != restoring.after() {
            break;
        }
    }
    Ok(restoring)
}

/// Reads completed trials in the space that their study has by now.
pub(super) fn adopt(
    study: &str,
    trials: Vec<RawTrial>,
    space: &Space,
    earlier: &EarlierSpaces,
) -> Result<Vec<Adopted>> {
    let adopt = |trial: RawTrial| {
        let completion = trial.completion.unwrap_or(0);
        trial.adopt(earlier, space).map(|adopted| (completion, adopted)).map_err(|error| misfit(study, error))
    };
    trials.into_iter().map(adopt).collect()
}

/// The error for a stored configuration that its study does not explain.
pub(super) fn misfit(study: &str, error: impl std::fmt::Display) -> Error {
    let problem = format!("a configuration does not fit its study: {error}");
    Error::Store(StoreError::Inconsistent { study: Some(study.to_owned()), problem })
}

#[cfg(test)]
mod tests {
    use treewright_store::MemoryStore;

    use super::super::Tuning;
    use super::super::checkpoints::tests::{alive, explore, frame, spec, sweep_a_minute};
    use super::*;
    use crate::clock::ManualClock;

    #[tokio::test]
    async fn a_study_that_goes_to_another_daemon_while_it_is_read_is_read_as_it_was() {
        let store = Arc::new(MemoryStore::new());
        let first = Tuning::new(Arc::clone(&store) as _, Arc::new(ManualClock::at(1_000)));
        first.create_study("hall", &spec()).await.expect("created");
        for _ in 0..5 {
            frame(&first, "one", 0.5).await;
        }
        let loaded = store.load("hall").await.expect("it is there");
        let before = loaded.study.statistics;
        let second = Tuning::new(Arc::clone(&store) as _, Arc::new(ManualClock::at(1_000)));
        for _ in 0..5 {
            frame(&second, "two", 0.5).await;
        }
        let late = read(store.as_ref(), loaded, 1_000).await.expect("what was loaded fits together");
        assert_eq!(late.tuner.statistics(), before);
        assert!(!late.fence.holds(), "the other has the study");
    }

    /// The final states of trials whose clients never come back, by whether the daemon was there when their
    /// leases ended.
    async fn lost_leases(is_away: impl Fn(u64) -> bool, restarts: bool) -> Vec<TrialState> {
        let (store, clock) = (Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)));
        let start = || Tuning::new(Arc::clone(&store) as _, Arc::clone(&clock) as _);
        let mut tuning = start();
        explore(&tuning).await;
        let mut trials = Vec::new();
        for number in 0..4 {
            trials.push(alive(&tuning, "one").await.number);
            if is_away(number) {
                clock.advance_ms(60_001);
                if restarts {
                    tuning = start();
                }
            } else {
                sweep_a_minute(&tuning, &clock).await;
            }
            tuning.sweep_leases().await.expect("swept");
        }
        let mut states = Vec::new();
        for number in trials {
            states.push(store.get_trial("hall", number).await.expect("it was handed out").state);
        }
        states
    }

    #[tokio::test]
    async fn leases_that_end_while_the_daemon_is_away_do_not_count_against_their_configurations() {
        use TrialState::{Completed, Expired};
        for restarts in [true, false] {
            assert_eq!(lost_leases(|_| true, restarts).await, [Expired; 4], "never given up");
            let lost = lost_leases(|number| number == 1, restarts).await;
            assert_eq!(lost, [Expired, Expired, Completed, Expired], "the second that it saw is the last");
        }
        let present = lost_leases(|_| false, false).await;
        assert_eq!(present, [Expired, Completed, Expired, Completed], "infeasible after two");
    }
}
