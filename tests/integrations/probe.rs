//! The preloaded library before Embree: its counts are right, and its host computes equal pictures with it,
//! without it, and where it cannot write.

use std::path::Path;
use std::process::{Command, Stdio};

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::program;

use crate::c_sdk::embree_example;
use crate::support::{built, has, succeed};

/// The brightness of each picture that a run of the example computed.
fn pictures(said: &str) -> Vec<f64> {
    let lines = said.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    lines.filter_map(|line| line["brightness"].as_f64()).collect()
}

/// Whether the pictures agree. One ray in some thousand meets an edge, of which trees may take either side.
fn are_alike(one: &[f64], other: &[f64]) -> bool {
    one.len() == 3 && other.len() == 3 && one.iter().zip(other).all(|(a, b)| (a - b).abs() < 2e-3)
}

fn arguments<'a>(example: &'a Path, url: &'a str) -> [&'a str; 9] {
    let example = example.to_str().expect("a path");
    [example, "--url", url, "--frames", "5", "--size", "16", "--deadline", "20000"]
}

#[test]
fn a_renderer_is_measured_and_left_as_it_is() {
    if !has("c++", "the probe on the C++ example") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let example = embree_example(folder.path());
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let asked = arguments(&example, daemon.url());
    let plain = succeed(Command::new(asked[0]).args(&asked[1..]));
    let said = succeed(Command::new(program("treewright-probe")).arg("--json").arg("--").args(asked));
    let found: serde_json::Value =
        said.lines().last().and_then(|line| serde_json::from_str(line).ok()).expect("findings");
    // Three scenes of five frames of 256 pixels.
    assert_eq!(found["closest"]["calls"], 3 * 5 * 256, "{found}");
    assert_eq!(found["builds"], 15, "{found}");
    assert!(found["occluded"]["calls"].as_u64() > Some(0), "{found}");
    assert!(found["embree"].as_str().is_some_and(|path| path.contains("libembree4")), "{found}");
    let printed =
        succeed(Command::new(program("treewright-probe")).arg("--").args(arguments(&example, daemon.url())));
    assert!(printed.contains("closest hit") && printed.contains("advice: "), "{printed}");
    let preload = built().join("libtreewright_probe.so");
    let mut unwritable = Command::new(asked[0]);
    unwritable.args(&asked[1..]).env("LD_PRELOAD", preload).env("TREEWRIGHT_PROBE", "/nowhere/at/all");
    let unwritable = succeed(&mut unwritable);
    // Settings change how trees are built, not the hits of rays.
    let set = succeed(
        Command::new(program("treewright-probe"))
            .args(["--set", "quality=low", "--set", "device=verbose=0", "--"])
            .args(arguments(&example, daemon.url())),
    );
    for other in [&said, &printed, &unwritable, &set] {
        assert!(are_alike(&pictures(&plain), &pictures(other)), "{plain}{other}");
    }
}

#[test]
fn programs_without_embree_are_told_so() {
    let output =
        Command::new(program("treewright-probe")).args(["--", "sh", "-c", "echo as it is; exit 3"]).output();
    let output = output.expect("it runs");
    assert_eq!((output.status.code(), output.stdout.as_slice()), (Some(3), b"as it is\n".as_slice()));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no Embree was met"));
}

/// A host of many frames whose findings meet a full disk and whose daemon goes away meanwhile.
#[test]
fn faults_of_the_probe_and_the_daemon_leave_a_thousand_frames_as_they_are() {
    if !has("c++", "the probe under faults") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let example = embree_example(folder.path());
    let command = |url: &str, before: &str| {
        let mut command = Command::new("sh");
        let frames = "exec \"$0\" --url \"$1\" --frames 334 --size 4 --deadline 500";
        command.args(["-c", &format!("{before}{frames}"), example.to_str().expect("a path"), url]);
        command
    };
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let plain = succeed(&mut command(daemon.url(), ""));
    let preloaded = |url: &str, before: &str| {
        let mut command = command(url, before);
        command.env("LD_PRELOAD", built().join("libtreewright_probe.so"));
        command.env("TREEWRIGHT_PROBE", folder.path().join("found"));
        command
    };
    let full = "ln -s /dev/full \"$TREEWRIGHT_PROBE.$$\"; ";
    let full = succeed(&mut preloaded(daemon.url(), full));
    let mut unwritable = preloaded(daemon.url(), "ulimit -f 0; ");
    // The host's own output must not go to a file.
    let child = unwritable.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let mut child = child.expect("it starts");
    // The first picture is done: the study is there, and the daemon may go.
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(child.stdout.take().expect("a pipe")));
    let mut said = lines.next().expect("a line").expect("text");
    drop(daemon);
    lines.for_each(|line| said += &format!("\n{}", line.expect("text")));
    assert!(child.wait().expect("it ends").success(), "{said}");
    for other in [&full, &said] {
        assert!(are_alike(&pictures(&plain), &pictures(other)), "{plain}{other}");
    }
}
