//! The package for Node as `npm pack` makes it, unpacked somewhere else: it holds all files that it reads,
//! and passes its tests. `make integrations` installs it by npm.

use std::path::Path;
use std::process::Command;

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::workspace;

use crate::frozen::answers_what_ran;
use crate::support::{file, has, succeed};

fn copy(from: &Path, to: &Path) {
    succeed(Command::new("cp").arg("-r").args([from, to]));
}

/// Packs a copy of the package that stands as it does in the workspace, and unpacks it into
/// `modules/treewright`.
fn packed(folder: &Path, modules: &Path) {
    let source = folder.join("integrations/javascript");
    std::fs::create_dir_all(&source).expect("a folder");
    for name in ["package.json", "README.md", "src", "examples"] {
        copy(&file("javascript").join(name), &source.join(name));
    }
    for name in ["proto", "LICENSE"] {
        copy(&workspace().join(name), &folder.join(name));
    }
    let pack = ["pack", "--silent", "--offline", "--pack-destination"];
    let cache = folder.join("cache");
    let name = succeed(
        Command::new("npm").current_dir(&source).env("npm_config_cache", cache).args(pack).arg(folder),
    );
    assert!(!source.join("proto").exists(), "packing leaves nothing behind");
    std::fs::create_dir_all(modules).expect("a folder");
    let archive = folder.join(name.trim());
    succeed(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(modules));
    std::fs::rename(modules.join("package"), modules.join("treewright")).expect("it is unpacked");
}

#[test]
fn the_packed_package_works_in_a_folder_of_its_own() {
    if !has("npm", "the package for Node") || !has("node", "the package for Node") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let modules = folder.path().join("program/node_modules");
    packed(folder.path(), &modules);
    let package = modules.join("treewright");
    for name in ["proto/treewright/v1/tuning.proto", "src/index.js", "src/index.d.ts", "LICENSE"] {
        assert!(package.join(name).is_file(), "the package lacks {name}");
    }
    let installed = file("javascript/node_modules");
    if !installed.join("@grpc").is_dir() {
        eprintln!(
            "passed by: the tests of the packed package, because `npm ci` was not run in {}",
            file("javascript").display()
        );
        return;
    }
    for entry in std::fs::read_dir(&installed).expect("the packages of others") {
        let path = entry.expect("an entry").path();
        let link = modules.join(path.file_name().expect("a name"));
        std::os::unix::fs::symlink(&path, link).expect("a link");
    }
    let script = folder.path().join("program/run.mjs");
    let typed = folder.path().join("program/typed.ts");
    std::fs::copy(file("javascript/test/run.js"), &script).expect("the tests");
    std::fs::copy(file("javascript/test/typed.ts"), &typed).expect("the tests of the types");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let node = || Command::new("node");
    assert_eq!(succeed(node().arg(&script).arg(daemon.url())), "ok\n");
    let frames = folder.path().join("program/frames.mjs");
    std::fs::copy(file("javascript/test/frames.js"), &frames).expect("the frames");
    answers_what_ran(daemon.url(), &|| {
        let mut program = node();
        program.arg(&frames);
        program
    });
    let checks = ["--noEmit", "--strict", "--module", "nodenext", "--target", "es2022"];
    succeed(node().arg(modules.join("typescript/bin/tsc")).args(checks).arg(&typed));
    let example = package.join("examples/three_mesh_bvh.js");
    let few = ["--trials", "1", "--rays", "2000", "--url"];
    assert_eq!(succeed(node().arg(example).args(few).arg(daemon.url())).lines().count(), 2);
}
