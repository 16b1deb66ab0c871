//! Removing the rows of deleted studies, a piece at a time.
//!
//! Deleting a study of 100,000 trials takes half a second, and every other write would have to wait. So
//! deleting only gives the study a name that cannot be requested, which is one small write. Its rows are
//! removed afterwards, in pieces between the other writes, also after a restart.

use sqlx::sqlite::SqliteConnection;

use super::statements as sql;
use crate::limits::{REAPED_PARTS_SQLITE, REAPED_ROWS_SQLITE};
use crate::rows::one_at_most;

/// Removes a piece of a deleted study, in a transaction of its own; false when there is none.
pub(super) async fn reap(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    let found: Option<i64> = sqlx::query_scalar(sql::DELETED_STUDY).fetch_optional(&mut *connection).await?;
    let Some(study) = found else {
        return Ok(false);
    };
    // Referring rows are removed first.
    for (statement, rows) in [
        (sql::REAP_TRIALS, REAPED_ROWS_SQLITE),
        (sql::REAP_VISITS, REAPED_ROWS_SQLITE),
        (sql::REAP_STATES, REAPED_ROWS_SQLITE),
        (sql::REAP_CHECKPOINTS, REAPED_PARTS_SQLITE),
    ] {
        let removed = sqlx::query(statement).bind(study).bind(rows).execute(&mut *connection);
        if removed.await?.rows_affected() > 0 {
            return Ok(true);
        }
    }
    one_at_most(sqlx::query(sql::REAP_STUDY).bind(study).execute(connection).await?.rows_affected());
    Ok(true)
}

#[cfg(test)]
mod tests {
    use sqlx::Connection as _;

    use super::*;

    async fn parts(connection: &mut SqliteConnection) -> i64 {
        let count = sqlx::query_scalar("SELECT count(*) FROM checkpoints").fetch_one(connection);
        count.await.expect("a count")
    }

    #[tokio::test]
    async fn parts_of_checkpoints_are_removed_a_few_at_a_time() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.expect("a database");
        crate::migrations::sqlite().run(&mut connection).await.expect("the schema");
        let study = "INSERT INTO studies (id, name, specification, policy, create_ms) \
                     VALUES (1, '~1', '{}', '{}', 0)";
        sqlx::query(study).execute(&mut connection).await.expect("a deleted study");
        for completion in 1..=3_i64 {
            for part in 0..3_i64 {
                let row = sqlx::query("INSERT INTO checkpoints VALUES (1, $1, $2, 3, x'00')");
                row.bind(completion).bind(part).execute(&mut connection).await.expect("a part");
            }
        }
        assert!(reap(&mut connection).await.expect("a piece"));
        assert_eq!(parts(&mut connection).await, 9 - i64::from(REAPED_PARTS_SQLITE));
        while reap(&mut connection).await.expect("a piece") {}
        assert_eq!(parts(&mut connection).await, 0);
    }
}
