//! `treewright`: tunes programs, and looks at and steers a tuning daemon, from the command line. A thin main:
//! it reads the arguments, runs one command, prints the answer and returns an exit code.
//!
//! `arguments` defines the command line, `commands` runs it, `show` puts answers into words. `study_file` and
//! `carry` read and write studies and their trials, `analysis` measures the influence of parameters, `exec`
//! runs other programs, and `local` finds or starts the user's own daemon.

mod analysis;
mod arguments;
mod carry;
mod commands;
mod exec;
mod failure;
mod files;
mod output;
mod progress;
mod setting_flags;
mod show;
mod study_file;

use std::io::Write as _;
use std::process::ExitCode;

use arguments::Arguments;
use failure::{Failure, Result};
use treewright_client::parse_arguments;

fn main() -> ExitCode {
    if let Some(code) = exec::supervisor::run_if_asked() {
        return code;
    }
    let arguments: Arguments = parse_arguments();
    match commands::run(&arguments).and_then(|text| print(&text)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if let Failure::Unfinished { found, .. } = &failure {
                // The failure counts more than an error of printing.
                let _ = print(found);
            }
            // Standard error may be closed; the exit code reports the failure anyway.
            let _ = writeln!(std::io::stderr(), "treewright: {failure}");
            failure.exit_code()
        }
    }
}

/// Prints to standard output. A reader that has seen enough, like `head`, is no failure.
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.map_err(Failure::Output),
    }
}
