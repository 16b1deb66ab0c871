//! Completions for shells and manual pages, made from the command line itself.

use std::path::Path;

use clap::CommandFactory as _;

use crate::administration::CommandOutput;
use crate::config::Cli;

/// The completion script of a shell.
pub fn completions(shell: clap_complete::Shell) -> CommandOutput {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "treewrightd", &mut text);
    CommandOutput { out: String::from_utf8_lossy(&text).into_owned(), note: String::new() }
}

/// Writes a manual page for each command, and names the folder.
pub fn man(folder: &Path) -> std::io::Result<CommandOutput> {
    std::fs::create_dir_all(folder)?;
    clap_mangen::generate_to(Cli::command(), folder)?;
    let page = folder.join("treewrightd.1");
    let out = format!("the manual is in {}: man -l {}", folder.display(), page.display());
    Ok(CommandOutput { out, note: String::new() })
}
