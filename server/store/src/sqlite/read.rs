//! The questions that only read, and the creation and naming of studies.

use sqlx::sqlite::{SqliteConnection, SqlitePool};

use super::codes::refused;
use super::{statements as sql, store_error};

fn failed(error: sqlx::Error) -> StoreError {
    store_error(&error)
}

crate::read::reads!(SqliteConnection);

pub(super) async fn studies_with_due_leases(readers: &SqlitePool, now_ms: i64) -> Result<Vec<String>> {
    sqlx::query_scalar(sql::STUDIES_WITH_DUE_LEASES).bind(now_ms).fetch_all(readers).await.map_err(failed)
}

#[cfg(test)]
mod tests {
    use sqlx::Connection as _;

    use super::*;

    #[tokio::test]
    async fn of_too_many_former_names_one_row_stands_for_the_lowest() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.expect("a database");
        crate::migrations::sqlite().run(&mut connection).await.expect("the schema");
        let mut listed = async |names: &[(&str, i64)], limit: u32| -> Vec<(String, i64)> {
            for (name, last) in names {
                let row = sqlx::query("INSERT INTO former_names VALUES ($1, $2)").bind(*name).bind(*last);
                row.execute(&mut connection).await.expect("a row");
            }
            fold_names(&mut connection, limit).await.expect("folded");
            let rows = sqlx::query_as("SELECT name, last_trial FROM former_names ORDER BY last_trial, name");
            rows.fetch_all(&mut connection).await.expect("rows")
        };
        let own = |rows: &[(&str, i64)]| {
            rows.iter().map(|(name, last)| ((*name).to_owned(), *last)).collect::<Vec<_>>()
        };
        let few = [("a", 4), ("b", 9), ("c", 2)];
        assert_eq!(listed(&few, 3).await, own(&[("c", 2), ("a", 4), ("b", 9)]));
        assert_eq!(listed(&[("d", 7), ("e", 3)], 3).await, own(&[("", 3), ("a", 4), ("d", 7), ("b", 9)]));
        assert_eq!(listed(&[("f", 8)], 2).await, own(&[("", 7), ("f", 8), ("b", 9)]), "the floor rises");
    }
}
