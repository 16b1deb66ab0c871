//! One daemon, one database: advisory locks (`flock`), which the system releases when their holder dies, however it
//! dies.
//!
//! `FILE.lock` holds the process id for the error message. The database file itself is locked as well, since it may
//! be reached by several names: through hard links or bind mounts. SQLite's own locks (`fcntl`) are of another kind,
//! and the two do not meet.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use crate::error::OpenError;

/// Held for as long as the store is open. The file stays behind: to delete it could delete the lock of
/// a daemon that has just opened it.
#[derive(Debug)]
pub(crate) struct DatabaseLock {
    _named: File,
    _database: Option<File>,
}

impl DatabaseLock {
    /// Takes the lock, or names the process that holds it. A database that does not exist yet is made, as an empty
    /// file.
    pub(crate) fn take(database: &Path) -> Result<Self, OpenError> {
        Self::take_with(database, true)
    }

    /// The same, where no file is to be made.
    pub(crate) fn take_without_file(database: &Path) -> Result<Self, OpenError> {
        Self::take_with(database, false)
    }

    fn take_with(database: &Path, make: bool) -> Result<Self, OpenError> {
        let path = lock_path(database);
        let mut named = open(&path)?;
        if !try_lock(&named, &path)? {
            let mut text = String::new();
            // The process id is a courtesy; without it the message is only shorter.
            let _ = named.read_to_string(&mut text);
            return Err(OpenError::InUse { path: database.to_owned(), pid: text.trim().parse().ok() });
        }
        let file = if make || database.exists() { Some(open(database)?) } else { None };
        if let Some(file) = &file
            && !try_lock(file, database)?
        {
            return Err(OpenError::InUse { path: database.to_owned(), pid: None });
        }
        let written = named
            .set_len(0)
            .and_then(|()| named.rewind())
            .and_then(|()| writeln!(named, "{}", std::process::id()));
        written.map_err(|error| not_writable(&path, &error))?;
        Ok(Self { _named: named, _database: file })
    }
}

fn open(path: &Path) -> Result<File, OpenError> {
    let mut options = OpenOptions::new();
    let opened = options.read(true).write(true).create(true).truncate(false).open(path);
    opened.map_err(|error| not_writable(path, &error))
}

/// Whether the lock could be had.
fn try_lock(file: &File, path: &Path) -> Result<bool, OpenError> {
    match file.try_lock() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(not_writable(path, &error)),
    }
}

fn not_writable(path: &Path, error: &std::io::Error) -> OpenError {
    OpenError::NotWritable { path: path.to_owned(), problem: error.to_string() }
}

/// Beside the file itself, should `database` be a link to it.
fn lock_path(database: &Path) -> PathBuf {
    let file = database.canonicalize();
    let mut name = file.unwrap_or_else(|_| database.to_owned()).into_os_string();
    name.push(".lock");
    PathBuf::from(name)
}
