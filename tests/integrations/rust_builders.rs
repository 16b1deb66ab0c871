//! The example on the builders of Rust libraries, over a real daemon.

use std::process::Command;

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::program;

use crate::support::succeed;

#[test]
fn builders_are_tuned_per_mesh_and_use() {
    let folder = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let arguments = ["--trials", "18", "--rays", "500,5000", "--rounds", "1", "--url", daemon.url()];
    let said = succeed(Command::new(program("treewright-builders")).args(arguments));
    let lines: Vec<serde_json::Value> =
        said.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), 4, "{said}");
    for line in &lines {
        assert_eq!(line["fixed"].as_array().map(Vec::len), Some(16), "{line}");
        assert_eq!(line["trial_costs"].as_array().map(Vec::len), Some(18), "{line}");
        assert!(line["tuned_costs"][0].as_f64() > Some(0.0), "{line}");
        assert!(line["tuned"]["library"].is_string(), "{line}");
    }
}
