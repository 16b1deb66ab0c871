//! Opening a database file: locks, settings, migrations, and clear errors.

use std::path::Path;

use sqlx::migrate::MigrateError;
use sqlx::sqlite::{
    SqliteAutoVacuum, SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePool,
    SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _};

use super::check::{self, Unsound};
use super::codes::{message, primary_code};
use super::lock::DatabaseLock;
use super::place;
use crate::error::OpenError;
use crate::{limits, migrations};

/// Marks a file as ours ("TWrt"), so that another program's database is not migrated by accident.
const APPLICATION_ID: i64 = 0x5457_7274;

pub(super) struct Opened {
    pub(super) lock: DatabaseLock,
    pub(super) writer: SqliteConnection,
    pub(super) readers: SqlitePool,
}

/// Opens or creates the file, and brings its schema up to date.
pub(super) async fn open(path: &Path) -> Result<Opened, OpenError> {
    place::check(path)?;
    place::check_names(path)?;
    let lock = DatabaseLock::take(path)?;
    place::make_private(path)?;
    place::warn_of_network(path);
    let options = options(path);
    inspect(path, &options).await?;

    let options = options.journal_mode(SqliteJournalMode::Wal);
    let mut making = options.clone();
    if std::fs::metadata(path).is_ok_and(|file| file.len() == 0) {
        // Pages that retention frees can then be given back to the system piece by piece. The setting only
        // works for a new file.
        making = making.auto_vacuum(SqliteAutoVacuum::Incremental);
    }
    let mut writer = SqliteConnection::connect_with(&making).await.map_err(|error| explain(path, &error))?;
    migrate(path, &mut writer).await?;
    look_at(path, &mut writer).await?;

    // All readers are opened now and kept, so that reads go on even while the file is moved away.
    let readers = SqlitePoolOptions::new()
        .min_connections(limits::READERS)
        .max_connections(limits::READERS)
        .idle_timeout(None)
        .max_lifetime(None)
        .acquire_timeout(limits::READER_TIMEOUT)
        .connect_with(options.create_if_missing(false).pragma("query_only", "ON"))
        .await
        .map_err(|error| explain(path, &error))?;
    let mut opened = Vec::new();
    for _ in 0..limits::READERS {
        opened.push(readers.acquire().await.map_err(|error| explain(path, &error))?);
    }
    debug_assert_eq!(readers.size(), limits::READERS, "all readers are open");
    drop(opened);
    Ok(Opened { lock, writer, readers })
}

/// A short check of the file: damage should show at the start, not at some client's request.
async fn look_at(path: &Path, writer: &mut SqliteConnection) -> Result<(), OpenError> {
    match check::at_start(writer).await {
        Ok(true) => Ok(()),
        Ok(false) => {
            tracing::info!(
                "the database is large and was checked in part only; `treewrightd check` looks at all of it"
            );
            Ok(())
        }
        Err(Unsound::Problems(problems)) => Err(OpenError::Damaged(path.to_owned(), in_words(&problems))),
        Err(Unsound::Unreadable(error)) => Err(explain(path, &error)),
    }
}

/// The first of many problems.
pub(crate) fn in_words(problems: &[String]) -> String {
    assert!(!problems.is_empty(), "a file is damaged for no reason");
    let first = problems.first().map_or("", |problem| problem.trim());
    match problems.len() {
        0 | 1 => first.to_owned(),
        more => format!("{first}; and {} more", more - 1),
    }
}

/// The options of every connection to the file.
pub(crate) fn options(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .foreign_keys(true)
        .busy_timeout(limits::BUSY_TIMEOUT)
        .disable_statement_logging()
        // A commit is on the disk when it returns: in WAL mode that takes FULL, not NORMAL.
        .synchronous(SqliteSynchronous::Full)
        // A write-ahead log that grew during a long read becomes small again.
        .pragma("journal_size_limit", limits::WAL_BYTES_KEPT.to_string())
}

/// Prepares a connection to a file that a daemon may have. Without a daemon, the schema is brought up to date
/// first.
pub(super) async fn beside(path: &Path) -> Result<SqliteConnectOptions, OpenError> {
    match open(path).await {
        Ok(Opened { lock, writer, readers }) => {
            readers.close().await;
            writer.close().await.map_err(|error| explain(path, &error))?;
            drop(lock);
        }
        Err(OpenError::InUse { .. }) => {}
        Err(other) => return Err(other),
    }
    Ok(options(path).create_if_missing(false))
}

/// Checks, before any change, that the file can be locked and is ours.
async fn inspect(path: &Path, options: &SqliteConnectOptions) -> Result<(), OpenError> {
    let explained = |error: sqlx::Error| explain(path, &error);
    let mut connection = SqliteConnection::connect_with(options).await.map_err(explained)?;
    // A foreign lock shows here, within the busy timeout, and not at the first client's request.
    for statement in ["BEGIN IMMEDIATE", "ROLLBACK"] {
        sqlx::query(statement).execute(&mut connection).await.map_err(explained)?;
    }
    if owner(&mut connection).await.map_err(explained)? == FileOwner::Foreign {
        return Err(OpenError::Foreign(path.to_owned()));
    }
    connection.close().await.map_err(explained)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileOwner {
    Ours,
    /// The file is empty.
    Nobody,
    Foreign,
}

pub(crate) async fn owner(connection: &mut SqliteConnection) -> Result<FileOwner, sqlx::Error> {
    let application: i64 = sqlx::query_scalar("PRAGMA application_id").fetch_one(&mut *connection).await?;
    let tables: i64 =
        sqlx::query_scalar("SELECT count(*) FROM sqlite_master").fetch_one(&mut *connection).await?;
    Ok(match (application, tables) {
        (APPLICATION_ID, _) => FileOwner::Ours,
        (0, 0) => FileOwner::Nobody,
        _ => FileOwner::Foreign,
    })
}

/// The newest schema version that this program knows.
pub(crate) fn known_version() -> i64 {
    migrations::sqlite().iter().map(|migration| migration.version).max().unwrap_or(0)
}

async fn migrate(path: &Path, writer: &mut SqliteConnection) -> Result<(), OpenError> {
    let mark = format!("PRAGMA application_id = {APPLICATION_ID}");
    sqlx::query(AssertSqlSafe(mark)).execute(&mut *writer).await.map_err(|error| explain(path, &error))?;
    migrations::sqlite().run(&mut *writer).await.map_err(|error| match error {
        MigrateError::VersionMissing(version) => {
            OpenError::Newer { path: path.to_owned(), version, known: known_version() }
        }
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => explain(path, &error),
        MigrateError::VersionMismatch(version) => OpenError::Damaged(
            path.to_owned(),
            format!("schema version {version} was made by another migration"),
        ),
        other => OpenError::Other(path.to_owned(), other.to_string()),
    })
}

/// Translates SQLite's primary result codes; see <https://sqlite.org/rescode.html>.
pub(crate) fn explain(path: &Path, error: &sqlx::Error) -> OpenError {
    let path = path.to_owned();
    let problem = message(error);
    match primary_code(error) {
        Some(5 | 6) => OpenError::Locked(path),
        Some(3 | 8 | 14) => OpenError::NotWritable(path, problem),
        Some(11 | 26) => OpenError::NotADatabase(path, problem),
        _ => OpenError::Other(path, problem),
    }
}
