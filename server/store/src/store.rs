//! The store's interface for the daemon: each method is one transaction and one use case.

use async_trait::async_trait;
use treewright_core::ids::StudyUid;
use treewright_core::space::EarlierSpaces;
use treewright_core::study::StudySpec;
use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{Change, Checkpoint, Snapshot, StudyCounts};

use crate::cursor::Cursor;
use crate::error::{Result, StoreError};
use crate::fence::{Fence, Receipt};
use crate::filter::{Filter, Order};

/// A study as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyRecord {
    /// The last part of its resource name.
    pub id: String,
    /// Its identity, which outlasts its name.
    pub uid: StudyUid,
    /// Trials up to this number were handed out before the study got its name, by itself or by other studies.
    pub named_after: u64,
    /// The highest trial number that was handed out or skipped. [`StudyCounts::trials`] of `statistics`
    /// counts the study's own trials.
    pub last_trial: u64,
    /// The specification, with the policy in force.
    pub spec: StudySpec,
    /// The spaces that the study had before its present one.
    pub earlier: EarlierSpaces,
    /// The time of its creation, in milliseconds since 1970.
    pub create_ms: i64,
    /// Counts.
    pub statistics: StudyCounts,
}

impl StudyRecord {
    /// The revision of the space with which a specification is that of the study, now or earlier. An error
    /// is the first difference from the present specification, in words.
    pub fn revision_of(&self, spec: &StudySpec) -> Result<u32, String> {
        let Some(difference) = self.spec.first_difference(spec) else {
            return Ok(self.earlier.revision());
        };
        let revision = self.earlier.find(&spec.space, &self.spec.space).filter(|_| {
            let then = StudySpec { space: spec.space.clone(), ..self.spec.clone() };
            then.first_difference(spec).is_none()
        });
        revision.ok_or(difference)
    }

    /// The answer to the creation of a study where this one exists.
    pub(crate) fn found(self, spec: &StudySpec) -> Result<Created> {
        match self.revision_of(spec) {
            Ok(_) => Ok(Created { study: self, is_new: false }),
            Err(difference) => Err(StoreError::StudyExists { study: self.id, difference }),
        }
    }
}

/// The size of a store, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreSize {
    /// The database.
    pub database_bytes: u64,
    /// Its write-ahead log, where that is a file beside it.
    pub log_bytes: u64,
}

/// The study that [`Store::create_study`] found or made.
#[derive(Clone, Debug, PartialEq)]
pub struct Created {
    /// The study as it is stored.
    pub study: StudyRecord,
    /// False when an equal study existed already.
    pub is_new: bool,
}

/// The beginning of a [`Restoring`](treewright_core::tuner::Restoring); it then asks for [completed
/// trials](Store::completed_trials).
#[derive(Debug)]
pub struct Loaded {
    /// The right to change the study from now on. Earlier fences of the study are broken.
    pub fence: Fence,
    /// The study.
    pub study: StudyRecord,
    /// States and visits.
    pub snapshot: Snapshot,
    /// The open trials, by rising number.
    pub open_trials: Vec<Trial>,
    /// The latest checkpoint that was saved whole.
    pub checkpoint: Option<Checkpoint>,
}

/// A question for trials.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialQuery {
    /// The filter of the trials.
    pub filter: Filter,
    /// The order of the trials.
    pub order: Order,
    /// The row behind which the page begins; none for the first page.
    pub after: Option<Cursor>,
    /// Most entries of the page: 1 to [`PAGE_SIZE`](crate::limits::PAGE_SIZE).
    pub size: u32,
}

/// A page of trials.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialPage {
    /// The trials, in order.
    pub trials: Vec<RawTrial>,
    /// The place of the next page; none on the last.
    pub next: Option<Cursor>,
}

/// A closed trial, in the form for retention.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClosedTrial {
    /// Its number.
    pub number: u64,
    /// Its place in the order of completion; none of a trial that was abandoned or expired.
    pub completion: Option<u64>,
}

/// A write of one study under its fence.
#[derive(Clone, Copy, Debug)]
pub enum StudyWrite<'a> {
    /// [`Store::commit`].
    Commit(&'a [Change]),
    /// [`Store::update_study`].
    Study(&'a StudySpec, &'a EarlierSpaces, u64),
    /// [`Store::change_space`].
    Space(&'a StudySpec, &'a EarlierSpaces),
    /// [`Store::exclude_trial`].
    Exclude(u64, Option<&'a str>),
}

/// Keeps studies, states, trials and visits.
///
/// There are two kinds of methods. The `async` ones are whole use cases. [`queue`](Store::queue), with which
/// [`commit`](Store::commit) and the like are written, only gives a write its place in the order of writes
/// and returns at once. So a caller can hold a lock while it queues, and let go before it waits.
#[async_trait]
pub trait Store: Send + Sync + 'static {
    /// Creates a study with an identity of its own, or finds an equal one under its id, be it with one of its
    /// earlier spaces. Its trial numbers begin after those of earlier studies of that id.
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created>;

    /// Reads a study.
    async fn get_study(&self, study: &str) -> Result<StudyRecord>;

    /// Reads at most `size` studies by rising id, behind `after`.
    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>>;

    /// The present id of the study with this identity; none where there is no such study.
    async fn find_study(&self, uid: StudyUid) -> Result<Option<String>>;

    /// Gives a study another id, and breaks its fence. Its trial numbers go on after its own and those of
    /// earlier studies of the new id. [`StoreError::NameTaken`] when a study has the id. Where a `uid` is
    /// given, a study of the old id with another identity counts as none.
    async fn rename_study(&self, study: &str, uid: Option<StudyUid>, to: &str) -> Result<StudyRecord>;

    /// Deletes a study with its states, trials and visits, and breaks its fence. Where a `uid` is given, a
    /// study of the id with another identity counts as none.
    async fn delete_study(&self, study: &str, uid: Option<StudyUid>) -> Result<()>;

    /// Waits for all writes queued so far, breaks earlier fences of the study and reads all of it but its
    /// closed trials. Where several replicas share the store, it fails with [`StoreError::Elsewhere`] while
    /// another holds the study.
    async fn load(&self, study: &str) -> Result<Loaded>;

    /// The secret by which processes that share this store recognise each other; none where only one process
    /// may serve it.
    fn replica_key(&self) -> Option<[u8; 32]> {
        None
    }

    /// Forgets the other replica that holds the study, because it could not be reached. The next load reads
    /// the holder again. Stores that are not shared do nothing.
    fn doubt(&self, study: &str) {
        let _ = study;
    }

    /// Whether the other replica at `address` still counts as alive and holds the study. True while this
    /// cannot be found out.
    async fn is_held_by(&self, study: &str, address: &str) -> bool {
        let _ = (study, address);
        true
    }

    /// The size of the store; `None` where it is not known.
    async fn size(&self) -> Option<StoreSize> {
        None
    }

    /// Gives a write its place in the order of writes.
    fn queue(&self, fence: &Fence, write: StudyWrite<'_>) -> Receipt;

    /// Queues changes that are stored all or none. An empty list, too, waits for every earlier change.
    fn commit(&self, fence: &Fence, changes: &[Change]) -> Receipt {
        self.queue(fence, StudyWrite::Commit(changes))
    }

    /// Queues a new policy and new texts for people, and with them [`Snapshot::models_since`]. The spaces are
    /// those that are stored.
    fn update_study(
        &self,
        fence: &Fence,
        spec: &StudySpec,
        earlier: &EarlierSpaces,
        models_since: u64,
    ) -> Receipt {
        self.queue(fence, StudyWrite::Study(spec, earlier, models_since))
    }

    /// Queues a new space of a study, with its policy as it is in that space, and the spaces before. The
    /// searches of all states and the checkpoint are dropped, because they are of another space. The tuner
    /// must be loaded again.
    fn change_space(&self, fence: &Fence, spec: &StudySpec, earlier: &EarlierSpaces) -> Receipt {
        self.queue(fence, StudyWrite::Space(spec, earlier))
    }

    /// Queues that a completed trial is excluded for a reason, or counts again without one. The checkpoint is
    /// dropped, because it rests on other trials. The tuner must be loaded again.
    fn exclude_trial(&self, fence: &Fence, number: u64, reason: Option<&str>) -> Receipt {
        self.queue(fence, StudyWrite::Exclude(number, reason))
    }

    /// Reads the completed trials behind a place in the order of completion, in that order, at most `size` of
    /// them. Only their exclusion changes, so the fence only names the study and may be broken. The cost does
    /// not depend on the place in the history.
    async fn completed_trials(&self, fence: &Fence, after: u64, size: u32) -> Result<Vec<RawTrial>>;

    /// Saves a checkpoint in the place of earlier ones. The earlier one stays until the new one is complete;
    /// other writes do not wait for the whole of it. A failure does not break the fence, because a checkpoint
    /// only saves time.
    async fn save_checkpoint(&self, fence: &Fence, checkpoint: &Checkpoint) -> Result<()>;

    /// The trials behind `after` and up to `to` that are not open, by rising number, at most `size` of
    /// them.
    async fn closed_trials(&self, fence: &Fence, after: u64, to: u64, size: u32) -> Result<Vec<ClosedTrial>>;

    /// Removes trials for good, and returns their number. Open trials stay, and so do those completed after
    /// the completion `covered`: an expired trial may have been reported since the caller looked. The trial
    /// with the highest number and the one completed last must stay, because the study's counts are read from
    /// them. Much free space in a file is given back in that step. A failure does not break the fence.
    async fn remove_trials(&self, fence: &Fence, numbers: &[u64], covered: u64) -> Result<u64>;

    /// Reads a trial.
    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial>;

    /// Reads a page of trials.
    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage>;

    /// The ids of the studies that hold an open trial whose lease ended before `now_ms`.
    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>>;

    /// Whether a writing task met a defect, so that no write is possible until the process is started again.
    fn has_failed(&self) -> bool {
        false
    }

    /// Finishes queued writes and closes. Later calls answer [`StoreError::Closed`].
    async fn close(&self);
}
