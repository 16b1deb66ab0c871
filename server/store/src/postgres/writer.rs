//! A writer: a task with a connection of its own that stores waiting commits together.
//!
//! The commits that have gathered while the last statement was being made durable share the next one (the
//! "group commit" of DeWitt et al., "Implementation techniques for main memory database systems", 1984). Each
//! caller is answered after PostgreSQL has confirmed the commit. Each study has one writer, so that its
//! writes keep their order.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use sqlx::Postgres;
use sqlx::postgres::{PgArguments, PgConnection};
use sqlx::query::Query;
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

use super::batch::{Batch, without_nul};
use super::open::silent;
use super::shared::SharedState;
use super::{claim, failed, statements as sql};
use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::limits;
use crate::rows::{StudyChange, inconsistent, one_at_most};

/// The time after a failure to reach the database in which writes are refused without another try.
const FAIL_FAST: Duration = Duration::from_millis(100);

/// The number of tries of a statement that the database aborts in favour of another.
const TRIES: usize = 4;

type Statement<'q> = Query<'q, Postgres, PgArguments>;

pub(super) enum StudyJob {
    Change(ChangeJob),
    Claim { study: String, answer: oneshot::Sender<Result<Fence>> },
}

/// A write under a fence, and the receiver of its answer.
pub(super) struct ChangeJob {
    pub(super) fence: Fence,
    pub(super) change: StudyChange,
    pub(super) answer: oneshot::Sender<Result<()>>,
}

impl StudyJob {
    pub(super) fn refuse(self, error: StoreError) {
        match self {
            Self::Change(job) => job.finish(Err(error)),
            Self::Claim { answer, .. } => drop(answer.send(Err(error))),
        }
    }
}

impl ChangeJob {
    /// Answers, and breaks the fence after an error.
    fn finish(self, result: Result<()>) {
        if let Err(error) = &result {
            self.change.fail(&self.fence, error);
        }
        drop(self.answer.send(result));
    }
}

enum BatchResult {
    /// The studies whose epoch still holds; their rows are stored.
    Held(HashSet<i64>),
    /// One of the rows breaks a rule; nothing is stored.
    Broken(StoreError),
    /// The database failed; nothing is known to be stored.
    Failed(StoreError),
}

/// Writes until the queue is closed and empty.
pub(super) async fn run(shared: Arc<SharedState>, mut queue: mpsc::Receiver<StudyJob>) {
    let mut writer = Writer { shared, connection: None, failure: None };
    while let Some(first) = queue.recv().await {
        let mut group = VecDeque::from([first]);
        while group.len() < limits::WRITE_GROUP
            && let Ok(job) = queue.try_recv()
        {
            group.push_back(job);
        }
        writer.write(group).await;
    }
}

struct Writer {
    shared: Arc<SharedState>,
    connection: Option<PgConnection>,
    failure: Option<(Instant, StoreError)>,
}

impl Writer {
    async fn write(&mut self, mut group: VecDeque<StudyJob>) {
        assert!((1..=limits::WRITE_GROUP).contains(&group.len()), "{} writes at once", group.len());
        loop {
            let together = leading_commits(&group);
            if together > 0 {
                let jobs = group.drain(..together).filter_map(|job| match job {
                    StudyJob::Change(job) => Some(job),
                    StudyJob::Claim { .. } => None,
                });
                self.store(jobs.collect()).await;
                continue;
            }
            match group.pop_front() {
                None => return,
                Some(StudyJob::Claim { study, answer }) => {
                    // A caller that has left does not hear the answer; the claim is then useless.
                    drop(answer.send(self.claim(&study).await));
                }
                Some(StudyJob::Change(job)) => {
                    let result = self.alone(&job).await;
                    job.finish(result);
                }
            }
        }
    }

    /// Stores commits that fit into one statement; where that breaks a rule, each in its own.
    async fn store(&mut self, jobs: Vec<ChangeJob>) {
        assert!(!jobs.is_empty() && jobs.iter().all(|job| matches!(job.change, StudyChange::Commit(_))));
        match self.batch(&jobs).await {
            BatchResult::Held(held) => {
                tracing::trace!(writes = jobs.len(), "stored");
                for job in jobs {
                    let is_held = held.contains(&job.fence.key());
                    let fenced = || StoreError::Fenced(job.fence.study().to_owned());
                    let result = if is_held { Ok(()) } else { Err(fenced()) };
                    job.finish(result);
                }
            }
            BatchResult::Broken(error) if jobs.len() == 1 => {
                for job in jobs {
                    let error = error.clone().in_study(job.fence.study());
                    job.finish(Err(error));
                }
            }
            BatchResult::Broken(_) => {
                for job in jobs {
                    match job.fence.check() {
                        Ok(()) => Box::pin(self.store(vec![job])).await,
                        refused => job.finish(refused),
                    }
                }
            }
            BatchResult::Failed(error) => {
                for job in jobs {
                    job.finish(Err(error.clone()));
                }
            }
        }
    }

    async fn batch(&mut self, jobs: &[ChangeJob]) -> BatchResult {
        let mut batch = Batch::default();
        for ChangeJob { fence, change, .. } in jobs {
            if let StudyChange::Commit(rows) = change {
                let is_added = batch.add(fence, rows);
                assert!(is_added, "a commit to {} would be acknowledged and not stored", fence.study());
            }
        }
        for _ in 0..TRIES {
            let connection = match self.connection().await {
                Ok(connection) => connection,
                Err(error) => return BatchResult::Failed(error),
            };
            let storing = timeout(limits::POSTGRES_WRITE_TIMEOUT, batch.store(connection));
            let error = match storing.await.unwrap_or_else(|_| Err(silent())) {
                Ok(held) => return BatchResult::Held(held),
                Err(error) => error,
            };
            let (class, problem) = match error.as_database_error() {
                Some(database) => (class(database), database.message().to_owned()),
                None => (Class::Gone, error.to_string()),
            };
            match class {
                // A deadlock with another replica, or the like: it was rolled back.
                Class::Again => {}
                Class::Rule => return BatchResult::Broken(inconsistent(problem)),
                Class::Refusal => return BatchResult::Failed(StoreError::Unavailable(problem)),
                Class::Gone => {
                    self.connection = None;
                    return BatchResult::Failed(StoreError::Unavailable(problem));
                }
            }
        }
        let problem = "it broke the write off again and again for the sake of others".to_owned();
        BatchResult::Failed(StoreError::Unavailable(problem))
    }

    async fn claim(&mut self, study: &str) -> Result<Fence> {
        let shared = Arc::clone(&self.shared);
        let connection = self.connection().await?;
        let claiming = timeout(limits::POSTGRES_WRITE_TIMEOUT, claim::claim(connection, &shared, study));
        let claimed = claiming.await.unwrap_or_else(|_| Err(failed(silent())));
        self.keep_connection_after(&claimed);
        claimed
    }

    /// A write that shares no statement: a study, a space, the exclusion of a trial, a part of a checkpoint,
    /// or a commit under a fence that is broken, which is refused.
    async fn alone(&mut self, job: &ChangeJob) -> Result<()> {
        let fence = &job.fence;
        fence.check()?;
        match &job.change {
            StudyChange::Study { specification, policy, models_since } => {
                let query = held(sql::STUDY_UPDATE, fence).bind(specification).bind(policy);
                self.execute_held(fence, query.bind(models_since)).await
            }
            StudyChange::Space { specification, policy } => {
                let query = held(sql::SPACE_UPDATE, fence).bind(specification).bind(policy);
                self.execute_held(fence, query).await
            }
            StudyChange::Exclude { number, reason } => {
                // A trial that was removed meanwhile looks like a study that another replica has: it is
                // missed when the study has been loaded again.
                let query =
                    held(sql::TRIAL_EXCLUDE, fence).bind(number).bind(reason.as_deref().map(without_nul));
                self.execute_held(fence, query).await
            }
            StudyChange::Part(row) => {
                assert!((0..row.parts).contains(&row.part), "part {} of {}", row.part, row.parts);
                let query = held(sql::PART_UPSERT, fence).bind(row.completion).bind(row.part);
                self.execute_held(fence, query.bind(row.parts).bind(&row.bytes)).await?;
                if row.part + 1 < row.parts {
                    return Ok(());
                }
                // Earlier checkpoints are removed, and the parts that a crash left. Another replica that has
                // taken the study since keeps its own.
                let query = held(sql::OTHER_CHECKPOINTS_DELETE, fence);
                self.execute(query.bind(row.completion).bind(row.parts)).await.map(|_| ())
            }
            StudyChange::Commit(_) => {
                unreachable!("a commit to {} would be acknowledged and not stored", fence.study())
            }
        }
    }

    /// Executes a statement that changes nothing where the study's epoch no longer holds.
    async fn execute_held(&mut self, fence: &Fence, query: Statement<'_>) -> Result<()> {
        let rows = self.execute(query).await?;
        one_at_most(rows);
        match rows {
            0 => Err(StoreError::Fenced(fence.study().to_owned())),
            _ => Ok(()),
        }
    }

    /// Executes a statement and counts the rows it changed.
    async fn execute(&mut self, query: Statement<'_>) -> Result<u64> {
        let connection = self.connection().await?;
        let done = timeout(limits::POSTGRES_WRITE_TIMEOUT, query.execute(connection)).await;
        let done = done.unwrap_or_else(|_| Err(silent())).map_err(failed);
        self.keep_connection_after(&done);
        Ok(done?.rows_affected())
    }

    /// A connection is not used again after an error, because its unread answers are unknown.
    fn keep_connection_after<T>(&mut self, result: &Result<T>) {
        if matches!(result, Err(StoreError::Unavailable { .. })) {
            self.connection = None;
        }
    }

    async fn connection(&mut self) -> Result<&mut PgConnection> {
        if self.connection.is_none() {
            if let Some((_, error)) = self.failure.as_ref().filter(|(at, _)| at.elapsed() < FAIL_FAST) {
                return Err(error.clone());
            }
            match self.shared.database.connect().await {
                Ok(connection) => {
                    self.failure = None;
                    self.connection = Some(connection);
                }
                Err(error) => {
                    let error = failed(error);
                    self.failure = Some((Instant::now(), error.clone()));
                    return Err(error);
                }
            }
        }
        self.connection.as_mut().ok_or(StoreError::Closed)
    }
}

/// A statement whose first parameters are a study and the epoch that must still be its own.
fn held<'q>(statement: &'static str, fence: &Fence) -> Statement<'q> {
    sqlx::query(statement).bind(fence.key()).bind(fence.epoch())
}

/// The number of jobs at the front that can share a statement.
fn leading_commits(group: &VecDeque<StudyJob>) -> usize {
    let mut batch = Batch::default();
    let mut count = 0;
    for job in group {
        match job {
            StudyJob::Change(ChangeJob { fence, change: StudyChange::Commit(rows), .. })
                if fence.holds() && batch.add(fence, rows) =>
            {
                count += 1;
            }
            _ => break,
        }
    }
    count
}

enum Class {
    Again,
    Rule,
    Refusal,
    Gone,
}

/// By SQLSTATE; see the appendix "PostgreSQL Error Codes" of its manual.
fn class(error: &dyn sqlx::error::DatabaseError) -> Class {
    let code = error.code().unwrap_or_default();
    match (code.get(..2), &*code) {
        (Some("40"), _) => Class::Again,
        (Some("22" | "23"), _) => Class::Rule,
        // The server ends, or ended this session.
        (_, "57P01" | "57P02" | "57P03" | "57P05") => Class::Gone,
        _ => Class::Refusal,
    }
}
