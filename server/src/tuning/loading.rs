//! Reading a study into memory: its states, then its completed trials in stretches.

use std::sync::Arc;

use tokio::runtime::{Handle, RuntimeFlavor};
use treewright_core::space::Space;
use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{RestoreError, Restoring, Tuner};
use treewright_store::{Fence, Loaded, Store, StoreError};

use crate::error::Error;
use crate::limits;

/// Loads a study. Breaks earlier fences of it.
pub(super) async fn load(store: &dyn Store, study: &str) -> Result<(Tuner, Fence), Error> {
    let Loaded { fence, study: record, snapshot, open_trials, checkpoint: _ } = store.load(study).await?;
    let spec = Arc::new(record.spec);
    let failed = |problem| Error::Restore { study: study.to_owned(), problem };
    let begun = Arc::clone(&spec);
    let mut restoring = compute(move || Restoring::new(begun, snapshot)).await?.map_err(failed)?;
    loop {
        let trials = store.completed_trials(&fence, restoring.after(), limits::TRIALS_PER_READ).await?;
        if trials.is_empty() {
            break;
        }
        let trials = check(trials, &spec.space)?;
        restoring = compute(move || learn(restoring, &trials)).await?.map_err(failed)?;
    }
    let tuner = compute(move || restoring.finish(open_trials)).await?.map_err(failed)?;
    Ok((tuner, fence))
}

fn learn(mut restoring: Restoring, trials: &[Trial]) -> Result<Restoring, RestoreError> {
    trials.iter().try_for_each(|trial| restoring.learn(trial))?;
    Ok(restoring)
}

fn check(trials: Vec<RawTrial>, space: &Space) -> Result<Vec<Trial>, Error> {
    let checked = trials.into_iter().map(|trial| trial.check(space));
    checked.collect::<Result<_, _>>().map_err(|error| {
        let problem = format!("a configuration does not fit its study: {error}");
        Error::Store(StoreError::Inconsistent { problem })
    })
}

/// Learning takes a while, in which other studies go on. A runtime of one thread has no other place for it, and one that
/// simulates time must not depend on how fast another thread is.
async fn compute<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, Error> {
    match Handle::current().runtime_flavor() {
        RuntimeFlavor::CurrentThread => Ok(work()),
        _ => {
            tokio::task::spawn_blocking(work).await.map_err(|_| Error::Defect("rebuilding a study panicked"))
        }
    }
}
