//! Copies of a database under load, and the restored daemons.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use tokio::task::JoinSet;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr, stdout};

use crate::site::{assert_sound, path_text};
use crate::wire;

/// The names of the trials whose report was acknowledged.
type Acknowledged = Arc<Mutex<BTreeSet<String>>>;

/// Reports until `stop` is set, or the daemon is gone.
async fn work(url: String, study: String, number: u32, acknowledged: Acknowledged, stop: Arc<AtomicBool>) {
    let mut client = wire::connect(&url).await;
    for step in 0.. {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let near = f64::from(number) / 4.0 + f64::from(step % 3) / 20.0;
        let asked = client.suggest(wire::suggestion(&study, &format!("worker-{number}"), near)).await;
        let Ok(trial) = asked.map(tonic::Response::into_inner) else { break };
        if client.report(wire::report(&trial)).await.is_err() {
            break;
        }
        acknowledged.lock().expect("nobody panics with it").insert(trial.name);
    }
}

fn count(acknowledged: &Acknowledged) -> BTreeSet<String> {
    acknowledged.lock().expect("nobody panics with it").clone()
}

async fn completed(url: &str, study: &str) -> BTreeSet<String> {
    let trials = wire::query(&mut wire::connect(url).await, study, "state = COMPLETED").await;
    trials.into_iter().map(|trial| trial.name).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_acknowledged_before_a_backup_comes_back_from_it() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let at = |name: &str| folder.path().join(name);
    let database = at("tuning.db");
    let daemon = Daemon::start(&database);
    let study = wire::create(&mut wire::connect(daemon.url()).await, "farm").await;
    let (acknowledged, stop) = (Acknowledged::default(), Arc::new(AtomicBool::new(false)));
    let mut workers = JoinSet::new();
    for number in 0..4 {
        let (url, study) = (daemon.url().to_owned(), study.clone());
        workers.spawn(work(url, study, number, Arc::clone(&acknowledged), Arc::clone(&stop)));
    }

    // Backups one after the other while the workers go on; the last is the one that counts.
    let mut before = BTreeSet::new();
    for round in 0..3 {
        while count(&acknowledged).len() < 60 * (round + 1) {
            tokio::time::sleep(std::time::Duration::from_millis(5)).await;
        }
        before = count(&acknowledged);
        let (from, to) = (database.clone(), at("backup.db"));
        let back_up = move || {
            let to = ["--to", path_text(&to), "--replace"];
            run("treewrightd", &[&["backup", "--database", path_text(&from)], &to[..]].concat())
        };
        let copied = tokio::task::spawn_blocking(back_up);
        let copied = copied.await.expect("it ends");
        assert!(copied.status.success(), "{}", stderr(&copied));
        assert!(stdout(&copied).contains("1 studies"), "{}", stdout(&copied));
    }
    let after = count(&acknowledged);
    assert!(after.len() > before.len(), "the workers were held up by the backup");

    let address = daemon.address().to_owned();
    daemon.kill();
    stop.store(true, Ordering::Relaxed);
    while workers.join_next().await.is_some() {}
    let everything = count(&acknowledged);

    let from = at("backup.db");
    let restore = ["restore", "--from", path_text(&from), "--database", path_text(&database)];
    let restored = run("treewrightd", &restore);
    assert!(restored.status.success(), "{}", stderr(&restored));
    let said = stdout(&restored);
    let aside = said.trim().rsplit(' ').next().expect("a name");
    let daemon = Daemon::start_at(&database, &address);
    let stored = completed(daemon.url(), &study).await;
    let missing: Vec<_> = before.difference(&stored).collect();
    assert!(missing.is_empty(), "acknowledged before the backup and gone: {missing:?}");
    // It goes on from there.
    let mut client = wire::connect(daemon.url()).await;
    let trial = loop {
        match client.suggest(wire::suggestion(&study, "later", 0.5)).await {
            Ok(trial) => break trial.into_inner(),
            // The study is read for as long as that takes.
            Err(status) if status.code() == tonic::Code::Unavailable => {
                tokio::time::sleep(std::time::Duration::from_millis(100)).await;
            }
            Err(status) => panic!("a trial: {status}"),
        }
    };
    client.report(wire::report(&trial)).await.expect("taken");
    assert!(daemon.terminate().success());

    // The old database has not lost anything either, though its daemon was killed.
    let aside = Path::new(aside);
    assert!(aside.exists(), "{said}");
    let daemon = Daemon::start(aside);
    let stored = completed(daemon.url(), &study).await;
    assert!(everything.is_subset(&stored), "the old file has lost something");

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
