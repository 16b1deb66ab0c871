//! Plans for suggestions, computed in threads of their own and without the study's lock, while the study
//! serves others.
//!
//! Under the study's lock a question is answered from tables, or it gives a plan request: copies of the
//! inputs of a computation. At most one for each processor runs at once, and one at a time plans for the
//! search of a state. A question without a permit gets a point from the reserve, or an answer from the
//! tables. A good configuration now is worth more than a better one later.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;
use treewright_core::tuner::{PlanRequest, SuggestionPlan};
use treewright_store::{Fence, Receipt, Store, StoreError};

use super::Tuning;
use super::compute::compute_aside;
use super::runtime::{Live, Runtime};
use crate::error::Result;
use crate::limits::PLANNING_WAIT;

/// Permits for plans that are computed at once: one for each processor.
pub(super) fn permits() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(std::thread::available_parallelism().map_or(1, usize::from)))
}

/// The computation without the lock before a question can be answered.
pub(super) enum Preparation {
    /// Reports have deferred updates of the models, which are about to be asked.
    Update,
    /// A plan has to be computed, by the holder of this state's search for that time. It is of use for this
    /// load of the study: another one may have another space, and other trials may count.
    Plan(Box<PlanRequest>, Option<Arc<()>>, Fence),
}

impl Live {
    /// The computation that a question needs before its answer with this plan.
    pub(super) fn preparation(&mut self, request: Box<PlanRequest>, is_updated: bool) -> Preparation {
        if !is_updated && self.tuner.knowledge().has_deferred_updates() {
            return Preparation::Update;
        }
        let token = request.searched_state().map(|state| self.planned_searches.take(state));
        Preparation::Plan(request, token, self.fence().clone())
    }
}

/// The results of preparations for a question.
#[derive(Debug, Default)]
pub(super) struct Prepared {
    /// The plan; none before it is known whether one is needed.
    pub(super) plan: Option<SuggestionPlan>,
    /// The models have just been updated.
    pub(super) is_updated: bool,
}

impl Tuning {
    /// Computes on a study's tuner until `step` has its answer. A preparation that it asks for is computed
    /// without the tuner's lock, and `step` is called again. `begun` is a preparation that is known to be
    /// needed.
    pub(super) async fn with_plan<T: Send>(
        &self,
        study: &str,
        begun: Option<Preparation>,
        mut step: impl FnMut(&mut Live, &dyn Store, Prepared, i64) -> Result<T, Preparation> + Send,
    ) -> Result<T> {
        let (mut preparation, mut plan, mut is_updated) = (begun, None, false);
        loop {
            match preparation.take() {
                None => {}
                Some(Preparation::Update) => {
                    assert!(!is_updated, "the models are updated twice for one question");
                    let runtime = self.runtime(study);
                    if let Ok(_turn) = timeout(PLANNING_WAIT, runtime.updating.lock()).await {
                        self.update_models(&runtime).await;
                    }
                    is_updated = true;
                }
                Some(Preparation::Plan(request, token, fence)) => {
                    plan = Some((self.compute_plan(*request).await?, fence));
                    drop(token);
                }
            }
            let planned = plan.take();
            let (is_planned, stepped) = self
                .with_tuner(study, |live, store, now_ms| {
                    let planned = planned.filter(|(_, fence)| live.fence().is_same(fence));
                    let prepared = Prepared { plan: planned.map(|(plan, _)| plan), is_updated };
                    (prepared.plan.is_some(), step(live, store, prepared, now_ms))
                })
                .await?;
            match stepped {
                Ok(answer) => return Ok(answer),
                Err(more) => {
                    assert!(!is_planned, "a question that has its plan asks for more");
                    preparation = Some(more);
                }
            }
        }
    }

    /// Computes a plan; an empty one where there is no processor for it in time.
    async fn compute_plan(&self, request: PlanRequest) -> Result<SuggestionPlan> {
        let Some(permit) = self.planning_permit().await else {
            self.metrics().not_planned();
            return Ok(SuggestionPlan::default());
        };
        let fit = move || {
            let plan = request.compute();
            drop(permit);
            plan
        };
        self.metrics().planned(compute_aside(fit)).await
    }

    /// A permit to compute, if one is free in time. It goes with the work into another thread, so that it is
    /// held until the work has ended, even after the request was cancelled.
    async fn planning_permit(&self) -> Option<OwnedSemaphorePermit> {
        let permit = Arc::clone(&self.planning_permits).acquire_owned();
        timeout(PLANNING_WAIT, permit).await.ok()?.ok()
    }

    /// Waits for the disk, and computes meanwhile the updates of the models that reports have deferred,
    /// unless another request computes them.
    pub(super) async fn durable(
        &self,
        study: &str,
        receipt: Receipt,
        deferred: bool,
    ) -> Result<(), StoreError> {
        let runtime = self.runtime(study);
        let turn = if deferred { runtime.updating.try_lock().ok() } else { None };
        match turn {
            Some(_turn) => tokio::join!(self.metrics().durable(receipt), self.update_models(&runtime)).0,
            None => self.metrics().durable(receipt).await,
        }
    }

    /// Computes the updates that reports have deferred, if a processor is free in time; otherwise they wait.
    /// Its caller holds `updating`, so that the work is not done twice.
    async fn update_models(&self, runtime: &Runtime) {
        debug_assert!(runtime.updating.try_lock().is_err(), "two compute these updates");
        let deferred = |live: &mut Live| {
            Some((live.tuner.knowledge().deferred_updates()?, Arc::clone(live.tuner.spec())))
        };
        let Some(permit) = self.planning_permit().await else {
            return;
        };
        let Some((updates, spec)) = runtime.peek(deferred).flatten() else {
            return;
        };
        let update = move || {
            let computed = updates.compute(&spec.space);
            drop(permit);
            computed
        };
        if let Ok(computed) = compute_aside(update).await {
            runtime.peek(|live| live.tuner.knowledge_mut().apply_updates(computed));
        }
    }
}

#[cfg(test)]
mod tests {
    use treewright_core::ids::StateId;
    use treewright_core::policy::{Policy, PredictorMethod, SearchMethod};
    use treewright_core::study::StudySpec;
    use treewright_core::trial::{Mode, Trial};
    use treewright_core::tuner::Ask;

    use super::*;
    use crate::tuning::checkpoints::tests::{frame, in_memory, spec, suggested};

    async fn tuning() -> Tuning {
        let tuning = in_memory();
        let (search, predictor) = (SearchMethod::Auto, PredictorMethod::Auto);
        let policy = Policy { search, predictor, epsilon: 1.0, ..Policy::default() };
        tuning.create_study("hall", &StudySpec { policy, ..spec() }).await.expect("created");
        tuning
    }

    fn is_by_model(trial: &Trial) -> bool {
        ["model", "local"].contains(&trial.reason().step.as_str())
    }

    /// After a change of the space the plan could name what is outside.
    #[tokio::test(flavor = "multi_thread")]
    async fn a_plan_is_of_no_use_once_the_study_was_read_again() {
        let tuning = tuning().await;
        for is_read_again in [false, true] {
            let mut begun = None;
            for _ in 0..40 {
                frame(&tuning, "one", 0.5).await;
                let preparation = tuning.with_tuner("hall", |live, _, _| {
                    let indicators = [("x".to_owned(), 0.5)].into();
                    let ask = Ask { client_id: "one".to_owned(), indicators, ..Ask::default() };
                    let question = live.tuner.question(&ask).expect("valid");
                    let request = live.tuner.plan(&question, |_| true)?;
                    Some(live.preparation(Box::new(request), true))
                });
                begun = preparation.await.expect("in memory");
                if begun.is_some() {
                    break;
                }
            }
            assert!(begun.is_some(), "there is something to plan");
            if is_read_again {
                tuning.with_tuner("hall", |live, _, _| live.is_stale = true).await.expect("in memory");
            }
            let has_plan =
                tuning.with_plan("hall", begun, |_, _, prepared, _| Ok(prepared.plan.is_some())).await;
            assert_eq!(has_plan.expect("in memory"), !is_read_again);
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn who_finds_a_search_planned_for_explores_all_the_same() {
        let tuning = tuning().await;
        let mut trials = Vec::new();
        for _ in 0..16 {
            trials.push(frame(&tuning, "one", 0.5).await);
        }
        let state = trials[0].state_id;
        assert!(trials.iter().any(is_by_model), "the design is over");
        let runtime = tuning.runtime("hall");
        let token = runtime.peek(|live| live.planned_searches.take(StateId(state))).expect("in memory");
        let mut distinct = std::collections::BTreeSet::new();
        for number in 0..20 {
            let meanwhile = suggested(&tuning, &format!("two {number}"), 0.5).await;
            assert_eq!(meanwhile.mode(), Mode::Explore, "{meanwhile:?}");
            distinct.insert(meanwhile.configuration);
        }
        assert_eq!(distinct.len(), 20, "nobody measures what another measures");
        drop(token);
        let after = suggested(&tuning, "three", 0.5).await;
        assert_eq!(after.mode(), Mode::Explore, "{after:?}");
        assert!(distinct.insert(after.configuration), "and not what is being measured already");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn without_a_free_processor_questions_are_answered_from_the_tables() {
        let tuning = tuning().await;
        for _ in 0..16 {
            frame(&tuning, "one", 0.5).await;
        }
        let all = u32::try_from(tuning.planning_permits.available_permits()).expect("few processors");
        let places = tuning.planning_permits.acquire_many(all).await.expect("never closed");
        assert_eq!(suggested(&tuning, "two", 0.5).await.mode(), Mode::Explore, "a guess near the best");
        let (study, far) = ("hall".into(), [("x".to_owned(), 0.9)].into());
        let predicted = tuning.predict(&study, &far, None, None, 0).await.expect("an answer");
        assert_eq!(predicted.reason().source, "default", "nothing was measured there");
        drop(places);
        assert_eq!(suggested(&tuning, "three", 0.5).await.mode(), Mode::Explore);
        let predicted = tuning.predict(&study, &far, None, None, 0).await.expect("an answer");
        let source = predicted.reason().source;
        assert!(["portfolio", "contextual"].contains(&source.as_str()), "what others know: {source}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn who_finds_the_models_being_updated_is_answered_all_the_same() {
        let tuning = tuning().await;
        frame(&tuning, "one", 0.1).await;
        let runtime = tuning.runtime("hall");
        let is_behind = || runtime.peek(|live| live.tuner.knowledge().has_deferred_updates());
        let turn = runtime.updating.lock().await;
        for number in 0..4 {
            frame(&tuning, "two", 0.2 * f64::from(number)).await;
        }
        assert_eq!(is_behind(), Some(true), "the holder of the turn computes");
        drop(turn);
        frame(&tuning, "three", 0.9).await;
        assert_eq!(is_behind(), Some(false));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn nothing_is_deferred_where_each_waits_for_its_answer() {
        let tuning = tuning().await;
        for number in 0..8 {
            frame(&tuning, "one", 0.1 * f64::from(number)).await;
        }
        let runtime = tuning.runtime("hall");
        assert_eq!(runtime.peek(|live| live.tuner.knowledge().has_deferred_updates()), Some(false));
        assert!(
            runtime
                .peek(|live| live.tuner.knowledge().predictor_errors().len())
                .is_some_and(|count| count > 0)
        );
    }
}
