//! One daemon, one database: an advisory lock (`flock`), which the system releases when its holder dies in
//! any way.
//!
//! `FILE.lock` is locked and holds the process id for the error message. Only SQLite opens the database file
//! itself, as [`place`](super::place) explains. A second name of the file would have another lock, so `place`
//! refuses it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;

use super::place;
use crate::error::OpenError;

/// Held for as long as the store is open. The file stays behind, because deleting it could delete the lock of
/// a daemon that has just opened it.
#[derive(Debug)]
pub(crate) struct DatabaseLock {
    _named: File,
}

impl DatabaseLock {
    /// Takes the lock, or names the process that holds it.
    pub(crate) fn take(database: &Path) -> Result<Self, OpenError> {
        // Beside the file itself, should `database` be a link to it.
        let path = place::beside(&database.canonicalize().unwrap_or_else(|_| database.to_owned()), ".lock");
        let failed = |error: std::io::Error| not_writable(&path, &error);
        let mut named = open(&path).map_err(failed)?;
        match named.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(refusal(database, path, named)),
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        let written = named
            .set_len(0)
            .and_then(|()| named.rewind())
            .and_then(|()| writeln!(named, "{}", std::process::id()));
        written.map_err(failed)?;
        Ok(Self { _named: named })
    }
}

/// Opens the file, which no other user may open: a user who can read it can lock it, and could keep the
/// daemon from starting.
fn open(path: &Path) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false).mode(place::PRIVATE);
    let file = options.custom_flags(OFlags::NOFOLLOW.bits().cast_signed()).open(path)?;
    place::tighten(path);
    Ok(file)
}

fn refusal(database: &Path, lock: PathBuf, mut named: File) -> OpenError {
    let mut text = String::new();
    // The process id is a courtesy; without it the message is only shorter.
    let _ = named.read_to_string(&mut text);
    let (said, holder) = (text.trim().parse().ok(), holder(&named));
    let path = database.to_owned();
    match holder {
        Some(pid) if said != Some(pid) && !is_daemon(pid) => OpenError::Held { path, lock, pid },
        _ => OpenError::InUse { path, pid: holder.or(said) },
    }
}

/// The process that holds a lock on the file, as far as Linux says (`proc_locks(5)`).
fn holder(file: &File) -> Option<u32> {
    let inode = format!(":{}", file.metadata().ok()?.ino());
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    locks.lines().find_map(|line| {
        // Number, kind, "ADVISORY", "WRITE", process, DEVICE:INODE, first and last byte. Some file systems
        // show a different device here.
        let words: Vec<&str> = line.split_whitespace().collect();
        let [_, "FLOCK", _, _, process, of, ..] = words[..] else { return None };
        of.ends_with(&inode).then(|| process.parse().ok()).flatten().filter(|&pid| pid > 0)
    })
}

fn is_daemon(pid: u32) -> bool {
    let name = std::fs::read_to_string(format!("/proc/{pid}/comm"));
    name.is_ok_and(|name| name.trim() == "treewrightd")
}

fn not_writable(path: &Path, error: &std::io::Error) -> OpenError {
    OpenError::NotWritable(path.to_owned(), error.to_string())
}
