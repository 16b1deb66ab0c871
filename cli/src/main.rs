//! `treewright`: tunes programs, and looks at and steers a tuning daemon, from the command line. A thin main:
//! read the settings and the arguments, do one thing, print it, and say with the exit code how that went.
//!
//! `arguments` says what can be written, `commands` does it, `show` puts answers into words. `study_file` and
//! `carry` read and write studies and their trials, `analysis` says what parameters do, `exec` runs other
//! programs, `local` finds or starts a daemon of one's own.

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
mod settings;
mod show;
mod study_file;

use std::io::Write as _;
use std::process::ExitCode;

use arguments::{Arguments, Command};
use failure::Failure;
use settings::Settings;

fn main() -> ExitCode {
    if let Some(code) = exec::supervisor::run_if_asked() {
        return code;
    }
    let mut settings = Settings::read();
    let arguments = match settings.arguments(std::env::args_os()) {
        Ok(arguments) => arguments,
        Err(error) => error.exit(),
    };
    match run(&arguments, &settings).and_then(|text| print(&text)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if let Failure::Unfinished { found, .. } = &failure {
                // What went wrong counts more than that it cannot be printed.
                let _ = print(found);
            }
            // Nobody may be listening; the exit code says it all the same.
            let _ = writeln!(std::io::stderr(), "treewright: {failure}");
            failure.exit_code()
        }
    }
}

fn run(arguments: &Arguments, settings: &Settings) -> Result<String, Failure> {
    // Who looks for what is wrong must get to see it.
    let looks = matches!(arguments.command, Command::Doctor | Command::Config(_));
    match settings.problem() {
        Some(problem) if !looks => Err(Failure::Usage(problem.to_owned())),
        _ => commands::run(arguments, settings),
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
