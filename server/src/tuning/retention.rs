//! Retention: of a long history only the latest trials are kept, and those that the study still needs.
//!
//! A trial is removed once five conditions hold. It is over. The number of trials to keep were handed out
//! after it. A checkpoint on the disk covers its result. No model may still need it. It is not the last
//! measurement of a configuration that its state remembers. An expired trial may be reported late, even
//! during its removal: then it stays. Last measurements stay so that a later version of the daemon, which
//! cannot read the checkpoint, still knows each state's best. Trials are removed in small steps beside the
//! requests.

use std::time::Duration;

use tokio::time::{Instant, sleep};
use treewright_core::limits::MODELS_TRIALS_MAX;
use treewright_core::tuner::Learnt;
use treewright_store::{ClosedTrial, Fence};

use super::Tuning;
use super::compute::compute_aside;
use super::runtime::Live;
use crate::error::Result;
use crate::limits::{TRIALS_PER_READ, TRIALS_PER_REMOVAL};

struct DueRemoval {
    learnt: Learnt,
    fence: Fence,
    /// Highest number that may be removed.
    number: u64,
    /// Highest completion that may be removed.
    completion: u64,
}

impl Live {
    /// The removal that is due where a newer checkpoint exists since the last one.
    fn take_thinning(&mut self, keep: u64, models: u64) -> Option<DueRemoval> {
        let stored = self.saved.stored;
        debug_assert!(self.thinned <= stored, "trials behind {stored} were removed, up to {}", self.thinned);
        let counts = self.tuner.statistics();
        let number = counts.trials.saturating_sub(keep);
        if stored <= self.thinned || number == 0 {
            return None;
        }
        self.thinned = stored;
        // A change of predictor teaches the new models the latest trials before it. The last trial always
        // stays: the study's counts are read from it, and a checkpoint ahead of them would be ignored.
        let mut completion = stored.min(counts.completed_trials.saturating_sub(models.max(1)));
        let since = self.tuner.knowledge().models_since();
        if stored <= since {
            completion = completion.min(since.saturating_sub(models));
        }
        let (trials, completed) = (counts.trials, counts.completed_trials);
        assert!(number < trials, "the last of {trials} trials has to stay");
        assert!(completion <= stored, "no checkpoint covers completion {completion}");
        assert!(completion == 0 || completion < completed, "the last of {completed} completed has to stay");
        Some(DueRemoval {
            learnt: self.tuner.knowledge().learnt(self.tuner.spec()),
            fence: self.fence().clone(),
            number,
            completion,
        })
    }
}

impl Tuning {
    /// Removes old trials of the studies in memory, each once a newer checkpoint covers them, so that about
    /// `keep` stay in each: see [`KEEP_TRIALS_MIN`](crate::limits::KEEP_TRIALS_MIN). To be called now and
    /// then.
    pub async fn thin_trials(&self, keep: u64) {
        self.thin_beyond(keep, MODELS_TRIALS_MAX).await;
    }

    /// Removes old trials where a change of predictor needs at most `models` completed trials.
    pub async fn thin_beyond(&self, keep: u64, models: u64) {
        for (study, runtime) in self.in_memory() {
            let Some(due) = runtime.peek(|live| live.take_thinning(keep, models)).flatten() else {
                continue;
            };
            match self.thin(due).await {
                Ok((0, _)) => {}
                Ok((removed, stayed)) => {
                    tracing::info!(study, removed, stayed, "old trials removed");
                }
                // The next checkpoint brings the next attempt.
                Err(error) => tracing::warn!(study, %error, "old trials were not removed"),
            }
        }
    }

    /// The numbers of removed trials, and of checked trials that stay.
    async fn thin(&self, due: DueRemoval) -> Result<(u64, u64)> {
        let DueRemoval { learnt, fence, number, completion } = due;
        let measured_by = compute_aside(move || learnt.measured_by()).await?;
        let may_go = |trial: &ClosedTrial| {
            trial.completion.is_none_or(|at| at <= completion) && !measured_by.contains(&trial.number)
        };
        let (mut after, mut removed, mut stayed) = (0, 0, 0);
        loop {
            let closed = self.store().closed_trials(&fence, after, number, TRIALS_PER_READ).await?;
            let Some(last) = closed.last() else {
                return Ok((removed, stayed));
            };
            debug_assert!(after < last.number && last.number <= number, "{} follows {after}", last.number);
            after = last.number;
            let gone: Vec<u64> =
                closed.iter().filter(|trial| may_go(trial)).map(|trial| trial.number).collect();
            stayed += (closed.len() - gone.len()) as u64;
            for some in gone.chunks(TRIALS_PER_REMOVAL) {
                let begun = Instant::now();
                let count = self.store().remove_trials(&fence, some, completion).await?;
                assert!(count <= some.len() as u64, "{count} trials were removed for {}", some.len());
                self.metrics().removed(count);
                removed += count;
                // Removal takes at most half of the disk's time.
                sleep(begun.elapsed().min(Duration::from_secs(1))).await;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use treewright_core::limits::CHECKPOINT_TRIALS_MIN;
    use treewright_core::tuner::Checkpoint;
    use treewright_store::filter::{Filter, Order};
    use treewright_store::{MemoryStore, Store, TrialQuery};

    use super::super::checkpoints::tests::{frames, spec};
    use super::*;
    use crate::clock::ManualClock;

    const KEEP: u64 = 500;

    async fn tuning(store: &Arc<MemoryStore>) -> Tuning {
        let tuning = Tuning::new(Arc::clone(store) as _, Arc::new(ManualClock::at(1_000)));
        tuning.create_study("hall", &spec()).await.expect("created");
        tuning
    }

    async fn stored(store: &MemoryStore, filter: &str) -> u64 {
        let filter = Filter::parse(filter).expect("a filter");
        let order = Order::parse("").expect("an order");
        let page = store.query_trials("hall", &TrialQuery { filter, order, after: None, size: 10_000 }).await;
        page.expect("a page").trials.len() as u64
    }

    /// The daemon's answers depend neither on removed trials nor on its starts.
    #[tokio::test]
    async fn without_its_old_trials_a_study_answers_as_with_them() {
        let many = CHECKPOINT_TRIALS_MIN + 700;
        let stores = [Arc::new(MemoryStore::new()), Arc::new(MemoryStore::new())];
        let mut answers = Vec::new();
        for (store, thins) in stores.iter().zip([true, false]) {
            let mut tuning = tuning(store).await;
            let mut all = frames(&tuning, 0..many).await;
            if thins {
                // Only trials that a checkpoint covers are removed.
                tuning.thin_beyond(KEEP, KEEP).await;
                assert_eq!(stored(store, "").await, many);
                tuning.save_checkpoints().await;
                tuning.thin_beyond(KEEP, many).await;
                assert_eq!(stored(store, "").await, many, "the models may need them");
                tuning = self::tuning(store).await;
            }
            all.extend(frames(&tuning, many..many + 1).await);
            if thins {
                let before = tuning.get_study("hall").await.expect("there").statistics;
                let best = tuning.best(&"hall".into(), None, None, None, 0).await.expect("something").0;
                tuning.thin_beyond(KEEP, KEEP).await;
                let left = stored(store, "").await;
                // And one for each configuration that a state remembers.
                assert!(left < many / 2, "{left} of {many} trials are left");
                assert!(left >= KEEP && stored(store, "state = OPEN").await == 0);
                let after = tuning.get_study("hall").await.expect("there").statistics;
                assert_eq!((after.trials, after.completed_trials), (before.trials, before.completed_trials));
                assert_eq!(tuning.best(&"hall".into(), None, None, None, 0).await.expect("one").0, best);
                let name = crate::convert::names::TrialName { study: "hall".into(), number: best.trial };
                tuning.get_trial(&name).await.expect("the best is always there");
                tuning = self::tuning(store).await;
            }
            all.extend(frames(&tuning, many + 1..many + 200).await);
            answers.push(all);
        }
        assert_eq!(answers[0], answers[1]);
    }

    /// As after an upgrade: the remaining trials are learnt again.
    #[tokio::test]
    async fn without_its_checkpoint_a_study_still_knows_its_best() {
        let many = CHECKPOINT_TRIALS_MIN + 100;
        let store = Arc::new(MemoryStore::new());
        let before = tuning(&store).await;
        frames(&before, 0..many).await;
        before.save_checkpoints().await;
        before.thin_beyond(KEEP, KEEP).await;
        assert!(stored(&store, "").await < many / 2);
        let best = before.best(&"hall".into(), None, None, None, 0).await.expect("something").0;
        let counts = before.get_study("hall").await.expect("there").statistics;

        let fence = store.load("hall").await.expect("loaded").fence;
        let other = Checkpoint { completion: many, bytes: b"of another version".to_vec() };
        store.save_checkpoint(&fence, &other).await.expect("saved");
        let after = tuning(&store).await;
        let again = after.best(&"hall".into(), None, None, None, 0).await.expect("something").0;
        assert_eq!((again.configuration, again.cost), (best.configuration, best.cost));
        assert_eq!(after.get_study("hall").await.expect("there").statistics, counts);
        let next = frames(&after, many..many + 1).await;
        assert_eq!(next[0].number, many + 1);
        assert_eq!(next[0].completion, None);
        assert_eq!(after.get_study("hall").await.expect("there").statistics.completed_trials, many + 1);
    }
}
