//! Whether the files that are written are still those that lie under the database's name.
//!
//! SQLite goes on writing to a file that was moved, deleted or replaced meanwhile, and what it acknowledges is gone with
//! the last handle on it. So the writer looks at the names before each transaction, which takes a few microseconds,
//! and refuses while they mean something else. Once the files are back, it goes on.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use crate::error::StoreError;

/// A file as the system tells it from others: device and inode.
type Identity = (u64, u64);

/// The files of an open database.
#[derive(Debug)]
pub(super) struct FileIdentity {
    database: PathBuf,
    log: PathBuf,
    database_is: Option<Identity>,
    /// Known once the log has been there; it then stays until the database is closed.
    log_is: Option<Identity>,
}

impl FileIdentity {
    /// Remembers what lies under the name of a database that has just been opened.
    pub(super) fn of(database: &Path) -> Self {
        // A link to the database stands for the file that it names, and the log lies beside that.
        let database = database.canonicalize().unwrap_or_else(|_| database.to_owned());
        let mut log = database.clone().into_os_string();
        log.push("-wal");
        let log = PathBuf::from(log);
        Self { database_is: identity(&database), log_is: identity(&log), database, log }
    }

    /// Refuses when another file, or none, lies where one of ours was.
    pub(super) fn check(&mut self) -> Result<(), StoreError> {
        let names = [(&self.database, self.database_is), (&self.log, self.log_is)];
        for (name, known) in names {
            if known.is_some() && identity(name) != known {
                let problem = format!(
                    "{} was moved, deleted or replaced while the daemon runs; put it back, or stop the daemon and \
                     restore a backup",
                    name.display()
                );
                return Err(StoreError::Unavailable { problem });
            }
        }
        if self.log_is.is_none() {
            self.log_is = identity(&self.log);
        }
        Ok(())
    }
}

fn identity(path: &Path) -> Option<Identity> {
    fs::metadata(path).ok().map(|file| (file.dev(), file.ino()))
}
