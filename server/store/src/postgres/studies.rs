//! Operations on whole studies: creating and deleting one, and sweeping due leases in all of them.

use sqlx::postgres::PgConnection;
use treewright_core::ids::StudyUid;
use treewright_core::space::EarlierSpaces;
use treewright_core::study::StudySpec;

use super::{failed, read, statements as sql};
use crate::assembly::study_not_found;
use crate::error::StoreError;
use crate::fence::Fence;
use crate::limits;
use crate::rows::{self, one_at_most, signed, unsigned};
use crate::store::Created;

/// Creates a study, or finds an equal one. If two replicas try at once, one of them creates it, and both
/// compare the stored study.
pub(super) async fn create(
    connection: &mut PgConnection,
    id: &str,
    spec: &StudySpec,
    now_ms: i64,
) -> Result<Created, StoreError> {
    let mut is_new = false;
    let stored = match read::study(&mut *connection, id).await {
        Err(StoreError::StudyNotFound { .. }) => {
            let count: i64 =
                sqlx::query_scalar(sql::STUDY_COUNT).fetch_one(&mut *connection).await.map_err(failed)?;
            if count >= i64::from(limits::STUDIES) {
                return Err(StoreError::TooManyStudies { limit: limits::STUDIES });
            }
            let (specification, policy) = rows::specification(spec, &EarlierSpaces::default())?;
            let inserted = sqlx::query(sql::STUDY_INSERT)
                .bind(id)
                .bind(specification)
                .bind(policy)
                .bind(now_ms)
                .execute(&mut *connection)
                .await
                .map_err(failed)?;
            one_at_most(inserted.rows_affected());
            is_new = inserted.rows_affected() == 1;
            read::study(connection, id).await?
        }
        found => found?,
    };
    Ok(Created { is_new, ..stored.found(spec)? })
}

/// Makes a study unfindable, and returns its key. [`reap`] removes its rows.
pub(super) async fn delete(
    connection: &mut PgConnection,
    study: &str,
    uid: Option<StudyUid>,
) -> Result<i64, StoreError> {
    let mut transaction = sqlx::Connection::begin(connection).await.map_err(failed)?;
    let key = lock(&mut transaction, study, uid).await?;
    leave_name(&mut transaction, key).await.map_err(failed)?;
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
) -> Result<i64, StoreError> {
    if study == to {
        return lock(connection, study, uid).await;
    }
    let mut transaction = sqlx::Connection::begin(connection).await.map_err(failed)?;
    let key = lock(&mut transaction, study, uid).await?;
    leave_name(&mut transaction, key).await.map_err(failed)?;
    let renamed = sqlx::query(sql::STUDY_RENAME).bind(key).bind(to).execute(&mut *transaction).await;
    let renamed = renamed.map_err(|error| match error.as_database_error() {
        Some(database) if database.is_unique_violation() => StoreError::NameTaken { study: to.to_owned() },
        _ => failed(error),
    })?;
    one_at_most(renamed.rows_affected());
    transaction.commit().await.map_err(failed)?;
    Ok(key)
}

/// The key of a study that has the identity, where one is given. Until the end of the transaction no replica
/// stores its rows.
async fn lock(connection: &mut PgConnection, study: &str, uid: Option<StudyUid>) -> Result<i64, StoreError> {
    let question = sqlx::query_scalar(sql::STUDY_LOCK).bind(study).bind(uid.map(|uid| uid.to_string()));
    let key: Option<i64> = question.fetch_optional(connection).await.map_err(failed)?;
    key.ok_or_else(|| study_not_found(study))
}

/// Notes the last trial number of a study under the name that it is about to lose.
async fn leave_name(connection: &mut PgConnection, key: i64) -> Result<(), sqlx::Error> {
    let noted = sqlx::query(sql::NAME_LEFT).bind(key).execute(&mut *connection).await?;
    one_at_most(noted.rows_affected());
    let folding = sqlx::query(sql::NAMES_FOLDED).bind(i64::from(limits::FORMER_NAMES));
    one_at_most(folding.execute(&mut *connection).await?.rows_affected());
    sqlx::query(sql::FOLDED_NAMES_DELETE).execute(connection).await?;
    Ok(())
}

/// Removes closed trials of a study, if its epoch still holds.
pub(super) async fn remove_trials(
    connection: &mut PgConnection,
    fence: &Fence,
    numbers: &[u64],
    covered: u64,
) -> Result<u64, StoreError> {
    fence.check()?;
    let most = numbers.len() as i64;
    let numbers = numbers.iter().map(|number| signed(*number)).collect::<Result<Vec<i64>, _>>()?;
    let (held, gone): (i64, i64) = sqlx::query_as(sql::TRIALS_DELETE)
        .bind(fence.key())
        .bind(fence.epoch())
        .bind(numbers)
        .bind(signed(covered)?)
        .fetch_one(connection)
        .await
        .map_err(failed)?;
    assert!(held <= 1, "{held} studies have one key");
    assert!(gone <= most && (held == 1 || gone == 0), "{gone} trials were removed for {most} numbers");
    if held == 0 {
        return Err(StoreError::Fenced { study: fence.study().to_owned() });
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
) -> Result<Vec<String>, StoreError> {
    let due: Vec<String> = sqlx::query_scalar(sql::STUDIES_WITH_DUE_LEASES)
        .bind(now_ms)
        .bind(me)
        .bind(limits::REPLICA_LAPSE.as_secs_f64())
        .bind(i64::from(limits::SWEEP_STUDIES))
        .fetch_all(connection)
        .await
        .map_err(failed)?;
    // At most one sweep of studies without an owner, and one of its own.
    assert!(due.len() <= 2 * limits::SWEEP_STUDIES as usize, "{} studies in one sweep", due.len());
    Ok(due)
}
