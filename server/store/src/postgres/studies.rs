//! Operations on whole studies: deleting and renaming one, and sweeping due leases in all of them.

use sqlx::postgres::PgConnection;
use treewright_core::ids::StudyUid;

use super::{failed, read, statements as sql};
use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::limits;
use crate::read::ask;
use crate::rows::{one_at_most, signed, unsigned};

/// Makes a study unfindable, and returns its key. [`reap`] removes its rows.
pub(super) async fn delete(connection: &mut PgConnection, study: &str, uid: Option<StudyUid>) -> Result<i64> {
    let mut transaction = sqlx::Connection::begin(connection).await.map_err(failed)?;
    let key = read::lock(&mut transaction, study, uid).await?;
    read::leave_name(&mut transaction, key).await?;
    let done = sqlx::query(sql::STUDY_DELETE).bind(key).execute(&mut *transaction).await.map_err(failed)?;
    one_at_most(done.rows_affected());
    transaction.commit().await.map_err(failed)?;
    Ok(key)
}

/// Gives a study another name, and returns its key.
pub(super) async fn rename(
    connection: &mut PgConnection,
    study: &str,
    uid: Option<StudyUid>,
    to: &str,
) -> Result<i64> {
    if study == to {
        return read::lock(connection, study, uid).await;
    }
    let mut transaction = sqlx::Connection::begin(connection).await.map_err(failed)?;
    let key = read::lock(&mut transaction, study, uid).await?;
    read::leave_name(&mut transaction, key).await?;
    let renamed = sqlx::query(sql::STUDY_RENAME).bind(key).bind(to).execute(&mut *transaction).await;
    let renamed = renamed.map_err(|error| match error.as_database_error() {
        Some(database) if database.is_unique_violation() => StoreError::NameTaken(to.to_owned()),
        _ => failed(error),
    })?;
    one_at_most(renamed.rows_affected());
    transaction.commit().await.map_err(failed)?;
    Ok(key)
}

/// Removes closed trials of a study, if its epoch still holds.
pub(super) async fn remove_trials(
    connection: &mut PgConnection,
    fence: &Fence,
    numbers: &[u64],
    covered: u64,
) -> Result<u64> {
    fence.check()?;
    let most = numbers.len() as i64;
    let numbers = numbers.iter().map(|number| signed(*number)).collect::<Result<Vec<i64>, _>>()?;
    let (key, epoch, covered) = (fence.key(), fence.epoch(), signed(covered)?);
    let (held, gone): (i64, i64) =
        ask!(query_as.fetch_one(connection, sql::TRIALS_DELETE, key, epoch, numbers, covered))?;
    assert!(held <= 1, "{held} studies have one key");
    assert!(gone <= most && (held == 1 || gone == 0), "{gone} trials were removed for {most} numbers");
    if held == 0 {
        return Err(StoreError::Fenced(fence.study().to_owned()));
    }
    unsigned(gone)
}

/// Removes a piece of a deleted study that no other replica works on; false when there is none.
pub(super) async fn reap(connection: &mut PgConnection) -> Result<bool, sqlx::Error> {
    let mut transaction = sqlx::Connection::begin(connection).await?;
    let found: Option<i64> = sqlx::query_scalar(sql::DELETED_STUDY).fetch_optional(&mut *transaction).await?;
    let Some(study) = found else {
        return Ok(false);
    };
    let most = limits::REAPED_ROWS;
    // Referring rows are removed first. The replica's heartbeat waits for the transaction, so that one that
    // removed all states of a large study at once would have the replica taken for dead.
    for statement in [sql::REAP_TRIALS, sql::REAP_VISITS, sql::REAP_STATES, sql::REAP_CHECKPOINTS] {
        let removing = sqlx::query(statement).bind(study).bind(i64::from(most)).execute(&mut *transaction);
        let removed = removing.await?.rows_affected();
        assert!(removed <= u64::from(most), "{removed} rows at once");
        if removed == u64::from(most) {
            transaction.commit().await?;
            return Ok(true);
        }
    }
    sqlx::query(sql::REAP_STUDY).bind(study).execute(&mut *transaction).await?;
    transaction.commit().await?;
    Ok(true)
}

/// The studies of replica `me` with leases that have run out, and those without a living owner, which `me`
/// takes over.
pub(super) async fn with_due_leases(
    connection: &mut PgConnection,
    me: i32,
    now_ms: i64,
) -> Result<Vec<String>> {
    let (lapse_s, most) = (limits::REPLICA_LAPSE.as_secs_f64(), i64::from(limits::SWEEP_STUDIES));
    let due: Vec<String> =
        ask!(query_scalar.fetch_all(connection, sql::STUDIES_WITH_DUE_LEASES, now_ms, me, lapse_s, most))?;
    // At most one sweep of studies without an owner, and one of its own.
    assert!(due.len() <= 2 * limits::SWEEP_STUDIES as usize, "{} studies in one sweep", due.len());
    Ok(due)
}
