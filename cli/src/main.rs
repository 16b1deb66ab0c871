//! `treewright`: looks at a tuning daemon from the command line. A thin main: read the arguments, do one
//! thing, print it, and say with the exit code how that went.

mod arguments;
mod commands;
mod failure;
mod setting_flags;
mod show;

use std::io::Write as _;
use std::process::ExitCode;

use clap::Parser as _;

use arguments::Arguments;
use failure::Failure;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match commands::run(&arguments).and_then(|text| print(&text)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // Nobody may be listening; the exit code says it all the same.
            let _ = writeln!(std::io::stderr(), "treewright: {failure}");
            failure.exit_code()
        }
    }
}

/// Prints to standard output. A reader that has seen enough, like `head`, is no failure.
fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.map_err(Failure::Output),
    }
}
