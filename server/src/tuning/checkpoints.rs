//! Checkpoints: the knowledge of the tuners in memory is saved now and then, so that a start reads few
//! trials.
//!
//! Under the study's lock only pointers are copied; packing and writing happen beside it. The changes that a
//! checkpoint covers are on the disk before it: it waits for every change that was queued up to then.

use std::sync::Arc;

use tokio::sync::SemaphorePermit;
use treewright_core::tuner::Learnt;
use treewright_store::{Fence, Receipt, Store};

use super::Tuning;
use super::compute::compute_aside;
use super::loading::Saved;
use super::runtime::{Live, Runtime};
use crate::error::{Error, Result};
use crate::limits;

/// The knowledge to be saved, and the condition for it.
struct DueCheckpoint {
    learnt: Learnt,
    fence: Fence,
    before: Receipt,
}

impl Live {
    fn take_due(&mut self, store: &dyn Store, is_due: impl Fn(Saved, u64) -> bool) -> Option<DueCheckpoint> {
        let completed = self.tuner.statistics().completed_trials;
        let Saved { completion: tried, stored, .. } = self.saved;
        debug_assert!(stored <= tried && tried <= completed, "{stored} of {tried} of {completed} are saved");
        if !is_due(self.saved, completed) {
            return None;
        }
        // After a failure the next attempt comes after as many trials again.
        self.saved.completion = completed;
        let before = self.commit(store, &[]);
        Some(DueCheckpoint {
            learnt: self.tuner.knowledge().learnt(self.tuner.spec()),
            fence: self.fence().clone(),
            before,
        })
    }
}

impl Tuning {
    /// Saves checkpoints where they are due, one study after the other. To be called now and then.
    pub async fn save_checkpoints(&self) {
        self.save_where(|saved, completed| saved.is_due(completed, self.checkpoint_after)).await;
    }

    /// Saves checkpoints wherever a start would otherwise learn many trials again. To be called at an orderly
    /// stop.
    pub async fn save_last_checkpoints(&self) {
        let many = limits::LAST_CHECKPOINT_TRIALS;
        self.save_where(|saved, completed| completed.saturating_sub(saved.stored) >= many).await;
    }

    /// Waits until no checkpoint is being saved; none is until the permit is dropped.
    pub(super) async fn pause_checkpoints(&self) -> Result<SemaphorePermit<'_>> {
        self.saving.acquire().await.map_err(|_| Error::Defect("checkpoints are saved no more"))
    }

    async fn save_where(&self, is_due: impl Fn(Saved, u64) -> bool) {
        let Ok(_alone) = self.pause_checkpoints().await else { return };
        for (study, runtime) in self.in_memory() {
            let due = runtime.peek(|live| live.take_due(self.store(), &is_due)).flatten();
            let Some(due) = due else {
                continue;
            };
            match self.save(due, &runtime).await {
                Ok(Some(Saved { completion, bytes, .. })) => {
                    tracing::debug!(study, completion, bytes, "checkpoint saved");
                }
                Ok(None) => {}
                // A checkpoint only saves time.
                Err(error) => tracing::warn!(study, %error, "a checkpoint was not saved"),
            }
        }
    }

    /// Saves a checkpoint, unless it is too large to be read again: the last one that can be read then stays.
    async fn save(&self, due: DueCheckpoint, runtime: &Arc<Runtime>) -> Result<Option<Saved>> {
        let DueCheckpoint { learnt, fence, before } = due;
        let checkpoint = match compute_aside(move || learnt.checkpoint()).await? {
            Ok(checkpoint) => checkpoint,
            Err(problem) => {
                let study = fence.study();
                tracing::warn!(study, %problem, "no checkpoint is saved, so a start takes longer");
                // The next attempt waits for as many trials as after a checkpoint of this length.
                runtime.peek(|live| live.saved.bytes = problem.bytes as u64);
                return Ok(None);
            }
        };
        before.durable().await?;
        self.store().save_checkpoint(&fence, &checkpoint).await?;
        let (completion, bytes) = (checkpoint.completion, checkpoint.bytes.len() as u64);
        let saved = Saved { completion, stored: completion, bytes };
        runtime.peek(|live| {
            if live.fence().is_same(&fence) {
                debug_assert!(live.saved.stored <= completion, "an older checkpoint follows a newer one");
                live.saved = saved;
            }
        });
        Ok(Some(saved))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeMap;

    use prost_types::FieldMask;
    use treewright_core::configuration::RawConfiguration;
    use treewright_core::limits::CHECKPOINT_TRIALS_MIN;
    use treewright_core::policy::{Policy, SearchMethod};
    use treewright_core::space::{Scale, Space};
    use treewright_core::study::StudySpec;
    use treewright_core::trial::{Outcome, Trial};
    use treewright_core::tuner::Ask;
    use treewright_core::value::Value;
    use treewright_proto::v1;
    use treewright_store::MemoryStore;

    use super::*;
    use crate::clock::ManualClock;
    use crate::convert::from_proto::{Report, SpaceChange, Suggest};
    use crate::convert::names::TrialName;
    use crate::convert::study_update::StudyUpdate;

    pub(in crate::tuning) fn spec() -> StudySpec {
        let space = Space::builder().integer("a", 0..=9).default(4).integer("b", 0..=9).default(4);
        let spec = StudySpec::builder(space.build().expect("valid"))
            .indicator("x", 0.0..=1.0, Scale::Linear)
            .minimise("render_ms", 1.0)
            .seed(3);
        let policy = Policy { search: SearchMethod::Random, epsilon: 0.5, ..Policy::default() };
        spec.build().expect("valid").with_policy(policy)
    }

    pub(in crate::tuning) fn in_memory() -> Tuning {
        Tuning::new(Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)))
    }

    /// Creates the study, which always explores, and measures four frames.
    pub(in crate::tuning) async fn explore(tuning: &Tuning) {
        let policy = Policy { epsilon: 1.0, ..spec().policy };
        tuning.create_study("hall", &StudySpec { policy, ..spec() }).await.expect("created");
        for _ in 0..4 {
            frame(tuning, "one", 0.5).await;
        }
        tuning.sweep_leases().await.expect("swept");
    }

    /// A trial whose client shows that it lives, so that its silence means something.
    pub(in crate::tuning) async fn alive(tuning: &Tuning, client_id: &str) -> TrialName {
        let number = suggested(tuning, client_id, 0.5).await.number;
        let trial = TrialName { study: "hall".into(), number };
        tuning.extend_lease(&trial).await.expect("it is open");
        trial
    }

    /// Lets leases end while the daemon is there.
    pub(in crate::tuning) async fn sweep_a_minute(tuning: &Tuning, clock: &ManualClock) {
        for _ in 0..61 {
            clock.advance_ms(1_000);
            tuning.sweep_leases().await.expect("swept");
        }
    }

    pub(in crate::tuning) async fn suggested(tuning: &Tuning, client_id: &str, place: f64) -> Trial {
        let indicators = BTreeMap::from([("x".to_owned(), place)]);
        let ask = Ask { client_id: client_id.to_owned(), indicators, ..Ask::default() };
        let suggest = Suggest { study: "hall".into(), ask, wanted: None, space_revision: 0 };
        tuning.suggest(suggest).await.expect("a trial")
    }

    pub(in crate::tuning) async fn frame(tuning: &Tuning, client_id: &str, place: f64) -> Trial {
        let trial = suggested(tuning, client_id, place).await;
        let number = |name: &str| trial.configuration.get(name).and_then(Value::as_number).expect("active");
        let cost = 1.0 + (number("a") - 9.0 * place).abs() + number("b");
        let report = Report {
            trial: TrialName { study: "hall".into(), number: trial.number },
            measurements: BTreeMap::from([("render_ms".to_owned(), cost)]),
            standard_errors: BTreeMap::new(),
            outcome: Outcome::Ok,
        };
        tuning.report(report).await.expect("taken");
        trial
    }

    /// Two clients, frame after frame; returns their trials.
    pub(in crate::tuning) async fn frames(tuning: &Tuning, numbers: std::ops::Range<u64>) -> Vec<Trial> {
        let mut trials = Vec::new();
        for number in numbers {
            // Later frames are in new places, where the models count.
            let shift = if number > CHECKPOINT_TRIALS_MIN + 300 { 0.05 } else { 0.0 };
            let place = (number / 10 % 9) as f64 / 9.0 + shift;
            trials.push(frame(tuning, &format!("client-{}", number % 2), place).await);
        }
        trials
    }

    async fn change_predictor(tuning: &Tuning, predictor: v1::PredictorMethod) {
        let policy = v1::Policy { predictor: predictor.into(), ..v1::Policy::default() };
        let study = v1::Study { policy: Some(policy), ..v1::Study::default() };
        let mask = FieldMask { paths: vec!["policy.predictor".to_owned()] };
        let update = StudyUpdate::read(study, Some(mask)).expect("valid");
        tuning.update_study(&"hall".into(), &update).await.expect("changed");
    }

    #[tokio::test]
    async fn an_orderly_stop_saves_what_a_start_would_learn_again() {
        let many = limits::LAST_CHECKPOINT_TRIALS;
        let store = Arc::new(MemoryStore::new());
        let start = || Tuning::new(Arc::clone(&store) as _, Arc::new(ManualClock::at(1_000)));
        let tuning = start();
        tuning.create_study("hall", &spec()).await.expect("created");
        let _few = frames(&tuning, 0..many - 1).await;
        tuning.save_last_checkpoints().await;
        let checkpoint = store.load("hall").await.expect("loaded").checkpoint;
        assert!(checkpoint.is_none(), "so few are learnt again at once");
        let tuning = start();
        let _last = frames(&tuning, many - 1..many).await;
        tuning.save_checkpoints().await;
        tuning.save_last_checkpoints().await;
        let checkpoint = store.load("hall").await.expect("loaded").checkpoint;
        assert_eq!(checkpoint.map(|checkpoint| checkpoint.completion), Some(many));
    }

    /// At an orderly stop the periodic checkpoints may still be under way.
    #[tokio::test]
    async fn who_saves_last_waits_for_who_saves() {
        let many = limits::LAST_CHECKPOINT_TRIALS;
        let store = Arc::new(MemoryStore::new());
        let tuning = Tuning::new(Arc::clone(&store) as _, Arc::new(ManualClock::at(1_000)));
        tuning.create_study("hall", &spec()).await.expect("created");
        let _all = frames(&tuning, 0..many).await;
        let other = tuning.saving.acquire().await.expect("it is never closed");
        let mut last = std::pin::pin!(tuning.save_last_checkpoints());
        let early = tokio::time::timeout(std::time::Duration::from_millis(50), &mut last).await;
        assert!(early.is_err(), "somebody saves");
        drop(other);
        last.await;
        let checkpoint = store.load("hall").await.expect("loaded").checkpoint;
        assert_eq!(checkpoint.map(|checkpoint| checkpoint.completion), Some(many));
    }

    /// One that is under way as the space changes is of the space of before.
    #[tokio::test]
    async fn a_change_of_the_space_waits_for_who_saves() {
        let tuning = in_memory();
        tuning.create_study("hall", &spec()).await.expect("created");
        let space = Space::builder().integer("a", 0..=9).default(4).integer("b", 0..=8).default(4);
        let (space, fixed) = (space.build().expect("valid"), RawConfiguration::new());
        let change = SpaceChange { revision: 1, space, fixed, validate_only: false };
        let study = "hall".into();
        let other = tuning.saving.acquire().await.expect("it is never closed");
        let mut changed = std::pin::pin!(tuning.change_space(&study, &change));
        let early = tokio::time::timeout(std::time::Duration::from_millis(50), &mut changed).await;
        assert!(early.is_err(), "somebody saves");
        drop(other);
        assert_eq!(changed.await.expect("changed").0.earlier.revision(), 2);
    }

    /// The daemon's answers do not depend on its checkpoints, nor on when it starts.
    #[tokio::test]
    async fn a_start_from_a_checkpoint_answers_like_one_from_all_trials() {
        let many = CHECKPOINT_TRIALS_MIN + 200;
        let stores = [Arc::new(MemoryStore::new()), Arc::new(MemoryStore::new())];
        let mut answers = Vec::new();
        for (store, saves) in stores.iter().zip([true, false]) {
            let start = || Tuning::new(Arc::clone(store) as _, Arc::new(ManualClock::at(1_000)));
            let mut tuning = start();
            tuning.create_study("hall", &spec()).await.expect("created");
            let mut all = frames(&tuning, 0..many).await;
            if saves {
                tuning.save_checkpoints().await;
                let loaded = store.load("hall").await.expect("loaded");
                assert_eq!(loaded.checkpoint.map(|checkpoint| checkpoint.completion), Some(many));
                tuning = start();
            }
            all.extend(frames(&tuning, many..many + 100).await);
            change_predictor(&tuning, v1::PredictorMethod::Contextual).await;
            all.extend(frames(&tuning, many + 100..many + 200).await);
            if saves {
                tuning = start();
            }
            all.extend(frames(&tuning, many + 200..many + 300).await);
            answers.push(all);
        }
        assert_eq!(answers[0], answers[1]);
        let later = &answers[0][(many + 100) as usize..];
        assert!(later.iter().any(|trial| trial.reason().source == "contextual"), "the model was asked");
    }
}
