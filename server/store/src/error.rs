//! The errors of a store, each with its cause and its remedy.

use std::path::PathBuf;

/// What a store answers.
pub type Result<T, E = StoreError> = std::result::Result<T, E>;

/// Why a store refuses a request. Nothing of the request was stored.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// No study has this id.
    #[error("study {0:?} does not exist")]
    StudyNotFound(String),
    /// The id is taken by another specification.
    #[error(
        "study {study:?} exists with a different specification: {difference} (stored against given); choose another id, repeat the stored specification, or change the study's space if that is all that differs"
    )]
    StudyExists {
        /// The id.
        study: String,
        /// The first difference, in words.
        difference: String,
    },
    /// Another study has the new id.
    #[error("study {0:?} exists already; choose another id, or delete or rename that study")]
    NameTaken(String),
    /// The database is full of studies.
    #[error("the database holds {0} studies, which is its limit; delete some")]
    TooManyStudies(u32),
    /// The study has no such trial.
    #[error("trial {number} of study {study:?} does not exist")]
    TrialNotFound {
        /// The study.
        study: String,
        /// The requested number.
        number: u64,
    },
    /// The change was computed on a copy of the study that is no longer current.
    #[error("study {0:?} was reloaded meanwhile; try again")]
    Fenced(String),
    /// Another replica holds the study's tuner.
    #[error("study {study:?} is held by the replica at {address}; ask that one")]
    Elsewhere {
        /// The study.
        study: String,
        /// The replica's address.
        address: String,
    },
    /// Too many writes wait.
    #[error("{0} writes are waiting for the disk, which is the limit; try again later")]
    QueueFull(usize),
    /// The database refused, at the moment.
    #[error("the database cannot be used at the moment: {0}; try again later")]
    Unavailable(String),
    /// The store has been closed.
    #[error("the database is closed; the daemon is shutting down")]
    Closed,
    /// A stored row is invalid, or a change breaks a rule of the tables.
    #[error(
        "the database is inconsistent{}: {problem}; restore it from a backup and report this as a defect",
        study.as_ref().map(|study| format!(" in study {study:?}")).unwrap_or_default()
    )]
    Inconsistent {
        /// The study, where it is known.
        study: Option<String>,
        /// The damage.
        problem: String,
    },
}

impl StoreError {
    /// Names the study in an error that names none, where its words need one.
    #[must_use]
    pub fn in_study(mut self, id: &str) -> Self {
        if let Self::Inconsistent { study, .. } = &mut self {
            study.get_or_insert_with(|| id.to_owned());
        }
        self
    }
}

/// Why a database cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The path names a directory.
    #[error("{} is a directory; name a database file", .0.display())]
    Directory(PathBuf),
    /// The directory that should hold the file is missing.
    #[error("the directory {} does not exist; create it or choose another path", .0.display())]
    NoDirectory(PathBuf),
    /// The file or its directory may not be written.
    #[error("{} cannot be written ({}); check the permissions of the file and its directory, or choose another path", .0.display(), .1)]
    NotWritable(PathBuf, String),
    /// The name stands for no file.
    #[error("{:?} is not the name of a file, and nothing would be kept; choose a file", .0.display().to_string())]
    NoName(PathBuf),
    /// The name is a URL, which SQLite and other programs read in their own ways.
    #[error("{} is a URL, and a database is named by its path: write tuning.db, or ./{} for a file that is called so", .0.display(), .0.display())]
    Url(PathBuf),
    /// The file is reached by several names.
    #[error("{} has {count} names (hard links), and what SQLite keeps beside the file lies beside one of them only; remove the others (`find -samefile`), or copy the file with no daemon running", path.display())]
    ManyNames {
        /// The path.
        path: PathBuf,
        /// The number of names.
        count: u64,
    },
    /// The file was mounted without its folder.
    #[error("{} is mounted as a file of its own, so the log that SQLite keeps beside it would be left behind; mount the folder that it lies in", .0.display())]
    MountedAlone(PathBuf),
    /// A program that is no daemon holds the daemon's lock.
    #[error("{} cannot be taken: process {pid}, which is no treewrightd, holds a lock on {}; end that process (`ps {pid}` says what it is)", path.display(), lock.display())]
    Held {
        /// The path.
        path: PathBuf,
        /// The file that is locked.
        lock: PathBuf,
        /// The process that holds it.
        pid: u32,
    },
    /// Another daemon serves this file.
    #[error("{} is in use by another treewrightd{}; stop it or choose another path", path.display(), pid.map(|pid| format!(" (pid {pid})")).unwrap_or_default())]
    InUse {
        /// The path.
        path: PathBuf,
        /// The other process, where it could be read.
        pid: Option<u32>,
    },
    /// Another program holds a lock.
    #[error("{} is locked by another process; close the program that has it open and try again", .0.display())]
    Locked(PathBuf),
    /// Not SQLite, or damaged.
    #[error("{} is not a usable database ({}); choose another path or restore it from a backup", .0.display(), .1)]
    NotADatabase(PathBuf, String),
    /// A database of ours that is damaged.
    #[error("{} is damaged ({}); restore a backup with `treewrightd restore`, and keep the damaged file: `treewrightd check` says more", .0.display(), .1)]
    Damaged(PathBuf, String),
    /// An SQLite database that something else made.
    #[error("{} is a database of another program; choose another path", .0.display())]
    Foreign(PathBuf),
    /// The tables are newer than this program.
    #[error("{} was written by a newer treewrightd (schema version {version}, this one knows {known}); upgrade this program", path.display())]
    Newer {
        /// The path.
        path: PathBuf,
        /// The newest schema version in the file.
        version: i64,
        /// The newest schema version this program knows.
        known: i64,
    },
    /// No PostgreSQL answers.
    #[error("no PostgreSQL answers at {0} ({1}); start it, or check host, port and network")]
    Unreachable(String, String),
    /// PostgreSQL is starting or recovering, and not ready yet.
    #[error("PostgreSQL at {0} is not ready yet ({1})")]
    Starting(String, String),
    /// PostgreSQL refuses to let us in.
    #[error(
        "PostgreSQL at {0} refuses ({1}); check user, password and database, and that the user may create tables there"
    )]
    Refused(String, String),
    /// The database at the server cannot be ours.
    #[error("the database at {0} cannot be used: {1}")]
    Unfit(String, String),
    /// The address of the database makes no sense.
    #[error("the database's address cannot be used: {0}; write postgres://USER@HOST:PORT/DATABASE")]
    BadAddress(String),
    /// Anything else.
    #[error("{} cannot be opened: {}", .0.display(), .1)]
    Other(PathBuf, String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_names_its_study_where_it_is_known() {
        let damage = crate::rows::inconsistent("a number is negative");
        assert!(damage.to_string().starts_with("the database is inconsistent: a number is negative; "));
        let placed = damage.in_study("hall").in_study("attic");
        let words = "the database is inconsistent in study \"hall\": a number is negative; ";
        assert!(placed.to_string().starts_with(words), "{placed}");
        assert_eq!(StoreError::Closed.in_study("hall"), StoreError::Closed);
    }
}
