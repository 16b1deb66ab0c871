//! The write commands, and the work of each inside the transaction that the writer has opened.

use std::collections::HashMap;

use sqlx::AssertSqlSafe;
use sqlx::sqlite::SqliteConnection;
use treewright_core::ids::StudyUid;
use treewright_core::study::StudySpec;
use treewright_core::tuner::StudyCounts;

use super::codes::refused;
use super::statements as sql;
use super::{read, script};
use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::limits;
use crate::rows::{self, StudyChange, one_at_most};
use crate::store::Created;

pub(super) enum WriteCommand {
    Create { id: String, spec: Box<StudySpec>, now_ms: i64 },
    Delete { study: String, uid: Option<StudyUid> },
    Rename { study: String, uid: Option<StudyUid>, to: String },
    // Breaks the study's fence and sets up a new one.
    Fence { study: String },
    Change { fence: Fence, change: StudyChange },
    // Removes closed trials: a JSON list of numbers. Its failure breaks no fence.
    Remove { fence: Fence, numbers: String, covered: i64 },
}

pub(super) enum WriteResult {
    Nothing,
    Created(Box<Created>),
    Fenced(Fence),
    Removed(u64),
}

/// The fence in force for each study, by key.
pub(super) type GroupFences = HashMap<i64, Fence>;

pub(super) async fn apply(
    connection: &mut SqliteConnection,
    fences: &mut GroupFences,
    command: &WriteCommand,
) -> Result<WriteResult> {
    match command {
        WriteCommand::Create { id, spec, now_ms } => {
            let created = read::create(connection, id, spec, *now_ms).await?;
            debug_assert!(
                !created.is_new || created.study.statistics == StudyCounts::default(),
                "a new study holds rows of another"
            );
            Ok(WriteResult::Created(Box::new(created)))
        }
        WriteCommand::Delete { study, uid } => {
            let key = read::lock(connection, study, *uid).await?;
            break_up(fences, key);
            read::leave_name(connection, key).await?;
            let done = sqlx::query(sql::STUDY_DELETE).bind(key).execute(connection).await.map_err(refused)?;
            one_at_most(done.rows_affected());
            Ok(WriteResult::Nothing)
        }
        WriteCommand::Rename { study, uid, to } => {
            if let Some(key) = rename(connection, (study.as_str(), *uid), to).await? {
                break_up(fences, key);
            }
            Ok(WriteResult::Nothing)
        }
        WriteCommand::Fence { study } => {
            let key = read::study_key(&mut *connection, study).await?;
            let fence = Fence::new(study, key);
            if let Some(earlier) = fences.insert(key, fence.clone()) {
                earlier.break_up();
            }
            Ok(WriteResult::Fenced(fence))
        }
        WriteCommand::Change { fence, change } => {
            check_in_force(fences, fence)?;
            change_study(connection, fence, change).await?;
            Ok(WriteResult::Nothing)
        }
        WriteCommand::Remove { fence, numbers, covered } => {
            fence.check()?;
            remove(connection, fence.key(), numbers, *covered)
                .await
                .map(WriteResult::Removed)
                .map_err(refused)
        }
    }
}

async fn change_study(connection: &mut SqliteConnection, fence: &Fence, change: &StudyChange) -> Result<()> {
    let study = fence.key();
    match change {
        StudyChange::Commit(rows) => {
            let stored = script::rows(study, rows).execute(connection).await;
            stored.map(|_| ()).map_err(|error| refused(error).in_study(fence.study()))
        }
        StudyChange::Study { specification, policy, models_since } => {
            let update = sqlx::query(sql::STUDY_UPDATE).bind(study).bind(specification).bind(policy);
            let update = update.bind(*models_since).execute(connection);
            one_at_most(update.await.map_err(refused)?.rows_affected());
            Ok(())
        }
        StudyChange::Space { specification, policy } => {
            change_space(connection, study, specification, policy).await.map_err(refused)
        }
        StudyChange::Exclude { number, reason } => {
            exclude(connection, fence, *number, reason.as_deref()).await
        }
        StudyChange::Part(row) => save_part(connection, study, row).await.map_err(refused),
    }
}

/// Whether a fence that holds is the one that the last load of its study set up.
pub(super) fn is_in_force(fences: &GroupFences, fence: &Fence) -> bool {
    fences.get(&fence.key()).is_some_and(|last| last.is_same(fence))
}

/// Checks that a fence holds, which then is the one in force.
fn check_in_force(fences: &GroupFences, fence: &Fence) -> Result<()> {
    fence.check()?;
    debug_assert!(is_in_force(fences, fence), "two fences of {} hold", fence.study());
    Ok(())
}

/// Breaks the fence in force for a study, if there is one.
fn break_up(fences: &mut GroupFences, study: i64) {
    if let Some(fence) = fences.remove(&study) {
        fence.break_up();
    }
}

/// Gives a study another name, and returns its key; none where it has that name.
async fn rename(
    connection: &mut SqliteConnection,
    (study, uid): (&str, Option<StudyUid>),
    to: &str,
) -> Result<Option<i64>> {
    let key = read::lock(&mut *connection, study, uid).await?;
    if study == to {
        return Ok(None);
    }
    match read::study_key(&mut *connection, to).await {
        Ok(_) => return Err(StoreError::NameTaken(to.to_owned())),
        Err(StoreError::StudyNotFound { .. }) => {}
        Err(error) => return Err(error),
    }
    read::leave_name(&mut *connection, key).await?;
    let renaming = sqlx::query(sql::STUDY_RENAME).bind(key).bind(to).execute(connection);
    one_at_most(renaming.await.map_err(refused)?.rows_affected());
    Ok(Some(key))
}

/// Changes the space of a study, and removes what is of the earlier one.
async fn change_space(
    connection: &mut SqliteConnection,
    study: i64,
    specification: &str,
    policy: &str,
) -> Result<(), sqlx::Error> {
    let changing = sqlx::query(sql::SPACE_UPDATE).bind(study).bind(specification).bind(policy);
    one_at_most(changing.execute(&mut *connection).await?.rows_affected());
    for removal in [sql::SEARCHES_DELETE, sql::CHECKPOINTS_DELETE] {
        sqlx::query(removal).bind(study).execute(&mut *connection).await?;
    }
    Ok(())
}

/// Notes whether a completed trial counts, and removes the checkpoint, which rests on other trials.
async fn exclude(
    connection: &mut SqliteConnection,
    fence: &Fence,
    number: i64,
    reason: Option<&str>,
) -> Result<()> {
    let excluding = sqlx::query(sql::TRIAL_EXCLUDE).bind(fence.key()).bind(number).bind(reason);
    let excluded = excluding.execute(&mut *connection).await.map_err(refused)?.rows_affected();
    one_at_most(excluded);
    if excluded == 0 {
        let number = rows::unsigned(number)?;
        return Err(StoreError::TrialNotFound { study: fence.study().to_owned(), number });
    }
    let dropping = sqlx::query(sql::CHECKPOINTS_DELETE).bind(fence.key()).execute(connection);
    dropping.await.map(|_| ()).map_err(refused)
}

/// Saves a part of a checkpoint. The last part removes earlier checkpoints and the parts that a crash left.
async fn save_part(
    connection: &mut SqliteConnection,
    study: i64,
    row: &rows::PartRow,
) -> Result<(), sqlx::Error> {
    assert!((0..row.parts).contains(&row.part), "part {} of {}", row.part, row.parts);
    let saving = sqlx::query(sql::PART_UPSERT).bind(study).bind(row.completion).bind(row.part);
    let saved = saving.bind(row.parts).bind(&row.bytes).execute(&mut *connection).await?;
    one_at_most(saved.rows_affected());
    if row.part + 1 == row.parts {
        let removing = sqlx::query(sql::OTHER_CHECKPOINTS_DELETE).bind(study).bind(row.completion);
        removing.bind(row.parts).execute(connection).await?;
    }
    Ok(())
}

/// Removes closed trials, and gives pages back to the system where many are free. Some stay free, so that a
/// file need not shrink and grow again and again.
async fn remove(
    connection: &mut SqliteConnection,
    study: i64,
    numbers: &str,
    covered: i64,
) -> Result<u64, sqlx::Error> {
    let removed = sqlx::query(sql::TRIALS_DELETE).bind(study).bind(numbers).bind(covered);
    let removed = removed.execute(&mut *connection).await?;
    let (free, all): (i64, i64) = sqlx::query_as(sql::PAGES).fetch_one(&mut *connection).await?;
    let spare = limits::PAGES_KEPT_FREE.max(all / 8);
    if free > spare {
        let pages = (free - spare).min(limits::PAGES_FREED);
        let shrink = format!("PRAGMA incremental_vacuum({pages})");
        // It gives back one page a step, so it is done when it yields nothing more.
        sqlx::query(AssertSqlSafe(shrink)).fetch_all(connection).await?;
    }
    Ok(removed.rows_affected())
}
