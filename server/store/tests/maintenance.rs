//! Copying, restoring and checking database files: the restored contents, and every refusal.

mod common;

use std::path::{Path, PathBuf};

use common::{NEWER_MIGRATION, alter, change, completed, foreign, open, spec};
use treewright_core::trial::Outcome;
use treewright_store::maintenance::{self, Inventory, MaintenanceError};
use treewright_store::{OpenError, SqliteStore, Store};

struct Place {
    _folder: tempfile::TempDir,
    database: PathBuf,
    backup: PathBuf,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (database, backup) = (folder.path().join("studies.db"), folder.path().join("backup.db"));
        Self { _folder: folder, database, backup }
    }

    fn names(&self) -> Vec<String> {
        let folder = std::fs::read_dir(self.database.parent().unwrap()).unwrap();
        folder.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }
}

/// A store with one study of `trials` completed trials and an open one.
async fn store(path: &Path, trials: u64) -> SqliteStore {
    let store = SqliteStore::open(path).await.unwrap();
    store.create_study("hall", &spec(), 5).await.unwrap();
    let fence = store.load("hall").await.unwrap().fence;
    let mut all: Vec<_> = (1..=trials).map(|number| completed(number, number, Outcome::Ok)).collect();
    all.push(open(trials + 1));
    store.commit(&fence, &[change(all)]).durable().await.unwrap();
    store
}

async fn trials(path: &Path) -> u64 {
    let store = SqliteStore::open(path).await.unwrap();
    let statistics = store.get_study("hall").await.unwrap().statistics;
    store.close().await;
    statistics.trials
}

#[tokio::test]
async fn a_backup_is_taken_from_a_running_store_and_put_back() {
    let place = Place::new();
    let running = store(&place.database, 500).await;
    let inventory = maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
    assert_eq!((inventory.studies, inventory.trials), (1, 501));
    assert_eq!(inventory.bytes, std::fs::metadata(&place.backup).unwrap().len());
    // Nothing else is left behind, neither a draft nor a log.
    let strays: Vec<_> = place.names().into_iter().filter(|name| name.contains("backup.db")).collect();
    assert_eq!(strays, ["backup.db"]);
    // The store goes on.
    running.create_study("later", &spec(), 6).await.unwrap();

    let error = maintenance::restore(&place.backup, &place.database).await.unwrap_err();
    assert!(matches!(error, MaintenanceError::Open(OpenError::InUse { .. })), "{error}");
    running.close().await;

    let restored = maintenance::restore(&place.backup, &place.database).await.unwrap();
    assert_eq!(restored.inventory, inventory);
    assert_eq!(trials(&place.database).await, 501);
    let back = SqliteStore::open(&place.database).await.unwrap();
    assert_eq!(back.list_studies(None, 10).await.unwrap().len(), 1);
    back.close().await;
    let aside = SqliteStore::open(&restored.aside.unwrap()).await.unwrap();
    assert_eq!(aside.list_studies(None, 10).await.unwrap().len(), 2);
}

/// A log that is left beside the new file would be taken for its own.
#[tokio::test]
async fn the_log_of_a_killed_daemon_is_put_aside_with_its_database() {
    let place = Place::new();
    let running = store(&place.database, 3).await;
    maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
    running.create_study("later", &spec(), 6).await.unwrap();
    let killed = place.database.with_file_name("killed.db");
    for suffix in ["", "-wal"] {
        let name = |path: &Path| PathBuf::from(format!("{}{suffix}", path.display()));
        std::fs::copy(name(&place.database), name(&killed)).unwrap();
    }
    running.close().await;
    let restored = maintenance::restore(&place.backup, &killed).await.unwrap();
    assert!(!killed.with_file_name("killed.db-wal").exists());
    let back = SqliteStore::open(&killed).await.unwrap();
    assert_eq!(back.list_studies(None, 10).await.unwrap().len(), 1);
    let aside = SqliteStore::open(&restored.aside.unwrap()).await.unwrap();
    assert_eq!(aside.list_studies(None, 10).await.unwrap().len(), 2);
}

#[tokio::test]
async fn a_backup_goes_where_nothing_is_unless_told() {
    let place = Place::new();
    store(&place.database, 2).await.close().await;
    let error = maintenance::back_up(&place.database, &place.database, true).await.unwrap_err();
    assert!(matches!(error, MaintenanceError::Same { .. }), "{error}");
    std::fs::write(&place.backup, "a letter").unwrap();
    let error = maintenance::back_up(&place.database, &place.backup, false).await.unwrap_err();
    assert!(error.to_string().contains("--replace"), "{error}");
    assert_eq!(std::fs::read(&place.backup).unwrap(), b"a letter");
    maintenance::back_up(&place.database, &place.backup, true).await.unwrap();
    assert_eq!(trials(&place.backup).await, 3);

    let folder = place.database.parent().unwrap();
    let error = maintenance::back_up(&place.database, folder, true).await.unwrap_err();
    assert!(matches!(error, MaintenanceError::Open(OpenError::Directory { .. })), "{error}");
    let error = maintenance::back_up(&place.database, &folder.join("missing/b"), false).await.unwrap_err();
    assert!(matches!(error, MaintenanceError::Open(OpenError::NoDirectory { .. })), "{error}");
    let error = maintenance::back_up(&folder.join("missing"), &place.backup, true).await.unwrap_err();
    assert!(matches!(error, MaintenanceError::Missing { .. }), "{error}");
    assert!(!folder.join("missing").exists());
    // Users who may not read the database may not read its backup.
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(&place.database, std::fs::Permissions::from_mode(0o600)).unwrap();
    maintenance::back_up(&place.database, &place.backup, true).await.unwrap();
    assert_eq!(std::fs::metadata(&place.backup).unwrap().permissions().mode() & 0o777, 0o600);
}

#[tokio::test]
async fn what_cannot_be_restored_changes_nothing() {
    let place = Place::new();
    store(&place.database, 7).await.close().await;
    maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
    let folder = place.database.parent().unwrap().to_owned();
    let names = place.names().len();

    let letter = folder.join("letter");
    std::fs::write(&letter, "Dear database, ".repeat(500)).unwrap();
    let cut = folder.join("cut");
    let bytes = std::fs::read(&place.backup).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let scratched = folder.join("scratched");
    let mut damaged = bytes.clone();
    let middle = damaged.len() / 2 / 4096 * 4096;
    damaged[middle..middle + 4096].fill(0x5a);
    std::fs::write(&scratched, damaged).unwrap();
    let newer = folder.join("newer");
    std::fs::copy(&place.backup, &newer).unwrap();
    alter(&newer, NEWER_MIGRATION).await;
    let in_use = folder.join("in_use");
    let user = store(&in_use, 1).await;
    let link = folder.join("link");
    std::os::unix::fs::symlink(&in_use, &link).unwrap();

    for (from, fragment) in [
        (&letter, "not a usable database"),
        (&cut, "malformed"),
        (&scratched, "is damaged"),
        (&newer, "newer treewrightd"),
        (&in_use, "treewrightd backup"),
        (&link, "treewrightd backup"),
        (&folder.join("missing"), "does not exist"),
        (&folder, "is a directory"),
    ] {
        let error = maintenance::restore(from, &place.database).await.unwrap_err();
        let said = error.to_string();
        assert!(said.contains(fragment) && said.contains(from.to_str().unwrap()), "{said}");
        assert!(!said.contains(".part-"), "{said}");
    }
    user.close().await;
    assert_eq!(trials(&place.database).await, 8);
    assert!(place.names().len() >= names);
    assert!(!place.names().iter().any(|name| name.contains("before-restore")));
}

#[tokio::test]
async fn a_check_finds_what_a_start_need_not() {
    let place = Place::new();
    store(&place.database, 300).await.close().await;
    let sound = maintenance::check(&place.database).await.unwrap();
    assert!(matches!(sound, Inventory { studies: 1, trials: 301, .. }));

    // A text that SQLite takes for one, and an index that lacks a row.
    let unreadable = place.database.with_file_name("unreadable.db");
    std::fs::copy(&place.database, &unreadable).unwrap();
    alter(&unreadable, "UPDATE trials SET indicators = '{\"x\": ' WHERE state = 'OPEN'").await;
    let error = maintenance::check(&unreadable).await.unwrap_err();
    assert!(error.to_string().contains("trial 301 of study 1 cannot be read"), "{error}");
    for (damage, found) in [
        ("UPDATE states SET indicators = '[0.1'", "state 1 of study 1 cannot be read"),
        (
            "INSERT INTO visits (study, client_id, state_id, number, decision) VALUES (1, 'one', 1, 1, '{')",
            "the visit of one in study 1 cannot be read",
        ),
        (
            "INSERT INTO tokens VALUES ('ab', 'a', zeroblob(32), 'READ', '[', '{}', 0, NULL, NULL)",
            "token ab cannot be read",
        ),
    ] {
        std::fs::copy(&place.database, &unreadable).unwrap();
        alter(&unreadable, damage).await;
        let error = maintenance::check(&unreadable).await.unwrap_err();
        assert!(error.to_string().contains(found), "{error}");
    }

    let stray = place.database.with_file_name("stray.db");
    std::fs::copy(&place.database, &stray).unwrap();
    alter(&stray, "PRAGMA foreign_keys = OFF; DELETE FROM states").await;
    let error = maintenance::check(&stray).await.unwrap_err();
    assert!(error.to_string().contains("missing row of states"), "{error}");
    SqliteStore::open(&stray).await.expect("its pages are sound").close().await;
}

#[tokio::test]
async fn trials_of_a_deleted_study_count_no_more() {
    let place = Place::new();
    // More than is removed at once.
    let running = store(&place.database, 1200).await;
    running.delete_study("hall", None).await.unwrap();
    running.close().await;
    let inventory = maintenance::check(&place.database).await.unwrap();
    assert_eq!((inventory.studies, inventory.trials), (0, 0));
}

/// Files of versions that did not know retention, made as those did.
#[tokio::test]
async fn the_copy_of_a_file_that_cannot_shrink_can() {
    let place = Place::new();
    let old = "PRAGMA application_id = 0x54577274; CREATE TABLE t (x); DROP TABLE t";
    alter(&place.database, old).await;
    store(&place.database, 5).await.close().await;
    maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
    for (file, expected) in [(&place.database, 0), (&place.backup, 2)] {
        let mut other = foreign(file).await;
        let shrinks: i64 = sqlx::query_scalar("PRAGMA auto_vacuum").fetch_one(&mut other).await.unwrap();
        assert_eq!(shrinks, expected);
    }
    assert_eq!(trials(&place.backup).await, 6);
}

/// A file of this schema must have its tables; one of an earlier schema is judged by its pages.
#[tokio::test]
async fn a_restore_looks_at_what_its_schema_says() {
    let place = Place::new();
    store(&place.database, 20).await.close().await;
    maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
    alter(&place.backup, "ALTER TABLE visits ADD COLUMN stray TEXT").await;
    let error = maintenance::restore(&place.backup, &place.database).await.unwrap_err();
    assert!(error.to_string().contains("visits"), "{error}");
    assert_eq!(trials(&place.database).await, 21, "nothing was changed");

    alter(&place.backup, "DELETE FROM _sqlx_migrations WHERE version > 1").await;
    let restored = maintenance::restore(&place.backup, &place.database).await.unwrap();
    assert_eq!(restored.inventory.trials, 21);
}

/// SQLite leaves an empty log behind where a reader was last. It holds nothing.
#[tokio::test]
async fn an_empty_log_beside_a_backup_is_no_daemon() {
    let place = Place::new();
    store(&place.database, 4).await.close().await;
    maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
    let log = place.backup.with_file_name("backup.db-wal");
    std::fs::write(&log, "").unwrap();
    maintenance::restore(&place.backup, &place.database).await.expect("it is a whole backup");
    std::fs::write(&log, "something").unwrap();
    let error = maintenance::restore(&place.backup, &place.database).await.unwrap_err();
    assert!(error.to_string().contains("database in use"), "{error}");
}

/// SQLite would play the log back over the new copy.
#[tokio::test]
async fn a_backup_is_not_put_beside_the_log_of_another_database() {
    let place = Place::new();
    store(&place.database, 4).await.close().await;
    let log = place.backup.with_file_name("backup.db-wal");
    for (replace, was) in [(false, None), (true, Some("a letter"))] {
        if let Some(was) = was {
            std::fs::write(&place.backup, was).unwrap();
        }
        std::fs::write(&log, "something").unwrap();
        let names = place.names().len();
        let error = maintenance::back_up(&place.database, &place.backup, replace).await.unwrap_err();
        assert!(matches!(error, MaintenanceError::Log { .. }), "{error}");
        assert!(error.to_string().contains("backup.db-wal"), "{error}");
        assert_eq!(place.names().len(), names);
        assert_eq!(std::fs::read_to_string(&place.backup).ok().as_deref(), was);
    }
    std::fs::write(&log, "").unwrap();
    maintenance::back_up(&place.database, &place.backup, true).await.expect("an empty log holds nothing");
    assert_eq!(trials(&place.backup).await, 5);
}

/// A log that stays would be taken for the new file's own, and a database of two names for damaged.
#[tokio::test]
async fn a_file_that_cannot_be_put_aside_ends_a_restore_and_nothing_was_changed() {
    for suffix in ["-wal", "-shm"] {
        let place = Place::new();
        store(&place.database, 4).await.close().await;
        maintenance::back_up(&place.database, &place.backup, false).await.unwrap();
        let name = format!("studies.db{suffix}");
        let beside = place.database.with_file_name(&name);
        std::fs::create_dir(&beside).unwrap();
        std::fs::write(beside.join("a file"), "").unwrap();
        let error = maintenance::restore(&place.backup, &place.database).await.unwrap_err();
        assert!(error.to_string().contains(&name), "{error}");
        std::fs::remove_dir_all(&beside).unwrap();
        assert!(!place.names().iter().any(|name| name.contains("before-restore")), "{:?}", place.names());
        assert_eq!(trials(&place.database).await, 5, "the database is where it was");
    }
}
