//! Arrows between the crates point one way, and the pure core stays pure.

use std::collections::{BTreeMap, BTreeSet};

use crate::packages::{cargo, packages};

/// The crates of the workspace that each crate may depend on, without `treewright-` before their names.
const ARROWS: &[(&str, &str)] = &[
    ("model", ""),
    ("proto", "model"),
    ("core", "model"),
    ("accel", ""),
    ("store", "core model"),
    ("server", "core figures model proto store"),
    ("client", "model proto"),
    ("figures", ""),
    ("cli", "client figures"),
    ("indicators", ""),
    ("scene", "accel indicators"),
    ("renderer", "accel client model scene"),
    ("render-cli", "accel client figures renderer scene"),
    // No crate may depend on the laboratory; it also judges the core's searches and predictors.
    ("lab", "accel client core figures render-cli renderer scene"),
    ("c", "client indicators"),
    ("probe", ""),
    ("python", "client"),
    ("builders", "client indicators"),
    // For ports that stay free while the server is away.
    ("test-postgres", "tests"),
    ("fuzz", "cli client core model proto scene server store"),
    ("simulation", "core model proto server store"),
];

/// The crates that compute and do nothing else, with their sources.
const PURE: &[(&str, &str)] = &[("treewright-model", "model/src"), ("treewright-core", "server/core/src")];

/// Crates that would bring I/O, clocks or threads into them.
const NOT_IN_PURE: &[&str] = &["tokio", "sqlx", "tonic", "prost", "reqwest", "rusqlite", "tracing", "chrono"];

/// Crates with lints of their own, which allow `unsafe`: Embree, and the shells of other languages.
const EDGES: &[&str] = &["treewright-accel", "treewright-c", "treewright-probe", "treewright-python"];

/// Crates for programs at a terminal, which a renderer that links the SDK must not get.
const NOT_IN_SDK: &[&str] = &["clap", "comfy-table", "crossterm", "indicatif"];

/// Standard library paths that they must not name: they compute, the shell does.
const NOT_SAID_IN_PURE: &str =
    "std::fs std::io std::net std::env std::thread SystemTime Instant::now thread_rng";

fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let name = |value: &serde_json::Value| value["name"].as_str().expect("a name is text").to_owned();
    packages()
        .iter()
        .map(|package| {
            let all = package["dependencies"].as_array().expect("dependencies is a list");
            // Tests may reach further than the code they test.
            (name(package), all.iter().filter(|one| one["kind"] != "dev").map(name).collect())
        })
        .collect()
}

#[test]
fn arrows_point_one_way() {
    let dependencies = dependencies();
    let known: BTreeMap<&str, BTreeSet<&str>> =
        ARROWS.iter().map(|(package, allowed)| (*package, allowed.split(' ').collect())).collect();
    for package in known.keys() {
        assert!(dependencies.contains_key(&format!("treewright-{package}")), "there is no {package}");
    }
    for (package, needed) in dependencies.iter().filter(|(package, _)| *package != "treewright-tests") {
        let allowed = known.get(package.trim_start_matches("treewright-"));
        let allowed = allowed.unwrap_or_else(|| panic!("{package} has no place in the order of crates"));
        for name in needed.iter().filter_map(|name| name.strip_prefix("treewright-")) {
            assert!(allowed.contains(name), "{package} must not know {name}");
        }
    }
}

#[test]
fn the_sdk_brings_no_command_line() {
    let of_sdk = ["tree", "--offline", "--package", "treewright-client", "--edges", "normal"];
    let tree = cargo(&[&of_sdk[..], &["--prefix", "none", "--format", "{p}"]].concat());
    assert!(tree.lines().any(|line| line.starts_with("tonic ")), "cargo tree says something else: {tree}");
    for name in NOT_IN_SDK {
        let found = tree.lines().any(|line| line.split(' ').next() == Some(name));
        assert!(!found, "every renderer that links the SDK would get {name}");
    }
}

#[test]
fn pure_crates_do_no_io() {
    let dependencies = dependencies();
    for (package, folder) in PURE {
        for name in &dependencies[*package] {
            assert!(!NOT_IN_PURE.contains(&name.as_str()), "{package} must not depend on {name}");
        }
        for file in super::tidiness::rust_files().filter(|file| file.path.starts_with(folder)) {
            for phrase in NOT_SAID_IN_PURE.split(' ') {
                let says = |line: &&str| !line.trim_start().starts_with("//") && line.contains(phrase);
                if let Some(code) = file.text.lines().find(says) {
                    panic!("{}: {package} must not use {phrase}: {code}", file.path);
                }
            }
        }
    }
}

/// The compiler forbids `unsafe` wherever the workspace's lints hold, and clippy wants an argument for each
/// block. This test checks that they hold everywhere but where Embree or another language begins.
#[test]
fn the_lints_of_the_workspace_hold_everywhere_but_at_the_edges() {
    for package in packages() {
        let path = package["manifest_path"].as_str().expect("a path is text");
        let manifest = std::fs::read_to_string(path).expect("a manifest can be read");
        let inherits = manifest.contains("[lints]\nworkspace = true");
        let is_edge = EDGES.iter().any(|name| package["name"] == *name);
        assert_eq!(inherits, !is_edge, "{path}");
        assert!(manifest.contains("undocumented_unsafe_blocks") || !is_edge, "{path}");
    }
}
