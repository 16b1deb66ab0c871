//! The store on SQLite: a write-ahead log, one writer, a few readers.
//!
//! `open` prepares the file. `place` checks its path. `lock` keeps a second daemon out. `check` finds damage.
//! `identity` notices a moved file. `writer`, `commands` and `script` write. `read` reads. `reap` removes
//! deleted studies. `filter` translates questions. `statements` holds the fixed SQL.

mod check;
mod codes;
mod commands;
mod filter;
mod identity;
mod lock;
mod open;
mod place;
mod read;
mod reap;
mod script;
mod statements;
mod tokens;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use sqlx::Connection as _;
use sqlx::pool::PoolConnection;
use sqlx::sqlite::{Sqlite, SqliteConnection, SqlitePool};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;
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
use commands::{WriteCommand, WriteResult};
pub use tokens::SqliteTokens;
use writer::{Reply, WriteJob};

/// Tools for files, used by [`maintenance`](crate::maintenance).
pub(crate) mod file {
    pub(crate) use super::check::{check, check_pages, check_schema};
    pub(crate) use super::codes::message;
    pub(crate) use super::lock::DatabaseLock;
    pub(crate) use super::open::{explain, known_version, options, owner};
    pub(crate) use super::place::{beside, check as check_place, check_name, check_names, folder};
}
pub(crate) use check::Unsound;
pub(crate) use open::FileOwner;

/// Keeps everything in one SQLite file and survives being killed at any moment: acknowledged writes are on
/// the disk.
#[derive(Debug)]
pub struct SqliteStore {
    path: PathBuf,
    readers: SqlitePool,
    /// None once closed.
    open: Mutex<Option<OpenFile>>,
    /// Held while the file is being closed.
    closing: Arc<tokio::sync::Mutex<()>>,
}

#[derive(Debug)]
struct OpenFile {
    queue: mpsc::Sender<WriteJob>,
    writer: JoinHandle<SqliteConnection>,
    lock: lock::DatabaseLock,
}

impl SqliteStore {
    /// Opens or creates the database file, and brings its schema up to date. Must be called within a tokio
    /// runtime, on which the writer then runs.
    ///
    /// # Errors
    /// [`OpenError`] with the cause and a remedy; a lock held elsewhere gives one after at most
    /// [`BUSY_TIMEOUT`](limits::BUSY_TIMEOUT).
    pub async fn open(path: &Path) -> Result<Self, OpenError> {
        let opened = open::open(path).await?;
        let (queue, waiting) = mpsc::channel(limits::WRITE_QUEUE);
        let writer = tokio::spawn(writer::run(opened.writer, identity::FileIdentity::of(path), waiting));
        Ok(Self {
            path: path.to_owned(),
            readers: opened.readers,
            open: Mutex::new(Some(OpenFile { queue, writer, lock: opened.lock })),
            closing: Arc::default(),
        })
    }

    /// The database file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives a write its place in the order of writes.
    fn enqueue(&self, command: WriteCommand, answer: Reply) {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let (job, error) = match &*open {
            None => (WriteJob { command, answer }, StoreError::Closed),
            Some(open) => match open.queue.try_send(WriteJob { command, answer }) {
                Ok(()) => return,
                Err(mpsc::error::TrySendError::Closed(job)) => (job, StoreError::Closed),
                Err(mpsc::error::TrySendError::Full(job)) => {
                    (job, StoreError::QueueFull(limits::WRITE_QUEUE))
                }
            },
        };
        job.refuse(error);
    }

    async fn write(&self, command: WriteCommand) -> Result<WriteResult> {
        let (sender, receiver) = oneshot::channel();
        self.enqueue(command, Reply::Done(sender));
        receiver.await.unwrap_or(Err(StoreError::Closed))
    }

    async fn reader(&self) -> Result<PoolConnection<Sqlite>> {
        self.readers.acquire().await.map_err(|error| store_error(&error))
    }
}

/// An error of the database in the form for the daemon's callers.
fn store_error(error: &sqlx::Error) -> StoreError {
    match error {
        sqlx::Error::PoolClosed => StoreError::Closed,
        sqlx::Error::Database(database) => StoreError::Unavailable(database.message().to_owned()),
        sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_) => rows::inconsistent(error.to_string()),
        other => StoreError::Unavailable(other.to_string()),
    }
}

/// An answer of another kind than the command asks for.
fn mismatch() -> StoreError {
    rows::inconsistent("the writer answered another question")
}

#[async_trait]
impl Store for SqliteStore {
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created> {
        let command = WriteCommand::Create { id: id.to_owned(), spec: Box::new(spec.clone()), now_ms };
        match self.write(command).await? {
            WriteResult::Created(created) => Ok(*created),
            _ => Err(mismatch()),
        }
    }

    async fn get_study(&self, study: &str) -> Result<StudyRecord> {
        read::study(&mut *self.reader().await?, study).await
    }

    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>> {
        read::studies(&mut *self.reader().await?, after, size).await
    }

    async fn delete_study(&self, study: &str, uid: Option<StudyUid>) -> Result<()> {
        let study = study.to_owned();
        self.write(WriteCommand::Delete { study, uid }).await.map(|_| ())
    }

    async fn find_study(&self, uid: StudyUid) -> Result<Option<String>> {
        read::study_of_uid(&mut *self.reader().await?, uid).await
    }

    async fn rename_study(&self, study: &str, uid: Option<StudyUid>, to: &str) -> Result<StudyRecord> {
        let command = WriteCommand::Rename { study: study.to_owned(), uid, to: to.to_owned() };
        self.write(command).await?;
        self.get_study(to).await
    }

    async fn load(&self, study: &str) -> Result<Loaded> {
        match self.write(WriteCommand::Fence { study: study.to_owned() }).await? {
            WriteResult::Fenced(fence) => {
                let read = read::load(&mut *self.reader().await?, fence).await;
                read.map_err(|error| error.in_study(study))
            }
            _ => Err(mismatch()),
        }
    }

    async fn size(&self) -> Option<StoreSize> {
        let bytes = |path: &Path| std::fs::metadata(path).map(|file| file.len());
        // Before the first write there is no log.
        let log_bytes = bytes(&place::beside(&self.path, "-wal")).unwrap_or(0);
        Some(StoreSize { database_bytes: bytes(&self.path).ok()?, log_bytes })
    }

    fn queue(&self, fence: &Fence, write: StudyWrite<'_>) -> Receipt {
        match StudyChange::of(write) {
            Ok(change) => {
                let (sender, receipt) = Receipt::pending();
                self.enqueue(WriteCommand::Change { fence: fence.clone(), change }, Reply::Stored(sender));
                receipt
            }
            Err(error) => Receipt::refused(fence, error),
        }
    }

    async fn completed_trials(&self, fence: &Fence, after: u64, size: u32) -> Result<Vec<RawTrial>> {
        let read = read::completed(&mut *self.reader().await?, fence, after, size).await;
        read.map_err(|error| error.in_study(fence.study()))
    }

    async fn save_checkpoint(&self, fence: &Fence, checkpoint: &Checkpoint) -> Result<()> {
        // The parts go one after the other, so that other writes come in between.
        for row in PartRow::cut(checkpoint) {
            let change = StudyChange::Part(row?);
            self.write(WriteCommand::Change { fence: fence.clone(), change }).await?;
        }
        Ok(())
    }

    async fn closed_trials(&self, fence: &Fence, after: u64, to: u64, size: u32) -> Result<Vec<ClosedTrial>> {
        let read = read::closed(&mut *self.reader().await?, fence, after, to, size).await;
        read.map_err(|error| error.in_study(fence.study()))
    }

    async fn remove_trials(&self, fence: &Fence, numbers: &[u64], covered: u64) -> Result<u64> {
        let most = numbers.len() as u64;
        let (numbers, covered) = (rows::write(&numbers)?, rows::signed(covered)?);
        match self.write(WriteCommand::Remove { fence: fence.clone(), numbers, covered }).await? {
            WriteResult::Removed(count) => {
                assert!(count <= most, "{count} trials were removed for {most} numbers");
                Ok(count)
            }
            _ => Err(mismatch()),
        }
    }

    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial> {
        let read = read::trial(&mut *self.reader().await?, study, number).await;
        read.map_err(|error| error.in_study(study))
    }

    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage> {
        let read = read::trials(&mut *self.reader().await?, study, query).await;
        read.map_err(|error| error.in_study(study))
    }

    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>> {
        read::studies_with_due_leases(&self.readers, now_ms).await
    }

    fn has_failed(&self) -> bool {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.as_ref().is_some_and(|open| open.writer.is_finished())
    }

    async fn close(&self) {
        let closing = Arc::clone(&self.closing).lock_owned().await;
        let taken = self.open.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(open) = taken else {
            return;
        };
        let readers = self.readers.clone();
        // A separate task closes the file in order even if the caller gives up waiting.
        let closed = tokio::spawn(async move {
            close(open, readers).await;
            drop(closing);
        });
        if let Err(error) = closed.await {
            tracing::warn!(%error, "closing the database ended badly; nothing is lost");
        }
    }
}

async fn close(open: OpenFile, readers: SqlitePool) {
    let OpenFile { queue, writer, lock } = open;
    // With its last sender gone the queue runs dry, and the writer ends.
    drop(queue);
    let connection = writer.await;
    readers.close().await;
    // Closing the last connection folds the write-ahead log into the file.
    let closed = match connection {
        Ok(connection) => connection.close().await.map_err(|error| error.to_string()),
        Err(error) => Err(error.to_string()),
    };
    if let Err(error) = closed {
        tracing::warn!(error, "the database was not closed cleanly; nothing is lost");
    }
    // Only now may another daemon have the file.
    drop(lock);
}
