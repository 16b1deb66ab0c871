//! Runs a program with scratch folders and checks its end; the test that uses this names it as `PROGRAM`.

use std::path::Path;
use std::process::{Command, Output};

pub(crate) const FAILED: i32 = 1;
pub(crate) const USAGE: i32 = 2;

/// Runs the program with arguments separated by spaces, in a folder of its own.
pub(crate) fn run(folder: &Path, arguments: &str) -> Output {
    Command::new(super::PROGRAM)
        .current_dir(folder)
        .env_remove("TREEWRIGHT_SERVER")
        .args(arguments.split_whitespace())
        .output()
        .expect("the program starts")
}

pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a scratch folder")
}

/// Expects success, and returns the output.
pub(crate) fn succeeds(folder: &Path, arguments: &str) -> String {
    let output = run(folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments}: {errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Expects an exit code and some words on standard error.
pub(crate) fn fails(arguments: &str, code: i32, said: &[&str]) {
    let folder = folder();
    let output = run(folder.path(), arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments}: {errors}");
    assert!(!errors.contains("panicked"), "{arguments}: {errors}");
    for words in said {
        assert!(errors.contains(words), "{arguments}: {words:?} is not in {errors}");
    }
}
