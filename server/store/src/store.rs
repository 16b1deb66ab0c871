//! The store as the daemon sees it: one method, one transaction, one use case.

use async_trait::async_trait;
use treewright_core::policy::Policy;
use treewright_core::study::StudySpec;
use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{Change, Snapshot, Statistics};

use crate::cursor::Cursor;
use crate::error::StoreError;
use crate::fence::{Fence, Receipt};
use crate::filter::{Filter, Order};

/// A study as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyRecord {
    /// The last part of its resource name.
    pub id: String,
    /// The specification, with the policy in force.
    pub spec: StudySpec,
    /// When it was created, in milliseconds since 1970.
    pub create_ms: i64,
    /// Counts.
    pub statistics: Statistics,
}

/// What [`Store::create_study`] found or made.
#[derive(Clone, Debug, PartialEq)]
pub struct Created {
    /// The study as it is stored.
    pub study: StudyRecord,
    /// False when an equal study was there already.
    pub is_new: bool,
}

/// Everything that [`Tuner::restore`](treewright_core::tuner::Tuner::restore) needs.
#[derive(Debug)]
pub struct Loaded {
    /// The right to change the study from here on. Earlier fences of the study are broken.
    pub fence: Fence,
    /// The study.
    pub study: StudyRecord,
    /// States and visits.
    pub snapshot: Snapshot,
    /// The open trials, then the completed ones by rising completion.
    pub trials: Vec<Trial>,
}

/// A question for trials.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialQuery {
    /// Which.
    pub filter: Filter,
    /// In which order.
    pub order: Order,
    /// Behind which row; none for the first page.
    pub after: Option<Cursor>,
    /// How many at most: 1 to [`PAGE_SIZE`](crate::limits::PAGE_SIZE).
    pub size: u32,
}

/// A page of trials.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialPage {
    /// The trials, in order.
    pub trials: Vec<RawTrial>,
    /// Where the next page goes on; none on the last.
    pub next: Option<Cursor>,
}

/// Keeps studies, states, trials and visits.
///
/// Two kinds of methods: the `async` ones are whole use cases. [`commit`](Store::commit) and
/// [`update_policy`](Store::update_policy) only take their place in the order of writes and return at
/// once, so that a caller can hold a lock while it queues and let go before it waits.
#[async_trait]
pub trait Store: Send + Sync + 'static {
    /// Creates a study, or finds an equal one under the same id.
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created, StoreError>;

    /// Reads a study.
    async fn get_study(&self, study: &str) -> Result<StudyRecord, StoreError>;

    /// Reads at most `size` studies by rising id, behind `after`.
    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>, StoreError>;

    /// Deletes a study with its states, trials and visits, and breaks its fence.
    async fn delete_study(&self, study: &str) -> Result<(), StoreError>;

    /// Waits for all writes queued so far, breaks earlier fences of the study and reads all of it.
    async fn load(&self, study: &str) -> Result<Loaded, StoreError>;

    /// Queues changes that belong together: all are stored or none. Also an empty list waits for every
    /// change before it.
    fn commit(&self, fence: &Fence, changes: &[Change]) -> Receipt;

    /// Queues a new policy.
    fn update_policy(&self, fence: &Fence, policy: &Policy) -> Receipt;

    /// Reads a trial.
    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial, StoreError>;

    /// Reads a page of trials.
    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage, StoreError>;

    /// The ids of the studies that hold an open trial whose lease ended before `now_ms`.
    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>, StoreError>;

    /// Finishes what is queued and closes. Later calls answer [`StoreError::Closed`].
    async fn close(&self);
}
