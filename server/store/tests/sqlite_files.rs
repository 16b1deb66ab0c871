//! The SQLite store and its files: reopening, and every file that cannot be opened.

mod common;

use std::path::{Path, PathBuf};

use common::{NEWER_MIGRATION, alter, change, completed, foreign, open, spec};
use sqlx::{Connection as _, Executor as _};
use treewright_core::trial::Outcome;
use treewright_core::tuner::{Change, Checkpoint};
use treewright_store::{Fence, OpenError, SqliteStore, Store};

/// The name of a database, in a folder of its own.
fn file() -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("studies.db");
    (directory, path)
}

async fn refusal(path: &Path) -> OpenError {
    SqliteStore::open(path).await.expect_err("this file cannot be opened")
}

/// A database of one study, and the right to write it.
async fn hall(path: &Path) -> (SqliteStore, Fence) {
    let store = SqliteStore::open(path).await.unwrap();
    store.create_study("hall", &spec(), 5).await.unwrap();
    let fence = store.load("hall").await.unwrap().fence;
    (store, fence)
}

/// As after a crash between two parts.
#[tokio::test]
async fn a_checkpoint_that_lacks_a_part_is_passed_over() {
    let (_directory, path) = file();
    let (store, fence) = hall(&path).await;
    let first = Checkpoint { completion: 5, bytes: vec![1; 10] };
    store.save_checkpoint(&fence, &first).await.unwrap();
    alter(&path, "INSERT INTO checkpoints SELECT id, 9, 0, 2, x'0102' FROM studies").await;
    let loaded = store.load("hall").await.unwrap();
    assert_eq!(loaded.checkpoint, Some(first));
    // The next whole one clears it away.
    let next = Checkpoint { completion: 8, bytes: vec![2; 10] };
    store.save_checkpoint(&loaded.fence, &next).await.unwrap();
    store.close().await;
    let mut other = foreign(&path).await;
    let rows: i64 =
        sqlx::query_scalar("SELECT count(*) FROM checkpoints").fetch_one(&mut other).await.unwrap();
    assert_eq!(rows, 1);
}

#[tokio::test]
async fn many_writers_at_once_are_all_answered() {
    let directory = tempfile::tempdir().unwrap();
    let (store, fence) = hall(&directory.path().join("studies.db")).await;
    let receipts: Vec<_> =
        (1..=500).map(|number| store.commit(&fence, &[change(vec![open(number)])])).collect();
    for receipt in receipts {
        receipt.durable().await.unwrap();
    }
    assert_eq!(store.get_study("hall").await.unwrap().statistics.trials, 500);
}

#[tokio::test]
async fn a_full_queue_refuses_and_breaks_the_fence() {
    let directory = tempfile::tempdir().unwrap();
    let (store, fence) = hall(&directory.path().join("studies.db")).await;
    // On this single-threaded runtime the writer only runs while we wait, so the queue must fill up.
    let receipts: Vec<_> = (0..=treewright_store::limits::WRITE_QUEUE)
        .map(|_| store.commit(&fence, &[Change::default()]))
        .collect();
    assert!(!fence.holds());
    let mut full = 0;
    for receipt in receipts {
        if let Err(error) = receipt.durable().await {
            full += usize::from(error.to_string().contains("writes are waiting for the disk"));
        }
    }
    assert_eq!(full, 1);
}

#[tokio::test]
async fn a_name_under_which_nothing_would_be_kept_is_refused() {
    for name in ["", ":memory:"] {
        assert!(matches!(refusal(Path::new(name)).await, OpenError::NoName { .. }), "{name:?}");
    }
}

#[tokio::test]
async fn a_second_daemon_is_told_who_has_the_file() {
    let (directory, path) = file();
    let first = SqliteStore::open(&path).await.unwrap();
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::InUse { pid: Some(pid), .. } if pid == std::process::id()));
    let message = error.to_string();
    assert!(
        message.contains(&format!("in use by another treewrightd (pid {})", std::process::id())),
        "{message}"
    );
    // A link is another name of the file.
    let link = directory.path().join("link.db");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    assert!(matches!(refusal(&link).await, OpenError::InUse { .. }));
    let hard_link = directory.path().join("other.db");
    std::fs::hard_link(&path, &hard_link).unwrap();
    assert!(matches!(refusal(&hard_link).await, OpenError::ManyNames { count: 2, .. }));
    std::fs::remove_file(&hard_link).unwrap();
    first.close().await;
    SqliteStore::open(&path).await.expect("free again");
}

/// SQLite takes such a name for a URL, so that `x.db` and `file:x.db` were one file under two locks.
#[tokio::test]
async fn a_url_is_refused_and_makes_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("x.db");
    for url in [
        format!("file:{}", database.display()),
        format!("file:{}?mode=memory", database.display()),
        format!("sqlite://{}", database.display()),
    ] {
        let error = refusal(Path::new(&url)).await;
        assert!(matches!(error, OpenError::Url { .. }), "{url}: {error}");
        assert!(error.to_string().contains("named by its path"), "{error}");
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
    // A file may be called so.
    let named = directory.path().join("file:x.db");
    SqliteStore::open(&named).await.expect("a path").close().await;
    assert!(named.is_file());
}

fn mode(path: &Path) -> u32 {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::metadata(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).permissions().mode()
        & 0o777
}

fn set_mode(path: &Path, mode: u32) {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

#[tokio::test]
async fn only_the_owner_can_read_or_lock_the_files() {
    const SUFFIXES: [&str; 4] = ["", "-wal", "-shm", ".lock"];
    let (directory, path) = file();
    let file = |suffix: &str| directory.path().join(format!("studies.db{suffix}"));
    let store = SqliteStore::open(&path).await.unwrap();
    store.create_study("hall", &spec(), 5).await.unwrap();
    for suffix in SUFFIXES {
        assert_eq!(mode(&file(suffix)), 0o600, "{suffix:?} of a new database");
    }
    // As a daemon of an earlier version left them when it was killed.
    let copies = tempfile::tempdir().unwrap();
    for suffix in SUFFIXES {
        let copy = copies.path().join(format!("studies.db{suffix}"));
        std::fs::copy(file(suffix), &copy).unwrap();
        set_mode(&copy, 0o644);
    }
    let store = SqliteStore::open(&copies.path().join("studies.db")).await.unwrap();
    for suffix in SUFFIXES {
        let copy = copies.path().join(format!("studies.db{suffix}"));
        assert_eq!(mode(&copy), 0o600, "{suffix:?} of an old one");
    }
    store.get_study("hall").await.expect("it is what it was");
}

/// A file that is locked from outside.
#[tokio::test]
async fn who_holds_the_lock_without_being_a_daemon_is_named() {
    let (directory, path) = file();
    SqliteStore::open(&path).await.unwrap().close().await;
    let lock = std::fs::File::open(directory.path().join("studies.db.lock")).unwrap();
    std::fs::write(directory.path().join("studies.db.lock"), "1\n").unwrap();
    lock.lock_shared().unwrap();
    let error = refusal(&path).await;
    let pid = std::process::id();
    assert!(matches!(error, OpenError::Held { pid: held, .. } if held == pid), "{error}");
    assert!(error.to_string().contains(&format!("end that process (`ps {pid}`")), "{error}");
    drop(lock);
    SqliteStore::open(&path).await.expect("free again");
}

/// A link in the place of the lock would have its target overwritten.
#[tokio::test]
async fn a_lock_that_is_a_link_is_not_followed() {
    let (directory, path) = file();
    let diary = directory.path().join("diary.txt");
    std::fs::write(&diary, "dear diary").unwrap();
    std::os::unix::fs::symlink(&diary, directory.path().join("studies.db.lock")).unwrap();
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::NotWritable { .. }), "{error}");
    assert_eq!(std::fs::read_to_string(&diary).unwrap(), "dear diary");
}

/// The log that was deleted is open still, and folded into the file when that is closed.
#[tokio::test]
async fn after_a_deleted_log_an_orderly_end_saves_everything() {
    for suffix in ["-wal", "-shm"] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("studies.db");
        let (store, fence) = hall(&path).await;
        for number in 1..=40 {
            store.commit(&fence, &[change(vec![open(number)])]).durable().await.unwrap();
        }
        std::fs::remove_file(directory.path().join(format!("studies.db{suffix}"))).unwrap();
        let error = store.commit(&fence, &[change(vec![open(41)])]).durable().await.unwrap_err();
        let said = error.to_string();
        assert!(said.contains("stop the daemon with SIGTERM"), "{said}");
        assert!(said.contains("Restore no backup"), "{said}");
        store.close().await;
        treewright_store::maintenance::check(&path).await.expect("sound");
        let store = SqliteStore::open(&path).await.unwrap();
        assert_eq!(store.get_study("hall").await.unwrap().statistics.trials, 40, "{suffix}");
    }
}

#[tokio::test]
async fn a_foreign_lock_is_an_error_and_not_a_hang() {
    let (_directory, path) = file();
    SqliteStore::open(&path).await.unwrap().close().await;
    let mut other = foreign(&path).await;
    other.execute("BEGIN IMMEDIATE").await.unwrap();
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::Locked { .. }), "{error}");
    other.execute("ROLLBACK").await.unwrap();

    // While serving, the write fails with a reason, and the next one works again.
    let store = SqliteStore::open(&path).await.unwrap();
    store.create_study("hall", &spec(), 5).await.unwrap();
    other.execute("BEGIN IMMEDIATE").await.unwrap();
    let error = store.create_study("sponza", &spec(), 5).await.unwrap_err();
    assert!(error.to_string().contains("database is locked"), "{error}");
    other.execute("ROLLBACK").await.unwrap();
    other.close().await.unwrap();
    store.create_study("sponza", &spec(), 5).await.expect("stored");
}

#[tokio::test]
async fn paths_that_cannot_be_a_database_are_explained() {
    let directory = tempfile::tempdir().unwrap();
    let error = refusal(directory.path()).await;
    assert!(matches!(error, OpenError::Directory { .. }), "{error}");
    let error = refusal(&directory.path().join("missing/studies.db")).await;
    assert!(matches!(error, OpenError::NoDirectory { .. }), "{error}");
    // A file in place of a directory also fails for a superuser, whom permissions do not stop.
    let file = directory.path().join("file");
    std::fs::write(&file, "x").unwrap();
    let error = refusal(&file.join("studies.db")).await;
    assert!(matches!(error, OpenError::NoDirectory { .. }), "{error}");
    // So does a lock file that cannot be one.
    std::fs::create_dir(directory.path().join("studies.db.lock")).unwrap();
    let error = refusal(&directory.path().join("studies.db")).await;
    assert!(matches!(error, OpenError::NotWritable { .. }), "{error}");
}

#[tokio::test]
async fn files_that_are_no_database_are_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("notes.txt");
    let text = "These are notes, not a database. ".repeat(40);
    std::fs::write(&path, &text).unwrap();
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::NotADatabase { .. }), "{error}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
}

#[tokio::test]
async fn a_damaged_database_is_refused() {
    let (_directory, path) = file();
    SqliteStore::open(&path).await.unwrap().close().await;
    let mut bytes = std::fs::read(&path).unwrap();
    // The first page keeps its header; the schema behind it becomes nonsense.
    bytes[100..4096].fill(0x5a);
    std::fs::write(&path, &bytes).unwrap();
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::NotADatabase { .. }), "{error}");
}

#[tokio::test]
async fn another_programs_database_is_refused_and_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("album.db");
    alter(&path, "CREATE TABLE photographs (id INTEGER)").await;
    let before = std::fs::read(&path).unwrap();
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::Foreign { .. }), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[tokio::test]
async fn a_newer_schema_is_refused() {
    let (_directory, path) = file();
    SqliteStore::open(&path).await.unwrap().close().await;
    alter(&path, NEWER_MIGRATION).await;
    let error = refusal(&path).await;
    assert!(matches!(error, OpenError::Newer { version: 9999, known: 1..9999, .. }), "{error}");
}

#[tokio::test]
async fn altered_tables_and_scratched_pages_are_refused_at_the_start() {
    let (directory, path) = file();
    let (store, fence) = hall(&path).await;
    let trials = (1..=300).map(|number| completed(number, number, Outcome::Ok)).collect();
    store.commit(&fence, &[change(trials)]).durable().await.unwrap();
    store.close().await;

    // Each in a file of its own: a refused one may still be being closed.
    let mut count = 0;
    let mut copy = || {
        count += 1;
        let altered = directory.path().join(format!("altered_{count}.db"));
        std::fs::copy(&path, &altered).unwrap();
        altered
    };
    for (sql, problem) in [
        ("DROP INDEX trials_open", "index trials_open is missing"),
        ("ALTER TABLE trials RENAME COLUMN reason TO because", "table trials was altered"),
        ("DROP TRIGGER trials_completed_are_final", "trigger trials_completed_are_final is missing"),
    ] {
        let altered = copy();
        alter(&altered, sql).await;
        let error = refusal(&altered).await;
        assert!(
            matches!(&error, OpenError::Damaged(_, problems) if problems.starts_with(problem)),
            "{error}"
        );
    }
    // An operator's own additions for questions are ignored.
    let altered = copy();
    alter(&altered, "CREATE INDEX mine ON trials (cost)").await;
    SqliteStore::open(&altered).await.expect("it is ours still").close().await;

    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2 / 4096 * 4096;
    bytes[middle..middle + 4096].fill(0x5a);
    let altered = copy();
    std::fs::write(&altered, &bytes).unwrap();
    let error = refusal(&altered).await;
    assert!(matches!(&error, OpenError::Damaged { .. }), "{error}");
    // As after a copy that was broken off.
    bytes.truncate(middle);
    let altered = copy();
    std::fs::write(&altered, &bytes).unwrap();
    let error = refusal(&altered).await;
    assert!(matches!(&error, OpenError::NotADatabase { .. } | OpenError::Damaged { .. }), "{error}");
}

#[tokio::test]
async fn new_files_can_shrink_and_every_commit_waits_for_the_disk() {
    let (_directory, path) = file();
    SqliteStore::open(&path).await.unwrap().close().await;
    let mut other = foreign(&path).await;
    for (pragma, expected) in [("PRAGMA auto_vacuum", 2), ("PRAGMA application_id", 0x5457_7274)] {
        let value: i64 = sqlx::query_scalar(sqlx::AssertSqlSafe(pragma)).fetch_one(&mut other).await.unwrap();
        assert_eq!(value, expected, "{pragma}");
    }
    let mode: String = sqlx::query_scalar("PRAGMA journal_mode").fetch_one(&mut other).await.unwrap();
    assert_eq!(mode, "wal");
}

#[tokio::test]
async fn a_file_shrinks_when_much_was_removed() {
    let (_directory, path) = file();
    let (store, fence) = hall(&path).await;
    let wide = |number| {
        let mut trial = completed(number, number, Outcome::Ok);
        trial.decision.said = Some("long ".repeat(2000));
        trial
    };
    for first in (1..=2000).step_by(100) {
        let trials = (first..first + 100).map(wide).collect();
        store.commit(&fence, &[change(trials)]).durable().await.unwrap();
    }
    let pages = async |pragma: &'static str| -> i64 {
        let mut other = foreign(&path).await;
        sqlx::query_scalar(pragma).fetch_one(&mut other).await.unwrap()
    };
    let before = pages("PRAGMA page_count").await;
    for first in (1..2000u64).step_by(50) {
        let some: Vec<u64> = (first..first + 50).collect();
        store.remove_trials(&fence, &some, u64::MAX >> 1).await.unwrap();
    }
    let after = pages("PRAGMA page_count").await;
    assert!(after < before / 2, "{before} pages became {after}");
    store.close().await;
    treewright_store::maintenance::check(&path).await.expect("sound");
    assert!(std::fs::metadata(&path).unwrap().len() < before as u64 * 4096 / 2);
}

/// A deletion in pieces: each looks for the next kind of rows only where none of the kind before is left.
#[tokio::test]
async fn nothing_of_a_deleted_study_stays_in_the_file() {
    let (_directory, path) = file();
    let (store, fence) = hall(&path).await;
    let trials = (1..=200).map(|number| completed(number, number, Outcome::Ok)).collect();
    store.commit(&fence, &[change(trials)]).durable().await.unwrap();
    store.delete_study("hall", None).await.unwrap();
    let mut other = foreign(&path).await;
    let sql = "SELECT (SELECT count(*) FROM trials) + (SELECT count(*) FROM states) + (SELECT count(*) FROM visits) \
               + (SELECT count(*) FROM checkpoints) + (SELECT count(*) FROM studies)";
    let begin = std::time::Instant::now();
    loop {
        let left: i64 = sqlx::query_scalar(sql).fetch_one(&mut other).await.unwrap();
        if left == 0 {
            break;
        }
        assert!(begin.elapsed().as_secs() < 60, "{left} rows are left");
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    store.close().await;
}

/// SQLite would go on writing to a file without a name.
#[tokio::test]
async fn a_file_that_is_moved_away_is_not_written_any_more() {
    let (directory, path) = file();
    let store = SqliteStore::open(&path).await.unwrap();
    store.create_study("hall", &spec(), 5).await.unwrap();
    for name in ["studies.db", "studies.db-wal"] {
        let (file, elsewhere) = (directory.path().join(name), directory.path().join("elsewhere"));
        let fence = store.load("hall").await.unwrap().fence;
        std::fs::rename(&file, &elsewhere).unwrap();
        let error = store.commit(&fence, &[change(vec![open(1)])]).durable().await.unwrap_err();
        assert!(error.to_string().contains("moved, deleted or replaced"), "{error}");
        assert!(!fence.holds());
        // Another one in its place is not ours either, nor is a directory.
        std::fs::create_dir(&file).unwrap();
        assert!(store.create_study("later", &spec(), 5).await.is_err());
        std::fs::remove_dir(&file).unwrap();
        std::fs::rename(&elsewhere, &file).unwrap();
        let fence = store.load("hall").await.unwrap().fence;
        store.commit(&fence, &[change(vec![open(1)])]).durable().await.expect("it is back");
    }
}

/// A daemon that stops while its last connections end first does this.
#[tokio::test]
async fn who_gives_up_waiting_for_the_end_does_not_keep_the_file_open() {
    let (directory, path) = file();
    let store = SqliteStore::open(&path).await.unwrap();
    store.create_study("hall", &spec(), 5).await.unwrap();
    {
        let mut closing = Box::pin(store.close());
        let once = std::future::poll_fn(|context| {
            std::task::Poll::Ready(closing.as_mut().poll(context).is_pending())
        });
        assert!(once.await, "it takes a while");
    }
    store.close().await;
    assert!(!directory.path().join("studies.db-wal").exists());
    SqliteStore::open(&path).await.expect("the lock is free").close().await;
}
