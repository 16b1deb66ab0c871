//! The preloaded library before Embree: it counts rightly, and its host computes the same with it, without it, and where it cannot write.

use std::path::Path;
use std::process::Command;

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::program;

use crate::c_sdk::embree_example;
use crate::support::{built, has, succeed};

/// What a run of the example computed: the brightness of each picture.
fn pictures(said: &str) -> Vec<f64> {
    let lines = said.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    lines.filter_map(|line| line["brightness"].as_f64()).collect()
}

/// The same pictures; a ray in some thousand meets an edge, of which trees may take either side.
fn are_alike(one: &[f64], other: &[f64]) -> bool {
    one.len() == 3 && other.len() == 3 && one.iter().zip(other).all(|(a, b)| (a - b).abs() < 2e-3)
}

fn arguments<'a>(example: &'a Path, url: &'a str) -> [&'a str; 7] {
    [example.to_str().expect("a path"), "--url", url, "--frames", "5", "--size", "16"]
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
    let told =
        succeed(Command::new(program("treewright-probe")).arg("--").args(arguments(&example, daemon.url())));
    assert!(told.contains("closest hit") && told.contains("advice: "), "{told}");
    let preload = built().join("libtreewright_probe.so");
    let mut unwritable = Command::new(asked[0]);
    unwritable.args(&asked[1..]).env("LD_PRELOAD", preload).env("TREEWRIGHT_PROBE", "/nowhere/at/all");
    let unwritable = succeed(&mut unwritable);
    for other in [&said, &told, &unwritable] {
        assert!(are_alike(&pictures(&plain), &pictures(other)), "{plain}{other}");
    }
}

#[test]
fn programs_without_embree_are_told_so() {
    let output =
        Command::new(program("treewright-probe")).args(["--", "sh", "-c", "echo as it is; exit 3"]).output();
    let output = output.expect("it runs");
    assert_eq!((output.status.code(), output.stdout.as_slice()), (Some(3), b"as it is\n".as_slice()));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no Embree 4 was met"));
}
