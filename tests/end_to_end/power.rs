//! The state that a power cut would meet: every answer to a report comes after its sync to the disk.
//!
//! No test can cut the power. But `strace` shows the daemon's system calls: the write-ahead log was synced
//! between the write and the answer. The test trusts the disk to keep synced data.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::program;
use treewright_tests::sandbox::skip;

use crate::wire;

/// Numbers of writes and of syncs of the write-ahead log, and of its writes since the last sync.
fn log_calls(trace: &Path) -> (usize, usize, usize) {
    let calls = std::fs::read_to_string(trace).unwrap_or_default();
    let (mut written, mut synced, mut unsynced) = (0, 0, 0);
    for call in calls.lines() {
        // With -y a file's name stands behind its number; a call that another one interrupts ends in a second
        // line.
        let of_log = call.contains("-wal>");
        if of_log && call.contains("pwrite64(") {
            written += 1;
            unsynced += 1;
        } else if of_log && (call.contains("fdatasync(") || call.contains("fsync(")) {
            synced += 1;
            unsynced = 0;
        }
    }
    (written, synced, unsynced)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_report_is_acknowledged_before_the_log_is_synced() {
    const FRAMES: usize = 15;
    let folder = tempfile::tempdir().expect("a scratch folder");
    let trace = folder.path().join("trace");
    // -D: the daemon stays this process's child. The tracer prints each call when it is done.
    let traced = |program: &Path| {
        let mut command = Command::new("strace");
        command.args(["-D", "-f", "-qq", "-y", "-e", "trace=pwrite64,fdatasync,fsync", "-o"]);
        command.arg(&trace).arg(program);
        command
    };
    treewright_tests::sandbox::expect_installed("strace");
    let probe = traced(Path::new("sync")).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        return skip("what is synced before an answer", "strace is not installed, or may not trace here");
    }
    let database = folder.path().join("tuning.db");
    let daemon = Daemon::start_by(traced(&program("treewrightd")), &database);
    let mut client = wire::connect(daemon.url()).await;
    let study = wire::create(&mut client, "power").await;
    let begun = Instant::now();
    while log_calls(&trace).1 == 0 {
        if begun.elapsed() > Duration::from_secs(20) {
            return skip("what is synced before an answer", "strace shows nothing here");
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let (_, before, _) = log_calls(&trace);
    for frame in 1..=FRAMES {
        let asked = client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial");
        client.report(wire::report(asked.get_ref())).await.expect("taken");
        let (written, synced, unsynced) = log_calls(&trace);
        // A suggestion and a report are two transactions; nobody else shares them.
        assert!(synced - before >= 2 * frame, "{synced} syncs, {before} of them before frame {frame}");
        assert!(written > synced, "{written} writes");
        assert_eq!(unsynced, 0, "written and acknowledged before it was synced, at frame {frame}");
    }
    assert!(daemon.terminate().success());
}
