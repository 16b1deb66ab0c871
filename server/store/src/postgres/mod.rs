//! The store on PostgreSQL, which several replicas of the daemon share.
//!
//! A study's tuner lives in one replica at a time. [`load`](Store::load) takes the study for this replica by
//! raising its epoch, unless another that lives holds it. Every write names the epoch it was computed under,
//! and is refused under an older one. So a replica that lost a study, for whatever reason, can store nothing
//! more of it. The epoch is the fencing token of M. Kleppmann, "Designing Data-Intensive Applications",
//! chapter 8.
//!
//! `open` connects. `replica` shows the others that this replica lives, and hears their notices. `claim`
//! takes studies. `writer` and `batch` write. `read` and `studies` ask. `filter` translates questions.
//! `statements` holds the SQL, `shared` the common state. `tokens` is independent of them.

mod batch;
mod claim;
mod filter;
mod open;
mod read;
mod replica;
mod shared;
mod statements;
mod studies;
mod tokens;
mod writer;

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash as _, Hasher as _};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgPool, Postgres};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;
use tokio::time::timeout;
use treewright_core::ids::StudyUid;
use treewright_core::study::StudySpec;
use treewright_core::trial::RawTrial;
use treewright_core::tuner::Checkpoint;

use crate::error::{OpenError, Result, StoreError};
use crate::fence::{Fence, Receipt};
use crate::limits;
use crate::rows::{self, PartRow, StudyChange};
use crate::store::{
    ClosedTrial, Created, Loaded, Store, StoreSize, StudyRecord, StudyWrite, TrialPage, TrialQuery,
};
use shared::SharedState;
use writer::{ChangeJob, StudyJob};

pub use open::PostgresAddress;
pub use tokens::PostgresTokens;

/// Keeps everything in a PostgreSQL database that other replicas may serve as well.
pub struct PostgresStore {
    shared: Arc<SharedState>,
    readers: PgPool,
    replica_key: [u8; 32],
    /// None once closed.
    open: Mutex<Option<OpenPostgres>>,
}

struct OpenPostgres {
    queues: Vec<mpsc::Sender<StudyJob>>,
    writers: Vec<JoinHandle<()>>,
    leave: oneshot::Sender<()>,
    session: JoinHandle<()>,
    listener: Listening,
}

/// Ends with its owner.
struct Listening(JoinHandle<()>);

impl Drop for Listening {
    fn drop(&mut self) {
        self.0.abort();
    }
}

impl PostgresStore {
    /// Connects, brings the schema up to date and enters this replica. `advertised` is its address for other
    /// replicas; `patience` is the longest wait for a server that comes up. Must be called within a tokio
    /// runtime, on which the writers then run. Dropped without [`close`](Store::close), the store is like
    /// that of a killed process.
    ///
    /// # Errors
    /// [`OpenError`] with the cause and a remedy, never with a password.
    pub async fn open(
        database: PostgresAddress,
        advertised: &str,
        patience: Duration,
    ) -> Result<Self, OpenError> {
        let mut connection = open::open(&database, patience).await?;
        let unreachable = |error: sqlx::Error| OpenError::Unreachable(database.shown(), error.to_string());
        let replica_key = open::replica_key(&mut connection, &database.shown()).await?;
        let me = replica::register(&mut connection, advertised).await.map_err(unreachable)?;
        let shared = Arc::new(SharedState::new(database.clone(), advertised.to_owned(), me));
        let listener = replica::listener(&shared).await.map_err(unreachable)?;
        let (leave, left) = oneshot::channel();
        let mut queues = Vec::new();
        let mut writers = Vec::new();
        for _ in 0..limits::POSTGRES_WRITERS {
            let (queue, waiting) = mpsc::channel(limits::WRITE_QUEUE);
            queues.push(queue);
            writers.push(tokio::spawn(writer::run(Arc::clone(&shared), waiting)));
        }
        tracing::info!(replica = me, advertised, "entered");
        let open = OpenPostgres {
            queues,
            writers,
            leave,
            session: tokio::spawn(replica::live(Arc::clone(&shared), connection, left)),
            listener: Listening(tokio::spawn(replica::listen(Arc::clone(&shared), listener))),
        };
        let readers = database.pool(limits::READERS);
        Ok(Self { readers, replica_key, shared, open: Mutex::new(Some(open)) })
    }

    /// Gives a write its place in the order of writes of its study.
    fn enqueue(&self, study: &str, job: StudyJob) {
        let mut hasher = DefaultHasher::new();
        study.hash(&mut hasher);
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let (job, error) = match &*open {
            None => (job, StoreError::Closed),
            Some(open) => {
                let writer = (hasher.finish() % open.queues.len() as u64) as usize;
                match open.queues[writer].try_send(job) {
                    Ok(()) => return,
                    Err(mpsc::error::TrySendError::Closed(job)) => (job, StoreError::Closed),
                    Err(mpsc::error::TrySendError::Full(job)) => {
                        (job, StoreError::QueueFull(limits::WRITE_QUEUE))
                    }
                }
            }
        };
        job.refuse(error);
    }

    /// Gives a change under a fence its place.
    fn change(&self, fence: &Fence, change: StudyChange) -> Receipt {
        let (answer, receipt) = Receipt::pending();
        let job = ChangeJob { fence: fence.clone(), change, answer };
        self.enqueue(fence.study(), StudyJob::Change(job));
        receipt
    }

    async fn reader(&self) -> Result<PoolConnection<Postgres>> {
        self.readers.acquire().await.map_err(failed)
    }
}

/// Waits for the answer to a question, but not for ever. The setting of [`PostgresAddress::pool`] stops a
/// server that is there and slow; this is for one that is silent.
async fn in_time<T>(question: impl Future<Output = Result<T>>) -> Result<T> {
    let answer = timeout(limits::POSTGRES_QUESTION_TIMEOUT, question).await;
    answer.unwrap_or_else(|_| Err(failed(open::silent())))
}

/// An error of the database in the form for the daemon's callers.
fn failed(error: sqlx::Error) -> StoreError {
    let problem = match &error {
        sqlx::Error::PoolClosed => return StoreError::Closed,
        sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_) => {
            return rows::inconsistent(error.to_string());
        }
        sqlx::Error::PoolTimedOut => {
            let waited_s = limits::POSTGRES_READER_TIMEOUT.as_secs();
            format!("it gave no connection within {waited_s} s, so it is down or overloaded")
        }
        sqlx::Error::Database(database) => database.message().to_owned(),
        other => other.to_string(),
    };
    StoreError::Unavailable(problem)
}

#[async_trait]
impl Store for PostgresStore {
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created> {
        in_time(read::create(&mut *self.reader().await?, id, spec, now_ms)).await
    }

    async fn get_study(&self, study: &str) -> Result<StudyRecord> {
        in_time(read::study(&mut *self.reader().await?, study)).await
    }

    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>> {
        in_time(read::studies(&mut *self.reader().await?, after, size)).await
    }

    async fn delete_study(&self, study: &str, uid: Option<StudyUid>) -> Result<()> {
        let key = in_time(studies::delete(&mut *self.reader().await?, study, uid)).await?;
        self.shared.deleted(key);
        Ok(())
    }

    async fn find_study(&self, uid: StudyUid) -> Result<Option<String>> {
        in_time(read::study_of_uid(&mut *self.reader().await?, uid)).await
    }

    async fn rename_study(&self, study: &str, uid: Option<StudyUid>, to: &str) -> Result<StudyRecord> {
        let key = in_time(studies::rename(&mut *self.reader().await?, study, uid, to)).await?;
        self.shared.deleted(key);
        self.get_study(to).await
    }

    async fn load(&self, study: &str) -> Result<Loaded> {
        if let Some(owner) = self.shared.owner(study) {
            return Err(StoreError::Elsewhere { study: study.to_owned(), address: owner.address });
        }
        let (answer, claimed) = oneshot::channel();
        self.enqueue(study, StudyJob::Claim { study: study.to_owned(), answer });
        let fence = claimed.await.unwrap_or(Err(StoreError::Closed))?;
        let read = in_time(read::load(&mut *self.reader().await?, fence)).await;
        read.map_err(|error| error.in_study(study))
    }

    fn replica_key(&self) -> Option<[u8; 32]> {
        Some(self.replica_key)
    }

    fn doubt(&self, study: &str) {
        self.shared.forget_owner(study);
    }

    async fn is_held_by(&self, study: &str, address: &str) -> bool {
        let Ok(mut reader) = self.reader().await else { return true };
        let question = sqlx::query_scalar(statements::HOLDER_ADDRESS)
            .bind(study)
            .bind(limits::REPLICA_LAPSE.as_secs_f64())
            .fetch_optional(&mut *reader);
        let asking = async { question.await.map_err(failed) };
        let found: Result<Option<Option<String>>, _> = in_time(asking).await;
        found.map_or(true, |holder| holder.flatten().is_some_and(|holder| holder == address))
    }

    async fn size(&self) -> Option<StoreSize> {
        let mut reader = self.reader().await.ok()?;
        let question = sqlx::query_scalar(statements::DATABASE_BYTES).fetch_one(&mut *reader);
        let bytes: i64 = in_time(async { question.await.map_err(failed) }).await.ok()?;
        Some(StoreSize { database_bytes: bytes.try_into().ok()?, log_bytes: 0 })
    }

    fn queue(&self, fence: &Fence, write: StudyWrite<'_>) -> Receipt {
        match StudyChange::of(write) {
            Ok(change) => self.change(fence, change),
            Err(error) => Receipt::refused(fence, error),
        }
    }

    async fn completed_trials(&self, fence: &Fence, after: u64, size: u32) -> Result<Vec<RawTrial>> {
        let read = in_time(read::completed(&mut *self.reader().await?, fence, after, size)).await;
        read.map_err(|error| error.in_study(fence.study()))
    }

    async fn save_checkpoint(&self, fence: &Fence, checkpoint: &Checkpoint) -> Result<()> {
        // The parts go one after the other, so that other writes come in between.
        for row in PartRow::cut(checkpoint) {
            self.change(fence, StudyChange::Part(row?)).durable().await?;
        }
        Ok(())
    }

    async fn closed_trials(&self, fence: &Fence, after: u64, to: u64, size: u32) -> Result<Vec<ClosedTrial>> {
        let read = in_time(read::closed(&mut *self.reader().await?, fence, after, to, size)).await;
        read.map_err(|error| error.in_study(fence.study()))
    }

    async fn remove_trials(&self, fence: &Fence, numbers: &[u64], covered: u64) -> Result<u64> {
        in_time(studies::remove_trials(&mut *self.reader().await?, fence, numbers, covered)).await
    }

    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial> {
        let read = in_time(read::trial(&mut *self.reader().await?, study, number)).await;
        read.map_err(|error| error.in_study(study))
    }

    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage> {
        let read = in_time(read::trials(&mut *self.reader().await?, study, query)).await;
        read.map_err(|error| error.in_study(study))
    }

    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>> {
        in_time(studies::with_due_leases(&mut *self.reader().await?, self.shared.me(), now_ms)).await
    }

    fn has_failed(&self) -> bool {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.as_ref().is_some_and(|open| open.writers.iter().any(JoinHandle::is_finished))
    }

    async fn close(&self) {
        let taken = self.open.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(OpenPostgres { queues, writers, leave, session, listener }) = taken else {
            return;
        };
        // With their last senders gone the queues run dry, and the writers end.
        drop(queues);
        for writer in writers {
            if let Err(error) = writer.await {
                tracing::warn!(%error, "a writer ended badly");
            }
        }
        // The session may have ended already; then no task receives this.
        let _ = leave.send(());
        let _ = session.await;
        drop(listener);
        self.readers.close().await;
    }
}
