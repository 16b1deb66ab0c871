//! One function per command: ask the daemon, and turn the answer into text. `studies`, `trials`, `steer`,
//! `shell` and `carry` hold those of one field each.

mod analyze;
mod carry;
mod doctor;
mod front;
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
use crate::arguments::{Arguments, Command};
use crate::failure::{Failure, Result};
use crate::output::either;
use crate::study_file;
use crate::{exec, progress, show};
use treewright_client::local::{self, LocalDaemon};

/// Time between two questions to a daemon that is not ready.
const PATIENCE: Duration = Duration::from_millis(200);
/// Where a daemon listens that was started without saying where.
const USUAL: &str = "http://127.0.0.1:50611";
/// The word for a daemon of one's own.
const LOCAL: &str = "local";

/// Runs the command and returns the text to print.
pub(crate) fn run(arguments: &Arguments) -> Result<String> {
    // These need no daemon.
    match &arguments.command {
        Command::Study(StudyCommand::Schema) => return either(true, &study_file::schema(), String::new),
        Command::Completions { shell } => return Ok(machine::completions(*shell)),
        Command::Man { folder } => return machine::man(folder),
        Command::Doctor => return doctor::run(arguments),
        _ => {}
    }
    let address = address(arguments)?;
    let client = connect(&address.url, arguments)?;
    let begun = Instant::now();
    loop {
        match ask(&client, &address, arguments) {
            Err(Failure::Client(problem))
                if is_worth_repeating(&arguments.command, &problem)
                    && begun.elapsed() < arguments.timeout =>
            {
                std::thread::sleep(PATIENCE);
            }
            done => return done,
        }
    }
}

/// Whether a command may succeed a little later.
fn is_worth_repeating(command: &Command, problem: &ClientError) -> bool {
    match problem {
        // A daemon that was just started reads a long study into memory first.
        ClientError::NotNow { .. } => is_repeatable(command),
        // A restart of the daemon does not lose a measurement.
        _ => problem.may_pass() && matches!(command, Command::Report(_)),
    }
}

/// Whether a command may be done again after a part of it was done.
fn is_repeatable(command: &Command) -> bool {
    match command {
        Command::Study(command) => matches!(command, StudyCommand::Edit(_)),
        Command::Exec(_) | Command::Export(_) | Command::Ping => false,
        // Those that need no daemon do not come here.
        _ => true,
    }
}

/// Does what needs a daemon.
fn ask(client: &Client, address: &Address, arguments: &Arguments) -> Result<String> {
    let json = arguments.json;
    match &arguments.command {
        Command::Exec(exec) => {
            let service = exec::Service { client, timeout: arguments.timeout, is_local: address.is_local };
            exec::run(&service, exec, json)
        }
        Command::Suggest(ask) => shell::suggest(client, ask, json),
        Command::Report(report) => shell::report(client, report, json),
        Command::Studies { standing: false, tags } => studies::list(client, tags, json),
        Command::Studies { standing: true, tags } => studies::standings(client, tags, json),
        Command::Study(command) => studies::run(client, command, json),
        Command::Trials(which) => trials::list(client, which, json),
        Command::Analyze(wanted) => analyze::run(client, wanted, json),
        Command::Front(wanted) => front::run(client, wanted, json),
        Command::Best(state) => trials::best(client, state, json),
        Command::Predict(state) => trials::predict(client, state, json),
        Command::Explain(state) => trials::explain(client, state, json),
        Command::Policy(change) => steer::policy(client, change, json),
        Command::Pin(pin) => steer::pin(client, pin, json),
        Command::Unpin { study } => steer::unpin(client, study, json),
        Command::Freeze { study } => steer::freeze(client, study, true, json),
        Command::Thaw { study } => steer::freeze(client, study, false, json),
        Command::Exclude { trial, reason } => trials::exclude(client, trial, Some(reason.as_str()), json),
        Command::Include { trial } => trials::exclude(client, trial, None, json),
        Command::Export(export) => carry::export(client, export),
        Command::Import(import) => carry::import(client, import, json),
        Command::Watch(watch) => watch::run(client, watch, json),
        Command::Ping => ping(client, json),
        // These need none.
        Command::Completions { .. } | Command::Man { .. } | Command::Doctor => Ok(String::new()),
    }
}

fn connect(url: &str, arguments: &Arguments) -> Result<Client> {
    let options =
        Options::new().call_deadline(arguments.timeout).credentials(arguments.credentials.credentials()?);
    Ok(Client::connect(url, options)?)
}

struct Address {
    url: String,
    /// It is the user's own, which is started when it is needed.
    is_local: bool,
}

/// The daemon's address. Without one in the arguments: the usual address if a daemon answers there, else
/// that of the local daemon.
fn address(arguments: &Arguments) -> Result<Address> {
    let elsewhere = |url: &str| Address { url: url.to_owned(), is_local: false };
    let here = |local: LocalDaemon| -> Result<Address> {
        Ok(Address { url: local.start(progress::note)?, is_local: true })
    };
    match arguments.server.as_deref() {
        Some(LOCAL) => here(LocalDaemon::of_user()?),
        Some(url) => Ok(elsewhere(url)),
        None if local::answers(USUAL) => Ok(elsewhere(USUAL)),
        None => {
            let local = LocalDaemon::of_user()?;
            // A command that only reads starts a daemon only where a database exists.
            if needs_a_daemon(&arguments.command) || local.database().exists() {
                here(local)
            } else {
                Ok(elsewhere(USUAL))
            }
        }
    }
}

/// Whether a command writes something. A daemon is started for it where there is none.
fn needs_a_daemon(command: &Command) -> bool {
    matches!(
        command,
        Command::Exec(_)
            | Command::Suggest(_)
            | Command::Import(_)
            | Command::Study(StudyCommand::Create { .. })
    )
}

fn ping(client: &Client, json: bool) -> Result<String> {
    // The first answer includes connecting; the second says how far away the daemon is.
    client.ping()?;
    let round_trip_ms = client.ping()?.as_secs_f64() * 1e3;
    let record =
        serde_json::json!({ "server": client.url(), "serving": true, "round_trip_ms": round_trip_ms });
    either(json, &record, || show::ping(client.url(), round_trip_ms))
}
