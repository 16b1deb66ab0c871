//! `treewrightd`: reads the command line, runs the daemon, administers its tokens or maintains its database,
//! and reports how it ended.

use std::io::Write as _;
use std::process::ExitCode;
use std::sync::Arc;

use treewright_server::administration::CommandOutput;
use treewright_server::config::{Cli, Command, ServeConfig};
use treewright_server::metrics::Metrics;
use treewright_server::telemetry::traces::Traces;
use treewright_server::{administration, daemon, inherited, maintenance, manual, telemetry};
use treewright_store::maintenance::MaintenanceError;

fn main() -> ExitCode {
    let command = Cli::read(std::env::args_os()).unwrap_or_else(|error| error.exit()).command;
    if let Command::Serve(config) = &command
        && config.idle_exit().is_some()
    {
        inherited::close_descriptors();
    }
    let runtime = match tokio::runtime::Runtime::new() {
        Ok(runtime) => runtime,
        Err(error) => {
            eprintln!("treewrightd: the system refuses threads: {error}");
            return ExitCode::FAILURE;
        }
    };
    match command {
        Command::Serve(config) => serve(&runtime, *config),
        Command::Token(command) => {
            let done = runtime.block_on(administration::run(&command));
            finish(done.map_err(|error| (error.exit_code(), error.to_string())))
        }
        Command::Backup(config) => finish(maintained(runtime.block_on(maintenance::back_up(&config)))),
        Command::Restore(config) => finish(maintained(runtime.block_on(maintenance::restore(&config)))),
        Command::Check(database) => finish(maintained(runtime.block_on(maintenance::check(&database)))),
        Command::Completions { shell } => finish(Ok(manual::completions(shell))),
        Command::Man { folder } => {
            let written = manual::man(&folder);
            finish(written.map_err(|error| (1, format!("{} cannot be written: {error}", folder.display()))))
        }
    }
}

fn serve(runtime: &tokio::runtime::Runtime, config: ServeConfig) -> ExitCode {
    // Connections to the collector live on the runtime.
    let inside = runtime.enter();
    let traces = match config.otlp.as_deref().map(Traces::to).transpose() {
        Ok(traces) => traces,
        Err(error) => {
            eprintln!("treewrightd: cannot send spans: {error}");
            return ExitCode::FAILURE;
        }
    };
    drop(inside);
    if let Ok(filter) = telemetry::filter(&config.log) {
        telemetry::begin(config.log_format, filter, traces.as_ref());
    }
    let ran = runtime.block_on(daemon::run(config, Arc::new(Metrics::new())));
    if let Some(traces) = traces {
        traces.end();
    }
    match ran {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("treewrightd: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

fn maintained(done: Result<CommandOutput, MaintenanceError>) -> Result<CommandOutput, (u8, String)> {
    done.map_err(|error| (maintenance::exit_code(&error), error.to_string()))
}

/// Prints a command's result, or its cause of failure, and gives the exit code.
fn finish(done: Result<CommandOutput, (u8, String)>) -> ExitCode {
    match done {
        Ok(said) => {
            if !said.note.is_empty() {
                eprintln!("{}", said.note);
            }
            // A token that could not be printed must not count as handed over.
            if !said.out.is_empty()
                && let Err(error) = writeln!(std::io::stdout(), "{}", said.out)
            {
                eprintln!("treewrightd: the result cannot be written: {error}");
                return ExitCode::FAILURE;
            }
            ExitCode::SUCCESS
        }
        Err((code, cause)) => {
            eprintln!("treewrightd: {cause}");
            ExitCode::from(code)
        }
    }
}
