//! The Python package, as an interpreter finds it: its documentation tests and those of
//! `integrations/python/tests/run.py`. The module is the one that cargo built; `make integrations` builds,
//! installs and tries the wheel.

use std::process::Command;

use treewright_tests::daemon::Daemon;

use crate::support::{built, file, has, succeed};

#[test]
fn the_package_does_what_its_documentation_says() {
    if !has("python3", "the Python package") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = folder.path().join("treewright");
    std::fs::create_dir(&package).expect("a folder");
    for entry in std::fs::read_dir(file("python/python/treewright")).expect("the package") {
        let path = entry.expect("an entry").path();
        if path.is_file() {
            std::fs::copy(&path, package.join(path.file_name().expect("a name"))).expect("a copy");
        }
    }
    std::fs::copy(built().join("libtreewright_native.so"), package.join("_native.abi3.so"))
        .expect("the module");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let run = file("python/tests/run.py");
    let said = succeed(Command::new("python3").env("PYTHONPATH", folder.path()).arg(run).arg(daemon.url()));
    assert!(said.ends_with("ok\n"), "{said}");
}
