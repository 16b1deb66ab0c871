//! Packages to publish and to install: each says its purpose and holds all its sources, and the files that
//! the Debian package and the archive name exist.

use std::collections::BTreeSet;
use std::process::Command;

use serde_json::Value;
use treewright_tests::programs::{program, workspace};
use treewright_tests::sandbox::skip;

fn command(arguments: &[&str]) -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(workspace()).args(arguments);
    cargo
}

/// The output of cargo in the workspace.
pub(crate) fn cargo(arguments: &[&str]) -> String {
    let output = command(arguments).output().expect("cargo runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// The packages of the lock file, those of the workspace alone with `--no-deps`.
pub(crate) fn metadata(more: &[&str]) -> Vec<Value> {
    let plain = ["metadata", "--format-version", "1", "--locked", "--offline"];
    let metadata: Value = serde_json::from_str(&cargo(&[&plain[..], more].concat())).expect("JSON");
    metadata["packages"].as_array().expect("packages").clone()
}

pub(crate) fn packages() -> Vec<Value> {
    metadata(&["--no-deps"])
}

#[test]
fn every_package_says_what_it_is() {
    for package in packages() {
        let name = package["name"].as_str().expect("a name");
        let description = package["description"].as_str().unwrap_or_default();
        assert!(description.len() > 20 && !description.ends_with('.'), "{name}: {description:?}");
        assert_eq!(package["license"], "MIT", "{name}");
        assert!(package["rust_version"].is_string(), "{name} says nothing of the compiler");
        // `null` is anywhere, a list names where.
        if package["publish"].is_null() {
            let says = |key: &str| package[key].as_array().is_some_and(|words| !words.is_empty());
            assert!(says("keywords") && says("categories"), "{name} cannot be found by what it is for");
            assert!(package["readme"].is_string(), "{name} has no README.md");
        }
    }
}

#[test]
fn packages_hold_what_they_are_built_from() {
    for (package, needed) in [
        ("treewright-model", &["Cargo.toml", "src/lib.rs"][..]),
        (
            "treewright-proto",
            &["src/generated/treewright.v1.rs", "treewright/v1/tuning.proto", "treewright/v1/study.proto"],
        ),
        ("treewright-client", &["src/lib.rs", "examples/integrate.rs"]),
        ("treewright-cli", &["src/main.rs"]),
        ("treewright-core", &["src/lib.rs", "clippy.toml"]),
        (
            "treewright-server",
            &["src/main.rs", "assets/live.js", "templates/study.html", "deploy/treewrightd.socket"],
        ),
    ] {
        let listed = cargo(&["package", "--list", "--allow-dirty", "--offline", "-p", package]);
        let listed: BTreeSet<&str> = listed.lines().collect();
        let missing: Vec<_> = needed.iter().filter(|name| !listed.contains(**name)).collect();
        assert!(missing.is_empty(), "{package} lacks {missing:?}");
    }
}

/// The libraries for other programs. The daemon is handed out as a program: its migrations lie outside of its
/// package.
#[test]
fn libraries_can_be_packaged() {
    let folder = std::env::temp_dir().join(format!("treewright-packages-{}", std::process::id()));
    let target = folder.to_str().expect("text");
    let options = "package --no-verify --allow-dirty --offline --locked --quiet --target-dir";
    let mut arguments: Vec<&str> = options.split(' ').chain([target]).collect();
    let libraries = ["model", "proto", "client", "core", "figures", "cli", "indicators"];
    let libraries = libraries.map(|name| format!("treewright-{name}"));
    arguments.extend(libraries.iter().flat_map(|name| ["-p", name.as_str()]));
    cargo(&arguments);
    let version = packages()[0]["version"].as_str().expect("a version").to_owned();
    let missing: Vec<_> = libraries
        .iter()
        .filter(|name| !folder.join("package").join(format!("{name}-{version}.crate")).exists())
        .collect();
    std::fs::remove_dir_all(&folder).expect("it is removed");
    assert!(missing.is_empty(), "{missing:?} are not there");
}

#[test]
fn the_debian_package_finds_what_it_names() {
    let all = packages();
    let server = all.iter().find(|package| package["name"] == "treewright-server").expect("the server");
    let deb = &server["metadata"]["deb"];
    assert!(deb["copyright"].is_string(), "cargo-deb makes no package without a copyright or authors");
    for asset in deb["assets"].as_array().expect("assets") {
        let source = asset[0].as_str().expect("a path");
        // Built files are not there before; patterns name a folder.
        if !source.contains("target/") {
            let fixed = source.split('*').next().expect("a beginning");
            assert!(workspace().join("server").join(fixed).exists(), "{source}");
        }
    }
    for unit in ["treewrightd.service", "treewrightd.socket"] {
        assert!(workspace().join("server/deploy").join(unit).exists(), "{unit}");
    }
}

/// As `make deb` makes it, of the programs that are tested.
#[test]
fn the_debian_package_can_be_made() {
    let works = |command: &mut Command| command.output().is_ok_and(|output| output.status.success());
    if !works(&mut command(&["deb", "--version"])) || !works(Command::new("dpkg-deb").arg("--version")) {
        return skip("the Debian package", "cargo-deb or dpkg-deb is not installed");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let built = folder.path().join("release");
    std::fs::create_dir(&built).expect("a folder");
    for name in ["treewrightd", "treewright"] {
        std::fs::copy(program(name), built.join(name)).expect("a copy");
    }
    let file = folder.path().join("treewright.deb");
    let options = ["deb", "-p", "treewright-server", "--no-build", "--no-strip", "--fast", "--output"];
    let made = command(&options).arg(&file).env("CARGO_TARGET_DIR", folder.path()).output();
    let made = made.expect("cargo runs");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let listed = Command::new("dpkg-deb").arg("--contents").arg(&file).output().expect("it runs");
    let listed = String::from_utf8_lossy(&listed.stdout);
    for name in [
        "/usr/bin/treewrightd",
        "/usr/bin/treewright\n",
        "/usr/share/doc/treewright/exec.md",
        "systemd/system/treewrightd.service",
        "systemd/system/treewrightd.socket",
    ] {
        assert!(listed.contains(name), "{name} is not in\n{listed}");
    }
}

#[test]
fn the_archive_finds_its_pages_and_what_they_link_to() {
    let script = workspace().join("tools/dist.py");
    let checked = Command::new("python3").arg(script).arg("--links").output().expect("Python is installed");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}

#[test]
fn the_changelog_tells_of_this_version() {
    let version = packages()[0]["version"].as_str().expect("a version").to_owned();
    let log = std::fs::read_to_string(workspace().join("CHANGELOG.md")).expect("the changelog");
    let first = log.lines().filter_map(|line| line.strip_prefix("## ")).next().expect("a version");
    assert!(first == "Unreleased" || first == version, "{first} stands before {version}");
    assert!(log.contains(&format!("\n## {version}\n")), "{version} is not there");
}
