//! The command lines of `treewrightd backup`, `restore` and `check`.

use std::path::PathBuf;

use clap::Args;
use treewright_store::is_postgres_address;

/// The message for a file operation on a PostgreSQL database.
const POSTGRES: &str = "PostgreSQL is kept with its own tools: pg_dump --format=custom --file=FILE URL copies a \
                        database while daemons run, pg_restore --clean --if-exists --dbname=URL FILE puts it back, \
                        pg_amcheck looks for damage (docs/operations.md)";

/// Whose database.
#[derive(Clone, Debug, Args)]
pub struct FileDatabase {
    /// Database file of the daemon.
    #[arg(long, env = "TREEWRIGHT_DATABASE", hide_env_values = true, value_name = "FILE", value_parser = file)]
    pub database: PathBuf,
}

/// How to copy a database.
#[derive(Clone, Debug, Args)]
pub struct BackupConfig {
    /// The database.
    #[command(flatten)]
    pub database: FileDatabase,

    /// File to write. It appears under this name only when complete and checked.
    #[arg(long, value_name = "FILE")]
    pub to: PathBuf,

    /// Replace the file if it exists.
    #[arg(long)]
    pub replace: bool,
}

/// How to put a copy back.
#[derive(Clone, Debug, Args)]
pub struct RestoreConfig {
    /// The database.
    #[command(flatten)]
    pub database: FileDatabase,

    /// The backup; it is not changed.
    #[arg(long, value_name = "FILE")]
    pub from: PathBuf,
}

fn file(text: &str) -> Result<PathBuf, String> {
    if is_postgres_address(text) {
        return Err(POSTGRES.to_owned());
    }
    Ok(PathBuf::from(text))
}
