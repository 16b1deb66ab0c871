//! The one writer: a task that owns the writing connection and puts waiting writes into one transaction.
//!
//! Waiting for the disk costs far more than the statements. So all writes that have gathered while the last
//! transaction was being made durable share the next one (the "group commit" of DeWitt et al.,
//! "Implementation techniques for main memory database systems", 1984). Every caller is answered after
//! COMMIT. A write that the tables refuse is taken out, and the others are tried again.

use sqlx::sqlite::SqliteConnection;
use tokio::sync::{mpsc, oneshot};
use tokio::time::{Instant, timeout_at};

use super::commands::{self, GroupFences, WriteCommand, WriteResult};
use super::identity::FileIdentity;
use super::{codes, reap, script};
use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::limits;
use crate::rows::{Rows, StudyChange};

pub(super) struct WriteJob {
    pub(super) command: WriteCommand,
    pub(super) answer: Reply,
}

/// The receiver of an answer. The write happens even if the caller has left.
pub(super) enum Reply {
    Done(oneshot::Sender<Result<WriteResult>>),
    Stored(oneshot::Sender<Result<()>>),
}

impl Reply {
    pub(super) fn give(self, result: Result<WriteResult>) {
        match self {
            Self::Done(sender) => drop(sender.send(result)),
            Self::Stored(sender) => drop(sender.send(result.map(|_| ()))),
        }
    }
}

impl WriteJob {
    pub(super) fn refuse(self, error: StoreError) {
        if let WriteCommand::Change { fence, change } = &self.command {
            change.fail(fence, &error);
        }
        self.answer.give(Err(error));
    }

    /// Whether it only waits for the writes before it.
    fn is_empty(&self) -> bool {
        matches!(
            &self.command,
            WriteCommand::Change { fence, change: StudyChange::Commit(rows) } if rows.is_empty() && fence.holds()
        )
    }
}

/// The cause of a failed transaction: one write, or the database.
struct GroupFailure {
    culprit: Option<usize>,
    error: StoreError,
}

/// Writes until the queue is closed and empty, then hands the connection back.
pub(super) async fn run(
    mut connection: SqliteConnection,
    mut identity: FileIdentity,
    mut queue: mpsc::Receiver<WriteJob>,
) -> SqliteConnection {
    let mut fences = GroupFences::new();
    let mut reaper = Reaper::default();
    while let Some(first) = reaper.next(&mut queue, &mut connection).await {
        let mut group = vec![first];
        while group.len() < limits::WRITE_GROUP
            && let Ok(job) = queue.try_recv()
        {
            group.push(job);
        }
        reaper.look_at(&group);
        match identity.check() {
            Ok(()) => write(&mut connection, &mut fences, group).await,
            Err(error) => group.into_iter().for_each(|job| job.refuse(error.clone())),
        }
    }
    connection
}

/// The schedule for removing rows of deleted studies: a piece at a time, with a pause between two.
struct Reaper {
    /// The time of the next piece; none while there is nothing to remove.
    due: Option<Instant>,
}

impl Default for Reaper {
    /// An earlier process may have left rows.
    fn default() -> Self {
        Self { due: Some(Instant::now() + limits::REAP_PAUSE) }
    }
}

impl Reaper {
    /// The next write; pieces that are due meanwhile are removed.
    async fn next(
        &mut self,
        queue: &mut mpsc::Receiver<WriteJob>,
        connection: &mut SqliteConnection,
    ) -> Option<WriteJob> {
        loop {
            let Some(due) = self.due else {
                return queue.recv().await;
            };
            if Instant::now() < due {
                match timeout_at(due, queue.recv()).await {
                    Ok(job) => return job,
                    Err(_) => continue,
                }
            }
            let pause = match reap::reap(connection).await {
                Ok(more) => more.then_some(limits::REAP_PAUSE),
                Err(error) => {
                    tracing::warn!(%error, "rows of a deleted study stay for now; trying again");
                    Some(limits::REAP_RETRY)
                }
            };
            self.due = pause.map(|pause| Instant::now() + pause);
            if let Ok(job) = queue.try_recv() {
                return Some(job);
            }
        }
    }

    /// Notes that a write leaves rows to remove.
    fn look_at(&mut self, group: &[WriteJob]) {
        if group.iter().any(|job| matches!(job.command, WriteCommand::Delete { .. })) {
            self.due.get_or_insert_with(|| Instant::now() + limits::REAP_PAUSE);
        }
    }
}

async fn write(connection: &mut SqliteConnection, fences: &mut GroupFences, mut group: Vec<WriteJob>) {
    let jobs = group.len();
    assert!((1..=limits::WRITE_GROUP).contains(&jobs), "{jobs} writes in one transaction");
    while !group.is_empty() {
        match transaction(connection, fences, &group).await {
            Ok(done) => {
                tracing::trace!(writes = group.len(), "stored");
                for (job, done) in group.into_iter().zip(done) {
                    job.answer.give(Ok(done));
                }
                return;
            }
            Err(GroupFailure { culprit: Some(index), error }) => {
                group.remove(index).refuse(error);
            }
            Err(GroupFailure { culprit: None, error }) => {
                for job in group {
                    job.refuse(error.clone());
                }
                return;
            }
        }
    }
}

async fn transaction(
    connection: &mut SqliteConnection,
    fences: &mut GroupFences,
    group: &[WriteJob],
) -> Result<Vec<WriteResult>, GroupFailure> {
    if group.iter().all(WriteJob::is_empty) {
        return Ok(group.iter().map(|_| WriteResult::Nothing).collect());
    }
    if let [WriteJob { command: WriteCommand::Change { fence, change: StudyChange::Commit(rows) }, .. }] =
        group
    {
        debug_assert!(!fence.holds() || commands::is_in_force(fences, fence), "two fences hold");
        return lone_commit(connection, fence, rows).await;
    }
    execute(connection, "BEGIN IMMEDIATE").await.map_err(database_failed)?;
    let mut done = Vec::with_capacity(group.len());
    for (index, job) in group.iter().enumerate() {
        match commands::apply(connection, fences, &job.command).await {
            Ok(one) => done.push(one),
            Err(error) => {
                roll_back(connection).await;
                return Err(GroupFailure { culprit: Some(index), error });
            }
        }
    }
    if let Err(error) = execute(connection, "COMMIT").await {
        roll_back(connection).await;
        return Err(database_failed(error));
    }
    Ok(done)
}

/// A commit alone in its transaction, as on every frame of a single client. It goes to SQLite in one piece,
/// so that it takes one way to the connection's thread, not one for each statement.
async fn lone_commit(
    connection: &mut SqliteConnection,
    fence: &Fence,
    rows: &Rows,
) -> Result<Vec<WriteResult>, GroupFailure> {
    let failed = |error| GroupFailure { culprit: Some(0), error };
    fence.check().map_err(failed)?;
    assert!(!rows.is_empty(), "what only waits needs no transaction");
    match script::transaction(fence.key(), rows).execute(&mut *connection).await {
        Ok(_) => Ok(vec![WriteResult::Nothing]),
        Err(error) => {
            roll_back(connection).await;
            Err(failed(codes::refused(error).in_study(fence.study())))
        }
    }
}

fn database_failed(error: sqlx::Error) -> GroupFailure {
    GroupFailure { culprit: None, error: super::store_error(&error) }
}

async fn roll_back(connection: &mut SqliteConnection) {
    // SQLite rolls back of its own accord after some errors; then nothing is left to do.
    if let Err(error) = execute(connection, "ROLLBACK").await {
        tracing::debug!(%error, "nothing to roll back");
    }
}

async fn execute(connection: &mut SqliteConnection, statement: &'static str) -> Result<(), sqlx::Error> {
    sqlx::query(statement).execute(connection).await.map(|_| ())
}
