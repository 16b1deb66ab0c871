//! Completions for shells and manual pages, made from the definition of the command line.

use std::path::Path;

use clap::CommandFactory as _;

use crate::arguments::Arguments;
use crate::failure::{Failure, Result};

/// The script with which a shell completes commands.
pub(super) fn completions(shell: clap_complete::Shell) -> String {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "treewright", &mut text);
    String::from_utf8_lossy(&text).into_owned()
}

/// Writes a manual page for each command, and says where.
pub(super) fn man(folder: &Path) -> Result<String> {
    let problem = |error: std::io::Error| Failure::file(folder, error.to_string());
    std::fs::create_dir_all(folder).map_err(problem)?;
    clap_mangen::generate_to(Arguments::command(), folder).map_err(problem)?;
    Ok(format!("the manual is in {}: man -l {}\n", folder.display(), folder.join("treewright.1").display()))
}
