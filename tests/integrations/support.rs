//! Helpers for the tests of all languages.

use std::path::PathBuf;
use std::process::{Command, Output};

use treewright_tests::programs::{program, workspace};

/// Runs a command to its end and returns its standard output.
pub(crate) fn succeed(command: &mut Command) -> String {
    let shown = format!("{command:?}");
    let output: Output = command.output().unwrap_or_else(|error| panic!("{shown} does not start: {error}"));
    let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let all = [&output.stdout, &output.stderr].map(|text| said(text)).concat();
    assert!(output.status.success(), "{shown}: {}\n{all}", output.status);
    said(&output.stdout)
}

/// Whether a tool is there; says so in one line where it is not.
pub(crate) fn has(tool: &str, test: &str) -> bool {
    let found = Command::new(tool).arg("--version").output().is_ok_and(|output| output.status.success());
    if !found {
        eprintln!("passed by: {test}, because there is no {tool}");
    }
    found
}

/// The folder of the workspace's built programs and libraries.
pub(crate) fn built() -> PathBuf {
    program("libtreewright.so").parent().expect("a folder").to_path_buf()
}

pub(crate) fn file(path: &str) -> PathBuf {
    workspace().join("integrations").join(path)
}
