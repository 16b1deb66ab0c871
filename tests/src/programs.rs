//! Finds the workspace's programs, building them first so that a test never runs a stale one; or takes
//! earlier builds from the folder that `TREEWRIGHT_PROGRAMS` names.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The workspace's top folder.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the tests lie one level below the top")
        .to_path_buf()
}

/// Path of a program of the workspace, `treewrightd`, `treewright` or `treewright-render`, or of a shared
/// library such as `libtreewright.so`.
pub fn program(name: &str) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        if let Some(folder) = std::env::var_os("TREEWRIGHT_PROGRAMS") {
            return PathBuf::from(folder);
        }
        let test = std::env::current_exe().expect("a test knows its own path");
        let folder = test.ancestors().nth(2).expect("tests lie in PROFILE/deps").to_path_buf();
        let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        build.current_dir(workspace()).args(["build", "--workspace", "--bins", "--lib", "--quiet"]);
        // Cargo's variables about this test's own package are not meant for others: some build scripts depend
        // on them, and half the workspace would be built again each time.
        for (name, _) in std::env::vars_os() {
            let name = name.to_string_lossy();
            if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") {
                build.env_remove(&*name);
            }
        }
        if folder.ends_with("release") {
            build.arg("--release");
        }
        assert!(build.status().expect("cargo runs").success(), "the programs do not build");
        folder
    });
    folder.join(name)
}

/// Runs a program to its end, from a folder that is not the checkout.
pub fn run(name: &str, arguments: &[&str]) -> Output {
    Command::new(program(name))
        .current_dir(std::env::temp_dir())
        .env_remove("TREEWRIGHT_SERVER")
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("{name} does not start: {error}"))
}

/// Makes a token for the daemon of a database, with the daemon's own command.
pub fn token(database: &Path, more: &[&str]) -> String {
    let database = database.to_str().expect("a path of text");
    let mut arguments = vec!["token", "create", "--database", database, "--name", "a test"];
    arguments.extend(more);
    let made = run("treewrightd", &arguments);
    assert!(made.status.success(), "{}", stderr(&made));
    stdout(&made).trim().to_owned()
}

/// Standard error of a finished program as text.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Standard output of a finished program as text.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}
