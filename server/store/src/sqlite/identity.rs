//! The check that the open files still lie under the database's name.
//!
//! SQLite goes on writing to a file that was moved, deleted or replaced meanwhile, and acknowledged writes
//! are lost with its last handle. So the writer checks the names before each transaction, which takes a few
//! microseconds, and refuses while they name other files. Once the files are back, it goes on.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use super::place::beside;
use crate::error::{Result, StoreError};

/// SQLite has the file open still, under another name or under none.
const DATABASE_REMEDY: &str =
    "put it back, and writes go on; where it is gone for good, stop the daemon and restore a backup";

/// The log is open still, and closing the database folds it into the file, even if another file has the log's
/// name.
const LOG_REMEDY: &str = "stop the daemon with SIGTERM, which writes all that it has acknowledged into the database, and \
                          start it again. Restore no backup: nothing is lost unless another program wrote meanwhile";

/// The system's identity of a file: device and inode.
type Identity = (u64, u64);

#[derive(Debug)]
struct KnownFile {
    name: PathBuf,
    /// Known once the file exists; files beside the database then stay until it is closed.
    is: Option<Identity>,
    remedy: &'static str,
}

#[derive(Debug)]
pub(super) struct FileIdentity([KnownFile; 3]);

impl FileIdentity {
    /// Remembers the files under the name of a database that has just been opened.
    pub(super) fn of(database: &Path) -> Self {
        // A link to the database stands for the file that it names, and the others lie beside that.
        let database = database.canonicalize().unwrap_or_else(|_| database.to_owned());
        let file = |suffix: &str, remedy| {
            let name = beside(&database, suffix);
            KnownFile { is: identity(&name), name, remedy }
        };
        Self([file("", DATABASE_REMEDY), file("-wal", LOG_REMEDY), file("-shm", LOG_REMEDY)])
    }

    /// Refuses when one of the files was replaced or is missing.
    pub(super) fn check(&mut self) -> Result<()> {
        for KnownFile { name, is, remedy } in &mut self.0 {
            let found = identity(name);
            if is.is_some() && found != *is {
                let name = name.display();
                let problem =
                    format!("{name} was moved, deleted or replaced while the daemon runs; {remedy}");
                return Err(StoreError::Unavailable(problem));
            }
            *is = found;
        }
        Ok(())
    }
}

fn identity(path: &Path) -> Option<Identity> {
    fs::metadata(path).ok().map(|file| (file.dev(), file.ino()))
}
