//! A store in memory that fails and dawdles as a test wants it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use treewright_core::ids::StudyUid;
use treewright_core::study::StudySpec;
use treewright_core::trial::RawTrial;
use treewright_core::tuner::Checkpoint;
use treewright_store::{
    ClosedTrial, Created, Fence, Loaded, MemoryStore, Receipt, Store, StoreError, StudyRecord, StudyWrite,
    TrialPage, TrialQuery,
};

/// A store whose disk can be unplugged, and slow.
#[derive(Default)]
pub(crate) struct Flaky {
    pub(crate) inner: MemoryStore,
    /// Nothing can be written.
    pub(crate) broken: AtomicBool,
    /// Somebody deletes each study as soon as it was read.
    pub(crate) fleeting: bool,
    /// Its writer met a defect.
    pub(crate) failed: bool,
    /// How long it takes to read a study into memory.
    pub(crate) load_takes: Duration,
}

#[async_trait]
impl Store for Flaky {
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created, StoreError> {
        self.inner.create_study(id, spec, now_ms).await
    }
    async fn get_study(&self, study: &str) -> Result<StudyRecord, StoreError> {
        let found = self.inner.get_study(study).await?;
        if self.fleeting {
            self.inner.delete_study(study, None).await?;
        }
        Ok(found)
    }
    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>, StoreError> {
        self.inner.list_studies(after, size).await
    }
    async fn delete_study(&self, study: &str, uid: Option<StudyUid>) -> Result<(), StoreError> {
        self.inner.delete_study(study, uid).await
    }
    async fn find_study(&self, uid: StudyUid) -> Result<Option<String>, StoreError> {
        self.inner.find_study(uid).await
    }
    async fn rename_study(
        &self,
        study: &str,
        uid: Option<StudyUid>,
        to: &str,
    ) -> Result<StudyRecord, StoreError> {
        self.inner.rename_study(study, uid, to).await
    }
    async fn load(&self, study: &str) -> Result<Loaded, StoreError> {
        tokio::time::sleep(self.load_takes).await;
        self.inner.load(study).await
    }
    fn queue(&self, fence: &Fence, write: StudyWrite<'_>) -> Receipt {
        if matches!(write, StudyWrite::Commit(_)) && self.broken.load(Ordering::SeqCst) {
            let problem = "database or disk is full".to_owned();
            return Receipt::refused(fence, StoreError::Unavailable(problem));
        }
        self.inner.queue(fence, write)
    }

    async fn completed_trials(
        &self,
        fence: &Fence,
        after: u64,
        size: u32,
    ) -> Result<Vec<RawTrial>, StoreError> {
        self.inner.completed_trials(fence, after, size).await
    }

    async fn save_checkpoint(&self, fence: &Fence, checkpoint: &Checkpoint) -> Result<(), StoreError> {
        self.inner.save_checkpoint(fence, checkpoint).await
    }
    async fn closed_trials(
        &self,
        fence: &Fence,
        after: u64,
        up_to: u64,
        size: u32,
    ) -> Result<Vec<ClosedTrial>, StoreError> {
        self.inner.closed_trials(fence, after, up_to, size).await
    }
    async fn remove_trials(&self, fence: &Fence, numbers: &[u64], covered: u64) -> Result<u64, StoreError> {
        self.inner.remove_trials(fence, numbers, covered).await
    }
    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial, StoreError> {
        self.inner.get_trial(study, number).await
    }
    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage, StoreError> {
        self.inner.query_trials(study, query).await
    }
    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>, StoreError> {
        self.inner.studies_with_due_leases(now_ms).await
    }
    fn has_failed(&self) -> bool {
        self.failed
    }
    async fn close(&self) {
        self.inner.close().await;
    }
}
