//! One function per command: ask the daemon, and turn the answer into text. `studies`, `trials`, `steer`, `shell` and
//! `carry` hold those of one field each.

mod analyze;
mod carry;
mod doctor;
mod machine;
mod shell;
mod steer;
mod studies;
mod trials;
mod watch;

use std::time::{Duration, Instant};

use treewright_client::blocking::Client;
use treewright_client::{ClientError, Options};

use crate::arguments::study::StudyCommand;
use crate::arguments::{Arguments, Command, ConfigCommand};
use crate::failure::Failure;
use crate::output::either;
use crate::settings::Settings;
use crate::study_file;
use crate::{exec, progress, show};
use treewright_client::local::{self, LocalDaemon};

/// Time between two questions to a daemon that is not ready.
const PATIENCE: Duration = Duration::from_millis(200);
/// Where a daemon listens that was started without saying where.
const USUAL: &str = "http://127.0.0.1:50611";
/// The word for a daemon of one's own.
const LOCAL: &str = "local";

/// Does what the command line says and returns what is to be printed.
pub(crate) fn run(arguments: &Arguments, settings: &Settings) -> Result<String, Failure> {
    let json = arguments.json;
    // These need no daemon.
    match &arguments.command {
        Command::Study(StudyCommand::Schema) => return either(true, &study_file::schema(), String::new),
        Command::Config(ConfigCommand::Show) => return settings.show(arguments, json),
        Command::Config(ConfigCommand::Check) => return settings.check(json),
        Command::Completions { shell } => return Ok(machine::completions(*shell)),
        Command::Man { folder } => return machine::man(folder),
        Command::Doctor => return doctor::run(arguments, settings),
        _ => {}
    }
    let client = connect(arguments)?;
    let begun = Instant::now();
    loop {
        match ask(&client, arguments) {
            // A daemon that was just started reads a long study into memory first.
            Err(Failure::Client(ClientError::NotNow { .. }))
                if is_repeatable(&arguments.command) && begun.elapsed() < arguments.timeout =>
            {
                std::thread::sleep(PATIENCE);
            }
            done => return done,
        }
    }
}

/// Whether a command may be done again after a part of it was done.
fn is_repeatable(command: &Command) -> bool {
    matches!(
        command,
        Command::Suggest(_)
            | Command::Report(_)
            | Command::Studies { .. }
            | Command::Trials(_)
            | Command::Analyze(_)
            | Command::Best(_)
            | Command::Predict(_)
            | Command::Explain(_)
            | Command::Policy(_)
            | Command::Pin(_)
            | Command::Unpin { .. }
            | Command::Freeze { .. }
            | Command::Thaw { .. }
            | Command::Import(_)
    )
}

/// Does what needs a daemon.
fn ask(client: &Client, arguments: &Arguments) -> Result<String, Failure> {
    let json = arguments.json;
    match &arguments.command {
        Command::Exec(exec) => exec::run(client, exec, json),
        Command::Suggest(ask) => shell::suggest(client, ask, json),
        Command::Report(report) => shell::report(client, report, json),
        Command::Studies { standing: false } => studies::list(client, json),
        Command::Studies { standing: true } => studies::standings(client, json),
        Command::Study(command) => studies::run(client, command, json),
        Command::Trials(which) => trials::list(client, which, json),
        Command::Analyze(wanted) => analyze::run(client, wanted, json),
        Command::Best(state) => trials::best(client, state, json),
        Command::Predict(state) => trials::predict(client, state, json),
        Command::Explain(state) => trials::explain(client, state, json),
        Command::Policy(change) => steer::policy(client, change, json),
        Command::Pin(pin) => steer::pin(client, pin, json),
        Command::Unpin { study } => steer::unpin(client, study, json),
        Command::Freeze { study } => steer::freeze(client, study, true, json),
        Command::Thaw { study } => steer::freeze(client, study, false, json),
        Command::Export(export) => carry::export(client, export),
        Command::Import(import) => carry::import(client, import, json),
        Command::Watch(watch) => watch::run(client, watch, json),
        Command::Ping => ping(client, json),
        // These need none.
        Command::Config(_) | Command::Completions { .. } | Command::Man { .. } | Command::Doctor => {
            Ok(String::new())
        }
    }
}

/// The daemon that the arguments mean.
fn connect(arguments: &Arguments) -> Result<Client, Failure> {
    let url = address(arguments)?;
    let options =
        Options::new().call_deadline(arguments.timeout).credentials(arguments.credentials.credentials()?);
    Ok(Client::connect(&url, options)?)
}

/// Its address. Where none is said: the usual one if somebody answers there, else the local one.
fn address(arguments: &Arguments) -> Result<String, Failure> {
    match arguments.server.as_deref() {
        Some(LOCAL) => Ok(LocalDaemon::of_user()?.start(progress::note)?),
        Some(url) => Ok(url.to_owned()),
        None if local::answers(USUAL) => Ok(USUAL.to_owned()),
        None => {
            let local = LocalDaemon::of_user()?;
            // Who only looks needs no new one, unless there is something to look at.
            if needs_a_daemon(&arguments.command) || local.database().exists() {
                Ok(local.start(progress::note)?)
            } else {
                Ok(USUAL.to_owned())
            }
        }
    }
}

/// Whether a command makes something, for which a daemon is started where there is none.
fn needs_a_daemon(command: &Command) -> bool {
    matches!(
        command,
        Command::Exec(_)
            | Command::Suggest(_)
            | Command::Import(_)
            | Command::Study(StudyCommand::Create { .. })
    )
}

fn ping(client: &Client, json: bool) -> Result<String, Failure> {
    // The first answer includes connecting; the second says how far away the daemon is.
    client.ping()?;
    let round_trip_ms = client.ping()?.as_secs_f64() * 1e3;
    let record =
        serde_json::json!({ "server": client.url(), "serving": true, "round_trip_ms": round_trip_ms });
    either(json, &record, || show::ping(client.url(), round_trip_ms))
}
