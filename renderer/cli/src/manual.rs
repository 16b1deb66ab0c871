//! Completions for shells and manual pages of a program, made from its command line.

use std::path::PathBuf;

use clap::Subcommand;

use crate::error::{CliError, Result};

/// The commands that each program has besides its own.
#[derive(Clone, Debug, Subcommand)]
pub enum ManualCommand {
    /// Print the completion script for a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Write the manual pages.
    Man {
        /// Folder to write them to.
        folder: PathBuf,
    },
}

impl ManualCommand {
    /// Carries it out for the program with this command line.
    pub fn run(&self, mut program: clap::Command) -> Result<()> {
        let name = program.get_name().to_owned();
        match self {
            Self::Completions { shell } => {
                let mut text = Vec::new();
                clap_complete::generate(*shell, &mut program, name, &mut text);
                print!("{}", String::from_utf8_lossy(&text));
            }
            Self::Man { folder } => {
                let problem = |error: std::io::Error| {
                    CliError::Failed(format!("{} cannot be written: {error}", folder.display()))
                };
                std::fs::create_dir_all(folder).map_err(problem)?;
                clap_mangen::generate_to(program, folder).map_err(problem)?;
                let page = folder.join(format!("{name}.1"));
                println!("the manual is in {}: man -l {}", folder.display(), page.display());
            }
        }
        Ok(())
    }
}
