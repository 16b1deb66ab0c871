//! Copies of a database under load, and the restored daemons.

use std::path::Path;

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr, stdout};

use crate::faults::Book;
use crate::site::{assert_sound, path_text};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_acknowledged_before_a_backup_comes_back_from_it() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let (database, backup) = (folder.path().join("tuning.db"), folder.path().join("backup.db"));
    let daemon = Daemon::start(&database);
    let mut book = Book::open(&daemon).await;
    book.frames(100).await;

    // Frames go on meanwhile, and an older copy is replaced.
    std::fs::write(&backup, "an older copy").expect("room");
    let before = book.acknowledged.clone();
    let (from, to) = (database.clone(), backup.clone());
    let copying = tokio::task::spawn_blocking(move || {
        let to = ["--to", path_text(&to), "--replace"];
        run("treewrightd", &[&["backup", "--database", path_text(&from)], &to[..]].concat())
    });
    while !copying.is_finished() {
        book.frames(1).await;
    }
    let copied = copying.await.expect("it ends");
    assert!(copied.status.success(), "{}", stderr(&copied));
    assert!(stdout(&copied).contains("1 studies"), "{}", stdout(&copied));
    assert!(book.acknowledged.len() > before.len(), "the frames were held up by the backup");
    let (everything, address) = (book.acknowledged.clone(), daemon.address().to_owned());
    daemon.kill();

    let restore = ["restore", "--from", path_text(&backup), "--database", path_text(&database)];
    let restored = run("treewrightd", &restore);
    assert!(restored.status.success(), "{}", stderr(&restored));
    let said = stdout(&restored);
    let aside = Path::new(said.trim().rsplit(' ').next().expect("a name"));
    let daemon = Daemon::start_at(&database, &address);
    book.reconnect(&daemon).await;
    book.acknowledged = before;
    book.reads().await;
    // It goes on from there, once the study is read.
    book.recovers().await;
    assert!(daemon.terminate().success());

    // The old database has not lost anything either, though its daemon was killed.
    assert!(aside.exists(), "{said}");
    let daemon = Daemon::start(aside);
    book.reconnect(&daemon).await;
    book.acknowledged = everything;
    book.reads().await;

    // A check of the whole database, also while it is in use.
    assert_sound(aside);
}

#[test]
fn postgresql_is_left_to_its_own_tools() {
    for command in [["backup", "--to"], ["restore", "--from"]] {
        let output = run("treewrightd", &[command[0], "--database", "postgres://u@h/d", command[1], "x"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("pg_dump --format=custom"), "{}", stderr(&output));
    }
}
