//! The questions that only read.

use sqlx::sqlite::{SqliteConnection, SqlitePool};
use tokio_stream::StreamExt as _;
use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{Checkpoint, Snapshot, StateRecord, Statistics};

use super::rows::{StateRow, TrialRow, VisitRow, inconsistent, into_specification, signed, unsigned};
use super::{filter, statements as sql, store_error};
use crate::error::StoreError;
use crate::fence::Fence;
use crate::store::{Loaded, StudyRecord, TrialPage, TrialQuery};

#[derive(sqlx::FromRow)]
struct StudyRow {
    name: String,
    specification: String,
    policy: String,
    create_ms: i64,
    models_since: i64,
    states: i64,
    trials: i64,
    completed_trials: i64,
    open_trials: i64,
}

impl StudyRow {
    fn into_record(self) -> Result<StudyRecord, StoreError> {
        Ok(StudyRecord {
            id: self.name,
            spec: into_specification(&self.specification, &self.policy)?,
            create_ms: self.create_ms,
            statistics: Statistics {
                states: unsigned(self.states)?,
                trials: unsigned(self.trials)?,
                completed_trials: unsigned(self.completed_trials)?,
                open_trials: unsigned(self.open_trials)?,
            },
        })
    }
}

fn failed(error: sqlx::Error) -> StoreError {
    store_error(&error)
}

fn study_not_found(study: &str) -> StoreError {
    StoreError::StudyNotFound { study: study.to_owned() }
}

/// The key of a study.
pub(super) async fn study_key(connection: &mut SqliteConnection, study: &str) -> Result<i64, StoreError> {
    sqlx::query_scalar(sql::STUDY_KEY)
        .bind(study)
        .fetch_optional(connection)
        .await
        .map_err(failed)?
        .ok_or_else(|| study_not_found(study))
}

pub(super) async fn study(connection: &mut SqliteConnection, study: &str) -> Result<StudyRecord, StoreError> {
    let row: Option<StudyRow> =
        sqlx::query_as(sql::STUDY_BY_NAME).bind(study).fetch_optional(connection).await.map_err(failed)?;
    row.ok_or_else(|| study_not_found(study))?.into_record()
}

pub(super) async fn studies(
    readers: &SqlitePool,
    after: Option<&str>,
    size: u32,
) -> Result<Vec<StudyRecord>, StoreError> {
    let rows: Vec<StudyRow> = sqlx::query_as(sql::STUDY_PAGE)
        .bind(after.unwrap_or_default())
        .bind(i64::from(size))
        .fetch_all(readers)
        .await
        .map_err(failed)?;
    rows.into_iter().map(StudyRow::into_record).collect()
}

/// Reads all of a study but its closed trials. The fence keeps others from changing it meanwhile.
pub(super) async fn load(connection: &mut SqliteConnection, fence: Fence) -> Result<Loaded, StoreError> {
    let key = fence.key();
    let row: Option<StudyRow> =
        sqlx::query_as(sql::STUDY_BY_KEY).bind(key).fetch_optional(&mut *connection).await.map_err(failed)?;
    let row = row.ok_or_else(|| study_not_found(fence.study()))?;
    let models_since = unsigned(row.models_since)?;
    let study = row.into_record()?;
    let visits: Vec<VisitRow> =
        sqlx::query_as(sql::VISITS_OF_STUDY).bind(key).fetch_all(&mut *connection).await.map_err(failed)?;
    let open: Vec<TrialRow> =
        sqlx::query_as(sql::OPEN_TRIALS).bind(key).fetch_all(&mut *connection).await.map_err(failed)?;

    let space = &study.spec.space;
    let misfit = |error| inconsistent(format!("a configuration does not fit its study: {error}"));
    let open_trials = open
        .into_iter()
        .map(|row| row.into_trial()?.check(space).map_err(misfit))
        .collect::<Result<Vec<Trial>, _>>()?;
    let snapshot = Snapshot {
        states: states(connection, key).await?,
        visits: visits
            .into_iter()
            .map(|row| row.into_visit()?.check(space).map_err(misfit))
            .collect::<Result<_, _>>()?,
        last_trial: study.statistics.trials,
        models_since,
    };
    let checkpoint = checkpoint(connection, key).await?;
    Ok(Loaded { fence, snapshot, open_trials, checkpoint, study })
}

/// Row by row, since a study may have a million of them.
async fn states(connection: &mut SqliteConnection, key: i64) -> Result<Vec<StateRecord>, StoreError> {
    let mut rows = sqlx::query_as::<_, StateRow>(sql::STATES_OF_STUDY).bind(key).fetch(connection);
    let mut states = Vec::new();
    while let Some(row) = rows.next().await {
        states.push(row.map_err(failed)?.into_state()?);
    }
    Ok(states)
}

async fn checkpoint(connection: &mut SqliteConnection, key: i64) -> Result<Option<Checkpoint>, StoreError> {
    let latest: Option<i64> = sqlx::query_scalar(sql::CHECKPOINT)
        .bind(key)
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed)?;
    let Some(completion) = latest else {
        return Ok(None);
    };
    let parts: Vec<Vec<u8>> = sqlx::query_scalar(sql::CHECKPOINT_PARTS)
        .bind(key)
        .bind(completion)
        .fetch_all(connection)
        .await
        .map_err(failed)?;
    Ok(Some(Checkpoint { completion: unsigned(completion)?, bytes: parts.concat() }))
}

/// Reads completed trials behind a place in their order.
pub(super) async fn completed(
    connection: &mut SqliteConnection,
    fence: &Fence,
    after: u64,
    size: u32,
) -> Result<Vec<RawTrial>, StoreError> {
    let rows: Vec<TrialRow> = sqlx::query_as(sql::COMPLETED_TRIALS)
        .bind(fence.key())
        .bind(signed(after)?)
        .bind(i64::from(size))
        .fetch_all(connection)
        .await
        .map_err(failed)?;
    rows.into_iter().map(TrialRow::into_trial).collect()
}

pub(super) async fn trial(
    connection: &mut SqliteConnection,
    study: &str,
    number: u64,
) -> Result<RawTrial, StoreError> {
    let key = study_key(&mut *connection, study).await?;
    let not_found = || StoreError::TrialNotFound { study: study.to_owned(), number };
    let row: Option<TrialRow> = sqlx::query_as(sql::TRIAL_BY_NUMBER)
        .bind(key)
        // A number that the column cannot hold is a number that no trial has.
        .bind(signed(number).map_err(|_| not_found())?)
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed)?;
    row.ok_or_else(not_found)?.into_trial()
}

pub(super) async fn trials(
    connection: &mut SqliteConnection,
    study: &str,
    query: &TrialQuery,
) -> Result<TrialPage, StoreError> {
    let key = study_key(&mut *connection, study).await?;
    let rows: Vec<TrialRow> =
        filter::trial_page(key, query)?.build_query_as().fetch_all(&mut *connection).await.map_err(failed)?;
    let more = rows.len() > query.size as usize;
    let trials = rows
        .into_iter()
        .take(query.size as usize)
        .map(TrialRow::into_trial)
        .collect::<Result<Vec<RawTrial>, _>>()?;
    let next = trials.last().filter(|_| more).map(|last| query.order.place(last));
    Ok(TrialPage { trials, next })
}

pub(super) async fn studies_with_due_leases(
    readers: &SqlitePool,
    now_ms: i64,
) -> Result<Vec<String>, StoreError> {
    sqlx::query_scalar(sql::STUDIES_WITH_DUE_LEASES).bind(now_ms).fetch_all(readers).await.map_err(failed)
}
