//! Removing the rows of deleted studies, a piece at a time.
//!
//! Deleting a study of 100,000 trials takes half a second, and every other write would have to wait. So
//! deleting only gives the study a name that cannot be requested, which is one small write. Its rows are
//! removed afterwards, in pieces between the other writes, also after a restart.

use sqlx::sqlite::SqliteConnection;

use super::statements as sql;
use crate::limits::REAPED_ROWS_SQLITE;

/// Removes a piece of a deleted study, in a transaction of its own; false when there is none.
pub(super) async fn reap(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    let found: Option<i64> = sqlx::query_scalar(sql::DELETED_STUDY).fetch_optional(&mut *connection).await?;
    let Some(study) = found else {
        return Ok(false);
    };
    // Referring rows are removed first.
    for statement in [sql::REAP_TRIALS, sql::REAP_VISITS, sql::REAP_STATES, sql::REAP_CHECKPOINTS] {
        let removed = sqlx::query(statement).bind(study).bind(REAPED_ROWS_SQLITE).execute(&mut *connection);
        if removed.await?.rows_affected() > 0 {
            return Ok(true);
        }
    }
    let gone = sqlx::query(sql::REAP_STUDY).bind(study).execute(connection).await?.rows_affected();
    assert!(gone <= 1, "{gone} studies have the key {study}");
    Ok(true)
}
