//! SQLite's view of an error: its words, its result code, and its meaning for a write.

use crate::error::StoreError;
use crate::rows::inconsistent;

/// SQLite's words, without those of sqlx.
pub(crate) fn message(error: &sqlx::Error) -> String {
    match error.as_database_error() {
        Some(database) => database.message().to_owned(),
        None => error.to_string(),
    }
}

/// The low byte of SQLite's extended result code.
pub(crate) fn primary_code(error: &sqlx::Error) -> Option<i32> {
    let code = error.as_database_error()?.code()?;
    code.parse::<i32>().ok().map(|code| code & 0xff)
}

/// A broken constraint is a defect of this program; any other error is the database's.
pub(super) fn refused(error: sqlx::Error) -> StoreError {
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
