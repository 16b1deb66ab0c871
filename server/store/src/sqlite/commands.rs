//! What each write does inside the transaction that the writer has opened.

use sqlx::sqlite::SqliteConnection;
use treewright_core::study::StudySpec;

use super::read;
use super::rows::{self, Rows, StateRow, TrialRow, VisitRow, inconsistent};
use super::statements as sql;
use super::writer::{Command, Done, Fences};
use crate::error::StoreError;
use crate::fence::Fence;
use crate::limits;
use crate::store::Created;

pub(super) async fn apply(
    connection: &mut SqliteConnection,
    fences: &mut Fences,
    command: &Command,
) -> Result<Done, StoreError> {
    match command {
        Command::Create { id, spec, now_ms } => {
            create(connection, id, spec, *now_ms).await.map(|created| Done::Created(Box::new(created)))
        }
        Command::Delete { study } => {
            let key = read::study_key(&mut *connection, study).await?;
            if let Some(fence) = fences.remove(&key) {
                fence.break_up();
            }
            sqlx::query(sql::STUDY_DELETE).bind(key).execute(connection).await.map_err(refused)?;
            Ok(Done::Nothing)
        }
        Command::Fence { study } => {
            let key = read::study_key(&mut *connection, study).await?;
            let fence = Fence::new(study, key);
            if let Some(earlier) = fences.insert(key, fence.clone()) {
                earlier.break_up();
            }
            Ok(Done::Fenced(fence))
        }
        Command::Policy { fence, policy } => {
            fence.check()?;
            sqlx::query(sql::POLICY_UPDATE)
                .bind(fence.key())
                .bind(policy)
                .execute(connection)
                .await
                .map_err(refused)?;
            Ok(Done::Nothing)
        }
        Command::Commit { fence, rows } => {
            fence.check()?;
            store(connection, fence.key(), rows).await?;
            Ok(Done::Nothing)
        }
    }
}

async fn create(
    connection: &mut SqliteConnection,
    id: &str,
    spec: &StudySpec,
    now_ms: i64,
) -> Result<Created, StoreError> {
    match read::study(&mut *connection, id).await {
        Ok(stored) => {
            return match stored.spec.first_difference(spec) {
                None => Ok(Created { study: stored, is_new: false }),
                Some(difference) => Err(StoreError::StudyExists { study: id.to_owned(), difference }),
            };
        }
        Err(StoreError::StudyNotFound { .. }) => {}
        Err(error) => return Err(error),
    }
    let count: i64 =
        sqlx::query_scalar(sql::STUDY_COUNT).fetch_one(&mut *connection).await.map_err(refused)?;
    if count >= i64::from(limits::STUDIES) {
        return Err(StoreError::TooManyStudies { limit: limits::STUDIES });
    }
    let (specification, policy) = rows::specification(spec)?;
    sqlx::query(sql::STUDY_INSERT)
        .bind(id)
        .bind(specification)
        .bind(policy)
        .bind(now_ms)
        .execute(&mut *connection)
        .await
        .map_err(refused)?;
    Ok(Created { study: read::study(connection, id).await?, is_new: true })
}

/// States first: visits and trials refer to them.
async fn store(connection: &mut SqliteConnection, study: i64, rows: &Rows) -> Result<(), StoreError> {
    for state in &rows.states {
        put_state(&mut *connection, study, state).await.map_err(refused)?;
    }
    for visit in &rows.visits {
        put_visit(&mut *connection, study, visit).await.map_err(refused)?;
    }
    for trial in &rows.trials {
        put_trial(&mut *connection, study, trial).await.map_err(refused)?;
    }
    Ok(())
}

async fn put_state(connection: &mut SqliteConnection, study: i64, row: &StateRow) -> Result<(), sqlx::Error> {
    let query =
        sqlx::query(sql::STATE_UPSERT).bind(study).bind(row.id).bind(&row.indicators).bind(&row.search);
    query.execute(connection).await.map(|_| ())
}

async fn put_visit(connection: &mut SqliteConnection, study: i64, row: &VisitRow) -> Result<(), sqlx::Error> {
    let query = sqlx::query(sql::VISIT_UPSERT)
        .bind(study)
        .bind(&row.client_id)
        .bind(row.state_id)
        .bind(row.number)
        .bind(&row.decision);
    query.execute(connection).await.map(|_| ())
}

/// Binds in the order of [`TRIAL_COLUMNS`](sql::TRIAL_COLUMNS).
async fn put_trial(connection: &mut SqliteConnection, study: i64, row: &TrialRow) -> Result<(), sqlx::Error> {
    let query = sqlx::query(sql::TRIAL_UPSERT)
        .bind(study)
        .bind(row.number)
        .bind(&row.client_id)
        .bind(row.state_id)
        .bind(&row.mode)
        .bind(&row.state)
        .bind(&row.outcome)
        .bind(&row.outcome_reason)
        .bind(row.outcome_lower_bound)
        .bind(row.cost)
        .bind(row.predicted_cost)
        .bind(row.late)
        .bind(row.create_ms)
        .bind(row.lease_expire_ms)
        .bind(row.complete_ms)
        .bind(row.completion)
        .bind(&row.configuration)
        .bind(&row.indicators)
        .bind(&row.measurements)
        .bind(&row.reason)
        .bind(&row.fingerprint);
    query.execute(connection).await.map(|_| ())
}

/// A constraint that a write breaks is a defect of the writer's; anything else is the database's trouble.
fn refused(error: sqlx::Error) -> StoreError {
    use sqlx::error::ErrorKind;
    match error.as_database_error() {
        Some(database) if database.kind() != ErrorKind::Other => inconsistent(database.message().to_owned()),
        // A trigger's RAISE(ABORT) is SQLITE_CONSTRAINT_TRIGGER, which sqlx does not name.
        Some(database) if database.code().as_deref() == Some("1811") => {
            inconsistent(database.message().to_owned())
        }
        _ => super::store_error(&error),
    }
}
