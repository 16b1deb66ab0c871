//! File system tools of backup and restore: names beside a name, copies that vanish unless they are kept, and
//! durable names.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use super::MaintenanceError;
use crate::error::OpenError;
pub(super) use crate::sqlite::file::{beside, folder};

/// Whether a write-ahead log that holds something lies beside a file. SQLite leaves empty ones behind.
pub(super) fn has_log(path: &Path) -> bool {
    fs::metadata(beside(path, "-wal")).is_ok_and(|log| log.len() > 0)
}

/// Refuses a path that is not a file.
pub(super) fn need(path: &Path) -> Result<(), MaintenanceError> {
    if path.is_dir() {
        return Err(OpenError::Directory(path.to_owned()).into());
    }
    if path.exists() { Ok(()) } else { Err(MaintenanceError::Missing(path.to_owned())) }
}

pub(super) fn are_same(one: &Path, other: &Path) -> bool {
    match (fs::metadata(one), fs::metadata(other)) {
        (Ok(one), Ok(other)) => (one.dev(), one.ino()) == (other.dev(), other.ino()),
        _ => false,
    }
}

/// Makes names in a folder durable.
pub(super) fn sync_folder(path: &Path) -> Result<(), MaintenanceError> {
    let folder = folder(path);
    let synced = File::open(folder).and_then(|open| open.sync_all());
    synced.map_err(MaintenanceError::system(folder, "made durable"))
}

/// A file that is written under a temporary name. It is removed unless it is kept.
pub(super) struct PartialFile {
    path: PathBuf,
    is_kept: bool,
}

impl PartialFile {
    /// An empty file beside `path` with the permissions of `like`: a database holds the hashes of tokens.
    pub(super) fn beside(path: &Path, like: &Path) -> Result<Self, MaintenanceError> {
        let draft = beside(path, &format!(".part-{}", std::process::id()));
        let mode = fs::metadata(like).map_or(0o600, |metadata| metadata.permissions().mode() & 0o777);
        // Removes the leftover of an earlier process with this number.
        let _ = fs::remove_file(&draft);
        let made = OpenOptions::new().write(true).create_new(true).mode(mode).open(&draft);
        match made {
            Ok(_) => Ok(Self { path: draft, is_kept: false }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(OpenError::NoDirectory(folder(path).to_owned()).into())
            }
            Err(error) => Err(MaintenanceError::system(&draft, "written")(error)),
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn sync(&self) -> Result<(), MaintenanceError> {
        let synced = File::open(&self.path).and_then(|open| open.sync_all());
        synced.map_err(MaintenanceError::system(&self.path, "made durable"))
    }

    /// Gives it its name, durably, and replaces a file of that name.
    pub(super) fn keep_as(self, path: &Path) -> Result<(), MaintenanceError> {
        self.rename(path)?;
        sync_folder(path)
    }

    /// Gives it its name, and replaces a file of that name.
    pub(super) fn rename(mut self, path: &Path) -> Result<(), MaintenanceError> {
        debug_assert_eq!(folder(&self.path), folder(path), "only within a folder is one name put at once");
        fs::rename(&self.path, path).map_err(MaintenanceError::system(path, "put in place"))?;
        self.is_kept = true;
        Ok(())
    }

    /// Gives it its name, durably, unless something has that name.
    pub(super) fn keep_as_new(self, path: &Path) -> Result<(), MaintenanceError> {
        match fs::hard_link(&self.path, path) {
            // The other name goes when this is dropped.
            Ok(()) => sync_folder(path),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                Err(MaintenanceError::Exists(path.to_owned()))
            }
            // Some file systems know no second names.
            Err(_) if path.exists() => Err(MaintenanceError::Exists(path.to_owned())),
            Err(_) => self.keep_as(path),
        }
    }
}

impl Drop for PartialFile {
    fn drop(&mut self) {
        if !self.is_kept {
            // If it stays, the next draft of this name replaces it.
            let _ = fs::remove_file(&self.path);
        }
    }
}
