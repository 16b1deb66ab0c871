//! Maintenance of a database file: backups while a daemon runs, restoring one, and checking the file.
//!
//! All three work on the file itself, beside the daemon or without one. `backup` writes copies, `restore`
//! puts them back, `files` holds their tools for the file system. PostgreSQL has its own tools for all three.

mod backup;
mod files;
mod restore;

use std::path::{Path, PathBuf};

use sqlx::sqlite::SqliteConnection;
use sqlx::{ConnectOptions as _, Connection as _};

pub use backup::back_up;
pub use restore::{Restored, restore};

use crate::error::OpenError;
use crate::sqlite::{FileOwner, Unsound, file};

/// Why a database could not be copied, put back or checked. Nothing was changed unless the message says so.
#[derive(Debug, thiserror::Error)]
pub enum MaintenanceError {
    /// The database cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// There is no such file.
    #[error("{} does not exist; check the path", .0.display())]
    Missing(PathBuf),
    /// The copy's name is taken.
    #[error("{} exists already; choose another name or pass --replace", .0.display())]
    Exists(PathBuf),
    /// A log lies where that of the copy would.
    #[error(
        "a write-ahead log lies at {}, which SQLite would take for the copy's own: some program has {} open, or \
         was killed; end it, or choose another name",
        log.display(),
        path.display()
    )]
    Log {
        /// The path of the copy.
        path: PathBuf,
        /// The log.
        log: PathBuf,
    },
    /// Source and destination are one file.
    #[error("{} is the database itself; choose another file", .0.display())]
    Same(PathBuf),
    /// A file is not fit to be restored.
    #[error("{} cannot be restored: {}", .0.display(), .1)]
    Unfit(PathBuf, String),
    /// The file is damaged.
    #[error("{} is damaged:{}", .0.display(), .1.iter().map(|line| format!("\n  {}", line.trim())).collect::<String>())]
    Damaged(PathBuf, Vec<String>),
    /// The system refuses.
    #[error("{} cannot be {doing} ({problem}); check space and permissions there", path.display())]
    System {
        /// The path.
        path: PathBuf,
        /// The operation on it.
        doing: &'static str,
        /// The system's error.
        problem: String,
    },
}

impl MaintenanceError {
    fn system(path: &Path, doing: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |error| Self::System { path, doing, problem: error.to_string() }
    }

    fn sqlite(path: &Path, error: &sqlx::Error) -> Self {
        Self::Open(file::explain(path, error))
    }

    fn unsound(path: &Path, unsound: Unsound) -> Self {
        match unsound {
            Unsound::Problems(problems) => {
                assert!(!problems.is_empty(), "a file is damaged for no reason");
                Self::Damaged(path.to_owned(), problems)
            }
            Unsound::Unreadable(error) => Self::sqlite(path, &error),
        }
    }
}

/// The contents of a sound database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inventory {
    /// Studies.
    pub studies: u64,
    /// Stored trials of all studies.
    pub trials: u64,
    /// Length of the file in bytes.
    pub bytes: u64,
}

/// Checks all of a database, even while a daemon has it: pages, indexes, references, and that documents can
/// be read. It takes minutes for ten gigabytes. Writes go on meanwhile, into a write-ahead log that grows
/// until the check is done.
///
/// # Errors
/// [`MaintenanceError::Damaged`] with the problems, or the reason why the check failed.
pub async fn check(database: &Path) -> Result<Inventory, MaintenanceError> {
    files::need(database)?;
    let mut connection = connect(database).await?;
    let version = schema_version(&mut connection, database).await?;
    let known = file::known_version();
    if version < known {
        let problem = format!(
            "its schema is of version {version} and this program's of {known}; start the daemon on it once, or use \
             the treewrightd that it belongs to"
        );
        return Err(OpenError::Other(database.to_owned(), problem).into());
    }
    assert_eq!(version, known, "the schema of a newer program was not refused");
    let looked = file::check(&mut connection).await;
    looked.map_err(|unsound| MaintenanceError::unsound(database, unsound))?;
    let inventory = inventory(&mut connection, database).await?;
    connection.close().await.map_err(|error| MaintenanceError::sqlite(database, &error))?;
    Ok(inventory)
}

/// A connection to a file that exists, even while another process has it.
async fn connect(path: &Path) -> Result<SqliteConnection, MaintenanceError> {
    file::check_place(path)?;
    file::check_names(path)?;
    let options = file::options(path).create_if_missing(false);
    options.connect().await.map_err(|error| MaintenanceError::sqlite(path, &error))
}

/// A connection to a closed file that no process changes: it needs neither locks nor files beside it.
async fn connect_closed(path: &Path) -> Result<SqliteConnection, MaintenanceError> {
    let options = file::options(path).create_if_missing(false).read_only(true).immutable(true);
    options.connect().await.map_err(|error| MaintenanceError::sqlite(path, &error))
}

/// The version of the schema, if the database is ours and not of a newer program.
async fn schema_version(connection: &mut SqliteConnection, path: &Path) -> Result<i64, MaintenanceError> {
    let failed = |error: sqlx::Error| MaintenanceError::sqlite(path, &error);
    if file::owner(connection).await.map_err(failed)? != FileOwner::Ours {
        return Err(OpenError::Foreign(path.to_owned()).into());
    }
    let version: Option<i64> = sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations")
        .fetch_one(connection)
        .await
        .map_err(failed)?;
    let (version, known) = (version.unwrap_or(0), file::known_version());
    if version > known {
        return Err(OpenError::Newer { path: path.to_owned(), version, known }.into());
    }
    Ok(version)
}

async fn inventory(connection: &mut SqliteConnection, path: &Path) -> Result<Inventory, MaintenanceError> {
    // Rows of a deleted study stay until they are removed piece by piece.
    let sql = "SELECT (SELECT count(*) FROM studies WHERE name < '~'), \
               (SELECT count(*) FROM trials WHERE study IN (SELECT id FROM studies WHERE name < '~')), \
               (SELECT page_count * page_size FROM pragma_page_count, pragma_page_size)";
    let counted: Result<(i64, i64, i64), _> = sqlx::query_as(sql).fetch_one(connection).await;
    let (studies, trials, bytes) = counted.map_err(|error| MaintenanceError::sqlite(path, &error))?;
    let count = |number: i64| u64::try_from(number).unwrap_or(0);
    Ok(Inventory { studies: count(studies), trials: count(trials), bytes: count(bytes) })
}

/// Checks a closed file, which may be of an earlier schema, and counts its contents.
async fn check_closed(path: &Path) -> Result<Inventory, MaintenanceError> {
    let mut connection = connect_closed(path).await?;
    let version = schema_version(&mut connection, path).await?;
    let unsound = |unsound| MaintenanceError::unsound(path, unsound);
    // Tables of an earlier schema are those of its time; the next start brings them up to date.
    if version == file::known_version() {
        file::check_schema(&mut connection).await.map_err(unsound)?;
    }
    file::check_pages(&mut connection).await.map_err(unsound)?;
    let inventory = inventory(&mut connection, path).await?;
    connection.close().await.map_err(|error| MaintenanceError::sqlite(path, &error))?;
    Ok(inventory)
}
