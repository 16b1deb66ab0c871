//! A network that is slow and breaks off between client and daemon: no frame waits for it, and no report is
//! lost.
//!
//! The test starts itself again in a network namespace of its own, whose loopback can be delayed and taken
//! down without harm to anybody.

use std::process::Command;
use std::time::{Duration, Instant};

use treewright_client::{Client, Indicators, Options, Outcome};
use treewright_tests::sandbox::skip;

use crate::site::{Site, leaf_study};
use crate::wire;

/// Set in the namespace.
const INSIDE: &str = "TREEWRIGHT_TEST_NAMESPACE";
const TEST: &str = "network::a_partition_blocks_no_frame_and_loses_nothing";
const FRAME_DEADLINE: Duration = Duration::from_millis(50);
const PARTITION: Duration = Duration::from_secs(4);
/// Far above the deadline and well below the partition.
const BLOCKED: Duration = Duration::from_secs(2);

fn ip(arguments: &[&str]) -> bool {
    Command::new("ip").args(arguments).status().is_ok_and(|status| status.success())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_partition_blocks_no_frame_and_loses_nothing() {
    if std::env::var_os(INSIDE).is_some() {
        return inside().await;
    }
    treewright_tests::sandbox::expect_installed("ip");
    let usable = |command: &mut Command| command.output().is_ok_and(|output| output.status.success());
    if !usable(Command::new("unshare").args(["--net", "ip", "link", "set", "lo", "up"])) {
        return skip("a partition", "it needs root, unshare and ip");
    }
    // The programs are built before the network is gone.
    treewright_tests::programs::program("treewrightd");
    let this = std::env::current_exe().expect("a test knows its own path");
    let arguments = ["--exact", TEST, "--nocapture"];
    let inside = Command::new("unshare").arg("--net").arg(this).args(arguments).env(INSIDE, "1").output();
    let inside = inside.expect("unshare runs");
    let said = String::from_utf8_lossy(&inside.stderr);
    assert!(inside.status.success(), "{}{said}", String::from_utf8_lossy(&inside.stdout));
    for line in said.lines().filter(|line| line.starts_with("skipped: ")) {
        skip("in the network namespace", line);
    }
}

async fn inside() {
    assert!(ip(&["link", "set", "lo", "up"]));
    let delay = ["qdisc", "add", "dev", "lo", "root", "netem", "delay", "10ms", "2ms"];
    let delayed = Command::new("tc").args(delay).output();
    if !delayed.is_ok_and(|output| output.status.success()) {
        skip("a delay on the way", "tc has no netem here; the partition is tested without");
    }
    let site = Site::new();
    let options = Options::new().client_id("renderer").deadline(FRAME_DEADLINE);
    let client = Client::connect(site.url(), options).expect("a good address");
    let study = client.study("hall", leaf_study()).await.expect("a study");
    let mut tuner = study.tuner();

    let (mut previous, mut longest, mut frames) = (None, Duration::ZERO, 0u64);
    let begun = Instant::now();
    let mut is_cut = false;
    let mut frames_while_cut = 0u64;
    while begun.elapsed() < PARTITION + Duration::from_secs(4) {
        let cut = (Duration::from_secs(2)..Duration::from_secs(2) + PARTITION).contains(&begun.elapsed());
        if cut != is_cut {
            assert!(ip(&["link", "set", "lo", if cut { "down" } else { "up" }]));
            is_cut = cut;
        }
        let asked = Instant::now();
        let indicators = Indicators::from([("triangles", (frames / 40 % 3) as f64 * 30.0)]);
        let suggestion = tuner.next(&indicators, previous.take()).await;
        longest = longest.max(asked.elapsed());
        let cost = suggestion.configuration().integer("leaf").expect("a leaf") as f64;
        previous = Some(suggestion.finished([("render_ms", cost)].into(), Outcome::Ok).expect("measured"));
        frames += 1;
        frames_while_cut += u64::from(cut);
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    drop(previous);
    client.flush(Duration::from_secs(30)).await.expect("everything arrives once the network is back");
    let stats = client.stats();
    let mut reader = wire::connect(site.url()).await;
    let stored = wire::query(&mut reader, "studies/hall", "state = COMPLETED").await.len() as u64;
    println!(
        "{frames} frames, {frames_while_cut} of them while cut off, longest wait {} ms, {} fallbacks, {stored} stored",
        longest.as_millis(),
        stats.fallbacks
    );
    assert!(longest < BLOCKED, "a frame waited {longest:?} for the network");
    assert!(frames_while_cut >= 5 && stats.fallbacks > 0, "frames go on without the daemon");
    assert_eq!((stats.dropped, stats.refused, stats.queued), (0, 0, 0), "{stats:?}");
    assert_eq!(stored, stats.acknowledged, "{stats:?}");
    assert_eq!(stats.acknowledged + stats.unreported, frames, "every result is accounted for: {stats:?}");
}
