//! Arrows between the crates point one way, and the pure core stays pure.

use std::collections::{BTreeMap, BTreeSet};

use crate::packages::{cargo, packages};

/// The crates of the workspace that each crate may depend on.
const ARROWS: &[(&str, &[&str])] = &[
    ("treewright-model", &[]),
    ("treewright-proto", &["treewright-model"]),
    ("treewright-core", &["treewright-model"]),
    ("treewright-accel", &[]),
    ("treewright-store", &["treewright-core", "treewright-model"]),
    (
        "treewright-server",
        &[
            "treewright-core",
            "treewright-figures",
            "treewright-model",
            "treewright-proto",
            "treewright-store",
        ],
    ),
    ("treewright-client", &["treewright-model", "treewright-proto"]),
    ("treewright-figures", &[]),
    ("treewright-cli", &["treewright-client", "treewright-figures"]),
    ("treewright-indicators", &[]),
    ("treewright-scene", &["treewright-accel", "treewright-indicators"]),
    (
        "treewright-renderer",
        &["treewright-accel", "treewright-client", "treewright-model", "treewright-scene"],
    ),
    (
        "treewright-render-cli",
        &[
            "treewright-accel",
            "treewright-client",
            "treewright-figures",
            "treewright-renderer",
            "treewright-scene",
        ],
    ),
    // No crate may depend on the laboratory; it also judges the core's searches and predictors.
    (
        "treewright-lab",
        &[
            "treewright-accel",
            "treewright-client",
            "treewright-core",
            "treewright-figures",
            "treewright-render-cli",
            "treewright-renderer",
            "treewright-scene",
        ],
    ),
    ("treewright-c", &["treewright-client", "treewright-indicators"]),
    ("treewright-probe", &[]),
    ("treewright-python", &["treewright-client"]),
    ("treewright-builders", &["treewright-client", "treewright-indicators"]),
    // For ports that stay free while the server is away.
    ("treewright-test-postgres", &["treewright-tests"]),
    (
        "treewright-fuzz",
        &[
            "treewright-cli",
            "treewright-client",
            "treewright-core",
            "treewright-model",
            "treewright-proto",
            "treewright-scene",
            "treewright-server",
            "treewright-store",
        ],
    ),
    (
        "treewright-simulation",
        &["treewright-core", "treewright-model", "treewright-proto", "treewright-server", "treewright-store"],
    ),
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
const NOT_SAID_IN_PURE: &[&str] = &[
    "std::fs",
    "std::io",
    "std::net",
    "std::env",
    "std::thread",
    "SystemTime",
    "Instant::now",
    "thread_rng",
];

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
    for (package, allowed) in ARROWS {
        let ours = dependencies[*package].iter().filter(|name| name.starts_with("treewright-"));
        for name in ours {
            assert!(allowed.contains(&name.as_str()), "{package} must not know {name}");
        }
    }
    for package in dependencies.keys().filter(|name| *name != "treewright-tests") {
        assert!(
            ARROWS.iter().any(|(known, _)| known == package),
            "{package} has no place in the order of crates"
        );
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
            for phrase in NOT_SAID_IN_PURE {
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
