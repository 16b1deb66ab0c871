//! The questions that only read.

use sqlx::sqlite::{SqliteConnection, SqlitePool};
use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{Snapshot, Statistics};

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

/// Reads all of a study. The fence keeps others from changing it meanwhile.
pub(super) async fn load(connection: &mut SqliteConnection, fence: Fence) -> Result<Loaded, StoreError> {
    let key = fence.key();
    let row: Option<StudyRow> =
        sqlx::query_as(sql::STUDY_BY_KEY).bind(key).fetch_optional(&mut *connection).await.map_err(failed)?;
    let study = row.ok_or_else(|| study_not_found(fence.study()))?.into_record()?;
    let states: Vec<StateRow> =
        sqlx::query_as(sql::STATES_OF_STUDY).bind(key).fetch_all(&mut *connection).await.map_err(failed)?;
    let visits: Vec<VisitRow> =
        sqlx::query_as(sql::VISITS_OF_STUDY).bind(key).fetch_all(&mut *connection).await.map_err(failed)?;
    let mut rows: Vec<TrialRow> =
        sqlx::query_as(sql::OPEN_TRIALS).bind(key).fetch_all(&mut *connection).await.map_err(failed)?;
    let completed: Vec<TrialRow> =
        sqlx::query_as(sql::COMPLETED_TRIALS).bind(key).fetch_all(&mut *connection).await.map_err(failed)?;
    rows.extend(completed);
    let last_trial: i64 =
        sqlx::query_scalar(sql::LAST_TRIAL).bind(key).fetch_one(&mut *connection).await.map_err(failed)?;

    let space = &study.spec.space;
    let misfit = |error| inconsistent(format!("a configuration does not fit its study: {error}"));
    let trials = rows
        .into_iter()
        .map(|row| row.into_trial()?.check(space).map_err(misfit))
        .collect::<Result<Vec<Trial>, _>>()?;
    let snapshot = Snapshot {
        states: states.into_iter().map(StateRow::into_state).collect::<Result<_, _>>()?,
        visits: visits
            .into_iter()
            .map(|row| row.into_visit()?.check(space).map_err(misfit))
            .collect::<Result<_, _>>()?,
        last_trial: unsigned(last_trial)?,
    };
    Ok(Loaded { fence, snapshot, trials, study })
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
