//! The questions that only read.

use sqlx::sqlite::{SqliteConnection, SqlitePool};

use super::{filter, statements as sql, store_error};

fn failed(error: sqlx::Error) -> StoreError {
    store_error(&error)
}

crate::read::reads!(SqliteConnection);

pub(super) async fn studies_with_due_leases(
    readers: &SqlitePool,
    now_ms: i64,
) -> Result<Vec<String>, StoreError> {
    sqlx::query_scalar(sql::STUDIES_WITH_DUE_LEASES).bind(now_ms).fetch_all(readers).await.map_err(failed)
}
