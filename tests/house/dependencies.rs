//! An audit of all linked crates, as far as possible without a network: their sources, licences, versions and
//! cryptography.
//!
//! It cannot know the published weaknesses of a crate, because the advisory database is on the network. Where
//! there is a network, `cargo audit` reads `Cargo.lock` and lists them.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::packages::metadata;

/// Licences that allow to use, change and pass on the whole, with a notice at most.
const LICENCES: &[&str] = &[
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    // The public domain, or as near to it as a country lets.
    "CC0-1.0",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Crates that name a file in place of a licence, and the licence in it, as read by a person.
const READ: &[(&str, &str)] = &[
    // The MIT licence.
    ("embree4-sys", "LICENSE"),
];

/// Where crates may come from. Lock files keep a checksum of each.
const SOURCE: &str = "registry+https://github.com/rust-lang/crates.io-index";

/// Crates that stand in the lock file in several versions, because crates that we use ask for different ones.
/// A new one is worth a look: two versions are twice the code to watch, and their types do not fit each
/// other.
const SEVERAL_VERSIONS: &str = "\
    base64 bit-vec block-buffer cpufeatures crypto-common digest foldhash getrandom glam hashbrown \
    itertools linux-raw-sys miniz_oxide num-bigint r-efi rand rand_chacha rand_core rustc-hash rustix \
    sha2 shlex syn unicode-width windows-sys";

/// There is one implementation of TLS, rustls on ring; these would be others.
const OTHER_TLS: &[&str] = &["openssl", "openssl-sys", "native-tls", "boring", "boring-sys", "aws-lc-sys"];

fn text<'a>(package: &'a Value, key: &str) -> &'a str {
    package[key].as_str().unwrap_or_default()
}

/// Whether an SPDX expression can be met with [`LICENCES`] alone. Older crates write `/` for `OR`. `AND`
/// binds closer than `OR`; parentheses stand around alternatives only.
fn is_free(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ");
    if let Some((before, rest)) = expression.split_once('(') {
        let Some((inner, after)) = rest.split_once(')') else {
            return false;
        };
        // A group that can be met stands for a licence that can, and the other way round.
        let inner = if is_free(inner) { LICENCES[0] } else { "none" };
        return is_free(&format!("{before}{inner}{after}"));
    }
    let is_known = |licence: &str| LICENCES.contains(&licence.trim());
    expression.split(" OR ").any(|all| all.split(" AND ").all(is_known))
}

#[test]
fn expressions_are_read_rightly() {
    for (expression, free) in [
        ("MIT", true),
        ("GPL-3.0-only", false),
        ("MIT OR GPL-3.0-only", true),
        ("MIT/Apache-2.0", true),
        ("Apache-2.0 / MIT", true),
        ("MIT AND GPL-3.0-only", false),
        ("(MIT OR GPL-3.0-only) AND Unicode-3.0", true),
        ("(GPL-2.0-only OR GPL-3.0-only) AND MIT", false),
        ("Apache-2.0 WITH LLVM-exception OR GPL-3.0-only", true),
        ("(MIT", false),
        ("", false),
    ] {
        assert_eq!(is_free(expression), free, "{expression:?}");
    }
}

#[test]
fn dependencies_may_be_used_and_come_from_one_place() {
    let mut problems = Vec::new();
    for package in metadata(&[]) {
        let name = text(&package, "name");
        match package["source"].as_str() {
            None | Some(SOURCE) => {}
            Some(other) => problems.push(format!("{name} comes from {other}")),
        }
        let ours = package["source"].is_null();
        let licence = text(&package, "license");
        let was_read = READ.contains(&(name, text(&package, "license_file")));
        if !ours && !is_free(licence) && !was_read {
            problems.push(format!("{name} is under {licence:?}"));
        }
        if OTHER_TLS.contains(&name) {
            problems.push(format!("{name} is another implementation of TLS"));
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
}

#[test]
fn what_stands_there_in_several_versions_is_known() {
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for package in metadata(&[]) {
        versions.entry(text(&package, "name").into()).or_default().insert(text(&package, "version").into());
    }
    versions.retain(|_, versions| versions.len() > 1);
    let found: BTreeSet<&str> = versions.keys().map(String::as_str).collect();
    let known: BTreeSet<&str> = SEVERAL_VERSIONS.split(' ').collect();
    let new: Vec<_> = found.difference(&known).map(|name| (name, &versions[*name])).collect();
    assert!(new.is_empty(), "in several versions now: {new:?}");
    let gone: Vec<_> = known.difference(&found).collect();
    assert!(gone.is_empty(), "in one version now, so no longer an exception: {gone:?}");
}
