//! A copy of a database while a daemon runs.
//!
//! `VACUUM INTO` reads one snapshot and writes all of it to a new file. The copy holds all changes that were
//! acknowledged before it began and no later ones, and writes go on meanwhile
//! (<https://sqlite.org/lang_vacuum.html>). SQLite does not sync the copy, so it is made durable here. Then
//! it is checked, and only then gets its name.

use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

use sqlx::Connection as _;
use sqlx::sqlite::SqliteConnection;

use super::files::{self, PartialFile};
use super::{Inventory, MaintenanceError, check_closed, connect, schema_version};
use crate::sqlite::file;

/// Writes a copy of `database` to the file `to`, which may exist only if it is to be replaced. Meanwhile the
/// database's write-ahead log cannot be folded, and grows with every write.
///
/// # Errors
/// [`MaintenanceError`]; then `to` is as it was.
pub async fn back_up(database: &Path, to: &Path, replace: bool) -> Result<Inventory, MaintenanceError> {
    files::need(database)?;
    file::check_name(to)?;
    if to.is_dir() {
        files::need(to)?;
    }
    if files::are_same(database, to) {
        return Err(MaintenanceError::Same(to.to_owned()));
    }
    if to.exists() && !replace {
        return Err(MaintenanceError::Exists(to.to_owned()));
    }
    if files::has_log(to) {
        return Err(MaintenanceError::Log { path: to.to_owned(), log: files::beside(to, "-wal") });
    }
    let mut source = connect(database).await?;
    schema_version(&mut source, database).await?;
    let draft = PartialFile::beside(to, database)?;
    // SQLite takes no absolute path for a URI.
    let absolute =
        std::path::absolute(draft.path()).map_err(MaintenanceError::system(draft.path(), "written"))?;
    let name =
        std::str::from_utf8(absolute.as_os_str().as_bytes()).map_err(|_| MaintenanceError::System {
            path: to.to_owned(),
            doing: "written",
            problem: "SQLite needs a name in UTF-8".to_owned(),
        })?;
    let written = write(&mut source, name).await;
    written.map_err(|error| MaintenanceError::System {
        path: to.to_owned(),
        doing: "written",
        problem: file::message(&error),
    })?;
    source.close().await.map_err(|error| MaintenanceError::sqlite(database, &error))?;
    draft.sync()?;
    let inventory = check_closed(draft.path()).await?;
    match replace {
        true => draft.keep_as(to)?,
        false => draft.keep_as_new(to)?,
    }
    Ok(inventory)
}

async fn write(source: &mut SqliteConnection, to: &str) -> Result<(), sqlx::Error> {
    let shrinks: i64 = sqlx::query_scalar("PRAGMA auto_vacuum").fetch_one(&mut *source).await?;
    if shrinks == 0 {
        // Files of early versions cannot shrink, but their copies can; the source stays as it is.
        sqlx::query("PRAGMA auto_vacuum = INCREMENTAL").execute(&mut *source).await?;
    }
    sqlx::query("VACUUM INTO $1").bind(to).execute(source).await.map(|_| ())
}
