//! `treewrightd`: reads the command line, runs the daemon, reports how it ended.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use treewright_server::config::{Cli, Command};
use treewright_server::{daemon, telemetry};

fn main() -> ExitCode {
    let Command::Serve(config) = match Cli::read(std::env::args_os()) {
        Ok(cli) => cli.command,
        Err(error) => error.exit(),
    };
    if let Ok(filter) = telemetry::filter(&config.log) {
        telemetry::begin(config.log_format, filter);
    }
    let runtime = match tokio::runtime::Runtime::new() {
        Ok(runtime) => runtime,
        Err(error) => {
            eprintln!("treewrightd: the system refuses threads: {error}");
            return ExitCode::FAILURE;
        }
    };
    match runtime.block_on(daemon::run(config)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("treewrightd: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
