//! `treewrightd backup`, `restore` and `check`: maintenance of a database file.

use std::path::{Path, PathBuf};
use std::time::{Instant, UNIX_EPOCH};

use treewright_store::maintenance::{self, Inventory, MaintenanceError};

use crate::administration::CommandOutput;
use crate::config::{BackupConfig, FileDatabase, RestoreConfig};

/// Exit code of a failed command: that of `serve` where the database is at fault.
pub fn exit_code(error: &MaintenanceError) -> u8 {
    match error {
        MaintenanceError::Open(_) | MaintenanceError::Damaged { .. } | MaintenanceError::Unfit { .. } => 4,
        MaintenanceError::Missing { .. }
        | MaintenanceError::Exists { .. }
        | MaintenanceError::Log { .. }
        | MaintenanceError::Same { .. }
        | MaintenanceError::System { .. } => 1,
    }
}

/// Copies a database while a daemon may run on it.
///
/// # Errors
/// [`MaintenanceError`]; there is no new copy then.
pub async fn back_up(config: &BackupConfig) -> Result<CommandOutput, MaintenanceError> {
    let begun = Instant::now();
    let inventory = maintenance::back_up(&config.database.database, &config.to, config.replace).await?;
    let seconds = begun.elapsed().as_secs_f64();
    // A failure to note the time of the copy does not make the copy a failure.
    let mark = backup_mark(&config.database.database);
    let note = match std::fs::write(&mark, "The date of this file says when the database was last copied.\n")
    {
        Ok(()) => String::new(),
        Err(problem) => format!("the date of the backup cannot be noted in {}: {problem}", mark.display()),
    };
    let copied =
        said(format!("backed up to {}: {} in {seconds:.1} s", config.to.display(), shown(inventory)));
    Ok(CommandOutput { note, ..copied })
}

/// The file beside a database whose date is that of the last backup. A link to a database stands for the file
/// that it names.
pub fn backup_mark(database: &Path) -> PathBuf {
    let mut name = database.canonicalize().unwrap_or_else(|_| database.to_owned()).into_os_string();
    name.push("-last-backup");
    name.into()
}

/// The date of such a file, in seconds since 1970; none where there is none.
pub(crate) fn last_backup_s(mark: &Path) -> Option<i64> {
    let date = std::fs::metadata(mark).ok()?.modified().ok()?;
    date.duration_since(UNIX_EPOCH).ok()?.as_secs().try_into().ok()
}

/// Puts a copy back.
///
/// # Errors
/// [`MaintenanceError`]; the database is then as it was.
pub async fn restore(config: &RestoreConfig) -> Result<CommandOutput, MaintenanceError> {
    let database = &config.database.database;
    let done = maintenance::restore(&config.from, database).await?;
    let before = match &done.aside {
        Some(aside) => format!("; what was there before is {}", aside.display()),
        None => String::new(),
    };
    Ok(said(format!("restored {}: {}{before}", database.display(), shown(done.inventory))))
}

/// Checks all of a database.
///
/// # Errors
/// [`MaintenanceError::Damaged`] with the problems.
pub async fn check(database: &FileDatabase) -> Result<CommandOutput, MaintenanceError> {
    let begun = Instant::now();
    let inventory = maintenance::check(&database.database).await?;
    let seconds = begun.elapsed().as_secs_f64();
    Ok(said(format!("{} is sound: {}, {seconds:.1} s", database.database.display(), shown(inventory))))
}

fn said(out: String) -> CommandOutput {
    CommandOutput { out, note: String::new() }
}

fn shown(inventory: Inventory) -> String {
    let Inventory { studies, trials, bytes } = inventory;
    format!("{studies} studies, {trials} trials, {:.1} MB", bytes as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_and_its_database_have_one_mark() {
        let folder = tempfile::tempdir().expect("a folder");
        let (database, link) = (folder.path().join("tuning.db"), folder.path().join("link.db"));
        std::fs::write(&database, "").expect("a file");
        std::os::unix::fs::symlink(&database, &link).expect("a link");
        assert_eq!(backup_mark(&link), backup_mark(&database));
        std::fs::write(backup_mark(&database), "").expect("a mark");
        assert!(last_backup_s(&backup_mark(&link)).is_some_and(|date_s| date_s > 1_700_000_000));
    }
}
