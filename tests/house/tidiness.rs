//! Files are short, have a head that describes them, and carry no leftovers.

use std::path::Path;

use treewright_tests::programs::workspace;

/// Longest Rust file. One room, one purpose.
const LINES_MAX: usize = 600;

/// Widest line of a comment, in characters, as of code. Tables, code and commands may be wider.
const COLUMNS_MAX: usize = 110;

/// Marks of unfinished work. Split so that this file does not find itself.
const LEFTOVERS: &[&str] =
    &[concat!("todo", "!("), concat!("unimplemented", "!("), concat!("#[ig", "nore"), concat!("FIX", "ME")];

/// A source file of the workspace.
pub(crate) struct File {
    /// Path below the top folder.
    pub(crate) path: String,
    pub(crate) text: String,
}

/// Every Rust file of the workspace; build folders and generated code are left out.
pub(crate) fn rust_files() -> impl Iterator<Item = File> {
    let mut found = Vec::new();
    let top = workspace();
    for folder in ["model", "proto", "server", "client", "cli", "renderer", "integrations", "lab", "tests"] {
        collect(&top, &top.join(folder), &mut found);
    }
    assert!(found.len() > 20, "the source files were not found");
    found.into_iter()
}

fn collect(top: &Path, folder: &Path, found: &mut Vec<File>) {
    for entry in std::fs::read_dir(folder).expect("a source folder can be read") {
        let path = entry.expect("a source folder can be listed").path();
        if path.is_dir() {
            if !path.ends_with("target") && !path.ends_with("generated") {
                collect(top, &path, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).expect("a source file is text");
            let path = path.strip_prefix(top).expect("it lies below the top").to_string_lossy().into_owned();
            found.push(File { path, text });
        }
    }
}

#[test]
fn files_fit_in_the_head() {
    for file in rust_files() {
        let lines = file.text.lines().count();
        assert!(
            lines <= LINES_MAX,
            "{} has {lines} lines; split it by meaning (limit {LINES_MAX})",
            file.path
        );
    }
}

#[test]
fn comments_are_as_narrow_as_code() {
    for file in rust_files() {
        for (place, line) in file.text.lines().enumerate() {
            let Some(comment) = line.trim_start().strip_prefix("//") else { continue };
            let words = comment.trim_start_matches(['/', '!']);
            let is_prose = !words.starts_with("    ") && !words.trim_start().starts_with(['|', '`']);
            assert!(
                !is_prose || line.chars().count() <= COLUMNS_MAX,
                "{}:{} is wider than {COLUMNS_MAX} columns",
                file.path,
                place + 1
            );
        }
    }
}

#[test]
fn every_module_says_what_it_is() {
    for file in rust_files() {
        assert!(
            file.text.starts_with("//!"),
            "{} does not begin with a line `//! what, why, source`",
            file.path
        );
    }
}

#[test]
fn nothing_is_left_lying_about() {
    for file in rust_files() {
        for mark in LEFTOVERS {
            assert!(!file.text.contains(mark), "{} still holds {mark:?}", file.path);
        }
    }
}
