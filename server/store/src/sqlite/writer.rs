//! The one writer: a task that owns the writing connection and puts waiting writes into one transaction.
//!
//! Waiting for the disk costs far more than the statements, so all writes that have gathered while the
//! last transaction was being made durable share the next one ("group commit"; DeWitt et al.,
//! "Implementation techniques for main memory database systems", 1984). Every caller is answered after
//! COMMIT and not before. A write that the tables refuse is taken out and the others are tried again.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;
use tokio::sync::{mpsc, oneshot};
use treewright_core::study::StudySpec;

use super::place::Place;
use super::{commands, script};
use crate::error::StoreError;
use crate::fence::Fence;
use crate::limits;
use crate::rows::{PartRow, Rows};
use crate::store::Created;

/// What can be written.
pub(super) enum Command {
    Create {
        id: String,
        spec: Box<StudySpec>,
        now_ms: i64,
    },
    Delete {
        study: String,
    },
    /// Breaks the study's fence and sets up a new one.
    Fence {
        study: String,
    },
    Policy {
        fence: Fence,
        policy: String,
        models_since: u64,
    },
    /// A part of a checkpoint. Its failure breaks no fence.
    Part {
        fence: Fence,
        row: PartRow,
    },
    /// Removes closed trials: a JSON list of numbers. Its failure breaks no fence.
    Remove {
        fence: Fence,
        numbers: String,
        covered: i64,
    },
    Commit {
        fence: Fence,
        rows: Rows,
    },
}

/// What a write yields.
pub(super) enum Done {
    Nothing,
    Created(Box<Created>),
    Fenced(Fence),
    Removed(u64),
}

/// A write and where its answer goes.
pub(super) struct Job {
    pub(super) command: Command,
    pub(super) answer: Answer,
}

/// Where an answer goes. A caller that has left is no reason not to write.
pub(super) enum Answer {
    Done(oneshot::Sender<Result<Done, StoreError>>),
    Stored(oneshot::Sender<Result<(), StoreError>>),
}

impl Answer {
    pub(super) fn give(self, result: Result<Done, StoreError>) {
        match self {
            Self::Done(sender) => drop(sender.send(result)),
            Self::Stored(sender) => drop(sender.send(result.map(|_| ()))),
        }
    }
}

impl Job {
    pub(super) fn refuse(self, error: StoreError) {
        // What the caller computed is lost, so nothing computed on top of it may be stored.
        if let Command::Policy { fence, .. } | Command::Commit { fence, .. } = &self.command {
            fence.break_up();
            tracing::warn!(study = fence.study(), %error, "a change was not stored");
        }
        self.answer.give(Err(error));
    }

    /// Whether it only waits for the writes before it.
    fn is_empty(&self) -> bool {
        matches!(&self.command, Command::Commit { fence, rows } if rows.is_empty() && fence.holds())
    }
}

/// The fence in force for each study, by key.
pub(super) type Fences = HashMap<i64, Fence>;

/// Why a transaction did not come about: one write, or the database.
struct Failure {
    culprit: Option<usize>,
    error: StoreError,
}

/// Writes until the queue is closed and empty, then hands the connection back.
pub(super) async fn run(
    mut connection: SqliteConnection,
    mut place: Place,
    mut queue: mpsc::Receiver<Job>,
) -> SqliteConnection {
    let mut fences = Fences::new();
    while let Some(first) = queue.recv().await {
        let mut group = vec![first];
        while group.len() < limits::WRITE_GROUP
            && let Ok(job) = queue.try_recv()
        {
            group.push(job);
        }
        match place.check() {
            Ok(()) => write(&mut connection, &mut fences, group).await,
            Err(error) => group.into_iter().for_each(|job| job.refuse(error.clone())),
        }
    }
    connection
}

async fn write(connection: &mut SqliteConnection, fences: &mut Fences, mut group: Vec<Job>) {
    while !group.is_empty() {
        match transaction(connection, fences, &group).await {
            Ok(done) => {
                tracing::trace!(writes = group.len(), "stored");
                for (job, done) in group.into_iter().zip(done) {
                    job.answer.give(Ok(done));
                }
                return;
            }
            Err(Failure { culprit: Some(index), error }) => group.remove(index).refuse(error),
            Err(Failure { culprit: None, error }) => {
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
    fences: &mut Fences,
    group: &[Job],
) -> Result<Vec<Done>, Failure> {
    if group.iter().all(Job::is_empty) {
        return Ok(group.iter().map(|_| Done::Nothing).collect());
    }
    if let [Job { command: Command::Commit { fence, rows }, .. }] = group {
        return lone_commit(connection, fence, rows).await;
    }
    execute(connection, "BEGIN IMMEDIATE").await.map_err(database_failed)?;
    let mut done = Vec::with_capacity(group.len());
    for (index, job) in group.iter().enumerate() {
        match commands::apply(connection, fences, &job.command).await {
            Ok(one) => done.push(one),
            Err(error) => {
                roll_back(connection).await;
                return Err(Failure { culprit: Some(index), error });
            }
        }
    }
    if let Err(error) = execute(connection, "COMMIT").await {
        roll_back(connection).await;
        return Err(database_failed(error));
    }
    Ok(done)
}

/// A commit that nobody shares its transaction with: what a single client pays for on every frame. It
/// goes to SQLite in one piece, which spares the way to the connection's thread for each statement.
async fn lone_commit(
    connection: &mut SqliteConnection,
    fence: &Fence,
    rows: &Rows,
) -> Result<Vec<Done>, Failure> {
    let failed = |error| Failure { culprit: Some(0), error };
    fence.check().map_err(failed)?;
    match script::transaction(fence.key(), rows).execute(&mut *connection).await {
        Ok(_) => Ok(vec![Done::Nothing]),
        Err(error) => {
            roll_back(connection).await;
            Err(failed(commands::refused(error)))
        }
    }
}

fn database_failed(error: sqlx::Error) -> Failure {
    Failure { culprit: None, error: super::store_error(&error) }
}

async fn roll_back(connection: &mut SqliteConnection) {
    // SQLite rolls back of its own accord after some errors; there is then nothing left to do.
    if let Err(error) = execute(connection, "ROLLBACK").await {
        tracing::debug!(%error, "nothing to roll back");
    }
}

async fn execute(connection: &mut SqliteConnection, statement: &'static str) -> Result<(), sqlx::Error> {
    sqlx::query(statement).execute(connection).await.map(|_| ())
}
