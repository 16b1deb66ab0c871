//! Commands that this program hands on to `treewright-lab`, so that a renderer carries none of it.

use std::{ffi::OsString, io::ErrorKind, os::unix::process::CommandExt as _, process::Command};

use clap::Args;

use crate::error::{CliError, Result};

const PROGRAM: &str = "treewright-lab";

/// Whatever stands behind the command's name.
#[derive(Args, Clone, Debug)]
#[command(disable_help_flag = true)]
pub(crate) struct Arguments {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    all: Vec<OsString>,
}

/// Becomes `treewright-lab` with these arguments; returns only when that is not possible.
pub(crate) fn run(command: &str, arguments: &Arguments) -> Result<()> {
    let own = std::env::current_exe()
        .map_err(|error| CliError::Failed(format!("the program's own folder is unknown: {error}")))?;
    let program = own.with_file_name(PROGRAM);
    let error = Command::new(&program).arg(command).args(&arguments.all).exec();
    Err(CliError::Failed(match error.kind() {
        ErrorKind::NotFound => format!(
            "{command} is a command of {PROGRAM}, and {} does not exist; `make build` builds both programs",
            program.display()
        ),
        _ => format!("{} does not start: {error}", program.display()),
    }))
}
