//! The Python package, as an interpreter finds it: its documentation tests and those of
//! `integrations/python/tests/run.py`. The module is the one that cargo built; `make integrations` builds,
//! installs and tries the wheel with packages of others.

use std::process::Command;
use std::time::{Duration, Instant};

use treewright_tests::daemon::Daemon;
use treewright_tests::sandbox::skip;

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

/// The wheel holds the daemon, so pip installs all parts. Only the installed wheel is in sight.
#[test]
fn the_wheel_alone_runs_a_first_trial() {
    let what = "the wheel for Python";
    let folder = tempfile::tempdir().expect("a folder");
    let (python, wheels) = (folder.path().join("env/bin/python"), folder.path().join("wheels"));
    let run = |command: &mut Command| {
        let output = command.output().map_err(|error| error.to_string())?;
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() { Ok(()) } else { Err(said) }
    };
    let made = run(Command::new("python3").args(["-m", "venv"]).arg(folder.path().join("env")));
    if let Err(why) = made {
        return skip(what, &format!("there is no `python3 -m venv`: {why}"));
    }
    let pip = || {
        let mut pip = Command::new(&python);
        let once = ["--retries", "1", "--disable-pip-version-check", "--quiet"];
        pip.args(["-m", "pip"]).args(once).current_dir(folder.path());
        pip
    };
    let mut wheel = pip();
    wheel.env("TREEWRIGHT_BUILT", built()).args(["wheel", "--no-deps", "--wheel-dir"]).arg(&wheels);
    if let Err(why) = run(wheel.arg(file("python"))) {
        assert!(why.contains("hatchling") && why.contains("No matching distribution"), "{why}");
        return skip(what, "what it is built with cannot be had from a registry");
    }
    let begin = Instant::now();
    let wheel = std::fs::read_dir(&wheels).expect("a folder").next().expect("a wheel").expect("an entry");
    succeed(pip().args(["install", "--no-index"]).arg(wheel.path()));
    let home = folder.path().join("home");
    std::fs::create_dir(&home).expect("a folder");
    let mut first = Command::new(&python);
    // A path without the daemon; it ends by itself when nobody asks it anything.
    first.env_clear().env("HOME", &home).env("PATH", "").env("TREEWRIGHT_LOCAL_IDLE_S", "2");
    let said = succeed(first.current_dir(&home).arg(file("python/tests/first.py")));
    assert!(said.contains("<Best leaf=") && said.contains("site-packages"), "{said}");
    assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", begin.elapsed());
}
