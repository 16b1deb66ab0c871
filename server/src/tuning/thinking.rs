//! Thinking apart from the tuners: fits of models, in threads of their own, while the study serves others.
//!
//! Under the study's lock a question is answered from tables, or it gives an errand: copies of what has to be thought
//! about. Not more errands run at once than there are processors, and one at a time thinks about the search of a
//! state. Who finds all of that taken is answered from the tables: a client would rather run the best that is known
//! now than wait for a better question.

use std::collections::HashMap;
use std::sync::{Arc, Weak};

use tokio::sync::Semaphore;
use treewright_core::tuner::{Errand, Thoughts, Tuner};
use treewright_store::{Receipt, Store, StoreError};

use super::Tuning;
use super::loading::compute;
use super::runtime::Live;
use crate::error::Error;
use crate::limits::THINKING_WAIT;
use crate::metrics::METRICS;

/// How many errands run at once: as many as there are processors.
pub(super) fn places() -> Semaphore {
    Semaphore::new(std::thread::available_parallelism().map_or(1, usize::from))
}

/// The states of a study whose search is being thought about: each as long as somebody holds its token.
#[derive(Debug, Default)]
pub(super) struct Searched(HashMap<u64, Weak<()>>);

impl Searched {
    pub(super) fn is_free(&self, state: u64) -> bool {
        self.0.get(&state).is_none_or(|token| token.strong_count() == 0)
    }

    fn take(&mut self, state: u64) -> Arc<()> {
        self.0.retain(|_, token| token.strong_count() > 0);
        let token = Arc::new(());
        self.0.insert(state, Arc::downgrade(&token));
        token
    }
}

/// What has to be done apart from a tuner before it can answer a question.
pub(super) enum Apart {
    /// The models owe something to earlier reports, and are about to be asked.
    Settle,
    /// Somebody has to think, and has this state's search for that time.
    Think(Box<Errand>, Option<Arc<()>>),
}

impl Live {
    /// What has to be done apart before a question is answered whose errand this is; nothing where the tables have the
    /// answer.
    pub(super) fn apart(
        &mut self,
        errand: impl FnOnce(&Tuner, &dyn Fn(u64) -> bool) -> Option<Errand>,
        is_settled: bool,
    ) -> Option<Apart> {
        let errand = errand(&self.tuner, &|state| self.searched.is_free(state))?;
        if !is_settled && self.tuner.owes() {
            return Some(Apart::Settle);
        }
        let token = errand.searched_state().map(|state| self.searched.take(state));
        Some(Apart::Think(Box::new(errand), token))
    }
}

impl Tuning {
    /// Computes on a study's tuner with what `errand` had thought about before, if that is needed. `begun` is what was
    /// found to be done apart already.
    pub(super) async fn with_thoughts<T>(
        &self,
        study: &str,
        begun: Option<Apart>,
        errand: impl Fn(&Tuner, &dyn Fn(u64) -> bool) -> Option<Errand> + Send + Sync,
        answer: impl FnOnce(&mut Live, &dyn Store, Thoughts, i64) -> T + Send,
    ) -> Result<T, Error> {
        let mut answer = Some(answer);
        let (mut apart, mut thoughts, mut is_settled) = (begun, None, false);
        loop {
            match apart.take() {
                None => {}
                Some(Apart::Settle) => {
                    self.settle(study).await;
                    is_settled = true;
                }
                Some(Apart::Think(errand, token)) => {
                    thoughts = Some(self.think(*errand).await?);
                    drop(token);
                }
            }
            let step = self
                .with_tuner(study, |live, store, now_ms| {
                    if thoughts.is_none()
                        && let Some(apart) = live.apart(&errand, is_settled)
                    {
                        return Err(apart);
                    }
                    let answer = answer.take().expect("a question is answered once");
                    Ok(answer(live, store, thoughts.take().unwrap_or_default(), now_ms))
                })
                .await?;
            match step {
                Ok(answer) => return Ok(answer),
                Err(more) => apart = Some(more),
            }
        }
    }

    /// Runs an errand; without any thoughts where there is no processor for it in time.
    async fn think(&self, errand: Errand) -> Result<Thoughts, Error> {
        let Ok(Ok(_place)) = tokio::time::timeout(THINKING_WAIT, self.thinking.acquire()).await else {
            METRICS.not_thought();
            return Ok(Thoughts::default());
        };
        METRICS.thought(compute(move || errand.run())).await
    }

    /// Waits for the disk, and settles meanwhile what a report has left to be done later.
    pub(super) async fn durable(&self, study: &str, receipt: Receipt, owes: bool) -> Result<(), StoreError> {
        if !owes {
            return METRICS.durable(receipt).await;
        }
        tokio::join!(METRICS.durable(receipt), self.settle(study)).0
    }

    /// Settles what reports have left to be done later, if there is a processor for it in time; it is no loss if not.
    async fn settle(&self, study: &str) {
        let owed = |live: &mut Live| Some((live.tuner.debts()?, Arc::clone(live.tuner.spec())));
        let runtime = self.runtime(study);
        let Some((debts, spec)) = runtime.peek(owed).flatten() else {
            return;
        };
        let Ok(Ok(_place)) = tokio::time::timeout(THINKING_WAIT, self.thinking.acquire()).await else {
            return;
        };
        if let Ok(settled) = compute(move || debts.settle(&spec.space)).await {
            runtime.peek(|live| live.tuner.hand_in(settled));
        }
    }
}

#[cfg(test)]
mod tests {
    use treewright_core::policy::{Policy, PredictorMethod, SearchMethod};
    use treewright_core::study::StudySpec;
    use treewright_core::trial::{Mode, Trial};
    use treewright_core::tuner::Ask;
    use treewright_store::MemoryStore;

    use super::*;
    use crate::clock::ManualClock;
    use crate::convert::from_proto::Suggest;
    use crate::tuning::checkpoints::tests::{frame, spec};

    async fn tuning() -> Tuning {
        let tuning = Tuning::new(Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)));
        let (search, predictor) = (SearchMethod::Auto, PredictorMethod::Auto);
        let policy = Policy { search, predictor, epsilon: 1.0, ..Policy::default() };
        tuning.create_study("hall", &StudySpec { policy, ..spec() }).await.expect("created");
        tuning
    }

    async fn suggest(tuning: &Tuning, client_id: &str) -> Trial {
        let indicators = [("x".to_owned(), 0.5)].into();
        let ask = Ask { client_id: client_id.to_owned(), indicators, ..Ask::default() };
        tuning.suggest(Suggest { study: "hall".to_owned(), ask, wanted: None }).await.expect("a trial")
    }

    fn is_by_model(trial: &Trial) -> bool {
        ["model", "local"].contains(&trial.reason.step.as_str())
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn who_finds_a_search_thought_about_runs_the_best_that_is_known() {
        let tuning = tuning().await;
        let mut trials = Vec::new();
        for _ in 0..16 {
            trials.push(frame(&tuning, "one", 0.5).await);
        }
        let state = trials[0].state_id;
        assert!(trials.iter().any(is_by_model), "the design is over");
        let runtime = tuning.runtime("hall");
        let token = runtime.peek(|live| live.searched.take(state)).expect("in memory");
        let meanwhile = suggest(&tuning, "two").await;
        assert_eq!(meanwhile.mode, Mode::Exploit, "{meanwhile:?}");
        drop(token);
        let after = suggest(&tuning, "three").await;
        assert!(is_by_model(&after), "{after:?}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn without_a_free_processor_questions_are_answered_from_the_tables() {
        let tuning = tuning().await;
        for _ in 0..16 {
            frame(&tuning, "one", 0.5).await;
        }
        let all = u32::try_from(tuning.thinking.available_permits()).expect("few processors");
        let places = tuning.thinking.acquire_many(all).await.expect("never closed");
        assert_eq!(suggest(&tuning, "two").await.mode, Mode::Exploit);
        let predicted =
            tuning.predict("hall", &[("x".to_owned(), 0.9)].into(), None).await.expect("an answer");
        assert_eq!(predicted.reason.source, "nearest_neighbour");
        drop(places);
        assert_eq!(suggest(&tuning, "three").await.mode, Mode::Explore);
        let predicted =
            tuning.predict("hall", &[("x".to_owned(), 0.9)].into(), None).await.expect("an answer");
        assert_eq!(predicted.reason.source, "contextual");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn nothing_is_owed_where_each_waits_for_its_answer() {
        let tuning = tuning().await;
        for number in 0..8 {
            frame(&tuning, "one", 0.1 * f64::from(number)).await;
        }
        let runtime = tuning.runtime("hall");
        assert_eq!(runtime.peek(|live| live.tuner.owes()), Some(false));
        assert!(runtime.peek(|live| live.tuner.predictor_errors().len()).is_some_and(|count| count > 0));
    }
}
