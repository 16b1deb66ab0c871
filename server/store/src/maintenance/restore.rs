//! Putting a backup in the place of a database.
//!
//! The backup is copied beside the database, made durable and checked there, so that the checked file is the
//! one in use later. Then the old database and its write-ahead log get further names. The old log must not
//! lie beside the new file, because SQLite would take it for that file's own. One rename puts the new file in
//! place.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use super::files::{self, PartialFile};
use super::{Inventory, MaintenanceError, check_closed};
use crate::sqlite::file;

/// The result of a restore.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Restored {
    /// The present contents of the database.
    pub inventory: Inventory,
    /// The new path of the former database, if there was one.
    pub aside: Option<PathBuf>,
}

/// Puts a copy of the backup `from` in the place of `database`, which need not exist.
///
/// # Errors
/// [`MaintenanceError`], chiefly when a daemon has the database, or the backup is damaged or of a newer
/// schema. Nothing was changed then.
pub async fn restore(from: &Path, database: &Path) -> Result<Restored, MaintenanceError> {
    files::need(from)?;
    if files::are_same(from, database) {
        return Err(MaintenanceError::Same(from.to_owned()));
    }
    // A link to a database stands for the file that it names.
    let database = &database.canonicalize().unwrap_or_else(|_| database.to_owned());
    file::check_place(database)?;
    let lock = file::DatabaseLock::take(database)?;
    // The log of a link lies beside the file that it names.
    let original = from.canonicalize().unwrap_or_else(|_| from.to_owned());
    if files::has_log(&original) {
        return Err(MaintenanceError::Unfit(
            from.to_owned(),
            "a write-ahead log lies beside it, so it is a database in use and no backup; make one with \
                      `treewrightd backup`"
                .to_owned(),
        ));
    }
    let like = if database.exists() { database } else { from };
    let draft = PartialFile::beside(database, like)?;
    copy(from, draft.path())?;
    draft.sync()?;
    let inventory = check_closed(draft.path()).await.map_err(|error| about(from, draft.path(), error))?;
    let aside = if database.exists() { Some(put_aside(database)?) } else { None };
    let placed = draft.rename(database);
    if let (Err(_), Some(aside)) = (&placed, &aside) {
        put_back(database, aside);
    }
    placed?;
    files::sync_folder(database)?;
    drop(lock);
    Ok(Restored { inventory, aside })
}

fn copy(from: &Path, to: &Path) -> Result<(), MaintenanceError> {
    let mut source = File::open(from).map_err(MaintenanceError::system(from, "read"))?;
    let target = File::options().write(true).truncate(true).open(to);
    let mut target = target.map_err(MaintenanceError::system(to, "written"))?;
    io::copy(&mut source, &mut target).map_err(MaintenanceError::system(to, "written")).map(|_| ())
}

/// Gives the database and its log further names, and takes the log from beside it. On failure everything is
/// as before: a database with a second name would be refused at the next start.
fn put_aside(database: &Path) -> Result<PathBuf, MaintenanceError> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let aside = files::beside(database, &format!(".before-restore-{}", since.as_millis()));
    let mut made = Vec::new();
    let done = take_away(database, &aside, &mut made);
    if done.is_err() {
        for name in made {
            let _ = fs::remove_file(name);
        }
    }
    done.map(|()| aside)
}

/// Undoes [`put_aside`], where nothing took the database's place: its log is put back first, and only then
/// the other name goes.
fn put_back(database: &Path, aside: &Path) {
    match fs::rename(files::beside(aside, "-wal"), files::beside(database, "-wal")) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {}
        _ => drop(fs::remove_file(aside)),
    }
}

/// Does the work of [`put_aside`], and collects new names in `made`.
fn take_away(database: &Path, aside: &Path, made: &mut Vec<PathBuf>) -> Result<(), MaintenanceError> {
    let log = files::beside(database, "-wal");
    for (name, other) in [(database, aside.to_owned()), (&log, files::beside(aside, "-wal"))] {
        match fs::hard_link(name, &other) {
            Ok(()) => made.push(other),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(MaintenanceError::system(name, "kept under another name")(error)),
        }
    }
    files::sync_folder(database)?;
    // The log goes last, because the database is incomplete without it.
    for name in [files::beside(database, "-shm"), log] {
        match fs::remove_file(&name) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(MaintenanceError::system(&name, "removed")(error)),
        }
    }
    Ok(())
}

/// An error about the copy is one about the backup.
fn about(from: &Path, draft: &Path, error: MaintenanceError) -> MaintenanceError {
    let problem = |text: String| MaintenanceError::Unfit(from.to_owned(), text);
    match error {
        MaintenanceError::Damaged(_, problems) => MaintenanceError::Damaged(from.to_owned(), problems),
        other => {
            let text = other.to_string();
            problem(text.replace(&draft.display().to_string(), &from.display().to_string()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_put_aside_in_vain_is_put_back_with_its_log() {
        let folder = tempfile::tempdir().expect("a folder");
        let database = folder.path().join("tuning.db");
        let log = files::beside(&database, "-wal");
        for has_log in [true, false] {
            fs::write(&database, "all").expect("a file");
            if has_log {
                fs::write(&log, "the latest").expect("a log");
            }
            let aside = put_aside(&database).expect("it is put aside");
            assert!(aside.exists() && !log.exists());
            put_back(&database, &aside);
            assert_eq!(fs::read_to_string(&database).expect("the database"), "all");
            assert_eq!(fs::read_to_string(&log).ok().as_deref(), has_log.then_some("the latest"));
            let names = fs::read_dir(folder.path()).expect("a folder").count();
            assert_eq!(names, if has_log { 2 } else { 1 }, "no other name is left");
            let _ = fs::remove_file(&log);
        }
    }
}
